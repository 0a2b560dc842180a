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
# # Your own algorithm in the same race
#
# You have an idea for a navigator. The lab gives it the same sensors and the same seeds as its own filters,
# measures it with the same plots, and judges it with the same verdict. This notebook begins with the worst
# navigator there is, improves it in two small steps, and lets all of them race.
#
# You need to know the strapdown step: `02_strapdown.py`, section 1.

# %%
import numpy as np
import pandas as pd
import panel as pn
from scipy.spatial.transform import Rotation

from lab import Estimate, Experiment, check, compare, plots
from lab.navigation import strapdown
from lab.navigation.algorithm import AlgorithmError

pn.extension()
plots.fit_phones()
pd.set_option("display.max_colwidth", None)

experiment = Experiment(mission="los_angeles", seed=1)
experiment.trajectory.imu_rate = 20  # Hz: Python takes a while for each sample

# %% [markdown]
# ## 1. What goes in, what comes out
#
# An algorithm is any object with a method `navigate(imu, fixes, start)`. It gets the increments of the IMU,
# the fixes, and a start with its errors. It never sees the truth. It returns an `Estimate`: position,
# velocity, attitude and nine σ, at each time of the IMU. All inside the lab is in radians, metres and
# seconds, with north, east, down; quaternions have the scalar first.
#
# The simplest one holds the last fix.


# %%
SIGMA = [15, 15, 3, 2, 2, 1, 0.3, 0.3, 1]  # m, m/s, rad: what we believe of our errors


class LastFix:
    """Position and velocity of the last fix, and the attitude of the start."""

    def navigate(self, imu, fixes, start):
        """Return the solution of a flight."""
        last = np.searchsorted(fixes.time, imu.time + 1e-6) - 1
        position = np.where((last < 0)[:, None], start.position, fixes.position[np.maximum(last, 0)])
        velocity = np.where((last < 0)[:, None], start.velocity_n, fixes.velocity_n[np.maximum(last, 0)])
        q_nb = np.tile(start.q_nb, (imu.time.size, 1))
        return Estimate(position, velocity, q_nb, np.tile(SIGMA, (imu.time.size, 1)))


held = experiment.run(algorithm=LastFix())
plots.errors(held)

# %%
check("09.1")

# %% [markdown]
# ## 2. One step better: extrapolate
#
# The receiver knows the velocity too. So the position between two fixes is that of the last one, plus
# velocity times age. A straight flight needs no more; a turn does.


# %%
class Extrapolate(LastFix):
    """The last fix, moved on with its velocity."""

    def navigate(self, imu, fixes, start):
        """Return the solution of a flight."""
        held = super().navigate(imu, fixes, start)
        times = np.concatenate(([imu.time[0]], fixes.time))
        age = imu.time - times[np.searchsorted(fixes.time, imu.time + 1e-6)]
        latitude, _, height = held.position.T
        radius = 6_378_137.0 + height  # m: on a sphere, which is good enough for a second
        moved = held.velocity_n * age[:, None]
        north, east, down = moved[:, 0] / radius, moved[:, 1] / (radius * np.cos(latitude)), -moved[:, 2]
        position = held.position + np.column_stack((north, east, down))
        return held._replace(position=position, sigma=np.tile([2, 2, 2, *SIGMA[3:]], (imu.time.size, 1)))


pd.DataFrame(
    {
        "unit": held.summary["unit"],
        "last fix, rms": held.summary["rms"],
        "extrapolated, rms": experiment.run(algorithm=Extrapolate()).summary["rms"],
    }
).set_index(held.summary["quantity"]).round(2)

# %% [markdown]
# **Try:** use the velocities of the last *two* fixes, and extrapolate with the acceleration as well. Is it
# better? Think of the noise.
#
# ## 3. Two steps better: strapdown with fixed gains
#
# Now the IMU moves the navigator, and each fix pulls it back by a constant part. The attitude needs a
# correction as well. A tilt φ resolves gravity wrongly, so the velocity error grows by g φ each second: north
# from a tilt about east, east from a tilt about −north. Hence a part of the velocity error, over g, is taken
# out of the tilts. This is a *complementary filter*; most drones flew with one before they had the computers
# for a Kalman filter. There are three numbers to choose, and you can choose them by hand.


# %%
class FixedGains:
    """Strapdown, pulled to each fix by constant gains."""

    def __init__(self, position=0.5, velocity=0.3, tilt=0.1):
        self.position, self.velocity, self.tilt = position, velocity, tilt

    def navigate(self, imu, fixes, start):
        """Return the solution of a flight."""
        state = np.zeros(strapdown.LENGTH)
        strapdown.set_position(state, *start.position)
        state[3:6], state[6:10] = start.velocity_n, start.q_nb
        rows, fix = [state[:10].copy()], 0
        for k, dt in enumerate(np.diff(imu.time)):
            strapdown.step(state, tuple(imu.dtheta[k]), tuple(imu.dvelocity[k]), dt)
            if fix < fixes.time.size and fixes.time[fix] <= imu.time[k + 1] + 1e-6:
                self.pull(state, fixes.position[fix], fixes.velocity_n[fix])
                fix += 1
            rows.append(state[:10].copy())
        rows = np.array(rows)
        sigma = np.tile([1, 1, 1, 0.5, 0.5, 0.5, 0.03, 0.03, 0.1], (imu.time.size, 1))
        return Estimate(rows[:, :3], rows[:, 3:6], rows[:, 6:10], sigma)

    def pull(self, state, position, velocity):
        """Take parts of the differences from a fix out of the navigator."""
        strapdown.set_position(state, *(state[:3] + self.position * (position - state[:3])))
        wrong = state[3:6] - velocity
        state[3:6] -= self.velocity * wrong
        phi = self.tilt / 9.81 * np.array([-wrong[1], wrong[0], 0])
        turned = Rotation.from_rotvec(phi) * Rotation.from_quat(state[6:10], scalar_first=True)
        state[6:10] = turned.as_quat(scalar_first=True)


