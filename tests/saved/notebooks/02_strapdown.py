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
# # Strapdown by experiment
#
# An inertial navigator adds up what its sensors measure, and nothing else. This notebook takes the GPS and
# the Kalman filter away and looks at the sum itself. How fast does it drift? Why do some errors come back
# after 84 minutes? And why does an IMU send 200 samples a second, when the aeroplane turns so slowly?
#
# The tour, `01_tour.py`, shows the whole laboratory. You need no more than that.

# %%
import holoviews as hv
import numpy as np
import pandas as pd
import panel as pn
from scipy.spatial.transform import Rotation

from lab import Experiment, Trajectory, check, earth, mission, plots
from lab.frames.displacement import displacement
from lab.navigation import strapdown
from lab.navigation.solution import Start

hv.extension("bokeh", inline=pn.config.inline)
plots.follow_theme()
pn.extension()
plots.fit_phones()

G = earth.STANDARD_GRAVITY  # m/s², the unit g of data sheets
HOURLY = np.radians(1) / 3600  # rad/s, 1 °/h

# %% [markdown]
# ## 1. One step, again and again
#
# A gyro measures how far the body turned during a sample, an accelerometer how much velocity it gained,
# gravity excepted. One **strapdown step** turns the attitude by the first, resolves the second in north,
# east, down, adds gravity, and moves the position. The lab's step is `strapdown.step`; the navigator is a
# loop around it. With perfect sensors and a perfect start, it follows a flight of 205 s to some micrometres.


# %%
def navigate(dtheta, dvelocity, dt, start, remember=True):
    """Return position, velocity and attitude (n + 1, 10) by strapdown steps alone."""
    state = np.zeros(strapdown.LENGTH)
    strapdown.set_position(state, *start.position)
    state[3:6], state[6:10] = start.velocity_n, start.q_nb
    rows = [state[:10].copy()]
    for turn, gain in zip(dtheta.tolist(), dvelocity.tolist(), strict=True):
        if not remember:  # the sample before this one: section 6
            state[strapdown.PREVIOUS_DTHETA : strapdown.PREVIOUS_DVELOCITY + 3] = 0
        strapdown.step(state, tuple(turn), tuple(gain), dt)
        rows.append(state[:10].copy())
    return np.array(rows)


flight = Trajectory.from_recording(mission("montreal").recording, imu_rate=200)
PERFECT = np.zeros(3)


def miss(rate, remember=True):
    """Return how far from the truth a perfect IMU of some rate ends [m]."""
    ideal = flight.increments(rate)
    truth = flight.at(ideal.time)
    start = Start.off(truth, PERFECT, PERFECT, PERFECT)
    end = navigate(ideal.dtheta, ideal.dvelocity, ideal.dt, start, remember)[-1:, :3]
    return float(np.linalg.norm(displacement(truth.position[-1:], end)))


print(f"error after {flight.duration:.0f} s: {1e6 * miss(200):.0f} µm")

# %% [markdown]
# **Try:** start 0.1 m/s too fast to the north: put `np.array([0.1, 0, 0])` in place of the second `PERFECT`.
# How large is the error after 205 s, and why does it not surprise you?
#
# ## 2. The first minutes of drift
#
# Put the navigator on a table at 45° north, and let one sensor err. A wrong accelerometer, by b, gives a
# wrong velocity b t and a wrong position **½ b t²**. A wrong gyro, by ε, tilts the navigator by ε t. Then a
# part g ε t of gravity looks like an acceleration, and the position is wrong by **g ε t³/6**.


# %%
def at_rest(seconds, accelerometer=0.0, gyro=0.0, tilt=0.0):
    """Return the error north [m], every second, of a navigator at rest on the ground.

    `accelerometer` [mg] points north, `gyro` [°/h] west, and `tilt` [°] raises the nose. The height is known.
    """
    latitude, state = np.radians(45), np.zeros(strapdown.LENGTH)
    strapdown.set_position(state, latitude, 0.0, 0.0)
    state[6:10] = Rotation.from_euler("y", tilt, degrees=True).as_quat(scalar_first=True)
    turn = (earth.RATE * np.cos(latitude), -gyro * HOURLY, -earth.RATE * np.sin(latitude))
    gain = (accelerometer * 1e-3 * G, 0.0, -earth.gravity(np.sin(latitude), 0.0))
    north = np.zeros(seconds + 1)
    for second in range(seconds):
        strapdown.step(state, turn, gain, 1.0)
        state[strapdown.HEIGHT], state[strapdown.VELOCITY + 2] = 0, 0
        north[second + 1] = (state[0] - latitude) * earth.radii(np.sin(latitude))[0]
    return north


t = np.array([10, 60, 300])
pd.DataFrame(
    {
        "1 mg": at_rest(300, accelerometer=1)[t],
        "½ b t²": 0.5e-3 * G * t**2,
        "10 °/h": at_rest(300, gyro=10)[t],
        "g ε t³/6": G * 10 * HOURLY * t**3 / 6,
    },
    index=pd.Index(t, name="after [s]"),
).round(2)

