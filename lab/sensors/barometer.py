"""Barometer: height from the pressure of the air, with a bias that is the weather's.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch.
6.2.1.
"""

from __future__ import annotations

import param

from lab.sensors.draws import Seed
from lab.sensors.readings import Readings, read, reading_times, slow_error
from lab.setting_kinds import Intervals, Quantity
from lab.settings import Settings
from lab.trajectory import Trajectory


class BarometerErrors(Settings):
    """Errors and timing of a barometer. Defaults: a MEMS sensor, whose zero is set at the start."""

    fitted = param.Boolean(
        default=False,
        label="Fitted",
        doc="Whether there is a barometer. It measures the height above the ellipsoid; the difference from "
        "the height by pressure is its bias. A filter that uses it has a state for the bias.",
    )
    period = Quantity(
        1.0,
        unit="s",
        bounds=(0.01, 60),
        softbounds=(0.1, 10),
        step=0.1,
        label="Period",
        doc="Time from reading to reading; the first is one period after the start.",
    )
    noise = Quantity(
        0.3,
        unit="m",
        bounds=(1e-6, 1e3),
        softbounds=(0.01, 5),
        step=0.01,
        label="Noise, σ",
        doc="Standard deviation of the white error of a reading.",
    )
    bias_sigma = Quantity(
        5.0,
        unit="m",
        bounds=(0, 1e4),
        softbounds=(0, 100),
        step=0.5,
        label="Bias, σ",
        doc="Standard deviation of the constant part of the bias, drawn anew for each seed.",
    )
    drift_sigma = Quantity(
        2.0,
        unit="m",
        bounds=(0, 1e3),
        softbounds=(0, 20),
        step=0.1,
        label="Drift, σ",
        doc="Standard deviation of the slow part of the bias, a first-order Gauss-Markov process.",
    )
    correlation_time = Quantity(
        1800.0,
        unit="s",
        bounds=(1, 1e6),
        softbounds=(60, 7200),
        step=60,
        label="Correlation time",
        doc="Correlation time of the drift.",
    )
    outages = Intervals(
        default=[], label="Outages", doc="Times without readings, as [start, end] pairs in seconds."
    )


def measure(trajectory: Trajectory, errors: BarometerErrors, seed: Seed) -> Readings:
    """Return the readings of a barometer: heights [m].

    Parameters
    ----------
    trajectory
        The flight.
    errors
        Errors and timing.
    seed
        Seed of the run.
    """
    times = reading_times(errors.period, trajectory.duration)
    bias = slow_error(
        seed, "barometer", times, errors.bias_sigma, errors.drift_sigma, errors.correlation_time
    )
    height = trajectory.at(times).height
    return read(seed, "barometer", times, height, bias, errors.noise, errors.outages)
