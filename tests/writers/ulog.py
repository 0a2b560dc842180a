"""PX4 ULog, byte by byte as published: attitude 50 times a second, position and velocity 10, IMU 200, GPS 5.

Angles and velocities are single precision, positions of the estimator double, of the receiver 1e-7 degrees.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable

import numpy as np

from lab.missions import Recording
from writers.autopilot import GPS_DELAY, GPS_SIGMA, LEVER_ARM, sensed, solution

BOOT = 12_345_678
"""Time since boot at which the flight begins [µs]."""
GEOID = -31.4
FORMATS = {
    "vehicle_attitude": "uint64_t timestamp;uint64_t timestamp_sample;float[4] q;float[4] delta_q_reset;"
    "uint8_t quat_reset_counter;uint8_t[7] _padding0;",
    "vehicle_local_position": "uint64_t timestamp;uint64_t timestamp_sample;double ref_lat;double ref_lon;"
    "float x;float y;float z;float vx;float vy;float vz;float ref_alt;bool xy_valid;bool z_valid;"
    "bool v_xy_valid;bool v_z_valid;bool xy_global;uint8_t[3] _padding0;",
    "vehicle_global_position": "uint64_t timestamp;uint64_t timestamp_sample;double lat;double lon;float alt;"
    "float alt_ellipsoid;bool dead_reckoning;uint8_t[7] _padding0;",
    "sensor_combined": "uint64_t timestamp;float[3] gyro_rad;uint32_t gyro_integral_dt;"
    "int32_t accelerometer_timestamp_relative;float[3] accelerometer_m_s2;uint32_t accelerometer_integral_dt;"
    "uint8_t accelerometer_clipping;uint8_t[7] _padding0;",
    "vehicle_gps_position": "uint64_t timestamp;uint64_t time_utc_usec;int32_t lat;int32_t lon;int32_t alt;"
    "int32_t alt_ellipsoid;float s_variance_m_s;float eph;float epv;float vel_n_m_s;float vel_e_m_s;"
    "float vel_d_m_s;uint8_t fix_type;bool vel_ned_valid;uint8_t satellites_used;uint8_t[5] _padding0;",
    "vehicle_status": "uint64_t timestamp;uint8_t vehicle_type;nested inner;uint8_t[3] _padding0;",
    "nested": "float a;uint16_t[2] b;",
}
PARAMETERS = {
    "EKF2_GPS_DELAY": 1000 * GPS_DELAY,
    "EKF2_GPS_POS_X": LEVER_ARM[0],
    "EKF2_GPS_POS_Y": LEVER_ARM[1],
    "EKF2_GPS_POS_Z": LEVER_ARM[2],
}
SYNC = bytes((0x2F, 0x73, 0x13, 0x20, 0x25, 0x0C, 0xBB, 0x12))


def message(kind: str, content: bytes) -> bytes:
    """Return a message with its header."""
    return struct.pack("<HB", len(content), ord(kind)) + content


def definitions(names: Iterable[str]) -> bytes:
    """Return header, flags, formats, parameters and subscriptions."""
    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", BOOT), message("B", bytes(40))]
    key = b"char[3] sys_name"
    parts.append(message("I", bytes((len(key),)) + key + b"PX4"))
    parts += [message("F", f"{name}:{fields}".encode()) for name, fields in FORMATS.items()]
    for name, value in PARAMETERS.items():
        key = f"float {name}".encode()
        parts.append(message("P", bytes((len(key),)) + key + struct.pack("<f", value)))
    parts += [
        message("A", struct.pack("<BH", 0, number) + name.encode()) for number, name in enumerate(names)
    ]
    return b"".join(parts)


def stamps(time: np.ndarray) -> np.ndarray:
    """Return times of the flight [s] as time since boot [µs]."""
    return BOOT + np.rint(time * 1e6).astype(np.int64)


def write(recording: Recording, dropout: bool = True) -> bytes:
    """Return the log of a flight."""
    numbers = {name: number for number, name in enumerate(FORMATS) if name != "nested"}
    messages: list[tuple[int, bytes]] = []

    def add(name: str, form: str, rows: Iterable[tuple]) -> None:
        made = struct.Struct("<H" + form)
        messages.extend((row[0], message("D", made.pack(numbers[name], *row))) for row in rows)

    fast, slow = solution(recording, 50.0), solution(recording, 10.0)
    add("vehicle_attitude", "QQ4f4fB", (
        (t + 400, t, *q, 1.0, 0.0, 0.0, 0.0, 0)
        for t, q in zip(stamps(fast.time).tolist(), fast.q_nb.tolist(), strict=True)
    ))  # fmt: skip
    place = np.column_stack((np.degrees(slow.latitude), np.degrees(slow.longitude), slow.height))
    times = stamps(slow.time).tolist()
    add("vehicle_local_position", "QQdd7f5B", (
        (t + 900, t, *place[0, :2], 0.0, 0.0, 0.0, *v, place[0, 2] - GEOID, 1, 1, 1, 1, 1)
        for t, v in zip(times, slow.velocity_n.tolist(), strict=True)
    ))  # fmt: skip
    add("vehicle_global_position", "QQddffB", (
        (t + 900, t, lat, lon, height - GEOID, height, 0)
        for t, (lat, lon, height) in zip(times, place.tolist(), strict=True)
    ))  # fmt: skip
    seen = sensed(recording)
    add("sensor_combined", "Q3fIi3fIB", (
        (t, *rates[:3], 5000, 0, *rates[3:], 5000, 0)
        for t, rates in zip(stamps(seen.imu_time).tolist(), seen.rates.tolist(), strict=True)
    ))  # fmt: skip
    fixes = np.column_stack((np.degrees(seen.gps_position[:, :2]) * 1e7, seen.gps_position[:, 2] * 1e3))
    add("vehicle_gps_position", "QQ4i6fBBB", (
        (t, 0, lat, lon, height - round(1e3 * GEOID), height, *GPS_SIGMA[::-1], GPS_SIGMA[0], *v, 3, 1, 14)
        for t, (lat, lon, height), v in zip(
            stamps(seen.gps_time).tolist(), np.rint(fixes).astype(int).tolist(), seen.gps_velocity.tolist(),
            strict=True,
        )
    ))  # fmt: skip
    add("vehicle_status", "QBf2H", ((t, 2, 0.0, 1, 2) for t in times[::10]))
    messages.sort(key=lambda one: one[0])
    data = [one for _, one in messages]
    for place_of in range(2000, len(data), 2000):
        data[place_of] += message("S", SYNC)
    if dropout:
        data[len(data) // 2] += message("O", struct.pack("<H", 30))
    return definitions(FORMATS) + b"".join(data)