# %% [markdown]
# The formulas hold for some minutes: after 300 s they are already 1 % off. Section 3 shows why.
#
# `check` shows a question. Write your answer behind its number, such as `check("02.1", 5)`, and run the cell
# again.

# %%
check("02.1")

# %% [markdown]
# **Try:** which gyro bias gives the same error after 60 s as an accelerometer bias of 1 mg? And after 10 s?
#
# ## 3. Schuler's 84 minutes
#
# Now wait for some hours. The Earth is round. If the navigator believes that it moved 10 km to the north, it
# also believes that the vertical there is another one, 0.09° away. It tilts its frame, and gravity pulls the
# solution back, as it pulls a pendulum. The pendulum is as long as the radius of the Earth: T = 2π √(R/g).
# Max Schuler saw this in 1923.

# %%
accelerometer = pn.widgets.FloatSlider(label="Accelerometer [mg]", start=0, end=2, step=0.1, value=1)
gyro = pn.widgets.FloatSlider(label="Gyro [°/h]", start=0, end=0.5, step=0.01, value=0)
tilt = pn.widgets.FloatSlider(label="Initial tilt [°]", start=0, end=0.1, step=0.01, value=0)


def hours(accelerometer, gyro, tilt):
    """Return the error north over three hours as a plot."""
    north = at_rest(3 * 3600, accelerometer, gyro, tilt)[::30] / 1e3
    curve = hv.Curve((np.arange(north.size) / 2, north), "time [min]", "error north [km]")
    return curve.opts(width=660, height=300, show_grid=True, tools=["hover"])


pn.Column(
    pn.FlexBox(accelerometer, gyro, tilt),
    pn.bind(hours, *(knob.param.value_throttled for knob in (accelerometer, gyro, tilt))),
)

# %% [markdown]
# An accelerometer error only swings: at most 2 b R/g, 13 km for 1 mg. A gyro error swings too, and on top of
# this it walks away with ε R, 111 km in an hour for 1 °/h. This is why a navigation-grade gyro has a bias
# below 0.01 °/h: it loses about a kilometre in an hour.

# %%
check("02.2")

# %% [markdown]
# **Try:** set the tilt to 0.1° and find the accelerometer error that cancels the swing. This is no
# accident: a navigator levels itself with its accelerometers, and so it starts with just this tilt. (Some 3
# km are left after three hours: about tilted axes, it subtracts the rotation of the Earth wrongly.) When
# will the two no longer cancel?
#
# ## 4. The height does not come back
#
# There is no pendulum for the height. A navigator that believes to be too high computes a gravity that is too
# weak, and takes less of it away from what it measures. So it accelerates up: the error e obeys ë = 2 g/R ·
# e. It grows e-fold in √(R/2g) = 9.5 minutes, for ever. No inertial navigator flies for hours without a
# barometer or GPS.

# %%
seconds = 3600
level = np.tile([earth.RATE * np.cos(np.pi / 4), 0, -earth.RATE * np.sin(np.pi / 4)], (seconds, 1))
force = np.tile([0, 0, -earth.gravity(np.sin(np.pi / 4), 0.0) - 1e-3 * G], (seconds, 1))
ground = Start(np.array([np.pi / 4, 0, 0]), PERFECT, np.array([1.0, 0, 0, 0]))
height = navigate(level, force, 1.0, ground)[:, 2]
minutes = np.array([1, 10, 30, 60])
rate = np.sqrt(2 * G / earth.radii(np.sin(np.pi / 4))[0])
pd.DataFrame(
    {
        "height error, 1 mg [m]": height[60 * minutes],
        "½ b t² [m]": 0.5e-3 * G * (60 * minutes) ** 2,
        "b/k² (cosh k t − 1), k² = 2 g/R [m]": 1e-3 * G / rate**2 * (np.cosh(rate * 60 * minutes) - 1),
    },
    index=pd.Index(minutes, name="after [min]"),
).round(0)

# %%
check("02.3")

# %% [markdown]
# ## 5. Coning
#
# Turn a book by 90° about its long edge, then by 90° about its short one. Do it again in the other order: the
# book ends differently. **Rotations do not commute**, so the sum of the angles of a gyro is not the rotation.
# The worst case is a body that wobbles like a coin before it comes to rest: the axis of its tilt goes round.
# This is *coning*. Gyros x and y swing as a cosine and a sine, and the body returns after each turn. Gyro z
# measures a small constant rate, and the swing of x and y, correctly added up, cancels it. A navigator that
# takes each sample by itself misses a part of the swing, and drifts about z, always in the same sense.
#
# The drift of a navigator that takes each sample by itself is ½ sin²a Ω (1 − sin(x)/x), for an angle a, a
# frequency Ω, and x = Ω Δt. The cure costs one vector product: the sample before tells how the axis turns
# (Savage, 1998).


