"""Magnetometers and barometers of phones: what is taken, and the heading and height it gives."""

from __future__ import annotations

import zipfile
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from foreign_tables import UNIX, table
from scipy.spatial.transform import Rotation

from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.files.sensor_log_writer import write_sensor_log
from lab.data.log.pressure_height import pressure_at
from lab.data.sheets.column_names import heading_of
from lab.data.sheets.sheet_field import _is_of_the_earth
from lab.missions import read_sensor_log
from lab.missions.flight_import import read_log
from lab.motion.frames.magnetic_field import magnetic_field
from lab.motion.frames.rotation import euler_from_quaternion, wrap
from lab.motion.recordings.recording import Recording
from lab.motion.truth.trajectory import Trajectory
from lab.navigation.log_navigation import navigate_log
from lab.navigation.settings import NavigatorSettings
from lab.sensors.suite import SensorSuite

RATE, DURATION = 50.0, 60.0
PLACE = np.array([np.radians(48.2), np.radians(11.6), 520.0])
MOUNTS = {"lies": (0.0, 5.0, -3.0), "leans": (40.0, 35.0, 5.0), "stands": (-70.0, 80.0, 0.0)}
"""Yaw, pitch and roll of the body of a phone, top forward and screen up, in a walker's hand [°]."""
FROM_BODY = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]], float)
"""Takes forward, right, down to the axes of a phone."""
NOISE = 0.5
"""σ of the magnetometer [µT]."""


@cache
def path(speed: float, course: float, climb: float = 0.0, turn: float = 0.0) -> Trajectory:
    """Return a steady walk, climbing [m/s], in a direction that turns in its middle [°]; or a rest."""
    t = np.arange(0, DURATION + 0.5 / RATE, 1 / RATE)
    angle = np.radians(course + turn * (1 - np.cos(np.pi * np.clip((t - 20) / 20, 0, 1))) / 2)
    velocity = np.column_stack((speed * np.cos(angle), speed * np.sin(angle), np.full(t.size, -climb)))
    way = np.vstack((np.zeros(3), np.cumsum((velocity[1:] + velocity[:-1]) / 2 / RATE, axis=0)))
    latitude = PLACE[0] + way[:, 0] / 6_373_500
    longitude = PLACE[1] + way[:, 1] / (6_390_200 * np.cos(PLACE[0]))
    euler = np.column_stack((0 * t, 0 * t, angle))
    return Trajectory.from_recording(
        Recording(t, latitude, longitude, PLACE[2] - way[:, 2], velocity, euler), RATE
    )


def mounted(mount: str) -> Rotation:
    return Rotation.from_euler("ZYX", MOUNTS[mount], degrees=True)


def export(
    folder, truth, mount, iron=(0, 0, 0), *, seed=1, field="Magnetic field {} (µT)", scale=1.0, pressure=None
):
    """Write a phone's sensors as phyphox does: each in a table of its own, with its own clock."""
    rng, device = np.random.default_rng(seed), mounted(mount)
    ideal = truth.increments(RATE)
    time = ideal.time[1:]

    def phone(vectors):
        return device.apply(vectors, inverse=True) @ FROM_BODY.T

    rate = phone(ideal.dtheta * RATE) + rng.normal(0, 2e-3, (time.size, 3))
    force = (
        phone(ideal.dvelocity * RATE) + np.array((0.05, -0.04, 0.06)) + rng.normal(0, 0.05, (time.size, 3))
    )
    at = np.arange(0.313, DURATION - 0.5, 0.04)
    attitude = Rotation.from_quat(truth.at(at).q_nb, scalar_first=True)
    measured = phone(attitude.apply(magnetic_field(PLACE), inverse=True)) + iron
    measured += rng.normal(0, NOISE, measured.shape)
    fixes = np.arange(1.37, DURATION - 0.5)
    there = truth.at(fixes)
    north, east, up = (rng.normal(size=(fixes.size, 3)) * (2, 2, 3)).T
    place = np.column_stack((np.degrees(there.latitude), np.degrees(there.longitude), there.height + up))
    place[:, :2] += np.column_stack((north / 111_200, east / (111_320 * np.cos(PLACE[0]))))
    speed = np.hypot(there.velocity_n[:, 0], there.velocity_n[:, 1]) + np.abs(rng.normal(0, 0.2, fixes.size))
    files = []

    def sheet(name, columns, *values):
        rows = np.column_stack(values)
        files.append(table(folder / f"{name}.csv", ",".join(columns), rows))

    sheet("Accelerometer", ("Time (s)", *(f"Acceleration {axis} (m/s^2)" for axis in "xyz")), time, force)
    sheet("Gyroscope", ("Time (s)", *(f"Gyroscope {axis} (rad/s)" for axis in "xyz")), time, rate)
    places = ("Latitude (°)", "Longitude (°)", "Height (m)")
    names = ("Time (s)", *places, "Velocity (m/s)", "Horizontal Accuracy (m)", "Vertical Accuracy (m)")
    sheet("Location", names, fixes, place, speed, np.tile((3.03, 3.0), (fixes.size, 1)))
    if field:
        sheet("Magnetometer", ("Time (s)", *(field.format(axis) for axis in "xyz")), at, measured * scale)
    if pressure is not None:
        sheet("Pressure", ("Time (s)", "Pressure (hPa)"), at, pressure(truth.at(at).height, rng) / 100)
    return files


