"""Live log: timed samples as a sensor log, for the batch and for the library of missions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lab.base.aid_table import SENT, SERIES
from lab.base.arrays import FloatArray
from lab.data.clock.faults import increasing
from lab.data.clock.timed_samples import NO_READINGS
from lab.data.log.auxiliary_data import AuxiliaryData, Headings, Magnetometer, Series
from lab.data.log.pressure_height import Heights
from lab.data.log.sensor_log import GnssLog, SensorLog, believed_sigma, repair_log
from lab.data.log.spikes import stream_spikes
from lab.data.protocols.samples import FIX_3D, UNSENT

MICROTESLA = 1e6
"""Microtesla per tesla: logs have the field in µT."""


def make_log(
    name: str,
    imu: NDArray[np.void],
    fixes: NDArray[np.void],
    lever_arm: FloatArray | None = None,
    latency: float = 0.0,
    vehicle: str = "",
    readings: NDArray[np.void] = NO_READINGS,
) -> SensorLog:
    """Return timed samples as a sensor log, repaired.

    Rows of the IMU without time, rate or force, rows that are not later than all before, and fixes without a
    position in three dimensions are left out, and spikes are found, as by the live navigator.

    Parameters
    ----------
    name
        The source, for messages.
    imu : (n,) array of `lab.data.clock.timed_samples.TIMED_IMU`
        Rows of the IMU, in b.
    fixes : (m,) array of `lab.data.clock.timed_samples.TIMED_FIX`
        Fixes of the antenna.
    lever_arm : (3,) array
        From the IMU to the antenna, in b; zero if it is left out [m].
    latency
        How much later than the fixes their times are [s].
    vehicle
        Name of the vehicle, as in `lab.data.log.vehicle.VEHICLES`; empty if unknown.
    readings : (k,) array of `lab.data.clock.timed_samples.TIMED_READING`
        Headings and speeds.

    Raises
    ------
    MissionError
        If IMU and receiver have too little in common.
    """
    imu = imu[usable_imu(imu)]
    imu = imu[increasing(imu["time"])]
    fixes = fixes[usable_fixes(fixes)]
    fixes = fixes[increasing(fixes["time"])]
    headings = readings[np.isfinite(readings["heading"])]
    barometer = make_barometer(imu, fixes)
    series = {} if barometer is None else {"barometer": barometer}
    auxiliary = AuxiliaryData.of_series(
        series | make_series(readings),
        vehicle=vehicle,
        magnetometer=make_magnetometer(imu["time"], imu["magnetic"]),
        headings=make_headings(headings["time"], headings["heading"], headings["heading_sigma"]),
    )
    return repair_log(
        name,
        imu["time"].copy(),
        np.concatenate((imu["rate"], imu["force"]), axis=1),
        make_gnss_log(fixes, lever_arm, latency),
        auxiliary=auxiliary,
        find_spikes=stream_spikes,
    )


def make_barometer(imu: NDArray[np.void], fixes: NDArray[np.void]) -> Series | None:
    """Return the heights by pressure as those of a log; None without pressures or fixes.

    Parameters
    ----------
    imu, fixes
        As of `make_log`, without the rows that are left out.
    """
    heights = Heights()
    time, height = heights.accept(imu)
    if not time.size or not fixes.size:
        return None
    heights.begin_at(float(fixes["time"][0]), float(fixes["height"][0]), time, height)
    return Series(time, height + heights.shift)


def make_gnss_log(
    fixes: NDArray[np.void], lever_arm: FloatArray | None = None, latency: float = 0.0
) -> GnssLog:
    """Return fixes as those of a log; arguments as of `make_log`."""
    level, up, speed = (
        believed_sigma(fixes[name]) for name in ("horizontal_sigma", "vertical_sigma", "speed_sigma")
    )
    return GnssLog(
        time=fixes["time"].copy(),
        position=np.stack([fixes[name] for name in ("latitude", "longitude", "height")], axis=-1),
        velocity_n=np.where(np.isfinite(fixes["velocity_n"]), fixes["velocity_n"], np.nan),
        position_sigma=np.stack((level, level, up), axis=-1),
        velocity_sigma=np.stack((speed, speed, speed), axis=-1),
        lever_arm=np.zeros(3) if lever_arm is None else np.array(lever_arm, dtype=np.float64),
        latency=latency,
    )


def make_magnetometer(time: FloatArray, magnetic: FloatArray) -> Magnetometer | None:
    """Return the measured field as that of a log; None if there is none.

    Parameters
    ----------
    time : (n,) array
        Times [s].
    magnetic : (n, 3) array
        Field in b [T]; NaN, or zero in all axes, where it was not measured.
    """
    # Column by column: this takes a third of the time of `all(axis=1)`, and the live navigator asks often.
    x, y, z = magnetic.T
    rows = np.isfinite(x) & np.isfinite(y) & np.isfinite(z)
    rows &= (x != 0) | (y != 0) | (z != 0)  # a device without a magnetometer may send zeros
    if not rows.any():
        return None
    return Magnetometer(time[rows].copy(), magnetic[rows] * MICROTESLA)


def make_series(readings: NDArray[np.void]) -> dict[str, Series]:
    """Return speeds [m/s] and other readings in the order of their times, by the names of the aid table."""
    found = {}
    for aid in SENT:
        rows = readings[np.isfinite(readings[aid.live])]
        if aid in SERIES and rows.size:
            found[aid.name] = Series(rows["time"].copy(), rows[aid.live].copy())
    return found


def make_headings(time: FloatArray, heading: FloatArray, sigma: FloatArray) -> Headings | None:
    """Return headings (k,) and their σ (k,) [rad] at times (k,) [s] as those of a log; None without any."""
    if not time.size:
        return None
    return Headings(time.copy(), heading.copy(), sigma.copy())


def usable_imu(imu: NDArray[np.void]) -> NDArray[np.bool_]:
    """Return the mask (n,) of the rows with time, rate and force."""
    good = np.isfinite(imu["time"]) & np.isfinite(imu["rate"]).all(axis=1)
    return np.asarray(good & np.isfinite(imu["force"]).all(axis=1))


def usable_fixes(fixes: NDArray[np.void]) -> NDArray[np.bool_]:
    """Return the mask (m,) of the fixes with a time and a position in three dimensions.

    A fix whose type the device does not send, -1, is used if it has a position.
    """
    good = np.isfinite(fixes["time"]) & np.isfinite(fixes["longitude"]) & np.isfinite(fixes["height"])
    good &= np.abs(fixes["latitude"]) <= np.pi / 2  # NaN is not
    return np.asarray(good & ((fixes["fix_type"] >= FIX_3D) | (fixes["fix_type"] == UNSENT)))
