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
# # Tuning: Q, R, P₀, and what the innovations say
#
# A Kalman filter needs to know three things: how noisy the fixes are (R), how noisy the inertial sensors
# are (Q), and how wrong the start may be (P₀). Nobody knows them exactly. This notebook makes each of them
# wrong on purpose and looks at what changes. Some lies show at once, some only if the truth is known, and
# one changes nothing but what the filter says of itself.
#
# You need to know what an innovation is: `01_tour.py`, section 6.

# %%
import numpy as np
import pandas as pd
import panel as pn

from lab import Experiment, check, plots

pn.extension()
plots.fit_phones()
pd.set_option("display.max_colwidth", None)

experiment = Experiment(mission="los_angeles", seed=1)
experiment.trajectory.imu_rate = 20  # Hz: this flight does not shake
experiment.navigator.rest_updates = False  # only GPS corrects
experiment.navigator.hold_heading = False  # each fix corrects all states


def run(**scales):
    """Return the result with factors on R, Q and P₀ as the filter assumes them."""
    trial = experiment.copy()
    for name, factor in scales.items():
        trial.set(f"navigator.{name}", factor)
    return trial.run()


matched = run()
plots.innovations(matched)

# %% [markdown]
# ## 1. Four numbers
#
# Here the lab gives the filter the true statistics: it is *matched*. Four numbers say so.
#
# - **NIS** compares the innovation of a fix with its covariance S: νᵀ S⁻¹ ν. On average it is the number of
#   measurements of a fix.
# - **Lag 1** is the correlation of an innovation with the next one. It is zero for an optimal filter: what
#   could be predicted from the last innovation, the filter should have used.
# - **NEES** compares the error of all states with P. On average it is the number of states. It needs the
#   truth.
# - The **rms** of the position error is what the pilot cares about. It needs the truth too.


# %%
def numbers(result):
    """Return NIS, correlation at lag 1, NEES and rms of the position error."""
    lag = result.autocorrelation.sel(lag=1)
    return {
        "NIS": float(result.innovations.nis.mean()),
        "lag 1, horizontal velocity": float(lag.velocity.sel(axis=["east", "north"]).mean()),
        "NEES": float(result.consistency.nees.mean()),
        "position, rms [m]": float(np.sqrt((result.errors.position**2).sum("axis").mean())),
    }


def scan(name, factors=(0.01, 0.1, 1, 10, 100)):
    """Return a table of these numbers for factors on R, Q or P₀."""
    table = {f"{name} {factor:g}": numbers(run(**{name: factor})) for factor in factors}
    return pd.DataFrame(table).T.round(2)


pd.Series(numbers(matched)).round(2)

# %%
check("05.1")

# %% [markdown]
# ## 2. R: how much to trust a fix
#
# R too small: the filter runs after each fix, and takes noise for motion. The innovations are as large as
# before, but the filter expects small ones, so NIS grows. R too large: the filter hardly listens. Its
# innovations are small compared with what it expects, and they stay on one side for a long time: an error
# that the filter does not correct is still there at the next fix.

# %%
scan("r_scale")

# %%
check("05.2")

# %% [markdown]
# **Try:** which is worse for the position, R ten times too small or ten times too large? And for the heading:
# `plots.errors(run(r_scale=0.01))`?
#
# ## 3. Q: how much to trust the inertial sensors
#
# Look at the column NIS first. Q wrong by a factor of 10 in either direction hardly changes it: from one
# fix to the next the noise of the gyros has little time to act, and R dominates S. What changes is NEES:
# with Q too small, P shrinks below the errors and stays there. With Q ten times too large, **nothing shows
# without the truth**. The filter loses accuracy, and its innovations look as they should. Only a factor of
# 100 makes them alternate a little.

# %%
scan("q_scale")

# %% [markdown]
# **Try:** add an outage, `experiment.sensors.gps.outages = [(60, 80)]`, and compare the first fix after it:
# `run(q_scale=0.01).innovations.nis.sel(time_gps=81)` and the same with `q_scale=1`. Why does NIS now see Q?
# (Do not forget to remove the outage.)

# %%
check("05.3")