def navigated(log, **settings):
    sensors = SensorSuite()
    for name, value in settings.items():
        sensors.set(name.replace("__", "."), value)
    return navigate_log(log, sensors, NavigatorSettings())


def heading_error(log, made, truth, mount, axes):
    """Return the error of the heading at the start and its σ [°]."""
    at = np.array([made.imu.time[0] + log.epoch])
    body = Rotation.from_quat(truth.at(at).q_nb, scalar_first=True) * mounted(mount)
    turned = body.as_matrix()[0] @ FROM_BODY.T @ axes.T
    true = np.arctan2(turned[1, 0], turned[0, 0])
    found = euler_from_quaternion(made.alignment.start.q_nb)[2]
    return float(np.degrees(wrap(found - true))), float(np.degrees(made.alignment.attitude_sigma[2]))


def axes_of(log):
    """Return the matrix from the phone's axes to the log's, out of the report."""
    said = next(one for one in log.repairs if one.startswith("Axes: "))
    words = said.removeprefix("Axes: ").split(" of the IMU")[0].split(", ")
    C = np.zeros((3, 3))
    for row, word in enumerate(words):
        name = word.rsplit(" ", 1)[1]
        C[row, "xyz".index(name[-1])] = -1 if name.startswith("-") else 1
    return C


@pytest.mark.proof
@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize(("speed", "course"), [(0.0, 20.0), (0.0, 250.0), (0.8, 130.0), (0.8, 320.0)])
def test_the_magnetometer_of_a_phone_gives_the_heading(tmp_path, mount, speed, course):
    truth = path(speed, course)
    files = export(tmp_path, truth, mount)
    log = read_log(files)
    write_sensor_log(tmp_path / "walk", log, title="Walk")
    again = read_sensor_log(tmp_path / "walk")
    made = navigated(again)
    error, sigma = heading_error(again, made, truth, mount, axes_of(log))
    assert sigma < 27
    assert abs(error) < 2 * sigma
    bare = navigated(read_log(files[:3]))
    assert np.degrees(bare.alignment.attitude_sigma[2]) > 90
    assert any("Magnetometer: Magnetic field x (µT)" in one and "25 Hz" in one for one in log.repairs)


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("Magnetic field x (µT)", "µT"), ("Magnetfeld x (µT)", "µT"), ("Champ magnétique x (µT)", "µT"),
        ("Campo magnetico x (μT)", "µT"), ("MAGNETIC FIELD X (μT)", "µT"), ("mag_x_uT", "µT"),
        ("mx_uT", "µT"),
        ("magnetometerX(µT)", "µT"), ("motionMagneticFieldX(µT)", "µT"), ("locationHeadingX(µT)", "µT"),
        ("magnetometerX(G)", "G"), ("Magnetometer x [mT]", "mT"), ("magnetic_field.x", ""), ("Bx", ""),
        ("MagX", ""), ("xmag", ""), ("Magnetometer X (nT)", "nT"), ("MagneticField.x", ""), ("X (µT)", "µT"),
    ],
)  # fmt: skip
def test_headings_name_a_magnetometer(text, unit):
    found = heading_of(text)
    assert (found.quantity, found.axis, found.unit) == ("field", "x", unit)


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("Pressure (hPa)", "hPa"), ("Luftdruck (hPa)", "hPa"), ("Pression (hPa)", "hPa"), ("pressure", ""),
        ("altimeterPressure(kPa)", "kPa"), ("ATMOSPHERIC PRESSURE (hPa)", "hPa"), ("pressure_hPa", "hPa"),
        ("Pressure [mbar]", "mbar"), ("p", ""), ("baro_pressure (Pa)", "Pa"),
    ],
)  # fmt: skip
def test_headings_name_a_pressure(text, unit):
    found = heading_of(text)
    assert (found.quantity, found.unit) == ("pressure", unit)


