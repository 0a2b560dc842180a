"""GPS: simulated fixes of a receiver from the true position and velocity (the truth side).

A fix is the truth at its time plus errors in metres: white and first-order Gauss-Markov noise, with a larger
σ while the constellation is bad; outliers of the position; and, with a latency or a lever arm, the
displacement from the IMU at the fix time to the antenna one latency earlier.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed. (cited as
Groves).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.parameters.setting_kinds import AxisQuantity, Intervals, Quantity
from lab.base.parameters.settings import Settings
from lab.base.parameters.units import si
from lab.motion.frames import earth, ecef, rotation
from lab.motion.frames.displacement import displaced, displacement
from lab.motion.frames.east_north_up import east_north_up
from lab.motion.truth.trajectory import Trajectory, Truth
from lab.sensors import processes
from lab.sensors.draws import Seed, unit_draws

EAST_NORTH_UP = ("east", "north", "up")


class GpsErrors(Settings):
    """Errors and timing of the GPS receiver. Defaults: the classic experiment."""

    position_variance = AxisQuantity(
        0.5,
        unit="m²",
        axes=EAST_NORTH_UP,
        bounds=(1e-6, 1e6),
        softbounds=(0.01, 25),
        step=0.01,
        label="Position variance",
        doc="Variance of the white position error.",
    )
    velocity_variance = AxisQuantity(
        0.2,
        unit="(m/s)²",
        axes=EAST_NORTH_UP,
        bounds=(1e-8, 1e4),
        softbounds=(0.001, 4),
        step=0.001,
        label="Velocity variance",
        doc="Variance of the white velocity error.",
    )
    correlated_sigma = AxisQuantity(
        0.0,
        unit="m",
        axes=EAST_NORTH_UP,
        bounds=(0, 1e3),
        softbounds=(0, 10),
        step=0.1,
        label="Correlated position error, σ",
        doc="Standard deviation of a first-order Gauss-Markov position error, on top of the white one.",
    )
    correlation_time = Quantity(
        60.0,
        unit="s",
        bounds=(0.1, 1e6),
        softbounds=(1, 600),
        step=1,
        label="Correlation time",
        doc="Correlation time of the Gauss-Markov position error.",
    )
    period = Quantity(
        1.0,
        unit="s",
        bounds=(0.05, 60),
        softbounds=(0.1, 10),
        step=0.1,
        label="Period",
        doc="Time from fix to fix; the first fix is one period after the start.",
    )
    outages = Intervals(
        default=[],
        label="Outages",
        doc="Times without fixes, as [start, end] pairs in seconds since the start; for a log, in the "
        "clock of its file.",
    )
    latency = Quantity(
        0.0,
        unit="s",
        bounds=(0, 10),
        softbounds=(0, 1),
        step=0.01,
        label="Latency",
        doc="Age of the reported position and velocity at the time stamp of the fix.",
    )
    lever_arm = AxisQuantity(
        0.0,
        unit="m",
        bounds=(-100, 100),
        softbounds=(-5, 5),
        step=0.1,
        label="Lever arm",
        doc="From the IMU to the antenna: forward, right, down. Fixes report the antenna's position and "
        "velocity.",
    )
    outlier_rate = Quantity(
        0.0,
        bounds=(0, 1),
        softbounds=(0, 0.2),
        step=0.01,
        label="Outliers, rate",
        doc="Fraction of the fixes whose position is an outlier, such as from multipath.",
    )
    outlier_size = Quantity(
        20.0,
        unit="m",
        bounds=(0, 1e5),
        softbounds=(0, 100),
        step=1,
        label="Outliers, size",
        doc="Standard deviation of the jump of an outlier east, north and up.",
    )
    quality_steps = Intervals(
        default=[],
        label="Bad constellation",
        doc="Times of a bad satellite geometry, as [start, end] pairs in seconds since the start.",
    )
    quality_factor = Quantity(
        3.0,
        bounds=(0.01, 100),
        softbounds=(0.1, 10),
        step=0.1,
        label="Bad constellation, factor",
        doc="Factor on the σ of the white and the correlated errors while the constellation is bad.",
    )


class GpsDraws(NamedTuple):
    """Unit draws of a receiver for m fixes.

    Attributes
    ----------
    position, velocity, correlated, jump : (m, 3) arrays
        East, north, up: white position and velocity errors, drive of the Gauss-Markov position error (its
        first row is the start), jumps of outliers.
    outlier : (m,) array
        Draws that select the outliers: the lowest ones.
    """

    position: FloatArray
    velocity: FloatArray
    correlated: FloatArray
    jump: FloatArray
    outlier: FloatArray

    @classmethod
    def of(cls, seed: Seed, fixes: int, errors: GpsErrors | None = None) -> GpsDraws:
        """Draw for a number of fixes, or for the next ones of a stream; only what given errors need."""
        drifts, jumps = (
            fixes if errors is None or wanted else 0
            for wanted in (
                errors is not None and any(errors.correlated_sigma),
                errors is not None and errors.outlier_rate,
            )
        )
        return cls(
            position=unit_draws(seed, "gps.position", (fixes, 3)),
            velocity=unit_draws(seed, "gps.velocity", (fixes, 3)),
            correlated=unit_draws(seed, "gps.correlated", (drifts, 3)),
            jump=unit_draws(seed, "gps.jump", (jumps, 3)),
            outlier=unit_draws(seed, "gps.outlier", (jumps,)),
        )


@dataclass
class Memory:
    """What a receiver keeps from one piece of its fixes to the next; new for the first piece.

    Attributes
    ----------
    correlated : (3,) array or None
        Last sample of the Gauss-Markov position error, in its σ.
    """

    correlated: FloatArray | None = None


class GpsFixes(NamedTuple):
    """The fixes of a receiver; the position [rad], [rad], [m] and velocity_n [m/s] as in `navigation.Fixes`.

    Attributes
    ----------
    time : (m,) array
        Time of validity [s].
    position : (m, 3) array
        Latitude, longitude, height.
    velocity_n : (m, 3) array
        Velocity north, east, down.
    position_error, velocity_error : (m, 3) arrays
        Fix minus truth of the IMU at the same time, east, north, up [m], [m/s].
    """

    time: FloatArray
    position: FloatArray
    velocity_n: FloatArray
    position_error: FloatArray
    velocity_error: FloatArray


def fix_times(errors: GpsErrors, duration: float) -> FloatArray:
    """Return the times of all fixes of a flight, those in outages included [s]."""
    period = errors.period
    # A fix at the very end counts, even if the quotient is rounded down.
    return period * np.arange(1.0, int(duration / period + 1e-9) + 1)


def outside_outages(errors: GpsErrors, times: FloatArray) -> NDArray[np.bool_]:
    """Return the mask of the times outside all outages; an outage includes its start and its end."""
    return ~mask_within(errors.outages, times)


def antenna(trajectory: Trajectory, errors: GpsErrors, times: FloatArray) -> Truth:
    """Return the true motion of the antenna at the times of fixes.

    The truth one latency earlier, moved by the lever arm l_b: C_nb l_b in position and C_nb (ω_eb,b × l_b) in
    velocity, with ω_eb,b = ω_ib,b − C_bn ω_ie,n (Groves, ch. 2.5). Attitude stays that of the IMU.

    Parameters
    ----------
    trajectory
        The flight of the IMU.
    errors
        The receiver's latency and lever arm.
    times : (m,) array
        Time stamps of the fixes [s]; for times below the latency, the start of the flight is returned.
    """
    lever_arm = si(errors, "lever_arm")
    # Before the start there is no flight; `measure` leaves these fixes out.
    seen = np.maximum(times - errors.latency, 0.0)
    truth = trajectory.at(seen)
    if not lever_arm.any():
        return truth
    C_nb = rotation.C_nb_from_euler(truth.euler)
    sine, cosine = np.sin(truth.latitude), np.cos(truth.latitude)
    omega_ie_n = earth.RATE * np.stack((cosine, np.zeros_like(sine), -sine), axis=-1)
    # The antenna moves relative to the Earth with ω_eb, while the rates are ω_ib.
    omega_eb_b = trajectory.rates(seen)[0] - np.einsum("mij,mi->mj", C_nb, omega_ie_n)
    latitude, longitude, height = displaced(truth.position, C_nb @ lever_arm).T
    velocity_n = truth.velocity_n + np.einsum("mij,mj->mi", C_nb, np.cross(omega_eb_b, lever_arm))
    there = np.stack((latitude, longitude), axis=-1)
    velocity_n = ecef.resolved_near_pole(velocity_n, truth.position, there)
    return replace(truth, latitude=latitude, longitude=longitude, height=height, velocity_n=velocity_n)


def measure(
    truth: Truth,
    errors: GpsErrors,
    draws: GpsDraws,
    seen: Truth | None = None,
    memory: Memory | None = None,
) -> GpsFixes:
    """Return the fixes of a receiver; with a latency, none before it has elapsed.

    Parameters
    ----------
    truth
        Truth of the IMU at the `fix_times`.
    errors
        The receiver's errors.
    draws
        Unit draws for as many fixes.
    seen
        Truth of the `antenna` as the same fixes report it; by default that of the IMU.
    memory
        Of the piece of fixes before, which is updated; without it, these are the first.
    """
    position_error, velocity_error = noise(truth.time, errors, draws, memory)
    if seen is not None:
        position_error = position_error + east_north_up(displacement(truth.position, seen.position))
        seen_n = ecef.resolved_near_pole(seen.velocity_n, seen.position, truth.position)
        velocity_error = velocity_error + east_north_up(seen_n - truth.velocity_n)
    position = displaced(truth.position, east_north_up(position_error))
    # A receiver resolves its velocity in north, east, down at its reported position.
    velocity_n = ecef.resolved_near_pole(
        truth.velocity_n + east_north_up(velocity_error), truth.position, position
    )
    keep = outside_outages(errors, truth.time) & (truth.time > errors.latency - 1e-9)
    return GpsFixes(
        truth.time[keep],
        position[keep],
        velocity_n[keep],
        position_error[keep],
        velocity_error[keep],
    )


def noise(
    times: FloatArray, errors: GpsErrors, draws: GpsDraws, memory: Memory | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the random errors of position [m] and velocity [m/s], (m, 3) each, east, north, up.

    Parameters
    ----------
    times : (m,) array
        Times of the fixes, one period apart [s].
    errors
        The receiver's errors.
    draws
        Unit draws for as many fixes.
    memory
        As of `measure`.
    """
    position = np.sqrt(si(errors, "position_variance")) * draws.position
    velocity = np.sqrt(si(errors, "velocity_variance")) * draws.velocity
    if any(errors.correlated_sigma) and times.size:
        position += drift(times, errors, draws, memory)
    if errors.quality_steps:
        factor = np.where(mask_within(errors.quality_steps, times), errors.quality_factor, 1.0)[:, None]
        position, velocity = factor * position, factor * velocity
    if errors.outlier_rate:
        # Outliers are the fixes with the lowest draws: a higher rate adds outliers and keeps the existing
        # ones.
        outlier = scipy.special.ndtr(draws.outlier) < errors.outlier_rate
        position = position + np.where(outlier[:, None], si(errors, "outlier_size") * draws.jump, 0.0)
    return position, velocity


def drift(times: FloatArray, errors: GpsErrors, draws: GpsDraws, memory: Memory | None = None) -> FloatArray:
    """Return the correlated position error (m, 3) of a good constellation, east, north, up [m].

    Parameters
    ----------
    times, errors, draws, memory
        As of `noise`.
    """
    if not times.size:
        return np.zeros((0, 3))
    decay = float(np.exp(-errors.period / si(errors, "correlation_time")))
    before = None if memory is None else memory.correlated
    process = processes.gauss_markov(draws.correlated[0], draws.correlated, decay, before)
    if memory is not None:
        memory.correlated = process[-1].copy()
    return np.asarray(si(errors, "correlated_sigma") * process)


def mask_within(intervals: Sequence[tuple[float, float]], times: FloatArray) -> NDArray[np.bool_]:
    """Return the mask of the times in any of the intervals, including their starts and ends."""
    inside = np.zeros(times.shape, dtype=np.bool_)
    for start, end in intervals:
        inside |= (times >= start) & (times <= end)
    return inside