# %%
def coning_drift(angle, frequency, rate, remember, seconds=2.0):
    """Return the drift about z [°/h] of a body that cones by an angle [°] at a frequency [Hz]."""
    a, omega, at = np.radians(angle), 2 * np.pi * frequency, np.arange(round(seconds * rate) + 1) / rate
    swing = np.sin(a) * np.column_stack((np.cos(omega * at), np.sin(omega * at)))
    dtheta = np.column_stack((np.diff(swing, axis=0), np.full(at.size - 1, omega / rate * (np.cos(a) - 1))))
    if remember:
        dtheta[1:] += np.cross(dtheta[:-1], dtheta[1:]) / 12
    turned = Rotation.from_rotvec([a, 0, 0])
    for one in Rotation.from_rotvec(dtheta):
        turned = turned * one
    true = Rotation.from_rotvec([*(a * np.array([np.cos(omega * at[-1]), np.sin(omega * at[-1])])), 0])
    return (turned * true.inv()).as_rotvec()[2] / seconds / HOURLY


rates = [50, 100, 200, 400]
x = 2 * np.pi * 10 / np.array(rates)
table = pd.DataFrame(
    {
        "each sample by itself [°/h]": [coning_drift(1, 10, rate, remember=False) for rate in rates],
        "formula [°/h]": -0.5 * np.sin(np.radians(1)) ** 2 * 2 * np.pi * 10 * (1 - np.sin(x) / x) / HOURLY,
        "with the sample before [°/h]": [coning_drift(1, 10, rate, remember=True) for rate in rates],
    },
    index=pd.Index(rates, name="IMU rate [Hz], coning of 1° at 10 Hz"),
)
table.round(2)

# %% [markdown]
# *Sculling* is the same for velocity. A body that rolls to and fro, and shakes sideways at the same rhythm,
# feels an acceleration that does not average out: at the moment of each push, the accelerometer points a
# little up. The step of the lab compensates for it in the same way.

# %%
check("02.4")

# %% [markdown]
# **Try:** by what factor does the drift fall when the rate is doubled? Find the order of both columns. What
# does that say about buying a faster IMU, compared with writing a better step?
#
# ## 6. Why 200 Hz
#
# How many samples does the flight over Montréal need? Its recording has 18 samples a second, and no
# vibration. Here the first column is a navigator that forgets the sample before, the second is that of the
# lab.

# %%
rates = [5, 10, 20, 50, 100, 200]
pd.DataFrame(
    {
        "position error, each sample by itself [m]": [miss(rate, remember=False) for rate in rates],
        "with the sample before [m]": [miss(rate) for rate in rates],
        "coning of 0.1° at 20 Hz [°/h]": [
            coning_drift(0.1, 20, rate, True) if rate > 40 else np.nan for rate in rates
        ],
    },
    index=pd.Index(rates, name="IMU rate [Hz]"),
).round(5)

# %% [markdown]
# The aeroplane itself is content with 10 to 20 Hz. The vibration of its engine is not: a wobble of a tenth
# of a degree at 20 Hz drifts by 25 °/h at 50 samples a second, more than the bias of a tactical gyro, and
# by 0.2 °/h at 200. With 40 samples a second the gyros seem to swing to and fro along a line, and with
# fewer the other way round, or not at all: no step can then correct the drift. **An IMU samples fast
# because of what shakes, not because of what flies.** The tests and notebooks of the lab use low rates for
# the same reason: their flights do not shake.
#
# ## 7. A flight without GPS
#
# Now all errors together, on a real flight: the experiment of the tour with no fix at all, so that the filter
# has nothing to do but to say how large it expects the errors to be. The band is its ±3σ. It knows how large
# your errors may be, but not their signs.

# %%
experiment = Experiment(mission="los_angeles", seed=1)
experiment.trajectory.imu_rate = 20  # Hz: this flight does not shake
experiment.sensors.gps.outages = [(0, 1000)]
experiment.navigator.rest_updates = False

gyro_bias = pn.widgets.FloatSlider(label="Gyro bias, σ [°/s]", start=0, end=0.5, step=0.01, value=0.1)
accelerometer_bias = pn.widgets.FloatSlider(
    label="Accelerometer bias, σ [mg]", start=0, end=10, step=0.1, value=2
)
initial_tilt = pn.widgets.FloatSlider(label="Initial tilt, σ [°]", start=0.01, end=2, step=0.01, value=0.5)


def without_gps(gyro, accelerometer, tilt):
    """Return the error plots of a flight without any fix."""
    trial = experiment.copy()
    trial.sensors.gyro.bias_sigma = gyro
    trial.sensors.accelerometer.bias_sigma = accelerometer
    trial.navigator.attitude_sigma = (tilt, tilt, 2.0)
    return plots.errors(trial.run())


knobs = (gyro_bias, accelerometer_bias, initial_tilt)
pn.Column(
    "# Strapdown without help",
    pn.FlexBox(*knobs),
    pn.bind(without_gps, *(knob.param.value_throttled for knob in knobs)),
).servable(title="Strapdown without help")

# %% [markdown]
# **Try:** set two of the three to their smallest value, each in turn. Which error does most of the harm
# within 100 s? Does section 2 agree?
#
# ## Where to go next
#
# - `03_sensor_errors.py`: where the biases and the noise of a sensor come from.
# - `07_outages.py`: how well the filter knows them when the fixes stop.
# - `lab/navigation/strapdown.py`: the step, with its equations.
