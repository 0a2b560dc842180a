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
# # Many runs
#
# One run is one draw of all random numbers. It may be lucky. Whoever says that a filter is honest, or that
# one is better than another, has to say it of many runs. And whoever gives a number has to say how sure it
# is. This notebook does both, with twenty flights in a second or two.
#
# You need to know what NEES and NIS are: `05_tuning.py`, section 1.

# %%
import holoviews as hv
import numpy as np
import pandas as pd
import panel as pn

from lab import Experiment, check, plots, run_ensemble

hv.extension("bokeh", inline=pn.config.inline)
plots.follow_theme()
pn.extension()
plots.fit_phones()
pd.set_option("display.max_colwidth", None)

experiment = Experiment(mission="los_angeles", seed=1)
experiment.trajectory.imu_rate = 20  # Hz: this flight does not shake


def fly(seeds=20, **settings):
    """Return an ensemble: a number of runs, or a list of seeds, with some settings changed."""
    trial = experiment.copy()
    for path, value in settings.items():
        trial.set(path.replace("__", "."), value)
    return run_ensemble(trial, seeds)


def position_rms(ensemble):
    """Return the rms position error of each run [m]."""
    return np.sqrt((ensemble.rms[:, :3] ** 2).sum(axis=1))


matched = fly()
pd.Series(position_rms(matched), name="rms of the position error [m]").describe().round(3).to_frame()

# %% [markdown]
# ## 1. One run is one draw
#
# The flight is the same, the settings are the same; only the seed differs. The worst run is a fifth worse
# than the best. Two filters whose runs differ by less than that cannot be compared by one run each.
#
# ## 2. NEES and NIS, averaged over the runs
#
# At each fix, NEES of one run may be anything: it is χ² distributed. The *average* of N runs at the same fix
# is much better known. N times the average has χ² with N times the degrees of freedom, so its 95 % interval
# can be computed, and 95 % of the fixes should be inside.


# %%
def over_time(ensemble):
    """Return the averages of NEES and NIS over time, each with its interval."""
    data, drawn = ensemble.consistency, []
    titles = {
        "anees": "NEES of all states",
        "anees_between": "NEES of the position, between fixes",
        "anis": "NIS",
    }
    for name, title in titles.items():
        time = data[data[name].dims[0]]
        edges = hv.Area((time, data[f"{name}_low"], data[f"{name}_high"]), "time [s]", [title, "high"])
        curve = edges.opts(alpha=0.2, line_alpha=0) * hv.Curve((time, data[name]), "time [s]", title)
        drawn.append(
            curve.opts(width=330, height=260, show_grid=True, ylabel="", title=title, fontsize={"title": 10})
        )
    return hv.Layout(drawn).cols(plots.columns(3)).opts(shared_axes=False)


over_time(matched)

# %%
check("10.1")

# %% [markdown]
# `inside` counts the fixes. The first 20 s are left out here: the filter is not linear while the errors of
# the start are large.

# %%
inside = matched.inside(after=20)
print(f"inside: NEES {100 * inside[0]:.0f} %, NIS {100 * inside[1]:.0f} % of the fixes")
matched.coverage.round(2)

# %% [markdown]
# The fixes of a run are not independent: an error of the heading that is large at one fix is large at the
# next. So 91 % instead of 95 % is no proof of a fault, and the curve stays on one side for a while. *Runs*
# are independent. This is why `mean ±` in the table counts each run once, and why the verdict adds up
# evidence with a known number of independent samples.

# %%
pd.Series(
    {
        "Q / 3": str(fly(navigator__q_scale=1 / 3).verdict),
        "matched": str(matched.verdict),
        "Q × 3": str(fly(navigator__q_scale=3).verdict),
    }
).to_frame("verdict on 20 runs")

# %% [markdown]
# **Try:** the verdict on one run: `fly(1, navigator__q_scale=3).verdict`, and with another seed, `fly([7],
# …)`. How many runs does it take to see Q × 1.6?
#
# ## 3. A number with an error bar
#
# The mean of N independent runs has the standard error s/√N, with s the scatter from run to run. A sweep is a
# plain loop. Here the gyro noise changes, and the answer is the rms of the heading error. `run_ensemble` uses
# all cores, and the lab's cache remembers the stages that do not change.

