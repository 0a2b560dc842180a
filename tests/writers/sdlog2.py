"""PX4's sdlog2, byte by byte: 50 times a second the time, then IMU, attitude and solution; the GPS when new.

Positions to 1e-7°, all else in single precision, height above the sea.
"""

from __future__ import annotations

import struct

import numpy as np

from lab.missions import Recording
from lab.motion.frames.rotation import euler_from_quaternion
from writers.ardupilot import CODES
from writers.autopilot import GPS_DELAY, GPS_SIGMA, sensed, solution

BOOT = 60_566_517
"""Time since boot at which the flight begins [µs]."""
RATE = 50.0
FORMATS = {
    "TIME": (129, "Q", "StartTime"),
    "PARM": (131, "Nf", "Name,Value"),
    "ATT": (2, "fffffffffffff", "qw,qx,qy,qz,Roll,Pitch,Yaw,RollRate,PitchRate,YawRate,GX,GY,GZ"),
    "IMU": (4, "ffffffffffff", "AccX,AccY,AccZ,GyroX,GyroY,GyroZ,MagX,MagY,MagZ,tA,tG,tM"),
    "GPS": (8, "QBffLLfffffBHHH", "GPSTime,Fix,EPH,EPV,Lat,Lon,Alt,VelN,VelE,VelD,Cog,nSat,SNR,N,J"),
    "GPOS": (16, "LLfffffff", "Lat,Lon,Alt,VelN,VelE,VelD,EPH,EPV,TALT"),
}
PARAMETERS = {"MAV_TYPE": 1.0, "PE_POS_DELAY_MS": 1000 * GPS_DELAY}


def message(name: str, *values: object) -> bytes:
    """Return a message."""
    number, letters, _ = FORMATS[name]
    return struct.pack("<3B" + "".join(CODES[letter] for letter in letters), 0xA3, 0x95, number, *values)


def descriptions() -> bytes:
    """Return the messages that describe the others: not themselves, as sdlog2 has it."""
    return b"".join(
        b"\xa3\x95\x80" + struct.pack(
            "<BB4s16s64s", number, 3 + struct.calcsize("<" + "".join(CODES[letter] for letter in letters)),
            name.encode(), letters.encode(), columns.encode(),
        )
        for name, (number, letters, columns) in FORMATS.items()
    )  # fmt: skip


def place(position: np.ndarray) -> tuple[int, int, float]:
    """Return latitude and longitude [1e-7°] and height [m]."""
    return round(1e7 * np.degrees(position[0])), round(1e7 * np.degrees(position[1])), position[2]


def write(recording: Recording) -> bytes:
    """Return the log of a flight."""
    out = [descriptions(), *(message("PARM", name.encode(), value) for name, value in PARAMETERS.items())]
    known, seen = solution(recording, RATE), sensed(recording, RATE)
    euler = euler_from_quaternion(known.q_nb)
    fix = 0
    for i, at in enumerate(known.time):
        out.append(message("TIME", BOOT + round(1e6 * at)))
        if 0 < i <= len(seen.rates):
            out.append(message("IMU", *seen.rates[i - 1, 3:], *seen.rates[i - 1, :3], *[0.0] * 6))
        out.append(message("ATT", *known.q_nb[i], *euler[i], *[0.0] * 6))
        out.append(message("GPOS", *place(known.position[i]), *known.velocity_n[i], 0.5, 0.5, 0.0))
        if fix < len(seen.gps_time) and seen.gps_time[fix] <= at:
            fields = (3, GPS_SIGMA[0], GPS_SIGMA[0], *place(seen.gps_position[fix]), *seen.gps_velocity[fix])
            out.append(message("GPS", 1_468_479_192_307_000 + BOOT, *fields, 0.0, 12, 0, 0, 0))
            fix += 1
    return b"".join(out)
