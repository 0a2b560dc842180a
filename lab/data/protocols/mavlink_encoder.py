"""MAVLink encoder: samples in HIGHRES_IMU and fixes in GPS_RAW_INT, by pymavlink; and a navigator's solution.

A solution is sent in HEARTBEAT, SYSTEM_TIME, ATTITUDE, GLOBAL_POSITION_INT, GLOBAL_POSITION_INT_COV and
VFR_HUD.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.parameters.units import GAUSS
from lab.data.protocols.mavlink import MISSING
from lab.data.protocols.samples import NO_FIX
from lab.data.protocols.sending import (
    FrameEncoder,
    known_fields,
    microseconds,
    round_to_bits,
    sent_fix,
    vector,
)
from lab.data.protocols.sent_solution import SentSolution

HEARTBEAT_PERIOD = 1.0
"""Time between two HEARTBEAT and SYSTEM_TIME [s], as ground stations expect them."""
_ALL_FIELDS = 0x1FFF  # fields_updated of HIGHRES_IMU: all thirteen
_ACTIVE = 4  # system_status of HEARTBEAT
_GPS_INS = 5  # estimator_type: GPS and an INS combined
_LARGEST_SINGLE = 3.4e38  # largest number in single precision, about
_UNKNOWN = 65_535  # value of an unknown 16-bit field of GPS_RAW_INT


class MavlinkEncoder(FrameEncoder):
    """Writes samples and fixes of system 1; NaN is sent as zero. Single precision rounds samples.

    Raises
    ------
    ImportError
        If pymavlink is not installed.
    """

    name = "mavlink"

    def __init__(self) -> None:
        self._link = _link_of_system_1()
        self._wheel: tuple[int, float, float] | None = None  # last time [µs], speed [m/s], distance [m]

    def encode_readings(self, reading: NDArray[np.void]) -> bytes:
        """Return headings in GPS2_RAW and speeds in WHEEL_DISTANCE, the distance of one wheel."""
        return b"".join(map(self._reading, reading))

    def _reading(self, row: np.void) -> bytes:
        packed, now = b"", microseconds(row["time"])
        if np.isfinite(row["heading"]):
            # 0 means unknown: north is 36,000.
            yaw = round(1e2 * math.degrees(row["heading"])) % 36_000 or 36_000
            unknown = (NO_FIX, 0, 0, 0, _UNKNOWN, _UNKNOWN, _UNKNOWN, _UNKNOWN, 255, 0, 0)
            spread = round(1e5 * math.degrees(known_fields(row, "heading_sigma")[0]))
            packed += self._pack_message(self._link.gps2_raw_encode(now, *unknown, yaw, hdg_acc=spread))
        if np.isfinite(row["speed"]):
            speed = float(row["speed"])
            before, slow, distance = self._wheel or (now, speed, 0.0)
            # A wheel counts its way: the speed is integrated by the trapezoidal rule.
            distance += (speed + slow) / 2 * (now - before) * 1e-6
            self._wheel = now, speed, distance
            packed += self._pack_message(self._link.wheel_distance_encode(now, 1, [distance, *[0.0] * 15]))
        return packed

    def _sample(self, row: np.void) -> bytes:
        temperature, pressure = known_fields(row, "temperature", "pressure")
        message = self._link.highres_imu_encode(
            microseconds(row["time"]), *vector(row, "force"), *vector(row, "rate"),
            *vector(row, "magnetic", GAUSS), pressure / 100, 0.0, 0.0, temperature, _ALL_FIELDS,
        )  # fmt: skip
        return self._pack_message(message)

    def _fix(self, row: np.void) -> bytes:
        fix = sent_fix(row)
        moving = np.isfinite(row["velocity_n"][:2]).all()
        height = round(1e3 * fix.height)
        message = self._link.gps_raw_int_encode(
            microseconds(row["time"]), max(fix.kind, NO_FIX), round(1e7 * fix.latitude),
            round(1e7 * fix.longitude), height, _UNKNOWN, _UNKNOWN,
            min(round(1e2 * fix.speed), _UNKNOWN - 1) if moving else _UNKNOWN,
            round(1e2 * fix.course) if moving else _UNKNOWN,
            fix.satellites if row["satellites"] >= 0 else 255, 0 if row["sea_level"] else height,
            round(1e3 * fix.horizontal_sigma), round(1e3 * fix.vertical_sigma), round(1e3 * fix.speed_sigma),
        )  # fmt: skip
        return self._pack_message(message)

    def _pack_message(self, message: object) -> bytes:
        return _pack_by_link(self._link, message)


class MavlinkSolution:
    """Writes solutions as the autopilot of system 1 does.

    Heights of these messages are above sea level, and no value of theirs stands for an unknown one: where it
    is not known, messages with a position are left out.

    Raises
    ------
    ImportError
        If pymavlink is not installed.
    """

    def __init__(self) -> None:
        self._link = _link_of_system_1()
        self._begun = self._beaten = math.nan
        self._home = math.nan

    def written(self, solution: SentSolution) -> bytes:
        """Return the messages of a solution; HEARTBEAT and SYSTEM_TIME once a second."""
        if not solution.time >= self._begun:  # the first one, or the clock was set back
            self._begun, self._beaten = solution.time, -math.inf
        # 32 bits of milliseconds begin anew after 49 days.
        link, boot = self._link, round(1e3 * (solution.time - self._begun)) % 2**32
        messages = []
        if solution.time - self._beaten >= HEARTBEAT_PERIOD:
            self._beaten = solution.time
            messages.append(link.heartbeat_encode(0, 0, 0, 0, _ACTIVE))  # a generic vehicle, in no mode
            messages.append(link.system_time_encode(microseconds(solution.utc), boot))
        if solution.has_attitude:
            roll, pitch, heading = np.radians(solution.euler).tolist()
            yaw = (heading + math.pi) % (2 * math.pi) - math.pi if solution.has_heading else math.nan
            rates = _limit_to_single(np.radians(solution.rate))
            messages.append(link.attitude_encode(boot, roll, pitch, yaw, *rates))
        if solution.has_position and math.isfinite(solution.sea_height):
            messages += self._place(solution, boot)
        return b"".join(_pack_by_link(link, message) for message in messages)

    def _place(self, solution: SentSolution, boot: int) -> list[object]:
        link, sea = self._link, solution.sea_height
        if math.isnan(self._home):
            self._home = sea
        place = round(1e7 * solution.latitude), round(1e7 * solution.longitude)
        heights = round_to_bits(1e3 * sea, 32), round_to_bits(1e3 * (sea - self._home), 32)
        has_heading = solution.has_attitude and solution.has_heading
        heading = float(solution.euler[2]) % 360
        messages = []
        north, east, down = solution.velocity_n.tolist()
        if math.isfinite(north + east + down):
            yaw = round(100 * heading) % 36_000 if has_heading else _UNKNOWN
            speeds = (round_to_bits(100 * one) for one in (north, east, down))
            messages.append(link.global_position_int_encode(boot, *place, *heights, *speeds, yaw))
            course = round(heading) % 360 if has_heading else 0
            speed, height, climb = _limit_to_single(np.array([solution.speed, sea, -down]))
            messages.append(link.vfr_hud_encode(math.nan, speed, course, 0, height, climb))
        covariance = np.full((6, 6), np.nan)
        covariance[:3, :3] = solution.position_covariance
        covariance[range(3, 6), range(3, 6)] = solution.velocity_sigma**2
        velocity = _limit_to_single(solution.velocity_n)
        utc, flat = microseconds(solution.utc), _limit_to_single(covariance.ravel())
        messages.append(link.global_position_int_cov_encode(utc, _GPS_INS, *place, *heights, *velocity, flat))
        return messages


def _link_of_system_1() -> Any:
    try:
        from pymavlink.dialects.v20 import ardupilotmega as dialect  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise ImportError(MISSING) from error
    return dialect.MAVLink(None, srcSystem=1, srcComponent=1)


def _limit_to_single(values: FloatArray) -> list[float]:
    """Return numbers that fit into single precision."""
    return np.clip(values, -_LARGEST_SINGLE, _LARGEST_SINGLE).tolist()  # type: ignore[no-any-return]


def _pack_by_link(link: Any, message: Any) -> bytes:
    packed = message.pack(link)
    link.seq = (link.seq + 1) % 256
    return bytes(packed)
