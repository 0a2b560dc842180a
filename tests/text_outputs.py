"""Texts that sketches, loggers and exports write, each with the values that were printed.

The forms are those of public examples: Adafruit's MPU6050, ICM20948, LSM9DS1 and BNO055, SparkFun's LSM6DS3,
LSM9DS1 and ICM-20948, the OpenLog Artemis, Jeff Rowberg's i2cdevlib, Kris Winer's MPU-9250, ST's LSM6DSO,
ESP-IDF's component of the MPU6050, WitMotion's Python, Movella's DOT and MT Manager, LP-Research, ROS.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

G = 9.80665
DEGREE = math.pi / 180
RATE = 50.0
COUNT = 60
"""Samples of each text."""


class Printed(NamedTuple):
    """A text, and what was printed in it.

    Attributes
    ----------
    text : str
        The text.
    rate, force : (n, 3) arrays
        Angular rates [rad/s] and specific forces [m/s²].
    time : (n,) array or None
        Times [s]; None where it has none.
    magnetic : (n, 3) array or None
        Magnetic field [T].
    """

    text: str
    rate: np.ndarray
    force: np.ndarray
    time: np.ndarray | None = None
    magnetic: np.ndarray | None = None


def numbers(seed: int, force: float, rate: float, decimals: int = 2) -> tuple[np.ndarray, np.ndarray]:
    """Return forces and rates (n, 3) of a device that is turned by hand, as they are printed.

    Parameters
    ----------
    seed
        Of the motion.
    force, rate
        1 g and 1 rad/s in the units that are printed.
    decimals
        Of the numbers.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(COUNT) / RATE
    tilt = 0.4 * np.sin(2 * t + 0.3)
    up = np.column_stack((np.sin(tilt), 0.1 * np.cos(t), np.cos(tilt))) + 0.004 * rng.standard_normal(
        (COUNT, 3)
    )
    turning = np.column_stack((0.05 * np.cos(t), 0.8 * np.cos(2 * t + 0.3), 0.02 + 0 * t))
    turning += 0.003 * rng.standard_normal((COUNT, 3))
    return np.round(force * up, decimals), np.round(rate * turning, decimals)


def field(seed: int, unit: float = 1.0) -> np.ndarray:
    """Return magnetic fields (n, 3) of 48 µT in a unit of this many µT."""
    rng = np.random.default_rng(seed)
    return np.round((np.array([20.0, -5.0, -43.0]) + 0.3 * rng.standard_normal((COUNT, 3))) / unit, 2)


def adafruit_mpu6050() -> Printed:
    f, w = numbers(1, G, 1.0)
    text = "Adafruit MPU6050 test!\r\nMPU6050 Found!\r\nAccelerometer range set to: +-8G\r\n"
    text += "Gyro range set to: +- 500 deg/s\r\nFilter bandwidth set to: 21 Hz\r\n\r\n"
    for a, b in zip(f, w, strict=True):
        text += f"Acceleration X: {a[0]:.2f}, Y: {a[1]:.2f}, Z: {a[2]:.2f} m/s^2\r\n"
        text += f"Rotation X: {b[0]:.2f}, Y: {b[1]:.2f}, Z: {b[2]:.2f} rad/s\r\n"
        text += "Temperature: 36.53 degC\r\n\r\n"
    return Printed(text, w, f)


def adafruit_icm20948() -> Printed:
    f, w = numbers(2, G, 1.0)
    m, text = field(2), ""
    for a, b, c in zip(f, w, m, strict=True):
        text += "\t\tTemperature 25.31 deg C\r\n"
        text += f"\t\tAccel X: {a[0]:.2f} \tY: {a[1]:.2f} \tZ: {a[2]:.2f} m/s^2 \r\n"
        text += f"\t\tMag X: {c[0]:.2f} \tY: {c[1]:.2f} \tZ: {c[2]:.2f} uT\r\n"
        text += f"\t\tGyro X: {b[0]:.2f} \tY: {b[1]:.2f} \tZ: {b[2]:.2f} radians/s \r\n\r\n"
    return Printed(text, w, f, magnetic=m * 1e-6)


def adafruit_lsm9ds1() -> Printed:
    f, w = numbers(3, G, 1.0)
    m, text = field(3), "LSM9DS1 data read demo\r\nFound LSM9DS1 9DOF\r\n"
    for a, b, c in zip(f, w, m, strict=True):
        text += f"Accel X: {a[0]:.2f} m/s^2 \tY: {a[1]:.2f} m/s^2 \tZ: {a[2]:.2f} m/s^2 \r\n"
        text += f"Mag X: {c[0]:.2f} uT\tY: {c[1]:.2f} uT\tZ: {c[2]:.2f} uT\r\n"
        text += f"Gyro X: {b[0]:.2f} rad/s\tY: {b[1]:.2f} rad/s\tZ: {b[2]:.2f} rad/s\r\n\r\n"
    return Printed(text, w, f, magnetic=m * 1e-6)


