"""Further texts that sketches, simulators, autopilots and apps print, of a device that is turned by hand.

The forms are those of Teleplot, Serial Studio, SparkFun, Adafruit, MotionCal, the Razor AHRS, Bolder Flight,
FastIMU, CircuitPython, MicroPython, HyperIMU, Sensorstream, ROS 1 and 2, logfmt, InfluxDB, x-IMU3, ST's
DataLog, Zephyr, PX4, Gazebo, AirSim, the Crazyflie, MAVProxy, Edge Impulse, M5Stack, WitMotion, TDK,
CH Robotics and Quectel.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

G, DEGREE = 9.80665, np.pi / 180
RATE, COUNT = 50.0, 600
REST = 3.0
"""Time before the device is turned [s]."""
_FORCES = {
    "m": 1.0,
    "g": G,
    "mg": G / 1000,
    "16384": G / 16384,
    "8192": G / 8192,
    "2048": G / 2048,
    "256": G / 256,
}
_RATES = {
    "rad": 1.0, "deg": DEGREE, "mdps": DEGREE / 1000, "mrad": 1e-3, "131": DEGREE / 131, "16": DEGREE / 16,
    "16.4": DEGREE / 16.4, "itg": DEGREE / 14.375,
}  # fmt: skip


class Form(NamedTuple):
    """How a device prints.

    Attributes
    ----------
    text : str
        A sample: f forces, w rates, m the field [µT], @F, @W and @M three of them with commas, @f and @w
        with blanks, too, t seconds, n its number.
    force, rate : str
        Units, and how many decimals are printed.
    decimals : int
        Of both.
    begin : float
        Time of the first sample [s]; NaN without times.
    head : str
        What stands before.
    slow : str
        What stands in every third sample where it has {slow}.
    """

    text: str
    force: str
    rate: str
    decimals: int = 3
    begin: float = np.nan
    head: str = ""
    slow: str = ""


def motion(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times, forces and rates (n, 3), in SI, of a device at rest that is turned later."""
    rng = np.random.default_rng(seed)
    t = np.arange(COUNT) / RATE

    def angle(size: float, fast: float) -> tuple[np.ndarray, np.ndarray]:
        since = np.maximum(t - REST, 0.0)
        swing, grown = np.sin(fast * since), 1 - np.exp(-(since**2))
        turned = fast * np.cos(fast * since) * grown + swing * 2 * since * np.exp(-(since**2))
        return size * swing * grown, size * turned

    (roll, p), (pitch, q), (_, r) = angle(0.5, 1.3), angle(0.6, 1.9), angle(0.7, 1.1)
    rate = np.column_stack((
        p - r * np.sin(pitch),
        q * np.cos(roll) + r * np.sin(roll) * np.cos(pitch),
        -q * np.sin(roll) + r * np.cos(roll) * np.cos(pitch),
    ))  # fmt: skip
    up = np.column_stack((-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)))
    rate += (0.012, -0.008, 0.004) + 0.002 * rng.standard_normal((COUNT, 3))
    return t, G * up + 0.03 * rng.standard_normal((COUNT, 3)), rate


def printed(form: Form, seed: int = 0) -> tuple[str, np.ndarray, np.ndarray]:
    """Return a text, and the forces and rates (n, 3) that were printed in it, in SI."""
    t, force, rate = motion(seed)
    f = np.round(force / _FORCES[form.force], form.decimals)
    w = np.round(rate / _RATES[form.rate], form.decimals)
    whole = int if form.decimals == 0 else float
    field = np.round((20.0, -5.0, -43.0) + 0.3 * np.random.default_rng(seed).standard_normal((COUNT, 3)), 2)
    words, slow = form.text, form.slow
    for one, between in (("f", ", "), ("w", ", "), ("F", ","), ("W", ","), ("M", ",")):
        three = between.join(f"{{{one.lower()}[{axis}]}}" for axis in range(3))
        words, slow = words.replace(f"@{one}", three), slow.replace(f"@{one}", three)
    text = form.head + "".join(
        words.replace("{slow}", "" if n % 3 else slow).format(
            f=list(map(whole, f[n])), w=list(map(whole, w[n])), t=form.begin + t[n], n=n, m=field[n],
            sec=int(np.nan_to_num(form.begin)) + n // 50, ns=n % 50 * 20_000_000, ms=20 * n,
            us=f"{int(1e6 * np.nan_to_num(form.begin)) + 20_000 * n}",
        )
        for n in range(COUNT)
    )  # fmt: skip
    return checked(text), f * _FORCES[form.force], w * _RATES[form.rate]


