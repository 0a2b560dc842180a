"""Sensors: datasets of what IMU and GPS receiver put out, and of their errors."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lab.analysis.errors import to_enu
from lab.datasets.labelled import DEGREE, labelled
from lab.sensors import temperature as thermal
from lab.units import TO_SI

if TYPE_CHECKING:
    import xarray as xr

    from lab.result import Result


def imu(result: Result) -> xr.Dataset:
    """Return the output of the IMU; see `Result.imu`."""
    ideal, dims = result.ideal, ("time_imu", "body_axis")
    dt = np.diff(result.time)[:, None] if ideal is None else ideal.dt
    rate, force = DEGREE / dt, 1 / dt
    turned, gained = result.gyro.increments, result.accelerometer.increments
    variables = {
        "angular_rate": (dims, turned * rate, "°/s", "measured angular rate"),
        "specific_force": (dims, gained * force, "m/s²", "measured specific force"),
    }
    if ideal is not None:
        variables |= {
            "angular_rate_true": (dims, ideal.dtheta * rate, "°/s", "true angular rate"),
            "specific_force_true": (dims, ideal.dvelocity * force, "m/s²", "true specific force"),
        }
    return labelled(result, **variables)


def temperature(result: Result) -> xr.Dataset:
    """Return the temperature of the IMU; see `Result.temperature`."""
    settings = result.experiment.sensors.temperature
    height = result.known_truth("temperature").height
    true = thermal.temperature(settings, result.time[1:], height[1:] - height[0])
    reading = thermal.thermometer(settings, result.experiment.seed, true)
    return labelled(
        result,
        true=(("time_imu",), true, "°C", "temperature of the IMU"),
        reading=(("time_imu",), reading, "°C", "temperature the thermometer shows"),
    )


def gps(result: Result) -> xr.Dataset:
    """Return the fixes; see `Result.gps`."""
    fixes, label = result.fixes, result.projection.label
    easting, northing = result.projection.project(fixes.position)
    dims = ("time_gps", "axis")
    variables = {
        "latitude": (("time_gps",), fixes.position[:, 0] * DEGREE, "°", "latitude"),
        "longitude": (("time_gps",), fixes.position[:, 1] * DEGREE, "°", "longitude"),
        "height": (("time_gps",), fixes.position[:, 2], "m", "height above the ellipsoid"),
        "easting": (("time_gps",), easting, "m", f"easting, {label}"),
        "northing": (("time_gps",), northing, "m", f"northing, {label}"),
        "velocity": (dims, to_enu(fixes.velocity_n), "m/s", "velocity"),
    }
    if result.recorded is None:
        variables |= {
            "position_error": (dims, fixes.position_error, "m", "position error of the fix"),
            "velocity_error": (dims, fixes.velocity_error, "m/s", "velocity error of the fix"),
        }
    return labelled(result, **variables)


def sensor_errors(result: Result) -> xr.Dataset:
    """Return biases and scale factors; see `Result.sensor_errors`."""
    solution, dims = result.solution_arrays, ("time", "body_axis")
    kinds = {"bias": ("bias", 9, ("°/s", "mg"), solution.bias, result.true_bias)}
    if solution.scale.size:
        kinds["scale"] = ("scale factor error", 15, ("%", "%"), solution.scale, result.true_scale)
    variables = {}
    for kind, (words, first, units, estimate, true) in kinds.items():
        sigma = np.sqrt(solution.variance[:, first : first + 6])
        for number, (name, unit) in enumerate(zip(("gyro", "accelerometer"), units, strict=True)):
            part = slice(3 * number, 3 * number + 3)
            for suffix, values, label in (
                ("", estimate, "estimated"),
                *([] if result.recorded else [("_true", true, "true")]),
                ("_sigma", sigma, "σ of the estimated"),
            ):
                shown = values[:, part] / TO_SI[unit]
                variables[f"{name}_{kind}{suffix}"] = (dims, shown, unit, f"{label} {name} {words}")
    return labelled(result, **variables)
