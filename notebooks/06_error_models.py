# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3 (ipykernel)
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Error models side by side
#
# A Kalman filter for inertial navigation does not estimate the attitude but its *error*. There are several
# ways to write down what an error is, and each gives another filter: phi, psi, the invariant error, or no
# linear model at all. This notebook lets them fly the same flights. Where errors are small, all agree. With a
# heading 60° off, they do not.
#
# `04_filter.py` shows the model phi, written openly.

# %%
import holoviews as hv
import numpy as np
import pandas as pd
import panel as pn

from lab import Experiment, check, compare, plots

hv.extension("bokeh", inline=pn.config.inline)
plots.follow_theme()
pn.extension()
plots.fit_phones()
pd.set_option("display.max_colwidth", None)

MODELS = ("phi", "psi", "invariant", "nonlinear")
experiment = Experiment(mission="pacific", seed=1)
experiment.trajectory.imu_rate = 20  # Hz: this flight does not shake

# %% [markdown]
# ## 1. What is the error?
#
# - `phi`: the attitude error is the rotation of the computed frame against the *true* north, east, down at
#   the vehicle, and the velocity error is v̂ − v.
# - `psi`: the same against north, east, down at the *computed* position.
# - `invariant`: one error of attitude, velocity and position together, on the group SE₂(3), resolved in the
#   body.
# - `nonlinear`: none. An unscented filter sends 30 navigators through the exact equations, and takes their
#   mean and covariance.
#
# The first three have a matrix F, with ẋ = F x + w. All four report the same errors: the lab maps each
# filter's own to position, velocity and attitude. (The first run of a model compiles it, which takes some 20
# s once.)
#
# ## 2. Small errors: no difference
#
# `compare` runs all models on the same seeds. The initial attitude is right to 0.5° and the heading to 2°.

# %%
rows = compare(experiment, MODELS, seeds=5)
pd.DataFrame(
    [(row.model, row.position, row.heading, row.nees, row.nis, row.verdict) for row in rows],
    columns=["model", "position [m]", "heading [°]", "NEES, expected 15", "NIS, expected 6", "verdict"],
).round(3)

# %%
check("06.1")

# %% [markdown]
# phi and psi are the same error in other coordinates: ψ = φ − δθ, where δθ is the angle between the computed
# and the true position, seen from the centre of the Earth. For a position error of 6 m this is one millionth
# of a radian.
#
# **Try:** print `rows[0].position - rows[1].position`. Which errors would have to be large for phi and psi to
# differ?
#
# ## 3. A heading 60° off
#
# Now the aircraft starts its filter in the air, with a guess of the heading that is 60° wrong. The filter
# knows: its initial σ of the heading is 60°. (It is 59.9° here, for the unscented filter accepts no more than
# 60°.)


# %%
def lost(model, seed=1, off=59.9, **settings):
    """Return the run of a model that starts with a wrong heading."""
    trial = experiment.copy()
    trial.set("seed", seed)
    trial.navigator.model = model
    trial.navigator.attitude_error = (0, 0, off)
    trial.navigator.attitude_sigma = (0.5, 0.5, 0.5)
    for path, value in settings.items():
        trial.set(path.replace("__", "."), value)
    return trial.run()


def heading_error(run, seconds=30):
    """Return the heading error of a run over time, with the band of its filter."""
    early = run.time < seconds
    error = run.errors.attitude.sel(angle="heading").values[early]
    sigma = run.sigma.attitude.sel(angle="heading").values[early]
    band = hv.Area((run.time[early], -3 * sigma, 3 * sigma), "time [s]", ["heading error [°]", "high"])
    curve = hv.Curve((run.time[early], error), "time [s]", "heading error [°]")
    return (band.opts(alpha=0.15, line_alpha=0) * curve).opts(
        width=400, height=260, show_grid=True, ylim=(-100, 20), title=run.experiment.navigator.model
    )


hv.Layout([heading_error(lost(model)) for model in MODELS]).cols(2)

# %% [markdown]
# All four find the heading only in the first turn, from 10 to 18 s. The difference is in what they *say*.
# NEES over six flights, and how often the heading error is beyond 3σ (expected 0.3 %):

