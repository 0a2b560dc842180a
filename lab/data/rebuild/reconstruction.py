"""Reconstruction: from the samples of a raw flight to a recording of one motion on a regular grid.

A recorded velocity is integrated and anchored to the positions; positions alone get a smoothing spline;
airspeed, attitude and the angles of the air flow alone give the path through the air, to which the wind is
added. The differences of samples and curve are kept as residuals.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
import scipy

from lab.base.arrays import FloatArray
from lab.base.files.mission_error import MissionError
from lab.data.checks.likeness import rms
from lab.data.log.vehicle import vehicle_in
from lab.data.rebuild.derived_motion import SmoothAxes
from lab.data.rebuild.flight_curves import (
    NOISE_THAT_MATTERS,
    FlightCurves,
    middle_stretch,
    offered,
    worthwhile_smoothing,
)
from lab.data.rebuild.import_settings import AUTO, ImportSettings
from lab.data.rebuild.raw_flight import RawFlight
from lab.data.rebuild.smoothing import evaluate_smoothed
from lab.data.rebuild.time_repair import AS_RECORDED, RepairedFlight
from lab.flying import coordinated_turn
from lab.motion.frames import ecef, rotation
from lab.motion.recordings.recording import Recording

ATTITUDE_NOISE_THAT_MATTERS = float(np.radians(0.5))
"""Roughness of the body rates from which an attitude is smoothed [rad/s]."""

_MAX_OFF_SAMPLES = 0.05
"""Largest distance of the curve from the recorded positions at which the samples are kept unchanged [m]."""
_EXACT = 1e-9
"""Largest difference of times that are equal except for rounding [s]."""
_MIN_RATE = 10.0
"""Least rate of a flight without a recorded attitude [Hz]: so that a bank that builds up within a second
is followed."""
_CLEARLY_WORSE = 2
"""Roughness of the recorded velocity over that of the positions from which the positions make the curve."""


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """A flight rebuilt, and how.

    Attributes
    ----------
    recording : Recording
        The flight on a regular grid, its time from 0.
    curve : str
        Source of the reconstruction: "velocity", "position" or "air data".
    offered : mapping of float
        The roughness of the acceleration that each possible curve has before it is smoothed [m/s²].
    unchanged : bool
        True if the samples were good and are the recording, unchanged.
    smoothing : mapping of float
        λ by what was smoothed: "velocity", "position", "height", "attitude" [s³].
    position_residual : (3,) array or None
        Curve minus recorded positions, rms, north, east, down [m].
    velocity_residual : (3,) array or None
        Curve minus recorded velocity, rms, north, east, down [m/s].
    attitude_residual : float or None
        Angle between curve and recorded attitude, rms [rad].
    wind : (3,) array or None
        Velocity of the air that was added, north, east, down [m/s].
    attitude_reconstructed : bool
        True if the file has no attitude, and the attitude is that of a coordinated turn.
    vehicle : str
        The vehicle that is assumed, as of `lab.flying.coordinated_turn.attitude`.
    remarks : tuple of str
        Assumptions.
    """

    recording: Recording
    curve: str
    offered: Mapping[str, float]
    unchanged: bool
    smoothing: Mapping[str, float]
    position_residual: FloatArray | None
    velocity_residual: FloatArray | None
    attitude_residual: float | None
    wind: FloatArray | None
    attitude_reconstructed: bool
    vehicle: str
    remarks: tuple[str, ...]


def reconstruct(flight: RepairedFlight, settings: ImportSettings) -> Reconstruction:
    """Return the flight rebuilt from the samples of a repaired raw flight.

    Parameters
    ----------
    flight
        One unbroken flight, as `lab.data.rebuild.time_repair.repair` returns it.
    settings
        How to rebuild it.

    Raises
    ------
    MissionError
        If the file lacks the quantities of the curve asked for, or the grid would be too large.
    """
    raw = flight.raw
    curves = offered(raw)
    curve = _choose_curve(str(settings.curve), curves, raw)
    grid = regular_grid(raw.time, float(settings.rate), 0.0 if raw.euler is not None else _MIN_RATE)
    made = FlightCurves(raw, settings, grid)
    vehicle = vehicle_in(raw.vehicle).flight if settings.vehicle == AUTO else str(settings.vehicle)
    recording = _keep_samples(flight, grid, settings) if curve == "velocity" else None
    unchanged = recording is not None
    if recording is None:
        methods = {"velocity": made.of_velocity, "position": made.of_positions, "air data": made.of_air_data}
        position, velocity_n = methods[curve]()
        euler = _attitude(made, position, velocity_n, vehicle)
        extras = {
            name: np.interp(grid, raw.time, values)
            for name in ("airspeed", "alpha", "beta")
            if (values := getattr(raw, name)) is not None
        }
        longitude = rotation.wrap(position[:, 1])
        recording = Recording(grid, position[:, 0], longitude, position[:, 2], velocity_n, euler, **extras)
    residuals = (np.zeros(3), np.zeros(3), 0.0) if unchanged else _residuals(made, recording)
    return Reconstruction(
        recording=recording,
        curve=curve,
        offered=curves,
        unchanged=unchanged,
        smoothing=made.smoothing,
        position_residual=residuals[0],
        velocity_residual=residuals[1],
        attitude_residual=residuals[2],
        wind=made.wind,
        attitude_reconstructed=raw.euler is None,
        vehicle=vehicle,
        remarks=tuple(made.remarks),
    )


def _choose_curve(wanted: str, curves: Mapping[str, float], raw: RawFlight) -> str:
    """Return the curve asked for, or the one of less noise: velocity unless there is much in it."""
    if not curves:
        raise MissionError(
            f"no flight can be made of {', '.join(raw.quantities)}; accepted are files with positions, with "
            "velocities, or with airspeed and attitude"
        )
    if wanted != AUTO:
        if wanted not in curves:
            raise MissionError(
                f"curve = {wanted}: the file lacks the required data; accepted here: "
                f"{', '.join((AUTO, *curves))}"
            )
        return wanted
    if "velocity" in curves and "position" in curves:
        clearly_worse = max(curves["velocity"], NOISE_THAT_MATTERS) > _CLEARLY_WORSE * max(
            curves["position"], NOISE_THAT_MATTERS
        )
        return "position" if clearly_worse else "velocity"
    return next(iter(curves))


def _attitude(made: FlightCurves, position: FloatArray, velocity_n: FloatArray, vehicle: str) -> FloatArray:
    """Return roll, pitch, yaw on the grid: those recorded, or those of a coordinated turn."""
    raw, grid = made.raw, made.grid
    if raw.euler is None:
        # A vehicle slower than the noise of its positions stands still, and keeps its heading.
        moves = np.hypot(velocity_n[:, 0], velocity_n[:, 1]) > made.slowest
        seen = velocity_n * np.stack((moves, moves, np.ones_like(moves)), axis=-1)
        return coordinated_turn.attitude(grid, seen, cast(coordinated_turn.Vehicle, vehicle))
    axes = SmoothAxes(position[:, 0])
    q_fb = axes.attitudes(raw.euler, _interpolate_positions(grid, position, raw.time))
    if made.settings.smoothing == AUTO:
        # Half the rotation is in a quaternion.
        parameter = worthwhile_smoothing(raw.time, 2 * q_fb, ATTITUDE_NOISE_THAT_MATTERS)
        if parameter:
            made.smoothing["attitude"] = parameter
            q_fb = evaluate_smoothed(raw.time, q_fb, parameter)
    q_fb = scipy.interpolate.CubicSpline(raw.time, q_fb)(grid)
    return axes.euler(q_fb / np.linalg.norm(q_fb, axis=1, keepdims=True), position)


def _interpolate_positions(grid: FloatArray, position: FloatArray, time: FloatArray) -> FloatArray:
    """Return positions on a grid (m, 3) at other times, by the cubic through them in Earth-fixed axes."""
    r_e = ecef.position(position)
    return ecef.geodetic(scipy.interpolate.CubicSpline(grid, r_e - r_e[0])(time) + r_e[0])


def _keep_samples(flight: RepairedFlight, grid: FloatArray, settings: ImportSettings) -> Recording | None:
    """Return the samples themselves if they need no change; long flights are judged by their middle."""
    raw, time = flight.raw, flight.raw.time
    if raw.latitude is None or raw.longitude is None or raw.height is None:
        return None
    if raw.euler is None or raw.velocity_n is None:
        return None
    same_times = len(grid) == len(time) and np.abs(grid - time).max() < _EXACT
    if flight.method != AS_RECORDED or not same_times or settings.smoothing == "given":
        return None
    part = middle_stretch(len(time))
    some = raw.rows(np.arange(part.start, min(part.stop, len(time))))
    some = replace(some, time=some.time - some.time[0])
    assert some.latitude is not None
    assert some.euler is not None
    made = FlightCurves(some, settings, some.time)
    position, _ = made.of_velocity()
    q_fb = SmoothAxes(some.latitude).attitudes(some.euler, position)
    noisy = settings.smoothing == AUTO and worthwhile_smoothing(
        some.time, 2 * q_fb, ATTITUDE_NOISE_THAT_MATTERS
    )
    if (
        made.smoothing
        or noisy
        or np.abs(ecef.displacement(made.recorded_positions(), position)).max() > _MAX_OFF_SAMPLES
    ):
        return None
    return Recording(
        time, raw.latitude, raw.longitude, raw.height, raw.velocity_n, raw.euler, raw.airspeed, raw.alpha,
        raw.beta,
    )  # fmt: skip


def _residuals(
    made: FlightCurves, recording: Recording
) -> tuple[FloatArray | None, FloatArray | None, float | None]:
    """Return the residuals of the curve: position, velocity and attitude, where recorded."""
    raw, time = made.raw, recording.time
    position = recording.position
    axes = SmoothAxes(recording.latitude)
    at = _interpolate_positions(time, position, raw.time)
    off_position = off_velocity = off_attitude = None
    if raw.latitude is not None:
        off_position = rms(ecef.displacement(made.recorded_positions(), at), 0)
    if raw.velocity_n is not None:
        velocity_f = scipy.interpolate.CubicSpline(time, axes.vectors(recording.velocity_n, position))(
            raw.time
        )
        off_velocity = rms(axes.vectors_n(velocity_f, at) - raw.velocity_n, 0)
    if raw.euler is not None:
        q_fb = scipy.interpolate.CubicSpline(time, axes.attitudes(recording.euler, position))(raw.time)
        alike = np.abs(np.sum(q_fb * axes.attitudes(raw.euler, at), axis=1)) / np.linalg.norm(q_fb, axis=1)
        off_attitude = float(np.sqrt(np.mean((2 * np.arccos(np.minimum(alike, 1))) ** 2)))
    return off_position, off_velocity, off_attitude


MAX_SAMPLES = 20_000_000
"""Most samples a rebuilt flight may have."""

_ROUND_RATES = np.array([1.0, 2.0, 4.0, 5.0, 8.0])
"""Leading digits of the rates that a grid may have [Hz]: their steps have few decimals."""
_NEARLY = 0.999
"""Part of the wanted rate that a round one must reach: rounded stamps move the usual step by as little."""
_MAX_UNEVEN = 1e-4
"""How far samples may lie off even times, in steps, to keep them: 0.1 µs at 1 kHz, the rounding of stamps."""
_GRID_TIMES_PER_STEP = 2
"""Grid times for each usual step of uneven samples, so that the grid follows what lies between them."""
_MAX_GRID_TIMES_PER_SAMPLE = 4
"""Grid times for each sample at most: a few in quick succession do not make the whole flight dense."""


def regular_grid(time: FloatArray, rate: float, least_rate: float) -> FloatArray:
    """Return evenly spaced times from the first sample to the last.

    Evenly spaced samples keep their times; others get two times for each usual step.

    Parameters
    ----------
    time : (n,) array
        Increasing times of the samples, from 0 [s].
    rate
        Rate of the grid; 0 for one that suits the samples [Hz].
    least_rate
        The grid is at least as dense as this, by a whole multiple of the samples' own rate [Hz].

    Raises
    ------
    MissionError
        If the grid would have more than `MAX_SAMPLES`.
    """
    steps = np.diff(time)
    usual, span = float(np.median(steps)), float(time[-1])
    mean = span / max(float(np.round(span / usual)), 1.0)  # some samples may be missing
    if rate:
        step = 1 / rate
    elif np.abs(time - mean * np.round(time / mean)).max() < _MAX_UNEVEN * mean:
        step = mean / max(np.ceil(least_rate * mean - 1e-6), 1)
    else:
        rate_of_samples = min(_GRID_TIMES_PER_STEP / usual, _MAX_GRID_TIMES_PER_SAMPLE * len(time) / span)
        wanted = max(rate_of_samples, least_rate)
        decade = 10.0 ** np.floor(np.log10(wanted))
        step = 0.1 / decade
        if wanted <= _ROUND_RATES[-1] * decade:
            step = 1 / (decade * _ROUND_RATES[_ROUND_RATES * decade >= wanted * _NEARLY][0])
    count = int(span / step + 1e-6)
    if count > MAX_SAMPLES:
        raise MissionError(
            f"{span:.6g} s at {1 / step:.4g} Hz are more than {MAX_SAMPLES} samples; accepted is a "
            "lower rate (setting rate), or a shorter flight"
        )
    grid = np.arange(count + 1) * step
    # Rounding must not carry the last point beyond the last sample.
    return np.minimum(grid, span) if count > 2 else np.linspace(0.0, span, 4)
