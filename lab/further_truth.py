"""Further truth: the true values of the further states of a filter, as they were simulated."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from lab.east_north_up import east_north_up
from lab.experiment_settings import ExperimentSettings
from lab.navigation import blocks
from lab.navigation.belief import assumed_latency, assumed_lever_arm
from lab.sensors import gps
from lab.sensors.readings import Readings
from lab.units import si

FloatArray = NDArray[np.float64]

_BIASES = {
    blocks.BAROMETER_BIAS: "barometer",
    blocks.HEADING_BIAS: "heading",
    blocks.ODOMETER_SCALE: "odometer",
}
"""Sensors whose slow error is a block."""


def further_truth(
    experiment: ExperimentSettings,
    readings: Mapping[str, Readings],
    names: tuple[str, ...],
    time: FloatArray,
) -> FloatArray:
    """Return the true values (n, k) of the further states after the scale factors at some times.

    The slow errors are known at the times of readings and fixes, and interpolated between them.

    Parameters
    ----------
    experiment
        The settings.
    readings
        Readings by the sensor's group in the settings.
    names
        The further blocks of the filter.
    time : (n,) array
        Times [s].
    """
    columns: list[FloatArray] = []
    for name in names:
        if name in blocks.SCALES:
            continue
        if name in blocks.MISALIGNMENTS:
            sensors = experiment.sensors
            triad = sensors.gyro if name == blocks.GYRO_MISALIGNMENT else sensors.accelerometer
            columns += [np.full(time.size, value) for value in si(triad, "misalignment")]
        elif name == blocks.GPS_DRIFT:
            columns += list(_drift(experiment, time).T)
        elif name in _BIASES:
            found = readings[_BIASES[name]]
            columns.append(
                np.interp(time, found.time, found.bias) if found.time.size else np.full(time.size, np.nan)
            )
        else:
            columns += [np.full(time.size, value) for value in _constant(experiment, name)]
    return np.stack(columns, axis=-1) if columns else np.zeros((time.size, 0))


def _drift(experiment: ExperimentSettings, time: FloatArray) -> FloatArray:
    """Return the correlated position error of the receiver (n, 3), north, east, down [m]."""
    errors = experiment.sensors.gps
    times = gps.fix_times(errors, float(time[-1]))
    drift = east_north_up(gps.drift(times, errors, gps.GpsDraws.of(experiment.seed, times.size)))
    if not times.size:
        return np.zeros((time.size, 3))
    return np.stack([np.interp(time, times, column) for column in drift.T], axis=-1)


def _constant(experiment: ExperimentSettings, name: str) -> FloatArray:
    """Return what a constant is off from its assumed value."""
    navigator, receiver = experiment.navigator, experiment.sensors.gps
    if name == blocks.LEVER_ARM:
        true = si(receiver, "lever_arm")
        return np.asarray(true - assumed_lever_arm(navigator, true))
    return np.array([receiver.latency - assumed_latency(navigator, receiver.latency)])