# %% [markdown]
# ## 4. P₀: how wrong the start may be
#
# P₀ acts once. If it is too small, the filter is certain of a wrong attitude and wrong biases, and needs a
# long time to give them up. If it is too large, the first fixes put it right. So **be generous with P₀**:
# here a factor of 100 on its variances costs 5 cm, and a factor of 1/100 costs more than a metre.

# %%
scan("p0_scale")

# %% [markdown]
# ## 5. Only ratios count for the estimate
#
# Now multiply all three by 4. The gain K = P Hᵀ (H P Hᵀ + R)⁻¹ does not notice: every term has the same
# factor. The estimates are the same to the last bit. Only what the filter *says* of them changes.

# %%
loud = run(r_scale=4, q_scale=4, p0_scale=4)
pd.DataFrame({"matched": numbers(matched), "all × 4": numbers(loud)}).round(2)

# %%
same = np.array_equal(matched.solution_arrays.position, loud.solution_arrays.position)
print(f"the same positions, bit by bit: {same}")
check("05.4")

# %% [markdown]
# This is why two kinds of tests are needed. *Whiteness* tests the ratios: is the gain right? *Size* tests the
# level: does σ tell the truth?
#
# ## 6. The verdict taken apart
#
# The lab's verdict answers these questions for you, each from a sample of its own. With the truth, the errors
# of the fixes show R, the growth of the errors between the fixes shows Q, and the error at the start shows
# P₀. So two lies at the same time do not hide one another. Here R is ten times too large and Q ten times too
# small, the combination that innovations confuse most.

# %%
lies = run(r_scale=10, q_scale=0.1)
pd.DataFrame(
    [
        (finding.quantity, finding.direction, round(finding.factor, 1), finding.evidence)
        for finding in lies.verdict.findings
    ],
    columns=["assumption", "is", "by a factor", "because"],
)

# %% [markdown]
# Each factor has an error bar: this is one flight of 105 s. In a real flight there is no truth, and the
# verdict rests on the innovations alone:

# %%
pd.Series(
    {
        name: str(run(**scales).innovation_verdict)
        for name, scales in {
            "matched": {},
            "R / 10": {"r_scale": 0.1},
            "Q / 10": {"q_scale": 0.1},
            "Q × 10": {"q_scale": 10},
            "P₀ / 10": {"p0_scale": 0.1},
            "P₀ × 10": {"p0_scale": 10},
        }.items()
    }
).to_frame("what the innovations say")

# %% [markdown]
# It finds what makes innovations too large or predictable, and it is silent about Q and P₀ that are ten
# times too large. That is not a weakness of the verdict: the information is not there.
#
# ## 7. Turn all three
#
# The sentence above the plots is the verdict.

# %%
FACTORS = [0.01, 0.03, 0.1, 0.3, 1, 3, 10, 30, 100]
r, q, p0 = (
    pn.widgets.DiscreteSlider(label=f"The filter believes {name} ×", options=FACTORS, value=1)
    for name in ("R", "Q", "P₀")
)


def bound(view):
    """Return a view that follows the three sliders."""
    knobs = (knob.param.value_throttled for knob in (r, q, p0))
    return pn.bind(lambda r, q, p0: view(run(r_scale=r, q_scale=q, p0_scale=p0)), *knobs)


pn.Column(
    "# Tuning",
    pn.FlexBox(r, q, p0),
    bound(lambda result: f"**Verdict:** {result.verdict}"),
    bound(lambda result: f"**From the innovations alone:** {result.innovation_verdict}"),
    pn.Tabs(
        ("Errors", bound(plots.errors)),
        ("Innovations", bound(plots.innovations)),
        ("σ", bound(plots.covariance)),
        dynamic=True,
    ),
).servable(title="Tuning")

# %% [markdown]
# **Try:** with Q × 0.01, look at the errors of the roll and at their band. Then find the R that makes the
# innovations white again. Is the filter now good?
#
# ## Where to go next
#
# - `docs/verdict.md`: what the verdict knows, and how its advice is tried before it is given.
# - `10_many_runs.py`: one flight is one draw; the same questions over many seeds.
# - `result.identify()`: Q and R of a real sensor log, from its innovations (`docs/logs.md`).
