r"""Texts of programs that people publish, of one device and of two: how each prints a sample.

The forms are those of sketches for the MPU-6050, LSM9DS1, BNO055, ICM-20948 and Nano 33, of the M5Stack, the
Sense HAT and the Astro Pi, of ESP-IDF, Arduino's monitor, ThingsBoard, SensorStreamer, Phidgets, x-io's NGIMU
and OpenIMU, as found in public repositories.
"""

from __future__ import annotations

import numpy as np
from further_outputs import COUNT, Form, _axes, motion

_XYZ = '"x":{0[0]},"y":{0[1]},"z":{0[2]}'
_F, _W = (_XYZ.replace("{0", "{" + one) for one in "fw")
SKETCHES = {
    "words_behind_names": Form(
        _axes("f", "AX value: #   ") + _axes("w", "GX value: #   ") + "yaw angle: {n}.5\r\n", "g", "deg"
    ),
    "semicolons": Form(_axes("f", "aX: #;  ") + _axes("w", "gX: #;  ") + "\r\n", "g", "deg", 2),
    "units_in_lines": Form(
        _axes("f", "ax: # m/s2\r\n") + "\r\n" + _axes("w", "gx: # deg/s\r\n") + "\r\n", "m", "deg", 2
    ),
    "dashes": Form(_axes("f", "Accel X: #;") + "-------" + _axes("w", "Gyro X: #;") + "\r\n", "g", "deg"),
    "pipes": Form("A:{f[0]:6d} {f[1]:6d} {f[2]:6d} | G:{w[0]:6d} {w[1]:6d} {w[2]:6d}\r\n", "16384", "131", 0),
    "esp_idf": Form(
        "\x1b[0;32mI ({ms}) ICM: Accel[g] (@f) Gyro[dps] (@w) Temp 25.10 C\x1b[0m\r\n", "g", "deg", 3, 0.0
    ),
    "indices": Form(_axes("f", "a[x]=# ") + _axes("w", "g[x]=# ") + "\n", "g", "deg"),
    "rates_first": Form("init\r\n@w @f @M\r\n".replace("@M", "{m[0]} {m[1]} {m[2]}"), "g", "deg", 4),
    "ngimu": Form("/sensors, {t:.6f}, @w, @f, {m[0]}, {m[1]}, {m[2]}, 1013.2\n", "g", "deg", 6, 2.0),
    "monitor_of_arduino": Form("10:20:{t:06.3f} -> @f, @w\r\n", "g", "deg", 3, 10.0),
    "astro_pi": Form("{n},2024-01-02 10:20:{t:09.6f},47.1,8.5,430.1,12,1,360,@F,@W\n", "g", "rad", 4, 10.0),
    "sensorstreamer": Form(
        '{{"accelerometer":{{"timestamp":{us}000,"value":[@F]}},'
        '"gyroscope":{{"timestamp":{us}000,"value":[@W]}}}}\n', "m", "rad", 5, 5000.0,
    ),
    "counted_lines": Form("$IMU,{n},@F,@W*hh\r\n", "m", "rad", 4),
    "bno055": Form(
        "Orient:\tx= {n}.94 |\ty= 0.1 |\tz= -1.2\r\nRot:\tx= {w[0]} |\ty= {w[1]} |\tz= {w[2]}\r\n"
        "Linear:\tx= 0.01 |\ty= 0.02 |\tz= 0.12\r\nAccl:\tx= {f[0]} |\ty= {f[1]} |\tz= {f[2]}\r\n--\r\n",
        "m", "rad", 2,
    ),
    "json": Form(
        '{{"team":"5","ip":"10.0.0.7","data":{{"accel":{{' + _F + '}},"gyro":{{' + _W + "}}}}}}\n", "g", "deg"
    ),
    "json_of_a_flat_row": Form(
        "{{" + _axes("w", '"gyro_x": #, ') + _axes("f", '"accel_x": #, ')
        + '"timestamp_mono_ns": {us}000, "sample_id": {n}}}\n', "m", "rad", 4, 100.0,
    ),
    "thingsboard": Form(
        "Published: {{'temperature': 33.1, 'orientation': {{'roll': 1.2, 'pitch': 359.1}}, 'acceleration': {{"
        + _F.replace('"', "'") + "}}, 'gyroscope': {{" + _W.replace('"', "'") + "}}}}\n", "g", "rad", 5,
    ),
    "sections": Form(
        "\n===== ACCELEROMETER =====\nx = {f[0]} g, y = {f[1]} g, z = {f[2]} g\nTotal acceleration: 1 g\n\n"
        "===== GYROSCOPE =====\nx = {w[0]}, y = {w[1]}, z = {w[2]}\n", "g", "rad", 4,
    ),
    "phidgets": Form(
        "Timestamp: {ms}.000\nAcceleration: \t{f[0]}  |  {f[1]}  |  {f[2]}\n"
        "AngularRate: \t{w[0]}  |  {w[1]}  |  {w[2]}\n----------\n", "g", "deg", 5, 0.0,
    ),
    "openimu": Form("ITOW: {ms}, accel: [@f], rate: [@w], temp: 30.1\n", "m", "deg", 4, 0.0),
    "journal": Form(
        "Jan 02 10:20:07 pi imu[812]:" + _axes("f", " ax=#") + _axes("w", " gx=#") + "\n", "g", "deg"
    ),
    "in_spanish": Form(
        "Acelerometro" + _axes("f", " X:#") + " Giroscopio" + _axes("w", " X:#") + "\r\n", "g", "deg"
    ),
    "in_chinese": Form("加速度: @f  角速度: @w\r\n", "g", "deg"),
    "behind_a_dash": Form(
        "2024-01-02 10:20:{t:06.3f} - INFO -" + ",".join((_axes("f", " ax=#"), _axes("w", " gx=#"))) + "\n",
        "g", "deg", 3, 10.0,
    ),
    "behind_a_position": Form(
        "Orion,A,430.12,430.62,47.376900,8.5417{n:02},@W,@F,-1.2{n},2,0.0,Orion\r\n", "g", "deg"
    ),
    "behind_numbers_that_stay": Form(
        "{ms},120324,47376900,8541700,43010,430.1,95000,120,10,4500,@F,@W,1,2,3\r\n", "16384", "131", 0, 0.0
    ),
    "before_a_quaternion": Form(
        "{ms},@F,@W,0.9848,0.0123,0.0234,0.1717,2{n:02},-50,-430,143\r\n", "g", "deg", 2, 0.0
    ),
    "tabs_behind_colons": Form(
        "I ({ms}) mpu: Acceleration:" + _axes("f", "\tx=#") + "\nI ({ms}) mpu: Rotation:"
        + _axes("w", "\tx=#") + "\n", "16384", "131", 0, 0.0,
    ),
    "date_without_zeros": Form("3/12/2024,7:3:{sec},@F,@W\r\n", "m", "deg", 2),
}  # fmt: skip
"""The texts of one device by name, as `further_outputs.Form` has them."""