@pytest.mark.parametrize(
    "text",
    [
        "mag_bias_x", "magnetometer offset x", "MagOfsX", "mag_field_earth_x", "magnitude x",
        "Moment Mx [Nm]",
        "motionMagneticFieldCalibrationAccuracy(Z)", "tire pressure (kPa)", "pressure altitude (Pa)",
        "mag_ned_x", "m_x [m]", "acc_bx",
    ],
)  # fmt: skip
def test_other_fields_and_pressures_are_not_taken(text):
    found = heading_of(text)
    assert found is None or found.quantity not in {"field", "pressure"}


@pytest.mark.parametrize(
    ("heading", "scale", "said"),
    [
        ("mag_{}", 1.0, "in µT (guessed"), ("B{}", 1.0, "in µT (guessed"), ("mag_{}", 1e-6, "in T (guessed"),
        ("mag_{} (G)", 1e-2, "in G (named"), ("Magnetometer {} (nT)", 1e3, "in nT (named"),
        ("x{}", 1.0, ""), ("mag_{} (mT)", 1.0, "The numbers look like µT: state the unit"),
    ],
)  # fmt: skip
def test_the_unit_is_that_of_the_heading_or_of_the_earths_field(tmp_path, heading, scale, said):
    log = read_log(export(tmp_path, path(0.0, 20.0), "lies", field=heading, scale=scale)[: 4 if said else 3])
    report = " ".join(log.repairs)
    assert said in report
    taken = log.auxiliary.magnetometer
    assert (taken is not None) == (" (guessed" in said or " (named" in said)
    if taken is not None:
        size = np.linalg.norm(taken.field, axis=1)
        assert np.median(size) == pytest.approx(np.linalg.norm(magnetic_field(PLACE)), abs=0.3)


def directions(count):
    """Return directions all around."""
    vectors = np.random.default_rng(7).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


@pytest.mark.proof
@pytest.mark.parametrize("iron", 40.0 * directions(6), ids=str)
def test_hard_iron_makes_nothing_worse(tmp_path, iron):
    """The walk with a corner is that without the magnetometer, and the report says what the field is."""
    files = export(tmp_path, path(0.8, 130.0, turn=90.0), "leans", iron)
    log, bare = read_log(files), read_log(files[:3])
    assert log.auxiliary.magnetometer is None
    assert any("is not used: it is" in one and "Iron nearby" in one for one in log.repairs)
    one, other = navigated(log), navigated(bare)
    np.testing.assert_array_equal(one.alignment.start.q_nb, other.alignment.start.q_nb)
    np.testing.assert_array_equal(one.solution.position, other.solution.position)


def test_iron_hides_in_few_directions_where_a_phone_does_not_turn():
    """The Earth's field may still be as long and as steep; turned by 90° iron shows in any direction."""
    earth = magnetic_field(PLACE)
    time = np.arange(0.5, 60)
    hidden = {}
    for turn in (0.0, 90.0):
        yaw = Rotation.from_euler("Z", np.interp(time, (20, 40), (0, turn))[:, None], degrees=True)
        field, force = (yaw.apply(vector, inverse=True) for vector in (earth, (0, 0, -STANDARD_GRAVITY)))
        stamps = np.append(0.0, time)
        log = SimpleNamespace(time=stamps, rates=(None, force))
        hidden[turn] = sum(
            _is_of_the_earth(time, field + iron, log, earth).mean() >= 0.8 for iron in 40.0 * directions(500)
        )
    assert 0 < hidden[0.0] < 25
    assert hidden[90.0] == 0