def adafruit_bno055() -> Printed:
    f, w = numbers(4, G, 1.0)
    m, text = field(4), "Orientation Sensor Test\r\n\r\n"
    for a, b, c in zip(f, w, m, strict=True):
        text += "Orient:\tx= 359.94 |\ty= -1.25 |\tz= 0.12\r\n"
        text += f"Gyro:\tx= {b[0]:.2f} |\ty= {b[1]:.2f} |\tz= {b[2]:.2f}\r\n"
        text += "Linear:\tx= 0.02 |\ty= -0.01 |\tz= 0.03\r\n"
        text += f"Mag:\tx= {c[0]:.2f} |\ty= {c[1]:.2f} |\tz= {c[2]:.2f}\r\n"
        text += f"Accl:\tx= {a[0]:.2f} |\ty= {a[1]:.2f} |\tz= {a[2]:.2f}\r\n"
        text += "Gravity:\tx= 0.02 |\ty= 0.21 |\tz= 9.80\r\n\r\n"
        text += "temperature: 27\r\n\r\nCalibration: Sys=0 Gyro=3 Accel=1 Mag=0\r\n--\r\n"
    return Printed(text, w, f, magnetic=m * 1e-6)


def sparkfun_icm20948() -> Printed:
    f, w = numbers(5, 1000.0, 1 / DEGREE)
    m, text = field(5), "Initialization of the sensor returned: All is well.\r\n"

    def padded(value: float) -> str:
        return f"{'-' if value < 0 else ' '}{abs(value):08.2f}"

    for a, b, c in zip(f, w, m, strict=True):
        text += (
            f"Scaled. Acc (mg) [ {', '.join(map(padded, a))} ], Gyr (DPS) [ {', '.join(map(padded, b))} ], "
        )
        text += f"Mag (uT) [ {', '.join(map(padded, c))} ], Tmp (C) [  00025.50 ]\r\n"
    return Printed(text, w * DEGREE, f * 1e-3 * G, magnetic=m * 1e-6)


def sparkfun_lsm6ds3() -> Printed:
    f, w = numbers(6, 1.0, 1 / DEGREE, 4)
    text = "Processor came out of reset.\r\n\r\n"
    for a, b in zip(f, w, strict=True):
        text += "\nAccelerometer:\n"
        text += "".join(f" {axis} = {value:.4f}\r\n" for axis, value in zip("XYZ", a, strict=True))
        text += "\nGyroscope:\n"
        text += "".join(f" {axis} = {value:.4f}\r\n" for axis, value in zip("XYZ", b, strict=True))
        text += "\nThermometer:\n Degrees C = 24.1250\r\n Degrees F = 75.4250\r\n"
    return Printed(text, w * DEGREE, f * G)


def seeed_lsm6ds3() -> Printed:
    found = sparkfun_lsm6ds3()
    text = found.text.replace(" X =", " X1 =").replace(" Y =", " Y1 =").replace(" Z =", " Z1 =")
    return found._replace(text=text)


def sparkfun_lsm9ds1() -> Printed:
    f, w = numbers(7, 1.0, 1 / DEGREE)
    m, text = field(7, 100.0), ""
    for a, b, c in zip(f, w, m, strict=True):
        text += f"G: {b[0]:.2f}, {b[1]:.2f}, {b[2]:.2f} deg/s\r\n"
        text += f"A: {a[0]:.2f}, {a[1]:.2f}, {a[2]:.2f} g\r\n"
        text += f"M: {c[0]:.2f}, {c[1]:.2f}, {c[2]:.2f} gauss\r\n"
        text += "Pitch, Roll: 1.20, -0.35\r\nHeading: 123.45\r\n\r\n"
    return Printed(text, w * DEGREE, f * G, magnetic=m * 1e-4)


def i2cdevlib_raw() -> Printed:
    f, w = numbers(8, 16384.0, 131 / DEGREE, 0)
    text = "Initializing I2C devices...\r\nTesting device connections...\r\nMPU6050 connection successful\r\n"
    for a, b in zip(f.astype(int), w.astype(int), strict=True):
        text += "a/g:\t" + "\t".join(map(str, (*a, *b))) + "\r\n"
    return Printed(text, w / 131 * DEGREE, f / 16384 * G)


