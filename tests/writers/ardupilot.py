"""ArduPilot DataFlash log, byte by byte: attitude, filter and position 25 times a second, IMU 50, GPS 5.

Attitude to 0.01°, positions to 1e-7°, the filter's velocities in single precision.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable

import numpy as np

from lab.missions import Recording
from lab.motion.frames.rotation import euler_from_quaternion
from writers.autopilot import GPS_DELAY, GPS_SIGMA, LEVER_ARM, sensed, solution

BOOT = 23_456_789
"""Time since boot at which the flight begins [µs]."""
GEOID = -31.4
UNDULATION = -GEOID
"""What ArduPilot calls so: the height of the ellipsoid over the geoid [m]."""
MARKS = b"\xa3\x95"
IMU_RATE = 50.0
FORMATS = {
    "FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns"),
    "PARM": (64, "QNff", "TimeUS,Name,Value,Default"),
    "MSG": (91, "QZ", "TimeUS,Message"),
    "GPS": (66, "QBBIHBcLLeffffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U"),
    "GPA": (67, "QBCCCCfBIHf", "TimeUS,I,VDop,HAcc,VAcc,SAcc,YAcc,VV,SMS,Delta,Und"),
    "IMU": (68, "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"),
    "ATT": (69, "QccccCCCCB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw,AEKF"),
    "XKF1": (70, "QBccCfffffffccce", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,GX,GY,GZ,OH"),
    "POS": (71, "QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt"),
    "RCIN": (72, "Qa", "TimeUS,Data"),
}
CODES = {
    "a": "64s", "b": "b", "B": "B", "h": "h", "H": "H", "i": "i", "I": "I", "f": "f", "d": "d", "n": "4s",
    "N": "16s", "Z": "64s", "c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "M": "B", "q": "q", "Q": "Q",
}  # fmt: skip
PARAMETERS = {
    "GPS1_DELAY_MS": 1000 * GPS_DELAY,
    "GPS1_POS_X": LEVER_ARM[0],
    "GPS1_POS_Y": LEVER_ARM[1],
    "GPS1_POS_Z": LEVER_ARM[2],
}


def packer(name: str) -> struct.Struct:
    """Return what packs a message of a name, its header included."""
    return struct.Struct("<3B" + "".join(CODES[letter] for letter in FORMATS[name][1]))


def message(name: str, *values: object) -> bytes:
    """Return a message."""
    return packer(name).pack(0xA3, 0x95, FORMATS[name][0], *values)


def descriptions() -> bytes:
    """Return the messages that describe the others."""
    return b"".join(
        message("FMT", number, packer(name).size, name.encode(), letters.encode(), columns.encode())
        for name, (number, letters, columns) in FORMATS.items()
    )


def write(recording: Recording, undulation: float = UNDULATION) -> bytes:
    """Return the log of a flight."""
    messages: list[tuple[int, bytes]] = []

    def add(name: str, rows: Iterable[tuple]) -> None:
        pack, number = packer(name).pack, FORMATS[name][0]
        messages.extend((row[0], pack(0xA3, 0x95, number, *row)) for row in rows)

    def stamps(time: np.ndarray) -> list[int]:
        return (BOOT + np.rint(time * 1e6).astype(np.int64)).tolist()

    known = solution(recording, 25.0)
    times = stamps(known.time)
    euler = np.degrees(euler_from_quaternion(known.q_nb))
    euler[:, 2] %= 360
    centi = np.rint(100 * euler).astype(int)
    centi[:, 2] %= 36_000
    add("ATT", ((t, 0, r, 0, p, 0, y, 0, 0, 3) for t, (r, p, y) in zip(times, centi.tolist(), strict=True)))
    add("XKF1", (
        (t, 0, r, p, y, *v, 0.0, 0.0, 0.0, 0.0, 0, 0, 0, 0)
        for t, (r, p, y), v in zip(times, centi.tolist(), known.velocity_n.tolist(), strict=True)
    ))  # fmt: skip
    where = np.rint(np.degrees(np.column_stack((known.latitude, known.longitude))) * 1e7).astype(int)
    add("POS", (
        (t, lat, lon, height - GEOID, 0.0, 0.0)
        for t, (lat, lon), height in zip(times, where.tolist(), known.height.tolist(), strict=True)
    ))  # fmt: skip
    seen = sensed(recording, IMU_RATE)
    add("IMU", (
        (t, 0, *rates, 0, 0, 35.0, 1, 1, 1000, 1000)
        for t, rates in zip(stamps(seen.imu_time), seen.rates.tolist(), strict=True)
    ))  # fmt: skip
    fixes = np.rint(np.degrees(seen.gps_position[:, :2]) * 1e7).astype(int).tolist()
    heights = np.rint(100 * (seen.gps_position[:, 2] - GEOID)).astype(int).tolist()
    north, east, down = seen.gps_velocity.T
    course = np.degrees(np.arctan2(east, north)) % 360
    times = stamps(seen.gps_time)
    add("GPS", (
        (t, 0, 3, 0, 2300, 14, 70, lat, lon, height, speed, angle, vertical, 0.0, 1)
        for t, (lat, lon), height, speed, angle, vertical in zip(
            times, fixes, heights, np.hypot(north, east).tolist(), course.tolist(), down.tolist(), strict=True
        )
    ))  # fmt: skip
    sigma = [round(100 * one) for one in (GPS_SIGMA[0], GPS_SIGMA[0], GPS_SIGMA[1])]
    add("GPA", ((t + 20, 0, 120, *sigma, 0.0, 1, t // 1000, 200, undulation) for t in times))
    messages.sort(key=lambda one: one[0])
    start = [message("MSG", BOOT, b"ArduPlane V4.5.1 (0a1b2c3d)")]
    start += [message("PARM", BOOT, name.encode(), value, 0.0) for name, value in PARAMETERS.items()]
    start.append(message("RCIN", BOOT, bytes(64)))
    return descriptions() + b"".join(start) + b"".join(one for _, one in messages)


WEEK_MS, WEEK = 130_040_903, 1769
"""GPS time at which the flight begins."""
BUS_DELAY = 0.07
"""How long after a fix is valid its message is written [s]."""
IMU_FIELDS, ATT_FIELDS = "GyrX,GyrY,GyrZ,AccX,AccY,AccZ", "RollIn,Roll,PitchIn,Pitch,YawIn,Yaw"
OLD_FORMATS = {
    2012: {
        "GPS": (130, "BIBcLLeeEe", "Status,Time,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs"),
        "IMU": (131, "ffffff", IMU_FIELDS),
        "ATT": (1, "cccccC", ATT_FIELDS),
    },
    2013: {
        "GPS": (130, "BIHBcLLeeEe", "Status,TimeMS,Week,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs"),
        "IMU": (131, "Iffffff", f"TimeMS,{IMU_FIELDS}"),
        "ATT": (1, "IcccccC", f"TimeMS,{ATT_FIELDS}"),
    },
    2014: {
        "GPS": (130, "BIHBcLLeeEefI", "Status,TimeMS,Week,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs,VZ,T"),
        "IMU": (131, "Iffffff", f"TimeMS,{IMU_FIELDS}"),
        "ATT": (1, "IcccccC", f"TimeMS,{ATT_FIELDS}"),
        "EKF1": (140, "IccCffffffccc", "TimeMS,Roll,Pitch,Yaw,VN,VE,VD,PN,PE,PD,GX,GY,GZ"),
    },
}
"""Messages of the logs of a year: times in milliseconds since boot, of the GPS week, or none."""


def write_old(recording: Recording, year: int, status: int = 3) -> bytes:
    """Return the log that an autopilot of 2012, 2013 or 2014 would have written."""
    formats = OLD_FORMATS[year]
    packers = {
        name: struct.Struct("<3B" + "".join(CODES[letter] for letter in letters))
        for name, (_, letters, _) in formats.items()
    }
    out: list[tuple[float, bytes]] = []

    def add(name: str, at: float, *values: object) -> None:
        values = values if "Time" not in formats[name][2][:5] else (BOOT // 1000 + int(1000 * at), *values)
        out.append((at, packers[name].pack(0xA3, 0x95, formats[name][0], *values)))

    known = solution(recording, 25.0)
    euler = np.degrees(euler_from_quaternion(known.q_nb))
    euler[:, 2] %= 360
    for at, (roll, pitch, yaw), velocity in zip(known.time, euler, known.velocity_n, strict=True):
        centi = (round(100 * roll), round(100 * pitch), round(100 * yaw) % 36_000)
        add("ATT", at, 0, centi[0], 0, centi[1], 0, centi[2])
        if "EKF1" in formats:
            add("EKF1", at, *centi, *velocity, 0.0, 0.0, 0.0, 0, 0, 0)
    seen = sensed(recording, IMU_RATE)
    for at, rates in zip(seen.imu_time, seen.rates, strict=True):
        add("IMU", at, *rates)
    north, east, down = seen.gps_velocity.T
    course = np.degrees(np.arctan2(east, north)) % 360
    for i, at in enumerate(seen.gps_time):
        place = [round(1e7 * np.degrees(angle)) for angle in seen.gps_position[i, :2]]
        height = round(100 * (seen.gps_position[i, 2] - GEOID))
        week = WEEK_MS + round(1000 * at)
        values = [status, week, WEEK, 10, 70, *place, 0, height, round(100 * np.hypot(north[i], east[i])),
                  round(100 * course[i])]  # fmt: skip
        if year == 2012:
            del values[2]
        if year == 2014:
            values += [down[i], BOOT // 1000 + round(1000 * (at + BUS_DELAY))]
        out.append((at + BUS_DELAY, packers["GPS"].pack(0xA3, 0x95, 130, *values)))
    out.sort(key=lambda one: one[0])
    start = b"".join(
        message("FMT", number, packers[name].size, name.encode(), letters.encode(), columns.encode())
        for name, (number, letters, columns) in formats.items()
    )
    return start + b"".join(one for _, one in out)
