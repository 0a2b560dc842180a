"""Heading sensor: the true heading from a magnetometer or from two antennas.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 6.1.1
and 10.2.5.
"""

from __future__ import annotations

import numpy as np
import param

from lab.rotation import wrap
from lab.sensors.draws import Seed
from lab.sensors.readings import Readings, read, reading_times, slow_error
from lab.setting_kinds import Intervals, Quantity
from lab.settings import Settings
from lab.trajectory import Trajectory
from lab.units import si


class HeadingErrors(Settings):
    """Errors and timing of a heading sensor. Defaults: a magnetometer with its iron calibrated."""

    fitted = param.Boolean(
        default=False,
        label="Fitted",
        doc="Whether there is a sensor of the heading: a magnetometer, with its declination removed, or two "
        "antennas. A filter that uses it has a state for its bias.",
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
        1.0,
        unit="°",
        bounds=(1e-4, 90),
        softbounds=(0.01, 10),
        step=0.01,
        label="Noise, σ",
        doc="Standard deviation of the white error of a reading.",
    )
    bias_sigma = Quantity(
        2.0,
        unit="°",
        bounds=(0, 90),
        softbounds=(0, 10),
        step=0.1,
        label="Bias, σ",
        doc="Standard deviation of the constant part of the bias, drawn anew for each seed.",
    )
    drift_sigma = Quantity(
        0.0,
        unit="°",
        bounds=(0, 90),
        softbounds=(0, 10),
        step=0.1,
        label="Drift, σ",
        doc="Standard deviation of the slow part of the bias, a first-order Gauss-Markov process.",
    )
    correlation_time = Quantity(
        300.0,
        unit="s",
        bounds=(1, 1e6),
        softbounds=(10, 3600),
        step=10,
        label="Correlation time",
        doc="Correlation time of the drift.",
    )
    outages = Intervals(
        default=[], label="Outages", doc="Times without readings, as [start, end] pairs in seconds."
    )


def measure(trajectory: Trajectory, errors: HeadingErrors, seed: Seed) -> Readings:
    """Return the readings of a heading sensor: true headings from −π to π [rad].

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
    constant, drift = float(si(errors, "bias_sigma")), float(si(errors, "drift_sigma"))
    bias = slow_error(seed, "heading", times, constant, drift, errors.correlation_time)
    heading = trajectory.at(times).euler[:, 2]
    readings = read(seed, "heading", times, heading, bias, float(si(errors, "noise")), errors.outages)
    return readings._replace(value=np.asarray(wrap(readings.value)))