def raw_on_two_lines() -> Printed:
    f, w = numbers(9, 16384.0, 131 / DEGREE, 0)
    text = ""
    for a, b in zip(f.astype(int), w.astype(int), strict=True):
        text += (
            f"Accelerometer: X: {a[0]} Y: {a[1]} Z: {a[2]}\r\nGyroscope: X: {b[0]} Y: {b[1]} Z: {b[2]}\r\n"
        )
    return Printed(text, w / 131 * DEGREE, f / 16384 * G)


def arduino_plotter() -> Printed:
    f, w = numbers(10, G, 1 / DEGREE)
    text = ""
    for a, b in zip(f, w, strict=True):
        text += f"ax:{a[0]:.2f},ay:{a[1]:.2f},az:{a[2]:.2f},gx:{b[0]:.2f},gy:{b[1]:.2f},gz:{b[2]:.2f}\r\n"
    return Printed(text, w * DEGREE, f)


def winer_mpu9250() -> Printed:
    f, w = numbers(11, 1000.0, 1 / DEGREE)
    m, text = field(11, 0.1), ""
    for a, b, c in zip(f, w, m, strict=True):
        text += f"ax = {a[0]:.2f} ay = {a[1]:.2f} az = {a[2]:.2f} mg\r\n"
        text += f"gx = {b[0]:.2f} gy = {b[1]:.2f} gz = {b[2]:.2f} deg/s\r\n"
        text += f"mx = {c[0]:.2f} my = {c[1]:.2f} mz = {c[2]:.2f} mG\r\n"
        text += "q0 = 0.98 qx = 0.01 qy = 0.02 qz = 0.17\r\n"
    return Printed(text, w * DEGREE, f * 1e-3 * G, magnetic=m * 1e-7)


def winer_basic() -> Printed:
    f, w = numbers(12, 1000.0, 1 / DEGREE)
    text = ""
    for a, b in zip(f, w, strict=True):
        text += (
            "".join(f"{axis}-acceleration: {one:.2f} mg " for axis, one in zip("XYZ", a, strict=True))
            + "\r\n"
        )
        text += "".join(
            f"{axis}-gyro rate: {one:.2f} degrees/sec " for axis, one in zip("XYZ", b, strict=True)
        )
        text += "\r\nTemperature is 27.53 degrees C\r\n\r\n"
    return Printed(text, w * DEGREE, f * 1e-3 * G)


def st_lsm6dso() -> Printed:
    f, w = numbers(13, 1000.0, 1000 / DEGREE, 0)
    text = ""
    for a, b in zip(f.astype(int), w.astype(int), strict=True):
        text += f"| Acc[mg]: {a[0]} {a[1]} {a[2]} | Gyr[mdps]: {b[0]} {b[1]} {b[2]} |\r\n"
    return Printed(text, w * 1e-3 * DEGREE, f * 1e-3 * G)


def esp_idf() -> Printed:
    f, w = numbers(14, 1.0, 1 / DEGREE)
    text = "I (312) main_task: Calling app_main()\r\n"
    for number, (a, b) in enumerate(zip(f, w, strict=True)):
        log = f"\x1b[0;32mI ({330 + 20 * number}) mpu6050 test: "
        text += f"{log}acce_x:{a[0]:.2f}, acce_y:{a[1]:.2f}, acce_z:{a[2]:.2f}\n\x1b[0m\r\n"
        text += f"{log}gyro_x:{b[0]:.2f}, gyro_y:{b[1]:.2f}, gyro_z:{b[2]:.2f}\n\x1b[0m\r\n"
        text += f"{log}t:36.53 \n\x1b[0m\r\n"
    return Printed(text, w * DEGREE, f * G, 0.33 + 0.02 * np.arange(COUNT))


def serial_monitor() -> Printed:
    """Return what the Arduino's monitor shows with its times, of a sketch with three names."""
    f, w = numbers(15, 1.0, 1 / DEGREE)
    text, time = "", np.round(45_296.780 + np.arange(COUNT) / RATE, 3)
    for t, a, b in zip(time, f, w, strict=True):
        clock = f"{int(t // 3600):02}:{int(t // 60) % 60:02}:{t % 60:06.3f}"
        text += f"{clock} -> Accel: {a[0]:.2f}, {a[1]:.2f}, {a[2]:.2f} | "
        text += f"Gyro: {b[0]:.2f}, {b[1]:.2f}, {b[2]:.2f} | Temp: 25.00\n"
    return Printed(text, w * DEGREE, f * G, time)


