"""Navigator settings: the filter's assumptions, and how it corrects (the belief side)."""

from __future__ import annotations

import param

from lab.base.parameters.setting_kinds import AxisQuantity, MatrixOrNone, Quantity, QuantityOrNone
from lab.base.parameters.settings import Settings
from lab.data.log.vehicle import VEHICLES

_AXES_NED = ("north", "east", "down")
_FIX_ROWS = [(f"position {axis}", "m") for axis in _AXES_NED] + [
    (f"velocity {axis}", "m/s") for axis in _AXES_NED
]
_STATE_ROWS = [
    *_FIX_ROWS,
    *((f"attitude {axis}", "°") for axis in _AXES_NED),
    *((f"gyro bias {axis}", "°/s") for axis in "xyz"),
    *((f"accelerometer bias {axis}", "mg") for axis in "xyz"),
    *((f"gyro scale {axis}", "%") for axis in "xyz"),
    *((f"accelerometer scale {axis}", "%") for axis in "xyz"),
]
_NOISE_ROWS = [
    *((f"gyro noise {axis}", "°/s/√Hz") for axis in "xyz"),
    *((f"accelerometer noise {axis}", "µg/√Hz") for axis in "xyz"),
    *((f"gyro bias drive {axis}", "°/h/√h") for axis in "xyz"),
    *((f"accelerometer bias drive {axis}", "mg/√h") for axis in "xyz"),
]


def _factor(label: str, what: str) -> Quantity:
    return Quantity(1.0, bounds=(1e-6, 1e6), softbounds=(0.01, 100), label=label, doc=f"Factor on {what}.")


