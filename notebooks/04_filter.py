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
# # The filter, written openly
#
# The lab's filter is compiled, and compiled code is not there to be read. This notebook writes the same
# filter again, in some forty lines of NumPy and [filterpy](https://filterpy.readthedocs.io), and shows that
# both give the same numbers. Then you take it apart: which terms of the error model does a cheap sensor need,
# and which does it not?
#
# You need to know what a Kalman filter is. The tour, `01_tour.py`, shows what this one does.

# %%
import holoviews as hv
import numpy as np
import pandas as pd
import panel as pn
from filterpy.kalman import KalmanFilter
from scipy.spatial.transform import Rotation

from lab import Estimate, Experiment, check, plots
from lab.navigation import strapdown
from lab.navigation.belief import belief
from lab.navigation.filters.error_models import PHI

hv.extension("bokeh")
plots.follow_theme()
pn.extension()
plots.fit_phones()

experiment = Experiment(mission="los_angeles", seed=1)
experiment.trajectory.imu_rate = 20  # Hz: Python takes a while for each sample
experiment.navigator.rest_updates = False  # only GPS corrects
experiment.navigator.hold_heading = False  # each fix corrects all states
compiled = experiment.run()
plots.ground_track(compiled)

# %% [markdown]
# ## 1. What is estimated
#
# The filter does not estimate where the aircraft is. It estimates how *wrong* the navigator is: it is an
# **error-state** filter. At each sample the navigator turns the measurements of the IMU into position,
# velocity and attitude, errors and all. The filter has fifteen states:
#
# | states | meaning | unit |
# |---|---|---|
# | 0 to 2 | position error north, east, down | m |
# | 3 to 5 | velocity error north, east, down | m/s |
# | 6 to 8 | rotation φ of the computed navigation frame about north, east, down | rad |
# | 9 to 11 | error of the gyro bias x, y, z | rad/s |
# | 12 to 14 | error of the accelerometer bias x, y, z | m/s² |
#
# Errors are small, so they follow a linear equation, ẋ = F x + w, although navigation is not linear. The
# filter knows four things, which it *believes*: how wrong the start may be (P0), how noisy the sensors are
# (the densities of w, which make Q), how fast the biases forget their value, and how noisy a fix is (R). Here
# the lab gives it the true values of the simulated sensors.

# %%
believed = belief(experiment.sensors, experiment.navigator)
pd.Series(
    {
        "σ of the position at the start [m]": np.sqrt(believed.P0[0, 0]),
        "σ of the heading at the start [°]": np.degrees(np.sqrt(believed.P0[8, 8])),
        "σ of a gyro bias at the start [°/s]": np.degrees(np.sqrt(believed.P0[9, 9])),
        "gyro noise, density [°/s/√Hz]": np.degrees(np.sqrt(believed.noise[0])),
        "σ of a position fix, north [m]": np.sqrt(believed.fix_covariance(np.array([0])).reshape(6, 6)[0, 0]),
    }
).round(3)

# %% [markdown]
# ## 2. Forty lines
#
# `predict` at each sample, `update` at each fix. After an update the estimated error is taken out of the
# navigator, and the estimate is zero again: **feedback**. The strapdown step and F are those of the lab,
# because they are physics, not filtering: `strapdown.step` and `PHI.write`. What is left is what every
# textbook writes.
#
# An object with a method `navigate` is an *algorithm of one's own*. The lab gives it the measurements of a
# run, and treats its solution like that of any built-in filter.


