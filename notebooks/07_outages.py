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
# # Outages: what survives a minute without GPS
#
# In a tunnel the fixes stop and the inertial system goes on alone. How long is it good enough? What limits
# it, and what would you buy to improve it? This notebook answers with the filter's own covariance, which
# knows more than one run can show: which source of error does the harm, and which manoeuvre before the outage
# helps.
#
# `02_strapdown.py` shows how a single error grows. Here all of them come together.

# %%
import numpy as np
import pandas as pd
import panel as pn

from lab import Experiment, check, plots
from lab.analysis.observability import observability_table
from lab.views.budget import BudgetFigures
from lab.views.figures import TimeAxis

pn.extension()
plots.fit_phones()
pd.set_option("display.max_colwidth", None)

experiment = Experiment(mission="montreal", seed=1)
experiment.trajectory.imu_rate = 20  # Hz: this flight does not shake


def outage(begin, seconds, seed=1, **settings):
    """Return the result of a flight with an outage."""
    trial = experiment.copy()
    trial.set("seed", seed)
    trial.sensors.gps.outages = [(begin + 0.5, begin + seconds + 0.5)] if seconds else []
    for path, value in settings.items():
        trial.set(path.replace("__", "."), value)
    return trial.run()


def at(result, time):
    """Return the horizontal position error of a run, and its σ, at a time [m]."""
    error, sigma = (
        group.position.sel(time=time, method="nearest")[:2] for group in (result.errors, result.sigma)
    )
    return float(np.hypot(*error)), float(np.hypot(*sigma))


plots.errors(outage(100, 60))

# %% [markdown]
# ## 1. How the error grows
#
# The outage begins at 100 s, after two turns. The table has the rms of the horizontal error over eight runs
# with different seeds, and the σ that the filter states. They agree as well as eight runs can. From 30 to
# 60 s the error grows some 4.5 times. Three laws are at work. A wrong velocity drifts with t. A tilt
# resolves gravity wrongly and drifts with **½ g φ t²**. The white noise of a gyro lets the tilt walk, and
# the position with it, as **g N √(t⁵/20)**.

# %%
lengths = [5, 10, 20, 30, 60]
runs = {
    seconds: [at(outage(100, seconds, seed), 100 + seconds) for seed in range(1, 9)] for seconds in lengths
}
noise = np.radians(experiment.sensors.gyro.noise_density[0])
pd.DataFrame(
    {
        "error, rms of 8 runs [m]": [np.sqrt(np.mean(np.square(runs[s]), axis=0))[0] for s in lengths],
        "σ of the filter [m]": [np.mean(runs[s], axis=0)[1] for s in lengths],
        "gyro noise since the last fix [m]": [
            np.sqrt(2) * 9.81 * noise * np.sqrt(s**5 / 20) for s in lengths
        ],
    },
    index=pd.Index(lengths, name="outage [s]"),
).round(1)

# %%
check("07.1")

# %% [markdown]
# The last column is the third law, for the two tilts together. It holds for a navigator that was level at the
# last fix. This one was not quite level: the noise had been at work before, too.

# %%
check("07.2")

# %% [markdown]
# ## 2. The error budget: who is to blame
#
# A Kalman filter is linear, and its sources of error are independent. So the variance of the error is a sum,
# and each source has its share. `result.budget` propagates each source alone through the filter's own gains.
# These are the shares of the horizontal variance at the end of the outage.

# %%
long = outage(100, 60)
end = long.budget.sel(time=160, method="nearest")
variance = (end.sigma.sel(quantity=["position east", "position north"]) ** 2).sum("quantity")
share = (100 * variance / variance.sum("source")).to_series().sort_values(ascending=False)
share[share > 0.5].round(1).rename("share of the horizontal variance [%]").to_frame()

# %%
check("07.3")

# %% [markdown]
# The budget says what to buy, and a run with the better part confirms it. A share that is small stays small,
# whatever the part costs.

# %%
better = {
    "as it is": {},
    "gyro noise / 2": {"sensors__gyro__noise_density": 0.025},
    "no accelerometer bias": {"sensors__accelerometer__bias_sigma": 0},
    "GPS noise / 2": {"sensors__gps__position_variance": 0.125, "sensors__gps__velocity_variance": 0.05},
}
pd.Series({name: at(outage(100, 60, **settings), 160)[1] for name, settings in better.items()}).round(
    1
).to_frame("horizontal σ after 60 s [m]")

# %% [markdown]
# **Try:** look at the height: `end.share.sel(quantity="position up")`. Which bias has a much larger share
# than above, and why is the height so much better than the horizontal position?
#
# ## 3. Observability: what brought the knowledge
#
# GPS measures position and velocity, nothing else. All other states are known because they *act* on the
# velocity, and how they act depends on the motion. The lower figure shows σ of the heading, of the flight
# without an outage; grey and white stripes are manoeuvres. The dotted curve is σ without any fix.