plots.errors(experiment.run(algorithm=FixedGains()))

# %% [markdown]
# The tilts no longer grow without limit: each fix takes out what the biases of the gyros have added, and
# some degrees are left. The position is good between the fixes. The heading is not: nothing corrects it,
# and the bias of the vertical gyro makes it drift.
#
# ## 4. The race
#
# `compare` runs your algorithms on the same seeds as the lab's filter. Everything that is random is the same
# for all.

# %%
rivals = {"last fix": LastFix(), "extrapolate": Extrapolate(), "fixed gains": FixedGains()}


def race(**settings):
    """Return the table of a race with some settings changed."""
    trial = experiment.copy()
    for path, value in settings.items():
        trial.set(path.replace("__", "."), value)
    rows = compare(trial, ["phi"], seeds=3, algorithms=rivals)
    return pd.DataFrame(
        [(row.model, row.position, row.velocity, row.heading) for row in rows],
        columns=["algorithm", "position [m]", "velocity [m/s]", "heading [°]"],
    ).round(2)


race()

# %% [markdown]
# And with an outage of 20 s, where gains do not help and knowledge of the biases does. A straight line is
# better than a navigator that does not know the biases of its gyros:

# %%
race(sensors__gps__outages=[(60.5, 80.5)])

# %% [markdown]
# **Try:** find better gains by hand, then with a loop. How close do you come to the Kalman filter without an
# outage? Its advantage is not the estimate alone: it needs no tuning for another sensor, and it knows how
# good it is.
#
# ## 5. Is your algorithm honest?
#
# A solution without a truthful σ is half a solution. With σ alone, the lab can say how many errors are within
# ±3σ. For NEES it needs the covariance at the fixes, for NIS and whiteness the innovations and theirs. The
# extrapolating navigator can give its innovations easily.


# %%
class Honest(Extrapolate):
    """The same, with its innovations at the fixes and their covariance as it believes it."""

    def navigate(self, imu, fixes, start):
        """Return the solution of a flight."""
        estimate = super().navigate(imu, fixes, start)
        before = np.searchsorted(imu.time, fixes.time - 1e-6) - 1  # the last sample without the fix
        wrong = estimate.position[before] - fixes.position
        radius = 6_378_137.0 + fixes.position[:, 2]
        metres = np.column_stack((radius, radius * np.cos(fixes.position[:, 0]), -np.ones(radius.size)))
        innovation = np.hstack((wrong * metres, estimate.velocity_n[before] - fixes.velocity_n))
        S = np.diag([2.0**2] * 3 + [1.0**2] * 3)
        return estimate._replace(
            innovation=innovation, innovation_covariance=np.tile(S, (fixes.time.size, 1, 1))
        )


honest = experiment.run(algorithm=Honest())
print(honest.innovation_verdict)
honest.coverage.round(2)

# %%
check("09.2")

# %% [markdown]
# **Try:** make S larger and smaller: from where on does the verdict name its size? And why are these
# innovations never white, whatever S is? (Two neighbours share one fix.)
#
# ## 6. When it fails
#
# A mistake in your code is reported under the name of your class, with file and line, and a wrong shape with
# the one that is expected. Nothing else breaks.


# %%
class Brief:
    """Has not read the documentation."""

    def navigate(self, imu, fixes, start):
        """Return one sample instead of all."""
        return Estimate(start.position, start.velocity_n, start.q_nb, SIGMA)


try:
    experiment.run(algorithm=Brief())
except AlgorithmError as error:
    message = str(error)
pd.Series({"the lab says": message}).to_frame("")

# %% [markdown]
# ## 7. Tune it by hand

# %%
position = pn.widgets.FloatSlider(label="Gain, position", start=0, end=1, step=0.05, value=0.5)
velocity = pn.widgets.FloatSlider(label="Gain, velocity", start=0, end=1, step=0.05, value=0.3)
tilt = pn.widgets.FloatSlider(label="Gain, tilt", start=0, end=1, step=0.02, value=0.1)


def tuned(position, velocity, tilt):
    """Return the run with the chosen gains."""
    return experiment.run(algorithm=FixedGains(position, velocity, tilt))


def show(view):
    """Return a view that follows the sliders."""
    knobs = (knob.param.value_throttled for knob in (position, velocity, tilt))
    return pn.bind(lambda *gains: view(tuned(*gains)), *knobs)


pn.Column(
    "# A navigator with fixed gains",
    pn.FlexBox(position, velocity, tilt),
    pn.Tabs(
        ("Errors", show(plots.errors)),
        ("Table", show(lambda result: result.summary)),
        ("Ground track", show(plots.ground_track)),
        dynamic=True,
    ),
).servable(title="A navigator with fixed gains")

# %% [markdown]
# ## Where to go next
#
# - `docs/algorithms.md`: the same on the command line and on the page, `ins-lab compare montreal --algorithm
#   my_filter.py:MyFilter`.
# - `04_filter.py`: the lab's own filter as an algorithm of this kind.
# - `lab/navigation/algorithm.py`: all shapes and units.