def json_lines() -> Printed:
    f, w = numbers(16, G, 1.0, 3)
    text = ""
    for number, (a, b) in enumerate(zip(f, w, strict=True)):
        text += (
            f'{{"type":"imu","t":{1000 + 20 * number},"acc":{{"x":{a[0]:.3f},"y":{a[1]:.3f},"z":{a[2]:.3f}}},'
        )
        text += f'"gyro":{{"x":{b[0]:.3f},"y":{b[1]:.3f},"z":{b[2]:.3f}}},"temp":null}}\n'
    return Printed(text, w, f, 1 + 0.02 * np.arange(COUNT))


def json_of_lists() -> Printed:
    f, w = numbers(17, G, 1.0, 3)
    text = ""
    for number, (a, b) in enumerate(zip(f, w, strict=True)):
        text += f'{{"timestamp_ms": {20 * number}, "accel": [{a[0]:.3f}, {a[1]:.3f}, {a[2]:.3f}], '
        text += f'"gyro": [{b[0]:.3f}, {b[1]:.3f}, {b[2]:.3f}]}}\n'
    return Printed(text, w, f, 0.02 * np.arange(COUNT))


def artemis() -> Printed:
    f, w = numbers(18, 1000.0, 1 / DEGREE)
    m = field(18)
    text = "rtcDate,rtcTime,aX,aY,aZ,gX,gY,gZ,mX,mY,mZ,imu_degC,output_Hz,\r\n"
    time = np.round(86_399.5 + np.arange(COUNT) / RATE, 2)
    for t, a, b, c in zip(time % 86_400, f, w, m, strict=True):
        clock = f"{int(t // 3600):02}:{int(t // 60) % 60:02}:{t % 60:05.2f}"
        text += f"01/02/2024,{clock},{','.join(f'{one:.2f}' for one in (*a, *b, *c))},25.10,50.000,\r\n"
    return Printed(text, w * DEGREE, f * 1e-3 * G, time, m * 1e-6)


def movella_dot() -> Printed:
    f, w = numbers(19, G, 1 / DEGREE, 6)
    text = "PacketCounter,SampleTimeFine,Euler_X,Euler_Y,Euler_Z,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z\n"
    for number, (a, b) in enumerate(zip(f, w, strict=True)):
        cells = ",".join(f"{one:.6f}" for one in (*a, *b))
        text += f"{number},{192_856_375 + 16_667 * number},1.5,-0.2,30.1,{cells}\n"
    return Printed(text, w * DEGREE, f, (192_856_375 + 16_667 * np.arange(COUNT)) * 1e-6)


def mt_manager() -> Printed:
    f, w = numbers(20, G, 1.0, 6)
    text = "// General information:\n//  MT Manager version: 2022.0\n"
    text += "PacketCounter\tSampleTimeFine\tAcc_X\tAcc_Y\tAcc_Z\tGyr_X\tGyr_Y\tGyr_Z\tPressure\tRoll\n"
    for number, (a, b) in enumerate(zip(f, w, strict=True)):
        cells = "\t".join(f"{one:.6f}" for one in (*a, *b))
        text += f"{number:05}\t{10_000 + 100 * number}\t{cells}\t{'NaN' if number % 2 else ''}\t0.5\n"
    return Printed(text, w, f, 1 + 0.01 * np.arange(COUNT))


def lp_research() -> Printed:
    f, w = numbers(21, 1.0, 1 / DEGREE, 4)
    text = (
        "SensorId, TimeStamp (s), FrameNumber, AccX (g), AccY (g), AccZ (g), GyroX (deg/s), GyroY (deg/s), "
    )
    text += "GyroZ (deg/s), MagX (uT), MagY (uT), MagZ (uT)\n"
    for number, (a, b) in enumerate(zip(f, w, strict=True)):
        cells = ", ".join(f"{one:.4f}" for one in (*a, *b, 20.0, -5.0, -43.0))
        text += f"1, {5 + number / 100:.4f}, {number}, {cells}\n"
    return Printed(text, w * DEGREE, f * G, 5 + np.arange(COUNT) / 100)


