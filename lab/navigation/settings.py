"""Navigator settings: what the filter believes, and how it corrects (the belief side)."""

from __future__ import annotations

import param

from lab.settings import AxisQuantity, MatrixOrNone, Quantity, Settings


class NavigatorSettings(Settings):
    """How the navigator starts, what its filter assumes, and when it corrects."""

    model = param.Selector(
        default="phi", objects=["phi"], label="Error model", doc="Error model of the filter."
    )
    engine = param.Selector(
        default="compiled",
        objects=["compiled", "filterpy"],
        label="Engine",
        doc="The compiled filter, or the same filter in filterpy as readable reference (much slower).",
    )
    correction = param.Selector(
        default="feedback",
        objects=["feedback", "feedforward"],
        label="Correction",
        doc="Feedback corrects the navigator with the estimated error; feedforward lets it run free and "
        "subtracts.",
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
    p0_scale = Quantity(
        1.0,
        bounds=(1e-6, 1e6),
        softbounds=(0.01, 100),
        label="P₀ scale",
        doc="Factor on the initial covariance the filter assumes.",
    )
    q_scale = Quantity(
        1.0,
        bounds=(1e-6, 1e6),
        softbounds=(0.01, 100),
        label="Q scale",
        doc="Factor on the process noise the filter assumes.",
    )
    r_scale = Quantity(
        1.0,
        bounds=(1e-6, 1e6),
        softbounds=(0.01, 100),
        label="R scale",
        doc="Factor on the measurement noise the filter assumes.",
    )
    p0 = MatrixOrNone(
        size=15,
        label="P₀",
        doc="Initial covariance the filter assumes, SI units, order POS VEL ATT GYRO_BIAS "
        "ACCEL_BIAS: its diagonal or the whole matrix; unset, matched to the initial errors and sensors.",
    )
    q = MatrixOrNone(
        size=12,
        diagonal_only=True,
        label="Q",
        doc="Process noise densities the filter assumes, SI units: gyro noise, "
        "accelerometer noise, gyro bias drive, accelerometer bias drive; unset, matched to the sensors.",
    )
    r = MatrixOrNone(
        size=6,
        label="R",
        doc="Covariance of a fix the filter assumes, SI units: position north, east, down, then "
        "velocity: its diagonal or the whole matrix; unset, matched to the receiver.",
    )