# %%
table = {}
for model in MODELS:
    runs = [lost(model, seed) for seed in range(1, 7)]
    table[model] = {
        "NEES, expected 15": np.mean([float(run.consistency.nees.mean()) for run in runs]),
        "heading beyond 3σ [%]": 100
        * np.mean(
            [np.abs(run.errors.attitude / run.sigma.attitude).sel(angle="heading") > 3 for run in runs]
        ),
        "position error, rms [m]": np.mean(
            [float(np.sqrt((run.errors.position**2).sum("axis").mean())) for run in runs]
        ),
    }
pd.DataFrame(table).T.round(2)

# %% [markdown]
# Why? The important element of F is the one that makes a velocity error of a tilt: **f ×**, with the specific
# force f in north, east, down. phi computes it from its own attitude. If this is 60° wrong, then so is f, and
# with it F: the filter learns the right thing about the wrong direction, believes it, and P shrinks too far.
# The invariant error is chosen such that F does **not depend on the estimated attitude and velocity**. It is
# resolved in the body, where the specific force and the rate are simply what the sensors measure; of the
# estimate, only the tiny gradient of gravity is left. So its P is as good with a wrong heading as with a
# right one.

# %%
check("06.2")

# %% [markdown]
# **Try:** `off=20` and `off=90` (without the nonlinear model). From where on is phi not honest any more? And
# what does `navigator__alignment=30` change, on the flight `montreal`?
#
# ## 4. Feedback and feedforward
#
# A linear model holds close to the point where it was made. With **feedback** the estimated error is taken
# out of the navigator at each fix, so the navigator stays close to the truth. With **feedforward** the
# navigator runs free, and only its output is corrected: an old and safe form, for a certified navigator must
# not be touched. But its errors grow without limit, and soon no linear model holds.

# %%
straight = Experiment(mission="los_angeles", seed=1)
straight.trajectory.imu_rate = 20


def corrected(correction, bias):
    """Return the run with a kind of correction and a turn-on bias of the gyros."""
    trial = straight.copy()
    trial.navigator.correction = correction
    trial.sensors.gyro.bias_sigma = bias
    return trial.run()


def position_rms(run):
    """Return the rms of the position error [m]."""
    return float(np.sqrt((run.errors.position**2).sum("axis").mean()))


pd.DataFrame(
    {
        correction: {bias: position_rms(corrected(correction, bias)) for bias in (0.02, 0.1, 0.3)}
        for correction in ("feedback", "feedforward")
    }
).rename_axis("gyro bias, σ [°/s]; position error, rms [m]").round(2)

# %% [markdown]
# The result says so itself:

# %%
pd.Series(corrected("feedforward", 0.1).remarks).to_frame("remarks")

# %%
check("06.3")

# %% [markdown]
# **Try:** load a navigation-grade sensor, `card("HG9900").load(straight)`, and compare again. Why was
# feedforward good enough for the large gimballed systems of the seventies?
#
# ## 5. All of it

# %%
model = pn.widgets.Select(label="Error model", options=list(MODELS))
off = pn.widgets.FloatSlider(label="Heading off by [°]", start=0, end=59.5, step=0.5, value=45)
bias = pn.widgets.FloatSlider(label="Gyro bias, σ [°/s]", start=0, end=0.5, step=0.01, value=0.1)
position = pn.widgets.FloatSlider(
    label="Position variance of a fix [m²]", start=0.1, end=20, step=0.1, value=0.5
)


def chosen(model, off, bias, position):
    """Return the run of the chosen filter."""
    return lost(model, off=off, sensors__gyro__bias_sigma=bias, sensors__gps__position_variance=position)


def show(view):
    """Return a view that follows the widgets."""
    knobs = (knob.param.value_throttled for knob in (off, bias, position))
    return pn.bind(lambda *values: view(chosen(*values)), model, *knobs)


pn.Column(
    "# Error models",
    pn.FlexBox(model, off, bias, position),
    show(lambda run: f"**Verdict:** {run.verdict}"),
    pn.Tabs(("Errors", show(plots.errors)), ("σ", show(plots.covariance)), dynamic=True),
).servable(title="Error models")

# %% [markdown]
# **Try:** the same seed, the same heading, one model after the other. In which of the nine plots does a model
# leave its band first?
#
# ## Where to go next
#
# - `lab/navigation/filters/error_models.py`: every element of each F, with its reference.
# - `docs/filters.md`: all filters and their options.
# - A. Barrau, S. Bonnabel, *The invariant extended Kalman filter as a stable observer*, IEEE Trans. AC 62
#   (2017).