# %%
class OpenFilter:
    """The filter of the lab with 15 states, feedback at each fix, and F under a mask."""

    def __init__(self, mask=1.0):
        self.mask = mask

    def navigate(self, imu, fixes, start):
        """Return the solution of a flight."""
        state = np.zeros(strapdown.LENGTH)
        strapdown.set_position(state, *start.position)
        state[VELOCITY], state[ATTITUDE] = start.velocity_n, start.q_nb
        kalman = KalmanFilter(dim_x=15, dim_z=6)
        kalman.x, kalman.P, self.F = np.zeros(15), believed.P0.copy(), np.zeros((15, 15))
        R, H = believed.fix_covariance(np.array([0])).reshape(6, 6), np.eye(6, 15)
        rows, fix = [(state.copy(), np.diag(kalman.P))], 0
        for k, dt in enumerate(np.diff(imu.time)):
            strapdown.step(state, tuple(imu.dtheta[k]), tuple(imu.dvelocity[k]), dt)
            PHI.write(state, self.F)
            self.F[9:, 9:] = -np.diag(believed.decay)
            kalman.predict(F=np.eye(15) + self.mask * self.F * dt, Q=self.noise(state) * dt)
            state[BIASES] *= 1 - believed.decay * dt
            if fix < fixes.time.size and fixes.time[fix] <= imu.time[k + 1] + 1e-6:
                kalman.update(self.away(state, fixes.position[fix], fixes.velocity_n[fix]), R=R, H=H)
                kalman.P = (kalman.P + kalman.P.T) / 2
                self.correct(state, kalman.x)
                kalman.x, fix = np.zeros(15), fix + 1
            rows.append((state.copy(), np.diag(kalman.P)))
        states, variances = (np.array(column) for column in zip(*rows, strict=True))
        return Estimate(states[:, :3], states[:, VELOCITY], states[:, ATTITUDE], np.sqrt(variances[:, :9]))

    def noise(self, state):
        """White noise of gyros turns, that of accelerometers accelerates, along the axes of the body."""
        C_nb, Q = state[strapdown.C_NB :][:9].reshape(3, 3), np.zeros((15, 15))
        Q[6:9, 6:9] = C_nb @ np.diag(believed.noise[0:3]) @ C_nb.T
        Q[3:6, 3:6] = C_nb @ np.diag(believed.noise[3:6]) @ C_nb.T
        Q[9:, 9:] = np.diag(believed.noise[6:])
        return Q

    def away(self, state, position, velocity_n):
        """Navigator minus fix: metres and metres per second north, east, down."""
        d = state[:3] - position
        north, east = d[0] / state[MERIDIAN], d[1] * state[COSINE] / state[TRANSVERSE]
        return np.array([north, east, -d[2], *(state[VELOCITY] - velocity_n)])

    def correct(self, state, x):
        """Take the estimated error out of the navigator."""
        latitude, longitude, height = state[:3]
        north, east = x[0] * state[MERIDIAN], x[1] * state[TRANSVERSE] / state[COSINE]
        strapdown.set_position(state, latitude - north, longitude - east, height + x[2])
        state[VELOCITY] -= x[3:6]
        turned = Rotation.from_rotvec(x[6:9]) * Rotation.from_quat(state[ATTITUDE], scalar_first=True)
        state[ATTITUDE] = turned.as_quat(scalar_first=True)
        strapdown.note_correction(state, tuple(x[6:9]))  # by which the next F turns P, too
        state[BIASES] -= x[9:]


VELOCITY = slice(strapdown.VELOCITY, strapdown.VELOCITY + 3)
ATTITUDE = slice(strapdown.Q_NB, strapdown.Q_NB + 4)
BIASES = slice(strapdown.GYRO_BIAS, strapdown.GYRO_BIAS + 6)
MERIDIAN, TRANSVERSE, COSINE = strapdown.MERIDIAN, strapdown.TRANSVERSE, strapdown.COSINE

whole = OpenFilter()
mine = experiment.run(algorithm=whole)
mine.summary

# %% [markdown]
# ## 3. The same numbers
#
# The largest difference between both solutions over the whole flight, beside the largest σ. What is left is
# the rounding of the computer, added up in another order.


# %%
def differences(one, other):
    """Return the largest differences of two results, and the largest σ of the first."""
    columns = {"position [m]": (0, 1), "velocity [m/s]": (3, 1), "rotation φ [°]": (6, np.degrees(1))}
    sigmas = [np.sqrt(run.solution_arrays.variance) for run in (one, other)]
    return pd.DataFrame(
        {
            column: {
                "difference": float(np.abs(one.errors[group] - other.errors[group]).max()),
                "σ": unit * sigmas[0][:, at : at + 3].max(),
                "difference of σ": unit * np.abs(sigmas[0] - sigmas[1])[:, at : at + 3].max(),
            }
            for (column, (at, unit)), group in zip(
                columns.items(), ("position", "velocity", "attitude"), strict=True
            )
        }
    )


differences(compiled, mine)

# %% [markdown]
# **Try:** leave out the line with `(kalman.P + kalman.P.T) / 2`. How large do the differences become? Then
# leave out `kalman.x, fix = np.zeros(15), fix + 1` but for the counter. Why does the navigator go wrong?
#
# ## 4. What F looks like
#
# These are the rows of position, velocity and attitude at the end of the flight. Red is positive, blue
# negative; the scale is logarithmic, so that it shows the small terms too. Four blocks stand out. **A wrong
# velocity moves** (r from v). **A tilt turns the specific force into a wrong direction** (v from φ), and so
# does **a wrong accelerometer** (v from its bias). **A wrong gyro tilts** (φ from its bias). All the rest is
# Earth: radii, rates and gravity.