def test_a_stuck_magnetometer_and_repeated_readings(tmp_path):
    """A table at the rate of the IMU repeats the readings of a slower sensor; a stuck one has no other."""
    files = export(tmp_path, path(0.0, 20.0), "lies")
    lines = files[3].read_text().splitlines()
    held = [lines[0]]
    for row, line in enumerate(lines[1:]):
        time, _, _ = line.partition(",")
        held.append(f"{time},{lines[1 + row // 5 * 5].partition(',')[2]}")
    held[10] = held[10].rpartition(",")[0] + ","
    files[3].write_text("\n".join(held) + "\n")
    log = read_log(files)
    assert 290 < len(log.auxiliary.magnetometer.time) < 300
    assert any("Magnetometer:" in one and "5 Hz" in one for one in log.repairs)
    stuck = [lines[0]] + [f"{line.partition(',')[0]},20,5,-43" for line in lines[1:]]
    files[3].write_text("\n".join(stuck) + "\n")
    log = read_log(files)
    assert log.auxiliary.magnetometer is None
    assert any("it does not change" in one for one in log.repairs)


def test_a_calibrated_magnetometer_is_preferred(tmp_path):
    """An uncalibrated one beside it, in which the iron of the phone is, is named and not used."""
    files = export(tmp_path, path(0.0, 20.0), "lies")
    lines = files[3].read_text().splitlines()
    raw = files[3].with_name("MagnetometerUncalibrated.csv")
    raw.write_text(
        "\n".join([lines[0].replace("Magnetic field", "Magnetic field uncalibrated"), *lines[1:]]) + "\n"
    )
    log = read_log([*files[:3], raw, files[3]])
    report = " ".join(log.repairs)
    assert "Magnetic field z (µT) of Magnetometer.csv, in µT" in report
    assert "Other magnetometers in the files are not used: Magnetic field uncalibrated x" in report


def weather(height, rng):
    """Return pressures [Pa]: 15 hPa below the standard atmosphere, with the noise of a phone, 10 cm."""
    return pressure_at(height + rng.normal(0, 0.1, height.size)) - 1500.0


def test_a_barometer_gives_the_height(tmp_path):
    truth = path(0.8, 130.0, climb=0.5)
    files = export(tmp_path, truth, "leans", pressure=weather)
    log, bare = read_log(files), read_log(files[:4])
    assert any("Barometer: Pressure (hPa) of Pressure.csv, in hPa" in one for one in log.repairs)
    series = log.auxiliary.barometer
    true = truth.at(series.time + log.epoch).height
    assert np.std(series.value - true) < 0.3
    assert abs(np.mean(series.value - true)) < 12
    assert np.diff(series.time).min() > 0.5
    unaided, aided = navigated(log), navigated(log, barometer__fitted=True)
    np.testing.assert_array_equal(unaided.solution.position, navigated(bare).solution.position)

    def scatter(run):
        error = run.solution.position[:, 2] - truth.at(run.imu.time + log.epoch).height
        return np.std(error[run.imu.time > 10])

    assert scatter(aided) < 0.5 * scatter(unaided)


def test_a_cabin_with_its_own_pressure_is_not_taken(tmp_path):
    """Its pressure does not change with the height."""
    files = export(
        tmp_path, path(5.0, 130.0, climb=4.0), "leans",
        pressure=lambda height, rng: pressure_at(500 + rng.normal(0, 0.1, height.size)),
    )  # fmt: skip
    log = read_log(files)
    assert log.auxiliary.barometer is None
    assert any("The barometer Pressure (hPa) of Pressure.csv is not used" in one for one in log.repairs)


def columns(file):
    """Return the numbers of a table."""
    return np.genfromtxt(file, delimiter=",", skip_header=1)