def checked(text: str) -> str:
    """Return lines with the check of NMEA in place of ``*hh``."""
    if "*hh" not in text:
        return text
    lines = []
    for line in text.splitlines():
        check = 0
        for sign in line[1:].partition("*")[0].encode():
            check ^= sign
        lines.append(line.replace("*hh", f"*{check:02X}"))
    return "\r\n".join(lines) + "\r\n"


def _axes(one: str, form: str) -> str:
    """Return the three axes of f or w in a form of ``X``, ``x`` and the number ``#``."""
    written = (form.replace("X", axis.upper()).replace("x", axis) for axis in "xyz")
    return "".join(text.replace("#", f"{{{one}[{n}]}}") for n, text in enumerate(written))


_COLUMN = "  x: {0[0]}\n  y: {0[1]}\n  z: {0[2]}\n"
_YAML_F, _YAML_W = (_COLUMN.replace("{0", "{" + one) for one in "fw")
_NINE = ",".join(["0.0"] * 9)
_ROS = f"{{sec}},{{ns}},imu,0.0,0.0,0.0,1.0,{_NINE},@W,{_NINE},@F,{_NINE}\n"
_MAV = _axes("f", "xacc : #, ") + _axes("w", "xgyro : #, ")
FORMS = {
    "teleplot": Form(_axes("f", ">ax:#\n") + _axes("w", ">gx:#\n"), "m", "rad"),
    "teleplot_with_times": Form(
        _axes("f", ">accX:1627551{ms:06}:#§m/s²\n") + _axes("w", ">gyrX:1627551{ms:06}:#§rad/s\n"),
        "m", "rad", 3, 1_627_551.0,
    ),
    "serial_studio": Form("/*@F,@W*/\n", "g", "deg"),
    "sparkfun_raw": Form(
        "RAW. Acc [ {f[0]:06}, {f[1]:06}, {f[2]:06} ], Gyr [ {w[0]:06}, {w[1]:06}, {w[2]:06} ], "
        "Mag [  00133, -00033, -00286 ], Tmp [  01540 ]\r\n", "16384", "131", 0,
    ),
    "motioncal_raw": Form("Raw:@F,@W,{m[0]:.0f},{m[1]:.0f},{m[2]:.0f}\r\n", "8192", "16", 0),
    "motioncal": Form("Raw:4096,-12,7000,1,2,-3,200,-50,-430\r\nUni:@F,@W,@M\r\n", "m", "rad", 4),
    "bno08x": Form(
        "Accelerometer - x: {f[0]} y: {f[1]} z: {f[2]}\r\nGyro - x: {w[0]} y: {w[1]} z: {w[2]}\r\n",
        "m", "rad", 2,
    ),
    "razor_m0": Form("{ms}, @f, @w, {m[0]}, {m[1]}, {m[2]}\r\n", "g", "deg", 3, 0.0),
    "razor_sensors": Form("#A-C=@F\r\n#M-C=20.10,-50.20,-430.00\r\n#G-C=@W\r\n", "256", "itg", 2),
    "bolder_flight": Form(
        _axes("f", "#\t") + _axes("w", "#\t") + "{m[0]}\t{m[1]}\t{m[2]}\t29.5\r\n", "m", "rad", 6
    ),
    "fastimu": Form(
        _axes("f", "#\t") + "{w[0]}\t{w[1]}\t{w[2]}\r\n", "g", "deg", 2, head="FastIMU test\r\nData:\r\n"
    ),
    "smbus": Form(_axes("w", "Gx=# °/s\t") + _axes("f", "Ax=# g\t") + "\n", "g", "deg", 2),
    "circuitpython": Form(
        "Acceleration (m/s^2): (@F)\r\nGyroscope (rad/sec): (@W)\r\nTemperature: 25.000C\r\n", "m", "rad"
    ),
    "micropython": Form("(@f) (@w) (20.1, -5.0, -43.2) 24.5\r\n", "m", "rad", 4),
    "hyperimu": Form("1518819{ms:06},@F,@W,@M,47.3000001,8.5,430.25\n", "m", "rad", 6, 1_518_819.0),
    "sensorstream": Form("{t:.5f}, 3, @F, 4, @W, 5, @M\n", "m", "rad", 3, 890.71558),
    "rostopic_echo": Form(
        'header: \n  seq: {n}\n  stamp: \n    secs: {sec}\n    nsecs: {ns:>9}\n  frame_id: "imu"\n'
        f"angular_velocity: \n{_YAML_W}angular_velocity_covariance: [{_NINE}]\n"
        f"linear_acceleration: \n{_YAML_F}---\n", "m", "rad", 6, 1.7e9,
    ),
    "ros2_csv": Form(_ROS, "m", "rad", 6, 1.7e9),
    "logfmt": Form(
        "ts={t:.3f} level=info" + _axes("f", " ax=#") + _axes("w", " gx=#") + "\n", "g", "deg", 3, 0.0
    ),
    "influx": Form(
        "imu,device=esp32 ax={f[0]},ay={f[1]},az={f[2]},gx={w[0]},gy={w[1]},gz={w[2]} {us}000\n",
        "m", "rad", 3, 1.7e9,
    ),
    "ximu3": Form("I,{us},@W,@F\r\nQ,{us},0.9990,0.0100,0.0200,0.0300\r\n", "g", "deg", 4, 1.0),
    "st_datalog": Form(
        "ACC_X: {f[0]}, ACC_Y: {f[1]}, ACC_Z: {f[2]}\r\nGYR_X: {w[0]}, GYR_Y: {w[1]}, GYR_Z: {w[2]}\r\n",
        "mg", "mdps", 0,
    ),
    "zephyr_lsm6dsl": Form(
        "\x1b[2J\x1b[HLSM6DSL sensor samples:\n\naccel" + _axes("f", " x:# ms/2") + "\ngyro"
        + _axes("w", " x:# dps") + "\nloop:{n} trig_cnt:{n}\n\n", "m", "deg", 6,
    ),
    "zephyr_mpu6050": Form(
        "[0:00:{t:06.3f}]:  25.5 Cel\n  accel {f[0]} {f[1]} {f[2]} m/s/s\n"
        "  gyro  {w[0]} {w[1]} {w[2]} rad/s\n",
        "m", "rad", 6, 0.0,
    ),
    "px4_listener": Form(
        "\nTOPIC: sensor_combined\n sensor_combined\n    timestamp: {us} (0.002 seconds ago)\n"
        "    gyro_rad: [@w]\n    gyro_integral_dt: 4000\n    accelerometer_m_s2: [@f]\n\n",
        "m", "rad", 5, 48.0,
    ),
    "gazebo": Form(
        'header {{\n  stamp {{\n    sec: {sec}\n    nsec: {ns}\n  }}\n}}\nentity_name: "imu"\n'
        f"angular_velocity {{{{\n{_YAML_W}}}}}\nlinear_acceleration {{{{\n{_YAML_F}}}}}\n\n",
        "m", "rad", 6, 12.0,
    ),
    "airsim": Form(
        "<ImuData> {{   'angular_velocity': <Vector3r> {{   'x_val': {w[0]},\n    'y_val': {w[1]},\n"
        "    'z_val': {w[2]}}},\n    'linear_acceleration': <Vector3r> {{   'x_val': {f[0]},\n"
        "    'y_val': {f[1]},\n    'z_val': {f[2]}}},\n    'time_stamp': {us}000}}\n", "m", "rad", 6, 1.7e9,
    ),
    "crazyflie": Form(
        "[{ms}][Imu]: {{" + _axes("f", "'acc.x': #, ") + _axes("w", "'gyro.x': #, ") + "'state': 1}}\n",
        "g", "deg", 6, 0.0,
    ),
    "mavproxy_highres": Form(
        f"HIGHRES_IMU {{{{time_usec : {{us}}, {_MAV}abs_pressure : 1013.2}}}}\n", "m", "rad", 6, 5.0
    ),
    "mavproxy_raw": Form(f"RAW_IMU {{{{time_usec : {{us}}, {_MAV}xmag : 200}}}}\n", "mg", "mrad", 0, 5.0),
    "tinyml": Form("@F,@W\r\n", "g", "deg", head="aX,aY,aZ,gX,gY,gZ\r\n"),
    "edge_impulse": Form("@F,@W\r\n", "m", "deg", 2),
    "bmi270": Form(
        "Acceleration in g's" + _axes("f", "\tX: #") + "\tRotation in deg/sec" + _axes("w", "\tX: #")
        + "\r\n", "g", "deg",
    ),
    "m5stick": Form("@W o/s \r\n@F mg\r\n\r\n Temperature : 36.51 C\r\n", "mg", "deg", 2),
    "jy901": Form(
        "Time:2024-1-2 10:20:{t:.2f}\r\nAcc:{f[0]} {f[1]} {f[2]}\r\nGyro:{w[0]} {w[1]} {w[2]}\r\n"
        "Angle:0.12 -0.25 30.1\r\nPressure:101325 Altitude:12.50\r\n\r\n", "g", "deg", 2, 5.0,
    ),
    "icm42670": Form(_axes("f", "AccelX:#,") + _axes("w", "GyroX:#,") + "Temp:25.1\r\n", "2048", "16.4", 0),
    "um7": Form(
        "$PCHRS,0,{t:.3f},@W,*hh\r\n$PCHRS,1,{t:.3f},@F,*hh\r\n$PCHRS,2,{t:.3f},0.4922,0.2708,-1.6283,*hh\r\n",
        "g", "deg", 2, 101.633,
    ),
    "name_first": Form("ACC,{ms},@F\nGYR,{ms},@W\n", "m", "rad", 3, 0.0),
    "with_a_slow_sensor": Form(
        "accelerometer,{ms},@F\ngyroscope,{ms},@W\n{slow}", "m", "rad", 3, 0.0, slow="magnetometer,{ms},@M\n"
    ),
    "units_in_cells": Form(_axes("f", "#,g,") + _axes("w", "#,dps,") + "\n", "g", "deg"),
    "time_first": Form("{ms},ACC,@F\n{ms},GYR,@W\n", "m", "rad", 3, 0.0),
    "quectel": Form("$PQTMIMU,{ms},@F,@W,0,0*hh\r\n", "m", "deg", 6, 0.0),
}  # fmt: skip
"""The texts by name."""