# %%
densities = [0.0125, 0.025, 0.05, 0.1, 0.2]
heading = [fly(sensors__gyro__noise_density=density).rms[:, 8] for density in densities]
mean = np.array([runs.mean() for runs in heading])
bar = np.array([runs.std(ddof=1) / np.sqrt(runs.size) for runs in heading])
(
    hv.ErrorBars((densities, mean, 2 * bar), "gyro noise [°/s/√Hz]", ["heading error, rms [°]", "2σ"])
    * hv.Scatter((densities, mean), "gyro noise [°/s/√Hz]", "heading error, rms [°]").opts(size=8)
).opts(
    width=560,
    height=320,
    logx=True,
    show_grid=True,
    padding=0.1,
    ylim=(0, 2.5),
    title="20 runs, ±2σ of the mean",
)

# %% [markdown]
# Sixteen times the noise makes the heading worse by only a third. Most of its error is left from before the
# first turn, and the gyro has nothing to do with that. Without the error bars you might see a step between
# the first two points; with them, you do not.

# %%
check("10.2")

# %% [markdown]
# **Try:** put an outage into `experiment` and sweep again, with the position error at its end as the answer.
# Now what does a better gyro buy?
#
# ## 4. The same seeds
#
# Is the filter with Q × 3 worse than the matched one? If both fly with the *same* seeds, both get the same
# luck: it cancels in the difference of each pair. With other seeds it does not. The lab scales its random
# numbers and does not draw new ones, so pairs are always to be had.

# %%
base = position_rms(matched)
paired = position_rms(fly(navigator__q_scale=3)) - base
apart = position_rms(fly(range(101, 121), navigator__q_scale=3))
unpaired = np.hypot(apart.std(ddof=1), base.std(ddof=1)) / np.sqrt(20)
pd.DataFrame(
    {
        "worse by [mm]": [1e3 * paired.mean(), 1e3 * (apart.mean() - base.mean())],
        "± 1σ [mm]": [1e3 * paired.std(ddof=1) / np.sqrt(20), 1e3 * unpaired],
    },
    index=["same seeds", "other seeds"],
).round(1)

# %% [markdown]
# With the same seeds the filter is worse by 7 mm, at 2.7σ. With others one would need some thirty times as
# many runs to see it. Whether 7 mm matter is another question: a result can be certain and small.

# %%
check("10.3")

# %% [markdown]
# **Try:** `lab.compare` flies error models with the same seeds: `compare(experiment, ["phi", "invariant"],
# seeds=20)`. Is their difference larger or smaller than the one above?
#
# ## 5. Watch the average settle
#
# With more runs the interval becomes narrower, and a wrong assumption cannot hide in it.

# %%
count = pn.widgets.IntSlider(label="Runs", start=1, end=40, value=5)
q = pn.widgets.DiscreteSlider(
    label="The filter believes Q ×", options=[0.1, 0.3, 0.6, 1, 1.6, 3, 10], value=1.6
)
r = pn.widgets.DiscreteSlider(
    label="The filter believes R ×", options=[0.1, 0.3, 0.6, 1, 1.6, 3, 10], value=1
)


def watched(count, q, r):
    """Return the averages and the verdict of some runs."""
    ensemble = fly(count, navigator__q_scale=q, navigator__r_scale=r)
    inside = ensemble.inside(after=20)
    share = f"Inside: NEES {100 * inside[0]:.0f} %, NIS {100 * inside[1]:.0f} % of the fixes."
    return pn.Column(over_time(ensemble), f"{share} **Verdict:** {ensemble.verdict}")


knobs = (knob.param.value_throttled for knob in (count, q, r))
pn.Column("# Many runs", pn.FlexBox(count, q, r), pn.bind(watched, *knobs)).servable(title="Many runs")

# %% [markdown]
# ## Where to go next
#
# - `ins-lab compare montreal --seeds 20`: the same on the command line.
# - The page *Verdict* has the verdict on many seeds, with its advice.
# - Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking and Navigation*,
#   section 5.4: these tests.
