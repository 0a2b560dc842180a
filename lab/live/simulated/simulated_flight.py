"""Simulated flight: what a device on a mission would send, and the truth behind it."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.base.aid_table import SENT
from lab.base.parameters.units import si
from lab.data.clock.timed_samples import TIMED_FIX, TIMED_IMU
from lab.data.log.pressure_height import pressure_at
from lab.data.log.vehicle import UNKNOWN, vehicle_of
from lab.data.protocols.samples import FIX, FIX_3D, IMU, NO_READINGS, READING
from lab.data.streams.axis_map import AxisMap
from lab.data.streams.transport import TransportError
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.missions import mission
from lab.missions.log_mission import LogMission
from lab.motion.frames.magnetic_field import magnetic_field
from lab.motion.frames.rotation import euler_from_quaternion, wrap
from lab.motion.recordings.flight_csv import write_flight_csv
from lab.motion.recordings.recording import Recording
from lab.navigation.alignment import limits
from lab.sensors.cards import card
from lab.sensors.gps import GpsErrors, GpsFixes
from lab.sensors.readings import read, slow_error

REST = "rest"
"""Name of the flight that never leaves: a table at 45° north, with the device heading north-east."""
_PLACE = (np.radians(45.0), np.radians(7.5), 200.0)  # latitude, longitude [rad], height [m]
_EULER = np.radians((2.0, -3.0, 40.0))  # roll, pitch, heading: a table is never level
MICROTESLA = 1e-6
"""A microtesla [T], the unit of the World Magnetic Model."""
_STANDS = 0.5
"""Speed below which a flight begins at rest, so that a rest can go before it [m/s]."""
_STANDS_STILL = 0.02
"""Speed up to which a vehicle stands still, as far as the navigator can tell [m/s]."""
_STEP = 0.1
"""Interval of the samples of a rest in a recording [s]."""
USUAL_REST = 600.0
"""Time for which a device on a table stands still, if nothing says how long [s]."""
_LEAST_REST = 1.0
"""Shortest flight recording of a device that rests [s]: a curve needs a few samples."""
_WEEK_TIME = 432_018.0
"""Time of the week of GPS at the start [s]: Friday, 0:00:18, since GPS is 18 s ahead of UTC."""
_UTC = 1_767_312_000.0
"""Time at the start since 1970 [s]: Friday, 2 January 2026, 0:00."""
_SATELLITES = 12
"""Satellites that the simulated receiver claims to use: plenty."""


@dataclass(frozen=True, eq=False)
class SimulatedFlight:
    """Samples of a simulated device.

    Attributes
    ----------
    imu : (n,) array of `lab.data.protocols.samples.IMU`
        Samples in the axes of the device, with times from the start [s].
    fix : (m,) array of `lab.data.protocols.samples.FIX`
        Fixes; ``time`` is that of validity [s].
    rate : float
        Samples of the IMU per second [Hz].
    result : Result
        The simulation: truth, errors of the sensors, and the navigator of the batch.
    reading : (k,) array of `lab.data.protocols.samples.READING`
        Headings and speeds of the sensors that are fitted; ``time`` is that of validity [s].
    """

    imu: NDArray[np.void]
    fix: NDArray[np.void]
    rate: float
    result: Result
    reading: NDArray[np.void] = field(default_factory=lambda: NO_READINGS)

    @classmethod
    def of(
        cls,
        name: str,
        rate: float,
        *,
        sensor: str = "",
        seed: int = 1,
        rest: float = 0.0,
        settings: Mapping[str, Any] | None = None,
        axes: AxisMap | None = None,
        assignments: Sequence[str] = (),
    ) -> SimulatedFlight:
        """Simulate a mission with a sensor card.

        Parameters
        ----------
        name
            The mission, or `REST` for a device that stands still for the time `rest`.
        rate
            Samples of the IMU per second [Hz].
        sensor
            A card; empty for the default sensors.
        seed
            Of all random numbers.
        rest
            Time at rest before the flight [s]; the flight must begin at rest.
        settings
            Further settings of the experiment.
        axes
            How the device is mounted.
        assignments
            Further settings as ``path=value``.

        Raises
        ------
        TransportError
            If the mission is a sensor log, or does not begin at rest and a rest is asked for.
        MissionError, SettingError, ValueError
            If mission, card or settings are not accepted.
        """
        with tempfile.TemporaryDirectory(prefix="ins-lab-") as folder:
            experiment = Experiment(mission=_mission(name, rest, Path(folder)), seed=seed)
            if sensor:
                card(sensor).load(experiment)
            experiment.set("trajectory.imu_rate", rate)
            experiment.update(dict(settings or {}))
            experiment.set_texts(assignments)
            return cls._from_result(experiment.run(), rate, axes or AxisMap())

    def timed(self) -> tuple[NDArray[np.void], NDArray[np.void]]:
        """Return samples and fixes as a source without delay would have them: `TIMED_IMU` and `TIMED_FIX`."""
        tables = []
        for rows, kind in ((self.imu, TIMED_IMU), (self.fix, TIMED_FIX)):
            table = np.zeros(len(rows), kind)
            for name in set(rows.dtype.names or ()) & set(kind.names or ()):
                table[name] = rows[name]
            table["arrival"] = rows["time"]
            tables.append(table)
        return tables[0], tables[1]

    @cached_property
    def vehicle(self) -> str:
        """The vehicle that carries the device: an aeroplane, or unknown if it does not go as its nose points.

        A device that is built into a vehicle knows it: without it, a course would first have to be
        compared with the acceleration for 20 s.
        """
        truth = self.result.truth_arrays
        assert truth is not None  # of a simulation
        moves = np.linalg.norm(truth.velocity_n[:, :2], axis=1) > limits.ALIGNMENT.rest_speed
        north, east = truth.velocity_n[moves, :2].T
        slip = wrap(np.arctan2(east, north) - euler_from_quaternion(truth.q_nb[moves])[:, 2])
        known = vehicle_of("aeroplane")
        return known.name if moves.any() and np.sqrt(np.mean(slip**2)) <= known.sideslip else UNKNOWN

    @classmethod
    def _from_result(cls, result: Any, rate: float, axes: AxisMap) -> SimulatedFlight:
        dt = 1 / rate
        imu = imu_rows(
            result.truth_arrays.time[1:],
            result.gyro.increments / dt,
            result.accelerometer.increments / dt,
            axes,
        )
        _measure_pressure(imu, result)
        _measure_field(imu, result, axes)
        fix = fix_rows(result.fixes, result.experiment.sensors.gps)
        return cls(imu, fix, rate, result, reading_rows(result))


def imu_rows(
    time: NDArray[np.float64], rate: NDArray[np.float64], force: NDArray[np.float64], axes: AxisMap
) -> NDArray[np.void]:
    """Return samples (n,) of `lab.data.protocols.samples.IMU` as a device sends them.

    Parameters
    ----------
    time : (n,) array
        Times by the clock of the device [s].
    rate, force : (n, 3) arrays
        Angular rate [rad/s] and specific force [m/s²] forward, right, down.
    axes
        How the device is mounted.
    """
    imu = np.zeros(len(time), IMU)
    imu["time"], imu["count"] = time, -1
    imu["rate"] = axes.unmapped(rate)
    imu["force"] = axes.unmapped(force, force=True)
    imu["magnetic"] = imu["pressure"] = np.nan
    imu["temperature"] = 25.0
    return imu


def _measure_pressure(imu: NDArray[np.void], result: Result) -> None:
    """Write the pressures that a barometer measures, with the errors in the settings, in each sample."""
    errors, time = result.experiment.sensors.barometer, result.time[1:]
    seed = result.experiment.seed
    bias = slow_error(errors, seed, "barometer", time)
    height = result.known_truth("pressures").height[1:]
    found = read(seed, "barometer", time, height, bias, float(errors.noise), errors.outages)
    imu["pressure"][np.searchsorted(time, found.time)] = pressure_at(found.value)


def _measure_field(imu: NDArray[np.void], result: Result, axes: AxisMap) -> None:
    """Write the fields of a magnetometer, if the settings have one, in the samples of its readings."""
    found, truth = result.readings.get("heading"), result.truth_arrays
    if found is None or truth is None or not found.field.size:
        return
    strength = np.linalg.norm(magnetic_field(truth.position[0])) * MICROTESLA
    imu["magnetic"][np.searchsorted(result.time[1:], found.time)] = strength * axes.unmapped(found.field)


def reading_rows(result: Result) -> NDArray[np.void]:
    """Return headings and speeds (k,) of `lab.data.protocols.samples.READING` in the order of their times.

    Parameters
    ----------
    result
        The simulation; a magnetometer's headings are none.
    """
    parts = [np.empty(0, READING)]
    for aid in SENT:
        found, name = result.readings.get(aid.name), aid.live
        if found is None or found.field.size:
            continue
        rows = np.zeros(found.time.size, READING)
        rows["time"], rows["week_time"], rows["utc"] = (zero + found.time for zero in (0.0, _WEEK_TIME, _UTC))
        for unknown in (*(one.live for one in SENT), "heading_sigma"):
            rows[unknown] = np.nan
        rows[name] = found.value
        if name == "heading":
            rows["heading_sigma"] = si(result.experiment.sensors.heading, "noise")
        parts.append(rows)
    made = np.concatenate(parts)
    return np.asarray(made[np.argsort(made["time"], kind="stable")])


def fix_rows(fixes: GpsFixes, errors: GpsErrors) -> NDArray[np.void]:
    """Return fixes (m,) of `lab.data.protocols.samples.FIX` with the σ that the errors of a receiver have."""
    fix = np.zeros(len(fixes.time), FIX)
    fix["time"] = fixes.time
    fix["week_time"], fix["utc"] = _WEEK_TIME + fixes.time, _UTC + fixes.time
    fix["latitude"], fix["longitude"], fix["height"] = fixes.position.T
    fix["velocity_n"] = fixes.velocity_n
    east, north, up = errors.position_variance
    fix["horizontal_sigma"], fix["vertical_sigma"] = np.sqrt((east + north) / 2), np.sqrt(up)
    fix["speed_sigma"] = np.sqrt(np.mean(errors.velocity_variance))
    fix["satellites"], fix["fix_type"] = _SATELLITES, FIX_3D
    return fix


def _mission(name: str, rest: float, folder: Path) -> str:
    """Return the mission with a rest before it: its name, or the path of a recording made for it."""
    if name == REST:
        return _write_recording(_record_standing_device(max(rest, _LEAST_REST)), folder)
    found = mission(name)
    if isinstance(found, LogMission):
        raise TransportError(
            f"{name}: is a sensor log; accepted are missions with a flight recording; `ins-lab live` plays "
            "raw recordings with replay:FILE"
        )
    if not rest:
        return name
    recording = found.recording
    speed = float(np.linalg.norm(recording.velocity_n[0]))
    if speed > _STANDS:
        raise TransportError(
            f"{name}: begins at {speed:.0f} m/s, so no rest can go before it; accepted is rest=0"
        )
    return _write_recording(_after_rest(recording, rest), folder)


def missing_rest(name: str, wanted: float) -> float:
    """Return the rest that a mission lacks at its start; none can go before one that begins in motion [s].

    Parameters
    ----------
    name
        The mission.
    wanted
        The rest that it should have [s].
    """
    found = mission(name)
    if isinstance(found, LogMission):
        return 0.0
    speed = np.linalg.norm(found.recording.velocity_n, axis=1)
    if speed[0] > _STANDS:
        return 0.0
    moves = np.append(np.flatnonzero(speed > _STANDS_STILL), len(speed) - 1)[0]
    own = float(found.recording.time[moves] - found.recording.time[0])
    return max(round(wanted - own, 1), 0.0)


def _record_standing_device(seconds: float) -> Recording:
    """Return the recording of a device on a table."""
    time = np.arange(0.0, seconds + _STEP / 2, _STEP)
    alike = np.ones_like(time)
    latitude, longitude, height = _PLACE
    return Recording(
        time=time,
        latitude=latitude * alike,
        longitude=longitude * alike,
        height=height * alike,
        velocity_n=np.zeros((time.size, 3)),
        euler=np.tile(_EULER, (time.size, 1)),
    )


def _after_rest(recording: Recording, seconds: float) -> Recording:
    """Return a recording that stands still where it begins, and then is the given one."""
    before = np.arange(0.0, seconds - _STEP / 2, _STEP)
    rows = np.zeros(before.size, dtype=int)
    values = {
        name: np.concatenate((value[rows], value))
        for name in ("latitude", "longitude", "height", "euler")
        for value in (getattr(recording, name),)
    }
    velocity_n = np.concatenate((np.zeros((before.size, 3)), recording.velocity_n))
    time = np.concatenate((before, recording.time - recording.time[0] + seconds))
    return Recording(time=time, velocity_n=velocity_n, **values)


def _write_recording(recording: Recording, folder: Path) -> str:
    path = folder / "flight.csv"
    write_flight_csv(path, recording)
    return str(path)