def _turned(form: str) -> str:
    """Return lines of three numbers that are angles, of up to 10°."""
    t = np.arange(COUNT) / RATE
    return "".join(form.format(10 * np.sin(x), 5 * np.cos(x), -3 * np.sin(2 * x)) for x in t)


NOTHING = {
    "dmp6": _turned("ypr\t{0:.2f}\t{1:.2f}\t{2:.2f}\r\n"),
    "razor_angles": _turned("#YPR={0:.2f},{1:.2f},{2:.2f}\r\n"),
    "euler": _turned("X: {0:.4f} Y: {1:.4f} Z: {2:.4f}\t\tCALIBRATION: Sys=0 Gyro=3 Accel=0 Mag=0\r\n"),
    "quaternions": "".join(
        f"{0.01 * np.sin(n / 50):.5f},0.02000,{0.3 * np.sin(n / 33):.5f},"
        f"{np.sqrt(1 - 0.0005 - 0.09 * np.sin(n / 33) ** 2):.5f}\r\n"
        for n in range(COUNT)
    ),
    "linear_acceleration": "".join(
        f"{n},3,{0.01 * np.sin(5 * n):.2f},{0.02 * np.sin(7 * n):.2f},-0.01,{0.01 * np.sin(3 * n):.2f},0.01,"
        "-0.02,0.9848,0.0123,0.0234,0.1717\r\n"
        for n in range(COUNT)
    ),
}
"""Texts without an IMU that look like one: angles, parts of a quaternion, and forces without gravity."""