def rostopic() -> Printed:
    f, w = numbers(22, G, 1.0, 6)
    head = "%time,field.header.seq,field.header.stamp,field.header.frame_id"
    head += "".join(f",field.orientation.{axis}" for axis in "xyzw")
    head += "".join(f",field.orientation_covariance{k}" for k in range(9))
    head += "".join(f",field.angular_velocity.{axis}" for axis in "xyz")
    head += "".join(f",field.angular_velocity_covariance{k}" for k in range(9))
    head += "".join(f",field.linear_acceleration.{axis}" for axis in "xyz")
    head += "".join(f",field.linear_acceleration_covariance{k}" for k in range(9))
    text = head + "\n"
    for number, (a, b) in enumerate(zip(f, w, strict=True)):
        stamp = 1_700_000_000_000_000_000 + 20_000_000 * number
        zeros = ",".join(["0.0"] * 9)
        text += f"{stamp},{number},{stamp},imu_link,0.0,0.0,0.0,1.0,{zeros},"
        text += f"{b[0]:.6f},{b[1]:.6f},{b[2]:.6f},{zeros},{a[0]:.6f},{a[1]:.6f},{a[2]:.6f},{zeros}\n"
    return Printed(text, w, f, 1_700_000_000 + 0.02 * np.arange(COUNT))


def ros2_topic() -> Printed:
    f, w = numbers(23, G, 1.0, 6)
    text, zeros = "", "".join("- 0.0\n" for _ in range(9))
    for number, (a, b) in enumerate(zip(f, w, strict=True)):
        text += f"header:\n  stamp:\n    sec: {1_700_000_000 + number // 50}\n"
        text += f"    nanosec: {number % 50 * 20_000_000}\n"
        text += "  frame_id: imu_link\norientation:\n  x: 0.0\n  y: 0.0\n  z: 0.0\n  w: 1.0\n"
        text += f"orientation_covariance:\n{zeros}"
        text += f"angular_velocity:\n  x: {b[0]:.6f}\n  y: {b[1]:.6f}\n  z: {b[2]:.6f}\n"
        text += f"angular_velocity_covariance:\n{zeros}"
        text += f"linear_acceleration:\n  x: {a[0]:.6f}\n  y: {a[1]:.6f}\n  z: {a[2]:.6f}\n"
        text += f"linear_acceleration_covariance:\n{zeros}---\n"
    return Printed(text, w, f, 1_700_000_000 + 0.02 * np.arange(COUNT))


def witmotion_text() -> Printed:
    f, w = numbers(24, 1.0, 1 / DEGREE, 4)
    text = "Chiptime\tax(g)\tay(g)\taz(g)\twx(deg/s)\twy(deg/s)\twz(deg/s)\t"
    text += "AngleX(deg)\tAngleY(deg)\tAngleZ(deg)\r\n"
    for number, (a, b) in enumerate(zip(f, w, strict=True)):
        cells = "\t".join(f"{one:.4f}" for one in (*a, *b, 1.5, -0.2, 30.1))
        text += f"2024-1-2 10:20:{30 + number // 50:02}:{20 * (number % 50):03}\t{cells}\r\n"
    return Printed(text, w * DEGREE, f * G, 37_230 + 0.02 * np.arange(COUNT))


def pico_printf() -> Printed:
    f, w = numbers(25, 1.0, 1 / DEGREE, 6)
    text = ""
    for a, b in zip(f, w, strict=True):
        text += f"accel x: {a[0]:.6f}, y: {a[1]:.6f}, z: {a[2]:.6f}\n\r"
        text += f"gyro x: {b[0]:.6f}, y: {b[1]:.6f}, z: {b[2]:.6f}\n\r"
    return Printed(text, w * DEGREE, f * G)


def still_dot(count: int) -> str:
    """Return what a Movella DOT at rest exports: rates of 0.2 °/s under a heading without a unit.

    Parameters
    ----------
    count
        Samples, of which it takes 60 a second.
    """
    rng = np.random.default_rng(1)
    lines = ["PacketCounter,SampleTimeFine,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z"]
    for number in range(count):
        force = np.array((0.1, -0.2, 9.8)) + 0.02 * rng.standard_normal(3)
        rate = np.array((0.2, -0.15, 0.08)) + 0.03 * rng.standard_normal(3)
        cells = ",".join(f"{one:.6f}" for one in (*force, *rate))
        lines.append(f"{number},{192_856_375 + 16_667 * number},{cells}")
    return "\n".join(lines) + "\n"


OUTPUTS: dict[str, Callable[[], Printed]] = {
    make.__name__: make
    for make in (
        adafruit_mpu6050, adafruit_icm20948, adafruit_lsm9ds1, adafruit_bno055, sparkfun_icm20948,
        sparkfun_lsm6ds3, seeed_lsm6ds3, sparkfun_lsm9ds1, i2cdevlib_raw, raw_on_two_lines, arduino_plotter,
        winer_mpu9250, winer_basic, st_lsm6dso, esp_idf, serial_monitor, json_lines, json_of_lists, artemis,
        movella_dot, mt_manager, lp_research, rostopic, ros2_topic, witmotion_text, pico_printf,
    )
}  # fmt: skip
"""The texts by name."""