def test_sensor_logger_on_an_iphone(tmp_path):
    """Its accelerations are along gravity, and its field is not; the one of a watch is not read."""
    files = export(tmp_path, path(0.0, 250.0), "leans", pressure=weather)
    force, rate, place, field, air = map(columns, files)
    folder = tmp_path / "export"
    folder.mkdir()

    def sheet(name, header, values):
        stamps = [f"{int((UNIX + t) * 1e9)}" for t in values[:, 0]]
        rows = [[text, t, *more] for text, (t, *more) in zip(stamps, values, strict=True)]
        return table(folder / f"{name}.csv", f"time,seconds_elapsed,{header}", rows)

    def vectors(name, values):
        return sheet(name, "z,y,x", values[:, [0, 3, 2, 1]])

    gravity = force.copy()
    gravity[:, 1:] = -np.median(force[:, 1:], axis=0)
    user = np.column_stack((force[:, 0], -force[:, 1:] - gravity[:, 1:]))
    row = ["3", "Phone", "0", "2023-11-14_22-13-20", "UTC", "ios", "1.64", "id", "A", "10", "false", "17"]
    table(
        folder / "Metadata.csv",
        "version,device name,recording epoch time,recording time,recording timezone,platform,appVersion,"
        "device id,sensors,sampleRateMs,standardisation,platform version",
        [row],
    )
    vectors("Gyroscope", rate)
    vectors("Gravity", gravity)
    vectors("Accelerometer", user)
    vectors("Magnetometer", field)
    vectors("MagnetometerUncalibrated", field + np.array((0.0, -90.0, 40.0, 200.0)))
    vectors("WatchMagnetometer", field[:, [0, 2, 1, 3]])
    sheet("Barometer", "relativeAltitude,pressure", np.insert(air, 1, 0.0, axis=1))
    sheet("WatchBarometer", "relativeAltitude,pressure", np.insert(air / [1, 10], 1, 0.0, axis=1))
    sheet("Location", "latitude,longitude,altitude,speed,verticalAccuracy", place)
    archive = tmp_path / "export.zip"
    with zipfile.ZipFile(archive, "w") as zipped:
        for one in sorted(folder.iterdir()):
            zipped.write(one, one.name)
    log, other = read_log([archive]), read_log(files)
    assert axes_of(log).tolist() == axes_of(other).tolist()
    np.testing.assert_allclose(
        log.auxiliary.magnetometer.field, other.auxiliary.magnetometer.field, atol=1e-9
    )
    np.testing.assert_allclose(log.auxiliary.barometer.value, other.auxiliary.barometer.value, atol=1e-6)
    report = " ".join(log.repairs)
    assert "x, y, z of Magnetometer.csv, in µT (guessed" in report
    assert "pressure of Barometer.csv, in hPa (guessed" in report
    assert "Watch" not in report.partition("Barometer:")[2]


def test_one_table_of_sensorlog(tmp_path):
    """Core Motion's field is preferred to the raw one; the pressure is in kPa, and slower sensors repeat."""
    files = export(tmp_path, path(0.0, 250.0), "leans", pressure=weather)
    force, rate, place, field, air = map(columns, files)
    time = rate[:, 0]

    def held(values):
        return values[np.clip(np.searchsorted(values[:, 0], time, "right") - 1, 0, None), 1:]

    fixes, iron = held(place), np.array((-90.0, 40.0, 200.0))
    names = [
        "accelerometerTimestamp_sinceReboot(s)",
        *(f"accelerometerAcceleration{axis}(G)" for axis in "XYZ"),
        *(f"gyroRotation{axis}(rad/s)" for axis in "XYZ"),
        *(f"magnetometer{axis}(µT)" for axis in "XYZ"),
        *(f"motionMagneticField{axis}(µT)" for axis in "XYZ"),
        "altimeterPressure(kPa)", "locationLatitude(WGS84)", "locationLongitude(WGS84)",
        "locationAltitude(m)",
        "locationSpeed(m/s)",
    ]  # fmt: skip
    rows = np.column_stack(
        (time, -force[:, 1:] / STANDARD_GRAVITY, rate[:, 1:], held(field) + iron, held(field),
         held(air) / 10, fixes[:, :4])
    )  # fmt: skip
    log = read_log([table(tmp_path / "log.csv", ",".join(names), rows)])
    report = " ".join(log.repairs)
    assert "Magnetometer: motionMagneticFieldX(µT)" in report
    assert "25 Hz" in report
    assert "not used: magnetometerX(µT) of log.csv" in report
    assert "altimeterPressure(kPa) of log.csv, in kPa (named" in report
    assert log.auxiliary.barometer is not None