_ONE = _axes("f", " ax:#") + _axes("w", " gx:#") + "\n"
TWO_DEVICES = {
    "word_and_number": "IMU{id},@F,@W\n",
    "word_number_time": "IMU{id},{ms},@F,@W\n",
    "number": "{id},@F,@W\n",
    "number_behind_time": "{ms},{id},@F,@W\n",
    "number_at_the_end": "@F,@W,{id}\n",
    "hash": "#{id} @f @w\n".replace(",", ""),
    "labelled": "Sensor {id}:" + _ONE,
    "json": '{{"id":{id},"accel":{{' + _F + '}},"gyro":{{' + _W + "}}}}\n",
    "own_line": "IMU {id}\n" + _ONE.replace("\n", "\n"),
    "words": "{side} @F,@W\n".replace(" ", ","),
    "addresses": "0x6{id}: @f, @w\n",
    "radio": "D4:22:CD:00:01:0{id},{ms},@F,@W\n",
    "logfmt": "sensor=imu{id}" + _ONE.replace(":", "="),
}
"""How lines say of which of two devices they are."""


def of_two_devices(form: str, seed: int = 0) -> tuple[str, list[np.ndarray], list[np.ndarray]]:
    """Return lines of two devices in turn, and the forces and rates (n, 3) of each.

    The second is mounted with its x axis reversed, and has biases of its own.
    """
    _, f, w = motion(seed)
    other = (-1, -1, 1)
    forces = [np.round(f, 3), np.round(f * other + (0.05, -0.03, 0.08), 3)]
    rates = [np.round(w, 4), np.round(w * other + (0.004, -0.006, 0.002), 4)]
    words = form
    for one, between in (("f", ", "), ("w", ", "), ("F", ","), ("W", ",")):
        words = words.replace(f"@{one}", between.join(f"{{{one.lower()}[{axis}]}}" for axis in range(3)))
    lines = [
        words.format(id=k + 1, side=("left", "right")[k], ms=20 * n, f=forces[k][n], w=rates[k][n])
        for n in range(COUNT)
        for k in range(2)
    ]
    return "".join(lines), forces, rates