# %%
NAMES = [f"{name} {axis}" for name in ("r", "v", "φ") for axis in "NED"]
NAMES += [f"{name} {axis}" for name in ("gyro", "accel.") for axis in "xyz"]


def picture(F):
    """Return the first nine rows of F as a picture, in decades above 10⁻⁸."""
    decades = np.sign(F[:9]) * np.maximum(np.log10(np.maximum(np.abs(F[:9]), 1e-30) / 1e-8), 0)
    cells = [(NAMES[j], NAMES[i], decades[i, j]) for i in range(9) for j in range(15)]
    return hv.HeatMap(cells, ["column", "row"], "decades above 1e-8").opts(
        cmap="RdBu_r",
        clim=(-9, 9),
        colorbar=True,
        width=760,
        height=420,
        invert_yaxis=True,
        tools=["hover"],
        xlabel="",
        ylabel="",
        xrotation=45,
    )


picture(whole.F)

# %%
check("04.1")

# %% [markdown]
# ## 5. Take it apart
#
# A mask over F leaves terms out, in the filter only: the navigator still knows the Earth. First only the four
# blocks are kept. Then each of them is missing in turn.

# %%
BLOCKS = {
    "position from velocity": (slice(0, 3), slice(3, 6)),
    "velocity from tilt": (slice(3, 6), slice(6, 9)),
    "velocity from accelerometer": (slice(3, 6), slice(12, 15)),
    "tilt from gyro": (slice(6, 9), slice(9, 12)),
}
four = np.zeros((15, 15))
four[9:, 9:] = 1
for block in BLOCKS.values():
    four[block] = 1
masks = {"all of F": np.ones((15, 15)), "four blocks": four}
for name, block in BLOCKS.items():
    masks[f"without {name}"] = np.ones((15, 15))
    masks[f"without {name}"][block] = 0

runs = {name: experiment.run(algorithm=OpenFilter(mask)) for name, mask in masks.items()}


def honest(run, quantity):
    """Return the rms of error over σ: 1 for an honest filter."""
    return float(np.sqrt(((run.errors[quantity] / run.sigma[quantity]) ** 2).mean()))


pd.DataFrame(
    {
        name: {
            "position error, rms [m]": float(np.sqrt((run.errors.position**2).sum("axis").mean())),
            "attitude error, rms [°]": float(np.sqrt((run.errors.attitude**2).sum("angle").mean())),
            "position error / σ": honest(run, "position"),
            "attitude error / σ": honest(run, "attitude"),
        }
        for name, run in runs.items()
    }
).T.round(2)

# %% [markdown]
# Four blocks are enough for this sensor: a gyro bias of 0.1 °/s turns some seven hundred times faster than
# the rotation of the Earth turns an attitude error of 2°. Without *velocity from tilt*, the filter cannot
# see an attitude error at all: nothing corrects it. Its σ of the attitude grows too, but that of the
# position does not say what this does to the position.

# %%
check("04.2")

# %% [markdown]
# **Try:** fly with a better sensor: import `card` from `lab`, and before the first run write
# `card("STIM300").load(experiment)` and `experiment.update({"navigator": {"states": 15, "alignment": 0,
# "estimate_misalignments": False, "estimate_g_sensitivity": False}})` (the card aligns the navigator before
# the flight and brings more states, which these forty lines do not have). Do four blocks still do? For how
# long must there be no fixes until they do not?
#
# ## 6. Look at both
#
# The attitude is where the filters differ. Choose one.

# %%
choice = pn.widgets.Select(label="F", options=list(runs))
pn.Column(
    "# The filter, written openly",
    choice,
    pn.bind(lambda name: plots.errors(runs[name]), choice),
).servable(title="The filter, written openly")

# %% [markdown]
# **Try:** filterpy updates P in the *Joseph form*, (I − K H) P (I − K H)ᵀ + K R Kᵀ. Write the short form, P =
# (I − K H) P, after the update, with `kalman.K` and the P from before. Does anything change here? When would
# it?
#
# ## Where to go next
#
# - `lab/navigation/reference.py`: this filter with all that the lab knows, in filterpy: lever arm, latency,
#   rest, gate. The compiled filter is tested against it.
# - `docs/algorithms.md`: an algorithm of your own beside the built-in ones, on the command line and the page.
# - `lab/navigation/filters/error_models.py`: every element of F, with its equation in the literature.