class NavigatorSettings(Settings):
    """The start of the navigator, the assumptions of its filter, and its corrections."""

    model = param.Selector(
        default="phi",
        objects=["phi", "psi", "invariant", "nonlinear"],
        label="Error model",
        doc="phi: linear, perturbation of the true navigation frame. psi: linear, errors in the computer "
        "frame. invariant: linear, group error on SE₂(3) whose model does not depend on the estimate; "
        "also for large attitude errors. nonlinear: unscented filter on the exact kinematics; also for "
        "large attitude errors; corrects by feedback at each fix.",
    )
    mechanization = param.Selector(
        default="north-slaved",
        objects=["north-slaved", "wander azimuth"],
        label="Mechanization",
        doc="Frame in which a linear filter computes. north-slaved: within 1° of a pole, it goes on in the "
        "other frame by itself. wander azimuth: does not turn about the vertical; everywhere. Both show "
        "their results in north, east, down. The model nonlinear always computes in wander azimuth.",
    )
    states = param.Selector(
        default=15,
        objects=[15, 21],
        label="Number of states",
        doc="15: errors of position, velocity, attitude, gyro and accelerometer biases. 21: also their scale "
        "factors, as random constants.",
    )
    engine = param.Selector(
        default="compiled",
        objects=["compiled", "filterpy"],
        label="Engine",
        doc="The compiled filter, or the same filter in filterpy as a readable reference (much slower).",
    )
    correction = param.Selector(
        default="feedback",
        objects=["feedback", "feedforward"],
        label="Correction",
        doc="feedback: corrects the navigator with the estimated error. feedforward: lets it run free and "
        "subtracts the estimated error from its output.",
    )
    correction_period = Quantity(
        0.0,
        unit="s",
        bounds=(0, 600),
        softbounds=(0, 30),
        step=1,
        label="Correction period",
        doc="Shortest time between two feedback corrections; 0 corrects at each fix.",
    )
    filter_rate = Quantity(
        0.0,
        unit="Hz",
        bounds=(0, 2000),
        softbounds=(0, 200),
        step=10,
        label="Filter rate",
        doc="Rate at which the covariance is propagated; 0 propagates it at every IMU sample.",
    )
    position_sigma = AxisQuantity(
        1.0,
        unit="m",
        axes=("north", "east", "down"),
        bounds=(1e-6, 1e5),
        softbounds=(0.1, 100),
        step=0.1,
        label="Initial position, σ",
        doc="Standard deviation of the initial position error.",
    )
    velocity_sigma = AxisQuantity(
        0.3,
        unit="m/s",
        axes=("north", "east", "down"),
        bounds=(1e-6, 1e3),
        softbounds=(0.01, 10),
        step=0.01,
        label="Initial velocity, σ",
        doc="Standard deviation of the initial velocity error.",
    )
    attitude_sigma = AxisQuantity(
        (0.5, 0.5, 2.0),
        unit="°",
        axes=("north", "east", "down"),
        bounds=(1e-6, 180),
        softbounds=(0.01, 30),
        step=0.01,
        label="Initial attitude, σ",
        doc="Standard deviation of the initial attitude error: tilt about north and east, and heading.",
    )
    position_error = AxisQuantity(
        0.0,
        unit="m",
        axes=("north", "east", "down"),
        bounds=(-1e5, 1e5),
        softbounds=(-100, 100),
        step=0.1,
        label="Initial position, given error",
        doc="Initial position error in addition to the drawn one; P₀ includes the second moment of both.",
    )
    velocity_error = AxisQuantity(
        0.0,
        unit="m/s",
        axes=("north", "east", "down"),
        bounds=(-1e3, 1e3),
        softbounds=(-10, 10),
        step=0.01,
        label="Initial velocity, given error",
        doc="Initial velocity error in addition to the drawn one; P₀ includes the second moment of both.",
    )
    attitude_error = AxisQuantity(
        0.0,
        unit="°",
        axes=("north", "east", "down"),
        bounds=(-180, 180),
        softbounds=(-90, 90),
        step=0.1,
        label="Initial attitude, given error",
        doc="Initial attitude error φ in addition to the drawn one, such as 60° down for a heading 60° too "
        "small; P₀ includes the second moment of both.",
    )
    alignment = Quantity(
        0.0,
        unit="s",
        bounds=(0, 3600),
        softbounds=(0, 120),
        step=1,
        label="Alignment before the flight",
        doc="Duration of a rest before the flight, as an autopilot needs it after it is switched on. The "
        "accelerometers level the navigator. The gyros show their constant biases, which are removed, "
        "and north if they are accurate enough. P₀ is the covariance of the remaining errors. 0 starts "
        "with the whole turn-on bias.",
    )
    rest_updates = param.Boolean(
        default=True,
        label="Updates at rest",
        doc="Zero angular rate updates: where the vehicle stands still for 10 s or more, the mean of the "
        "gyros shows their biases. GPS velocity and spread of the IMU samples detect the rest.",
    )
    hold_heading = param.Boolean(
        default=True,
        label="Hold heading going straight",
        doc="Fixes that show the heading at most by chance, as those of a vehicle that goes straight, leave "
        "it and the vertical gyro bias as they are. Without, σ of the heading becomes too small there.",
    )
    smoother = param.Boolean(
        default=False,
        label="Smoother",
        doc="Use all fixes of the flight for every sample (fixed-interval smoothing, as by Rauch, Tung and "
        "Striebel). Linear models only; the innovations remain those of the filter.",
    )
    zero_velocity = param.Boolean(
        default=False,
        label="Zero velocity at rest",
        doc="Zero velocity updates: where the vehicle stands still for 10 s or more, its velocity is "
        "measured as zero once a second. Detected as for the updates at rest, until the specific force "
        "changes; without fixes, until the inertial sensors show motion.",
    )
    zero_velocity_sigma = Quantity(
        0.02,
        unit="m/s",
        bounds=(1e-5, 10),
        softbounds=(0.001, 0.5),
        step=0.001,
        label="Zero velocity, σ",
        doc="Standard deviation of the velocity of the vehicle at rest, for each component.",
    )
    no_slip = param.Boolean(
        default=False,
        label="Vehicle does not slip",
        doc="Non-holonomic constraints of a vehicle on wheels or rails: at the place of the odometer "
        "(sensors.odometer.lever_arm), the speeds to the right and down are measured as zero once a second. "
        "Aeroplanes and boats slip: for them it is wrong.",
    )
    slip_sigma = AxisQuantity(
        (0.1, 0.1),
        unit="m/s",
        axes=("right", "down"),
        bounds=(1e-5, 100),
        softbounds=(0.01, 2),
        step=0.01,
        label="Slip, σ",
        doc="Standard deviation of these speeds, white from second to second.",
    )
    aiding_scale = _factor(
        "Scale of other measurements",
        "the variances of all measurements other than GPS fixes that the filter assumes",
    )
    estimate_misalignments = param.Boolean(
        default=False,
        label="Estimate misalignments",
        doc="Twelve states for the misalignments of gyros and accelerometers, constants with the sizes of "
        "sensors.gyro.misalignment and sensors.accelerometer.misalignment as σ.",
    )
    estimate_g_sensitivity = param.Boolean(
        default=False,
        label="Estimate g-sensitivity",
        doc="Three states for what the gyros feel of the specific force, constants with the sizes of "
        "sensors.gyro.g_sensitivity as σ.",
    )
    estimate_bias_drift = param.Boolean(
        default=False,
        label="Estimate bias drift",
        doc="Six states for the instability of the biases, a first-order Gauss-Markov process, beside those "
        "for the rest of the biases. Otherwise one state of each axis is both.",
    )
    own_states = param.String(
        default="",
        label="Own states",
        doc="Names of states of errors of the IMU, separated by commas, that a notebook declared with "
        "lab.declare_states.",
    )
    estimate_gps_drift = param.Boolean(
        default=False,
        label="Estimate GPS drift",
        doc="Three states for the correlated position error of the receiver "
        "(sensors.gps.correlated_sigma and correlation_time).",
    )
    estimate_lever_arm = param.Boolean(
        default=False,
        label="Estimate lever arm",
        doc="Three states for the error of the assumed lever arm, constants with the σ below.",
    )
    lever_arm_sigma = AxisQuantity(
        0.5,
        unit="m",
        axes=("forward", "right", "down"),
        bounds=(1e-6, 1e3),
        softbounds=(0.01, 5),
        step=0.01,
        label="Lever arm, σ",
        doc="Standard deviation of the error of the assumed lever arm, if it is estimated.",
    )
    estimate_latency = param.Boolean(
        default=False,
        label="Estimate latency",
        doc="One state for the error of the assumed latency, a constant with the σ below.",
    )
    latency_sigma = Quantity(
        0.1,
        unit="s",
        bounds=(1e-6, 60),
        softbounds=(0.01, 1),
        step=0.01,
        label="Latency, σ",
        doc="Standard deviation of the error of the assumed latency, if it is estimated. The estimate is of "
        "first order: motion is extrapolated by velocity and acceleration.",
    )
    gate = Quantity(
        0.0,
        bounds=(0, 1),
        softbounds=(0, 1),
        step=0.001,
        label="Gate",
        doc="Fraction of the good fixes that pass the χ² test of their six innovations, such as 0.999; the "
        "others are rejected. 0 uses every fix. After rejections that chance cannot explain, the "
        "filter takes itself to be wrong: it raises P and uses the fix, and the result counts this.",
    )
    robust = param.Selector(
        default="none",
        objects=["none", "huber", "student-t"],
        label="Robust update",
        doc="Weight of a fix whose innovation is larger than expected. none: full weight. huber: its "
        "effect on the estimate is bounded. student-t: its effect decreases as the innovation grows (4 "
        "degrees of freedom).",
    )
    lever_arm = QuantityOrNone(
        unset="matched",
        unit="m",
        axes=("forward", "right", "down"),
        bounds=(-1000, 1000),
        label="Lever arm the filter assumes",
        doc="Place of the GPS antenna that the filter assumes, from the IMU forward, right, down. matched: "
        "that of the simulated receiver, or of the log.",
    )
    latency = QuantityOrNone(
        unset="matched",
        unit="s",
        bounds=(-60, 60),
        label="Latency the filter assumes",
        doc="Age of a fix at its time stamp, as the filter assumes it. matched: that of the simulated "
        "receiver, or of the log.",
    )
    p0_scale = _factor("P₀ scale", "the initial covariance the filter assumes")
    q_scale = _factor("Q scale", "the process noise the filter assumes")
    r_scale = _factor("R scale", "the measurement noise the filter assumes")
    r_factors = AxisQuantity(
        1.0,
        axes=("horizontal position", "vertical position", "velocity"),
        bounds=(1e-6, 1e6),
        softbounds=(0.01, 100),
        label="R factors",
        doc="Factors on the variances of a fix in addition to the R scale, one for each part. A receiver "
        "that states its own σ may be too optimistic for one part and not for another.",
    )
    p0 = MatrixOrNone(
        size=(15, 21),
        rows=_STATE_ROWS,
        label="P₀",
        doc="Initial covariance the filter assumes, SI units, order POS VEL ATT GYRO_BIAS ACCEL_BIAS, and "
        "with 21 states GYRO_SCALE ACCEL_SCALE: its diagonal or the whole matrix. Unset: matched to "
        "the initial errors and sensors.",
    )
    q = MatrixOrNone(
        size=12,
        diagonal_only=True,
        rows=_NOISE_ROWS,
        label="Q",
        doc="Process noise densities the filter assumes, SI units: gyro noise, accelerometer noise, gyro "
        "bias drive, accelerometer bias drive. Unset: matched to the sensors.",
    )
    r = MatrixOrNone(
        size=6,
        rows=_FIX_ROWS,
        label="R",
        doc="Covariance of a fix the filter assumes, SI units: position north, east, down, then velocity: "
        "its diagonal or the whole matrix. Unset: matched to the receiver.",
    )
    vehicle = param.Selector(
        default="auto",
        objects=["auto", *VEHICLES],
        label="Vehicle of a log or stream",
        doc="Vehicle that carried the sensors of a log. Aeroplanes and cars move where their nose points: "
        "this shows the initial heading and wrong axes. The others need not. auto: as stated in the "
        "log.",
    )
    initial_heading = QuantityOrNone(
        unset="found",
        unit="°",
        bounds=(-360, 360),
        label="Initial heading of a log or stream",
        doc="True heading at the first sample of a log. found: what antennas, course, motion or "
        "magnetometer show.",
    )
    initial_heading_uncertainty = Quantity(
        5.0,
        unit="°",
        bounds=(1e-3, 180),
        softbounds=(0.1, 30),
        step=0.1,
        label="Initial heading of a log or stream, σ",
        doc="Standard deviation of a given initial heading.",
    )
    log_from = QuantityOrNone(
        unset="start",
        unit="s",
        bounds=(-1e10, 1e10),
        label="Log from",
        doc="Start of the navigation of a log, in the clock of its file. start: at its first sample.",
    )
    log_to = QuantityOrNone(
        unset="end",
        unit="s",
        bounds=(-1e10, 1e10),
        label="Log to",
        doc="End of the navigation of a log, in the clock of its file. end: at its last sample.",
    )
