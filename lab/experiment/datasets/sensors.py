"""Sensors: datasets of what IMU and GPS receiver put out, and of their errors."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lab.base.parameters.units import TO_SI
from lab.experiment.datasets.labelled import DEGREE, labelled
from lab.motion.frames.east_north_up import east_north_up
from lab.motion.frames.projection import Projection
from lab.run.run import Run
from lab.sensors import temperature as thermal

if TYPE_CHECKING:
    import xarray as xr


def imu(run: Run) -> xr.Dataset:
    """Return the output of the IMU; see `Result.imu`."""
    ideal, dims = run.ideal, ("time_imu", "body_axis")
    dt = np.diff(run.time)[:, None] if ideal is None else ideal.dt
    rate, force = DEGREE / dt, 1 / dt
    turned, gained = run.gyro.increments, run.accelerometer.increments
    variables = {
        "angular_rate": (dims, turned * rate, "°/s", "measured angular rate"),
        "specific_force": (dims, gained * force, "m/s²", "measured specific force"),
    }
    if ideal is not None and run.shows_sensor_errors:
        variables |= {
            "angular_rate_true": (dims, ideal.dtheta * rate, "°/s", "true angular rate"),
            "specific_force_true": (dims, ideal.dvelocity * force, "m/s²", "true specific force"),
        }
    return labelled(run, **variables)


def temperature(run: Run) -> xr.Dataset:
    """Return the temperature of the IMU; see `Result.temperature`."""
    settings, true = run.experiment.sensors.temperature, run.imu_temperature()
    reading = thermal.thermometer(settings, run.experiment.seed, true)
    return labelled(
        run,
        true=(("time_imu",), true, "°C", "temperature of the IMU"),
        reading=(("time_imu",), reading, "°C", "temperature the thermometer shows"),
    )


def gps(run: Run, projection: Projection) -> xr.Dataset:
    """Return the fixes, also in metres on a map; see `Result.gps`."""
    fixes, label = run.fixes, projection.label
    easting, northing = projection.project(fixes.position)
    dims = ("time_gps", "axis")
    variables = {
        "latitude": (("time_gps",), fixes.position[:, 0] * DEGREE, "°", "latitude"),
        "longitude": (("time_gps",), fixes.position[:, 1] * DEGREE, "°", "longitude"),
        "height": (("time_gps",), fixes.position[:, 2], "m", "height above the ellipsoid"),
        "easting": (("time_gps",), easting, "m", f"easting, {label}"),
        "northing": (("time_gps",), northing, "m", f"northing, {label}"),
        "velocity": (dims, east_north_up(fixes.velocity_n), "m/s", "velocity"),
    }
    if run.shows_sensor_errors:
        variables |= {
            "position_error": (dims, fixes.position_error, "m", "position error of the fix"),
            "velocity_error": (dims, fixes.velocity_error, "m/s", "velocity error of the fix"),
        }
    return labelled(run, **variables)


def sensor_errors(run: Run) -> xr.Dataset:
    """Return biases and scale factors; see `Result.sensor_errors`."""
    solution, dims = run.solution_arrays, ("time", "body_axis")
    kinds = {"bias": ("bias", 9, ("°/s", "mg"), solution.bias, run.true_bias)}
    if solution.scale.size:
        kinds["scale"] = ("scale factor error", 15, ("%", "%"), solution.scale, run.true_scale)
    variables = {}
    for kind, (words, first, units, estimate, true) in kinds.items():
        sigma = np.sqrt(solution.variance[:, first : first + 6])
        for number, (name, unit) in enumerate(zip(("gyro", "accelerometer"), units, strict=True)):
            part = slice(3 * number, 3 * number + 3)
            for suffix, values, label in (
                ("", estimate, "estimated"),
                *([("_true", true, "true")] if run.shows_sensor_errors else []),
                ("_sigma", sigma, "σ of the estimated"),
            ):
                shown = values[:, part] / TO_SI[unit]
                variables[f"{name}_{kind}{suffix}"] = (dims, shown, unit, f"{label} {name} {words}")
    return labelled(run, **variables)
