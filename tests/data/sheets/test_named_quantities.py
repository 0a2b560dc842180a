"""Quantities that a csv of unknown origin names: each is used, in any usual spelling and unit, or said.

The flights are closed forms: a heading that swings, a coordinated bank, wind, and heights with a sine.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.spatial.transform import Rotation

from lab.data.formats import read_raw
from lab.data.sheets.sensor_csv import read, sheets_of
from lab.data.sheets.sheet_fixes import find_fixes
from lab.missions import MissionError, prepare_import

GRAVITY = 9.80665
RADIUS = 6.371e6


class Flight:
    """A flight in the wind, at 5 Hz, at 46.5° N: positions [°, m], velocity [m/s] and attitude [rad]."""

    def __init__(self, wind=(4.0, -11.0), airspeed=45.0, duration=160.0, turned=0.0, noise=0.0, start=0.0):
        self.time = start + np.arange(0.0, duration, 0.2)
        t = self.time - start
        angle = 0.7 + 0.6 * np.sin(2 * np.pi * t / 50)
        rate = 0.6 * 2 * np.pi / 50 * np.cos(2 * np.pi * t / 50)
        climb = 2.5 * np.sin(2 * np.pi * t / 31)
        self.velocity = np.column_stack(
            (airspeed * np.cos(angle) + wind[0], airspeed * np.sin(angle) + wind[1], -climb)
        )
        bank = np.arctan(airspeed * rate / GRAVITY)
        self.euler = np.column_stack((bank, np.full_like(t, 0.05), angle))
        if turned:  # thrust tilts as before, and the nose points elsewhere
            about = Rotation.from_euler("z", turned)
            self.euler = (Rotation.from_euler("ZYX", self.euler[:, ::-1]) * about).as_euler("ZYX")[:, ::-1]
        moved = cumulative_trapezoid(self.velocity, t, axis=0, initial=0.0)
        latitude = 46.5 + np.degrees(moved[:, 0] / 6.3669e6)
        longitude = 7.0 + np.degrees(moved[:, 1] / (6.3887e6 * np.cos(np.radians(46.5))))
        height = 900.0 - moved[:, 2] + noise * np.random.default_rng(4).standard_normal(len(t))
        self.place = np.column_stack((latitude, longitude, height))
        self.quaternion = Rotation.from_euler("ZYX", self.euler[:, ::-1]).as_quat(scalar_first=True)

    def write(self, path, columns: dict[str, np.ndarray]):
        """Write columns by their headings, and return the path."""
        rows = np.column_stack(list(columns.values()))
        lines = [",".join(columns), *(",".join(f"{x:.11g}" for x in row) for row in rows)]
        path.write_text("\n".join(lines) + "\n")
        return path

    def placed(self, time="time", names=("lat", "lon", "alt")) -> dict[str, np.ndarray]:
        """Return the columns of time and position."""
        return {time: self.time, **dict(zip(names, self.place.T, strict=True))}


def apart(found, euler) -> float:
    """Return the largest angle between two attitudes [°]."""
    turn = Rotation.from_euler("ZYX", found[:, ::-1]).inv() * Rotation.from_euler("ZYX", euler[:, ::-1])
    return float(np.degrees(turn.magnitude().max()))


ANGLES = (
    ("roll", "pitch", "heading"), ("Roll (deg)", "Pitch (deg)", "Yaw (deg)"),
    ("bank", "pitch", "true heading"),
    ("OSD.roll", "OSD.pitch", "OSD.yaw"), ("phi_deg", "theta_deg", "psi_deg"), ("roulis", "tangage", "lacet"),
    ("Rollwinkel", "Nickwinkel", "Gierwinkel"), ("attitude_roll", "attitude_pitch", "attitude_yaw"),
)  # fmt: skip


@pytest.mark.parametrize("names", ANGLES)
@pytest.mark.parametrize("clockwise_from_zero", [True, False])
def test_angles_in_degrees_are_the_attitude(tmp_path, names, clockwise_from_zero):
    flown = Flight()
    angles = np.degrees(flown.euler)
    if clockwise_from_zero:
        angles[:, 2] %= 360
    columns = flown.placed() | dict(zip(names, angles.T, strict=True))
    flight = read_raw(flown.write(tmp_path / "a.csv", columns))
    assert flight.euler is not None and apart(flight.euler, flown.euler) < 1e-3
    assert any(f"Attitude: {names[0]}" in one for one in flight.remarks)


@pytest.mark.parametrize(
    ("tail", "factor", "unit"),
    [("", 1.0, "rad"), ("_rad", 1.0, "rad"), (" [deg]", 180 / np.pi, "°"), ("", 18_000 / np.pi, "0.01°")],
)
def test_the_unit_of_angles_is_named_or_shown(tmp_path, tail, factor, unit):
    flown = Flight()
    columns = flown.placed() | {
        f"{name}{tail}": factor * one
        for name, one in zip(("roll", "pitch", "yaw"), flown.euler.T, strict=True)
    }
    flight = read_raw(flown.write(tmp_path / "a.csv", columns))
    assert flight.euler is not None and apart(flight.euler, flown.euler) < 1e-3
    assert {one.unit for one in flight.units if one.column.startswith(("roll", "pitch", "yaw"))} == {unit}


def test_yaw_from_east_to_north_and_pitch_down_is_told_by_the_course(tmp_path):
    flown = Flight()
    roll, pitch, yaw = flown.euler.T
    columns = flown.placed() | {"roll": roll, "pitch": -pitch, "yaw": np.pi / 2 - yaw}
    flight = read_raw(flown.write(tmp_path / "a.csv", columns))
    assert flight.euler is not None and apart(flight.euler, flown.euler) < 1e-3


FLIP = Rotation.from_matrix(np.diag([1.0, -1, -1]))
SWAP = Rotation.from_matrix([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])


@pytest.mark.parametrize("enu", [False, True])
@pytest.mark.parametrize("inverse", [False, True])
@pytest.mark.parametrize(
    ("names", "order"),
    [
        (("qw", "qx", "qy", "qz"), "wxyz"), (("q[0]", "q[1]", "q[2]", "q[3]"), "wxyz"),
        (("q0", "q1", "q2", "q3"), "xyzw"),
        (("orientation.x", "orientation.y", "orientation.z", "orientation.w"), "xyzw"),
    ],
)  # fmt: skip
def test_quaternions_of_any_order_and_frame(tmp_path, names, order, enu, inverse):
    flown = Flight()
    turn = Rotation.from_quat(flown.quaternion, scalar_first=True)
    turn = SWAP * turn * FLIP if enu else turn
    parts = (turn.inv() if inverse else turn).as_quat(scalar_first=order == "wxyz")
    columns = flown.placed() | dict(zip(names, parts.T, strict=True))
    flight = read_raw(flown.write(tmp_path / "a.csv", columns))
    assert flight.euler is not None and apart(flight.euler, flown.euler) < 1e-3


@pytest.mark.parametrize("turned", [np.pi, np.pi / 2])
def test_a_copter_may_fly_backwards_or_sideways(tmp_path, turned):
    flown = Flight(turned=turned)
    columns = flown.placed() | dict(zip(("roll", "pitch", "yaw"), np.degrees(flown.euler).T, strict=True))
    flight = read_raw(flown.write(tmp_path / "a.csv", columns))
    assert flight.euler is not None and apart(flight.euler, flown.euler) < 1e-3


@pytest.mark.parametrize("seed", range(6))
def test_the_attitude_of_something_else_is_not_used_and_said(tmp_path, seed):
    """Of a phone in a hand: turning slowly, which has nothing to do with the motion, and swinging."""
    flown = Flight(wind=(0.0, 0.0), airspeed=5.0)
    rng = np.random.default_rng(seed)
    swing = Rotation.from_rotvec(0.6 * np.sin(flown.time[:, None] * rng.uniform(0.2, 0.5, 3)))
    spin = Rotation.from_euler("z", (flown.time * rng.uniform(0.05, 0.2))[:, None])
    turn = spin * Rotation.from_quat(rng.standard_normal(4)) * swing
    columns = flown.placed() | dict(
        zip(("roll", "pitch", "yaw"), np.degrees(turn.as_euler("ZYX")[:, ::-1]).T, strict=True)
    )
    flight = read_raw(flown.write(tmp_path / "a.csv", columns))
    assert flight.euler is None
    assert any(
        "roll, pitch, yaw is not used" in one and "--column roll=roll" in one for one in flight.remarks
    )
    said = read_raw(tmp_path / "a.csv", {name: f"{name}[°]" for name in ("roll", "pitch", "yaw")})
    assert said.euler is not None and apart(said.euler, turn.as_euler("ZYX")[:, ::-1]) < 1e-3


def test_an_attitude_of_its_own_rate_and_file_is_interpolated(tmp_path):
    flown = Flight()
    place = flown.write(tmp_path / "position.csv", flown.placed("timestamp_s"))
    rows = slice(None, None, 3)
    names = ("timestamp_s", "q[0]", "q[1]", "q[2]", "q[3]")
    columns = dict(zip(names, (flown.time[rows], *flown.quaternion[rows].T), strict=True))
    columns |= {f"rollspeed{i}": 0 * flown.time[rows] for i in range(2)}
    found = read([place, flown.write(tmp_path / "attitude.csv", columns)], {})
    assert found.euler is not None and apart(found.euler, flown.euler[: len(found.time)]) < 0.5


VERTICAL = (
    (("vel_n_m_s", "vel_e_m_s", "vel_d_m_s"), (1, 1, 1)),
    (("vn", "ve", "vd"), (1, 1, 1)),
    (("velE", "velN", "velU"), (0, 0, -1)),
    (("vel_north [mm/s]", "vel_east [mm/s]", "vel_down [mm/s]"), (1e3, 1e3, 1e3)),
)


@pytest.mark.parametrize(("names", "factors"), VERTICAL)
def test_the_vertical_velocity_of_a_csv_is_that_of_the_flight(tmp_path, names, factors):
    flown = Flight(noise=4.0)
    north, east, down = flown.velocity.T
    values = (east, north, -down) if names[2].endswith("U") else (north, east, down)
    values = [one * (abs(f) if f else 1) for one, f in zip(values, factors, strict=True)]
    columns = flown.placed(names=("lat", "lon", "alt_m")) | dict(zip(names, values, strict=True))
    made = prepare_import(flown.write(tmp_path / "a.csv", columns))
    np.testing.assert_allclose(made.raw.velocity_n[:, 2], down, atol=0.02)
    assert not made.raw.made
    assert made.rebuilt.velocity_residual[2] < 0.02


@pytest.mark.parametrize(
    ("name", "factor", "unit"),
    [("climb", -60 / 0.3048, "ft/min"), ("vspd", -60 / 0.3048, "ft/min"), ("vertical speed", -1.0, "m/s"),
     ("climb rate (km/h)", -3.6, "km/h")],
)  # fmt: skip
def test_a_climb_beside_speed_and_course_is_in_the_unit_of_the_heights(tmp_path, name, factor, unit):
    flown = Flight(noise=1.0)
    north, east, down = flown.velocity.T
    columns = flown.placed(names=("lat", "lon", "alt_m")) | {
        "speed": np.hypot(north, east), "course": np.degrees(np.arctan2(east, north)) % 360,
        name: factor * down,
    }  # fmt: skip
    flight = read_raw(flown.write(tmp_path / "a.csv", columns))
    np.testing.assert_allclose(flight.velocity_n[:, 2], down, atol=0.02)
    assert {one.column: one.unit for one in flight.units}[name] == unit


def test_a_vertical_velocity_of_the_other_sign_is_not_used_and_said(tmp_path):
    flown = Flight()
    columns = flown.placed() | dict(zip(("vn", "ve", "vd"), (flown.velocity * [1, 1, -1]).T, strict=True))
    path = flown.write(tmp_path / "a.csv", columns)
    flight = read_raw(path)
    assert np.abs(flight.velocity_n[:, 2] - flown.velocity[:, 2]).max() < 0.5  # the slope of the heights
    (said,) = [one for one in flight.remarks if "the heights change the other way" in one]
    heading, _, quantity = said.partition('--column "')[2].partition('"')[0].partition("=")
    right = read_raw(path, {heading: quantity})
    np.testing.assert_allclose(right.velocity_n[:, 2], flown.velocity[:, 2], atol=1e-6)


@pytest.mark.parametrize(
    "counter", ["lat_lon_reset_counter", "xy_reset_counter", "resets", "position reset count"]
)
@pytest.mark.parametrize("jump", [30.0, 75.0])
def test_a_counted_reset_of_the_estimator_cuts_the_flight(tmp_path, counter, jump):
    flown = Flight()
    columns = flown.placed("timestamp_s") | dict(zip(("vn", "ve", "vd"), flown.velocity.T, strict=True))
    columns["lat"] = columns["lat"] + np.degrees(jump / 6.3669e6) * (flown.time >= 100)
    path = flown.write(tmp_path / "a.csv", columns | {counter: 3.0 + (flown.time >= 100)})
    made = prepare_import(path)
    (reset,) = made.raw.resets
    assert reset.time == pytest.approx(100.0) and "the position by" in reset.change
    assert made.recording.duration == pytest.approx(99.8, abs=0.3)
    # A counter that counts without a jump cuts nothing.
    smooth = columns | {"lat": flown.place[:, 0], counter: 3.0 + (flown.time >= 100)}
    assert not read_raw(flown.write(tmp_path / "b.csv", smooth)).resets


def test_a_counted_reset_of_the_velocity_cuts_too(tmp_path):
    flown = Flight()
    velocity = flown.velocity + [2.0, 0, 0] * (flown.time >= 40)[:, None]
    columns = flown.placed() | dict(zip(("vn", "ve", "vd"), velocity.T, strict=True))
    flight = read_raw(
        flown.write(tmp_path / "a.csv", columns | {"vxy_reset_counter": (flown.time >= 40) * 1.0})
    )
    assert [one.change.partition(" by")[0] for one in flight.resets] == ["the velocity"]


@pytest.mark.parametrize("left", [1, 3])
def test_columns_that_are_not_used_are_listed(tmp_path, left):
    flown = Flight()
    more = {f"battery {i}": flown.time for i in range(left)} | {"pressure_hpa": flown.time}
    flight = read_raw(flown.write(tmp_path / "a.csv", flown.placed() | more))
    (said,) = [one for one in flight.remarks if one.startswith("Columns not read")]
    assert all(name in said for name in more)


def test_some_of_the_labs_own_headings_are_a_csv_with_named_columns(tmp_path):
    flown = Flight()
    own = dict(zip(("roll_deg", "pitch_deg", "yaw_deg"), np.degrees(flown.euler).T, strict=True))
    velocity = dict(zip(("vel_n_m_s", "vel_e_m_s", "vel_d_m_s"), flown.velocity.T, strict=True))
    found = []
    for time in ("time_s",):
        columns = flown.placed(time, ("lat_deg", "lon_deg", "alt_m")) | velocity | own
        found.append(read_raw(flown.write(tmp_path / "a.csv", columns)))
    for one in found:
        assert one.format == "csv with named columns"
        np.testing.assert_allclose(one.velocity_n, flown.velocity, atol=1e-6)
        assert apart(one.euler, flown.euler) < 1e-3


MESSAGES = (
    ("mm", "mm/s", 1e3, ("hAcc", "vAcc", "sAcc"), ("velN", "velE", "velD")),
    ("cm", "cm/s", 1e2, ("h_acc", "v_acc", "s_acc"), ("vel_n", "vel_e", "vel_d")),
)


@pytest.mark.parametrize(("length", "speed", "factor", "accuracies", "velocities"), MESSAGES)
@pytest.mark.parametrize("named", [True, False])
def test_accuracies_share_the_unit_of_what_they_are_of(
    tmp_path, length, speed, factor, accuracies, velocities, named
):
    flown = Flight()
    flown.place[:, 2] += 100.0 * (not named and length == "mm")
    latitude, longitude, height = flown.place.T
    name = f"height [{length}]" if named or length == "cm" else "height"
    columns = {
        "time": flown.time, "lat": np.rint(latitude * 1e7), "lon": np.rint(longitude * 1e7),
        name: np.rint(height * factor),
        **dict(zip(velocities, np.rint(factor * flown.velocity).T, strict=True)),
        **{name: np.full(len(flown.time), np.rint(size * factor / 1e3))
           for name, size in zip(accuracies, (1515.0, 1500.0, 100.0), strict=True)},
    }  # fmt: skip
    gnss = find_fixes(sheets_of([flown.write(tmp_path / "a.csv", columns)], {})).gnss
    np.testing.assert_allclose(gnss.position_sigma[5], [1.0, 1.0, 1.5], rtol=4e-3)  # 152 cm
    np.testing.assert_allclose(gnss.velocity_sigma[5], 0.1, rtol=1e-6)  # of what is measured, down too
    del columns[velocities[2]]
    gnss = find_fixes(sheets_of([flown.write(tmp_path / "level.csv", columns)], {})).gnss
    np.testing.assert_allclose(gnss.velocity_sigma[5], [0.1, 0.1, np.nan], rtol=1e-6)


def test_a_sigma_of_hundreds_of_metres_beside_fixes_that_agree_is_in_another_unit(tmp_path):
    flown = Flight()
    columns = flown.placed(names=("lat", "lon", "alt_m")) | {"hAcc": np.full(len(flown.time), 1515.0)}
    gnss = find_fixes(sheets_of([flown.write(tmp_path / "a.csv", columns)], {})).gnss
    np.testing.assert_allclose(gnss.position_sigma[:, 0], 1.0, rtol=1e-6)
    rng = np.random.default_rng(1)  # of a network: 800 m, and it is as bad as it says
    for name, size in (("lat", 1e-5), ("lon", 1e-5)):
        columns[name] = columns[name] + 500 * size * rng.standard_normal(len(flown.time))
    gnss = find_fixes(sheets_of([flown.write(tmp_path / "b.csv", columns)], {})).gnss
    np.testing.assert_allclose(gnss.position_sigma[:, 0], 1000.0, rtol=1e-6)


@pytest.mark.parametrize("outwards", [0.0, 0.15])
def test_what_does_not_bank_into_its_turns_is_a_car(tmp_path, outwards):
    """A car leans outwards by a sixth of what an aeroplane banks inwards: its roll is no fault."""
    flown = Flight(wind=(0.0, 0.0), airspeed=20.0)
    flown.euler[:, 0] *= -outwards
    columns = flown.placed() | dict(zip(("roll", "pitch", "heading"), np.degrees(flown.euler).T, strict=True))
    columns |= dict(zip(("vn", "ve", "vd"), flown.velocity.T, strict=True))
    made = prepare_import(flown.write(tmp_path / "a.csv", columns))
    assert made.rebuilt.vehicle == "car" and made.report.verdict == "plausible"
    assert apart(made.raw.euler, flown.euler) < 1e-3
    assert not Flight().euler[:, 0].std() < 0.1
    assert (
        prepare_import(
            Flight().write(
                tmp_path / "b.csv",
                Flight().placed()
                | dict(zip(("roll", "pitch", "heading"), np.degrees(Flight().euler).T, strict=True)),
            )
        ).rebuilt.vehicle
        == "aircraft"
    )


def test_accuracies_in_metres_beside_heights_in_mm_stay_metres(tmp_path):
    """MAVLink writes heights in mm and, in some exports, accuracies in metres with fractions."""
    flown = Flight()
    rng = np.random.default_rng(2)
    flown.place[:, :2] += 1.2e-5 * rng.standard_normal((len(flown.time), 2))
    latitude, longitude, height = flown.place.T
    columns = {
        "time": flown.time, "lat": np.rint(latitude * 1e7), "lon": np.rint(longitude * 1e7),
        "height [mm]": np.rint(height * 1e3), "hAcc": 1.5 + 0.1 * np.sin(flown.time),
        "vAcc": np.full(len(height), 2.0),
    }  # fmt: skip
    gnss = find_fixes(sheets_of([flown.write(tmp_path / "a.csv", columns)], {})).gnss
    np.testing.assert_allclose(gnss.position_sigma[:, 0], columns["hAcc"] / 1.515, rtol=1e-6)
    np.testing.assert_allclose(gnss.position_sigma[:, 2], 2.0, rtol=1e-6)


def test_one_accuracy_that_names_its_unit_names_that_of_the_others(tmp_path):
    flown = Flight()
    size = len(flown.time)
    columns = flown.placed(names=("lat", "lon", "alt_m")) | {
        "hAcc [mm]": np.full(size, 1515.0), "vAcc": np.full(size, 1500.0), "sAcc [mm/s]": np.full(size, 80.0),
    }  # fmt: skip
    gnss = find_fixes(sheets_of([flown.write(tmp_path / "a.csv", columns)], {})).gnss
    np.testing.assert_allclose(gnss.position_sigma[5], [1.0, 1.0, 1.5], rtol=1e-6)
    np.testing.assert_allclose(gnss.velocity_sigma[5, 0], 0.08, rtol=1e-6)


@pytest.mark.parametrize("stamp", [1e9, 1e15, 1e300])
@pytest.mark.parametrize("value", [0.0, 1e200, 1e308])
def test_damaged_stamps_and_attitudes_end_nothing(tmp_path, stamp, value):
    """A span of 10^15 s asks for no memory; quaternions of zeros, or beyond all numbers, are none."""
    flown = Flight()
    names = ("q0", "q1", "q2", "q3")
    columns = flown.placed("time_s") | dict(zip(names, flown.quaternion.T * 16384, strict=True))
    columns |= dict(zip(("vn", "ve", "vd"), flown.velocity.T, strict=True))
    columns = {name: one.copy() for name, one in columns.items()}
    columns["time_s"][-1] = stamp
    for name in names:
        columns[name][100:103] = value
    flight = read_raw(flown.write(tmp_path / "a.csv", columns))
    assert flight.euler is not None and len(flight.time) > 700
    assert apart(flight.euler[:90], flown.euler[:90]) < 0.1


def test_an_attitude_of_the_smaller_part_of_a_flight_is_named_and_not_used(tmp_path):
    """An estimator that starts late writes zeros before; the rest show the length of its quaternions."""
    flown, names = Flight(), ("q0", "q1", "q2", "q3")
    quaternions = flown.quaternion * 16384
    quaternions[: 6 * len(quaternions) // 10] = 0.0
    flight = read_raw(
        flown.write(tmp_path / "a.csv", flown.placed() | dict(zip(names, quaternions.T, strict=True)))
    )
    assert flight.euler is None
    said = " ".join(flight.remarks)
    assert "Attitude: q0, q1, q2, q3" in said
    assert "it is known at too few points" in said


def test_accuracies_without_a_fix_are_refused(tmp_path):
    flown = Flight()
    columns = flown.placed() | {"hAcc": flown.time}
    columns["lat"] = columns["lat"] * np.nan
    with pytest.raises(MissionError):
        read_raw(flown.write(tmp_path / "a.csv", columns))


@pytest.mark.parametrize("value", [1e9, 1e200, 1e308])
def test_damaged_angles_end_nothing(tmp_path, value):
    flown = Flight()
    columns = flown.placed() | dict(zip(("roll", "pitch", "yaw"), np.degrees(flown.euler).T, strict=True))
    columns["yaw"] = np.where(np.arange(len(flown.time)) == 50, value, columns["yaw"])
    assert read_raw(flown.write(tmp_path / "a.csv", columns)).latitude is not None


@pytest.mark.parametrize(("wind", "used"), [((4.0, -11.0), False), ((0.0, 0.0), True)])
def test_a_heading_beside_roll_and_pitch_is_a_course_only_if_the_motion_is_along_it(tmp_path, wind, used):
    flown = Flight(wind=wind)
    columns = flown.placed() | {"ground speed": np.hypot(*flown.velocity[:, :2].T)}
    columns |= dict(zip(("roll", "pitch", "heading"), np.degrees(flown.euler).T, strict=True))
    flight = read_raw(flown.write(tmp_path / "a.csv", columns))
    assert (flight.velocity_n is not None) == used
    if used:
        np.testing.assert_allclose(flight.velocity_n[:, :2], flown.velocity[:, :2], atol=0.01)
    assert apart(flight.euler, flown.euler) < 1e-3