# %%
whole = outage(0, 0)
axis = TimeAxis()
axis.range.update(end=205, bounds=(0, 205))
figures = BudgetFigures(axis)
figures.show(whole.budget, whole.observability, "heading")
plots.follow_theme(*figures.figures)
for figure in figures.figures:
    figure.update(sizing_mode="fixed", width=760, height=320)
pn.Column(*figures.figures)

# %%
observability_table(whole.observability)[6:].set_index("quantity").round(3)

# %% [markdown]
# The take-off run shows roll and pitch. The turns show the heading: a heading error δψ turns the sideways
# acceleration a of the turn into a wrong direction, a δψ, and GPS sees the wrong velocity. In straight and
# level flight there is no such acceleration. **What is not moved is not observed.**

# %%
check("07.4")

# %% [markdown]
# ## 4. Which manoeuvre helps
#
# So the same outage of 30 s costs more or less depending on what was flown before. Only the beginning changes
# here:

# %%
begins = {
    10: "during the take-off run",
    30: "after it",
    64: "after the first turn",
    102: "after the second",
    120: "level, later",
}
found = {begin: outage(begin, 30) for begin in begins}
pd.DataFrame(
    {
        "begins": list(begins.values()),
        "σ heading then [°]": [
            float(run.sigma.attitude.sel(angle="heading").sel(time=begin, method="nearest"))
            for begin, run in found.items()
        ],
        "horizontal σ at the end [m]": [at(run, begin + 30)[1] for begin, run in found.items()],
    },
    index=pd.Index(begins, name="at [s]"),
).round(2)

# %% [markdown]
# The first turn takes a third off the error after 30 s. It costs nothing.
#
# **Try:** take the flight `pacific`, with its steep turns from the start. How large is the σ of the heading
# after 30 s?
#
# ## 5. Afterwards: the smoother
#
# Who draws a map needs no answer in real time. A **smoother** uses the fixes after the outage too. It is a
# bridge fixed at both ends, and the error is largest in the middle.

# %%
plots.errors(outage(100, 60, navigator__smoother=True))

# %% [markdown]
# **Try:** compare the largest σ in the outage, filtered and smoothed. Where in the outage does each have it?
#
# ## 6. Other sensors
#
# A barometer costs a dollar and knows the height to a metre, whatever happens to GPS. It helps sideways too.
# From 138 to 152 s the aircraft turns, so the specific force has a horizontal part, and a tilt of the
# navigator makes a vertical acceleration of it. The barometer sees that there was none, and so it sees the
# tilt.

# %%
with_barometer = outage(100, 60, sensors__barometer__fitted=True)
pd.DataFrame(
    {
        name: run.sigma.position.sel(time=160, method="nearest").to_series()
        for name, run in (("σ without [m]", long), ("σ with a barometer [m]", with_barometer))
    }
).round(1)

# %% [markdown]
# **Try:** a heading sensor, `outage(100, 60, sensors__heading__fitted=True)`, and on wheels an odometer
# with `navigator__no_slip` (`docs/filters.md`). Which of the nine errors does a heading sensor improve
# most, and which hardly?
#
# ## 7. Your outage

# %%
begin = pn.widgets.IntSlider(label="No GPS from [s]", start=0, end=140, step=5, value=100)
seconds = pn.widgets.IntSlider(label="for [s]", start=0, end=60, step=5, value=60)
density = pn.widgets.FloatSlider(
    label="Gyro noise [°/s/√Hz]", start=0.0, end=0.1, step=0.005, value=0.05, format="0.000"
)
smoother = pn.widgets.Checkbox(label="Smoother", value=False)


def chosen(begin, seconds, density, smoother):
    """Return the run of the chosen outage."""
    return outage(begin, seconds, sensors__gyro__noise_density=density, navigator__smoother=smoother)


def show(view):
    """Return a plot that follows the widgets."""
    knobs = (
        begin.param.value_throttled,
        seconds.param.value_throttled,
        density.param.value_throttled,
        smoother,
    )
    return pn.bind(lambda *values: view(chosen(*values)), *knobs)


pn.Column(
    "# A minute without GPS",
    pn.FlexBox(begin, seconds, density, smoother),
    pn.Tabs(
        ("Errors", show(plots.errors)),
        ("σ", show(plots.covariance)),
        ("Ground track", show(plots.ground_track)),
        dynamic=True,
    ),
).servable(title="A minute without GPS")

# %% [markdown]
# ## Where to go next
#
# - `ins-lab budget montreal`: the budget on the command line; the page *Budget* has it over time.
# - `docs/filters.md`: all other sensors, and the states they bring.
# - `lab/analysis/budget.py` and `lab/analysis/observability.py`: the equations, with references.
