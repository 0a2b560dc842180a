"""Heading sensor: the true heading from a magnetometer or from two antennas.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 6.1.1
and 10.2.5.
"""

from __future__ import annotations

import numpy as np

from lab.rotation import wrap
from lab.sensors import readings
from lab.sensors.draws import Seed
from lab.sensors.readings import Readings, read, reading_times, slow_error
from lab.settings import Settings
from lab.trajectory import Trajectory
from lab.units import si


class HeadingErrors(Settings):
    """Errors and timing of a heading sensor. Defaults: a magnetometer with its iron calibrated."""

    fitted = readings.fitted(
        "a sensor of the heading: a magnetometer, with its declination removed, or two antennas. A filter "
        "that uses it has a state for its bias."
    )
    period = readings.period(1.0)
    noise = readings.noise(1.0, unit="°", bounds=(1e-4, 90), softbounds=(0.01, 10), step=0.01)
    bias_sigma = readings.bias_sigma(2.0, unit="°", bounds=(0, 90), softbounds=(0, 10), step=0.1)
    drift_sigma = readings.drift_sigma(0.0, unit="°", bounds=(0, 90), softbounds=(0, 10), step=0.1)
    correlation_time = readings.correlation_time(300.0)
    outages = readings.outages()


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
    found = read(seed, "heading", times, heading, bias, float(si(errors, "noise")), errors.outages)
    return found._replace(value=np.asarray(wrap(found.value)))
