"""Fixes and samples in units, frames and signs that a heading does not name, or names in a rare way."""

from __future__ import annotations

import numpy as np
import pytest
from sensor_logs import tables

from lab.data.files.unit_names import UNITS, unit_of
from lab.data.log.sensor_log import GnssLog
from lab.data.protocols.column_guess import guess_columns
from lab.data.protocols.column_map import ColumnMap
from lab.data.sheets.column_names import heading_of
from lab.data.sheets.sheet import read_sheet
from lab.data.sheets.sheet_fixes import find_fixes
from lab.data.sheets.sheet_gravity import refuse_cm_per_s2
from lab.data.sheets.sheet_imu import find_imu
from lab.missions import MissionError


def fixes(header, rows):
    text = "\n".join((header, *(",".join(f"{x:.12g}" for x in row) for row in rows)))
    return find_fixes([read_sheet("gps.csv", text.encode())])


def track(made):
    """Return time [s], latitude, longitude [°], height [m], velocity north, east [m/s]."""
    return made[1][:, :6].copy()


def speed_and_course(made):
    north, east = track(made)[:, 4:].T
    return np.hypot(north, east), np.degrees(np.arctan2(east, north)) % 360


@pytest.mark.parametrize(
    ("unit", "factor"), [("m/s", 1), ("km/h", 3.6), ("kt", 3600 / 1852), ("cm/s", 100), ("mm/s", 1000)]
)
def test_the_unit_of_velocities_is_found_by_the_positions(made, unit, factor):
    rows = track(made)
    rows[:, 4:] *= factor
    found = fixes("time,lat,lon,alt,vn,ve", rows)
    np.testing.assert_allclose(found.gnss.velocity_n[:, :2], track(made)[:, 4:], rtol=1e-4, atol=1e-3)
    assert any(f"vn in {unit} (" in remark for remark in found.remarks)
    named = fixes("time,lat,lon,alt,vn [m/s],ve [m/s]", rows)  # wrong, but not a guess: refused later
    np.testing.assert_allclose(named.gnss.velocity_n[:, :2], rows[:, 4:])


def test_a_pause_of_the_logger_shows_no_unit(made):
    """A car that went on at half its speed while nothing was recorded has no speeds in knots."""
    rows = track(made)
    half = len(rows) // 2
    pause = 20 * np.ptp(rows[:, 0])
    pace = np.hypot(*rows[:, 4:].T).mean()
    rows[half:, 0] += pause
    rows[half:, 1] += pause * 0.5 * pace / 111_200
    found = fixes("time,lat,lon,alt,vn,ve", rows)
    np.testing.assert_allclose(found.gnss.velocity_n[:, :2], rows[:, 4:], atol=1e-9)


@pytest.mark.parametrize("crab", [0.0, 6.0])
def test_noise_of_positions_makes_no_crab_angle(crab):
    """At 5 Hz and 30 m/s, 0.3 m turn the way from fix to fix by 4°; a wind of 3 m/s turns the nose by 6°."""
    t = np.arange(0, 60, 0.2)
    course = 0.5 + np.sin(t / 8)
    noise = np.random.default_rng(2).normal(scale=0.3, size=(2, t.size))
    north, east = (np.cumsum(30 * 0.2 * f(course)) + n for f, n in zip((np.cos, np.sin), noise, strict=True))
    place = np.column_stack((50 + north / 111_200, 8 + east / (111_300 * np.cos(np.radians(50)))))
    rows = np.column_stack((t, place, 0 * t, 30 + 0 * t, np.degrees(course) + crab, 0 * t, 0 * t))
    found = fixes("time,lat,lon,alt,speed,heading_deg,roll,pitch", rows)
    assert np.isfinite(found.gnss.velocity_n[:, :2]).all() == (crab == 0)


@pytest.mark.parametrize(("unit", "factor"), [("0.01°", 100), ("1e-5°", 1e5)])
def test_whole_numbers_of_a_course(made, unit, factor):
    speed, course = speed_and_course(made)
    found = fixes(
        "time,lat,lon,alt,speed,course",
        np.column_stack((track(made)[:, :4], speed, np.rint(course * factor))),
    )
    np.testing.assert_allclose(found.gnss.velocity_n[:, :2], track(made)[:, 4:], atol=0.01)
    assert any(f"course in {unit} (guessed" in remark for remark in found.remarks)


def test_heights_above_the_limit_of_receivers_are_mm(made):
    rows = track(made)
    rows[:, 3] = 30.5 + 1.003 * np.arange(len(rows))
    high = rows * [1, 1, 1, 1000, 1, 1]
    np.testing.assert_allclose(fixes("time,lat,lon,alt,vn,ve", high).gnss.position[:, 2], rows[:, 3])
    # A heading that says m is believed.
    np.testing.assert_allclose(fixes("time,lat,lon,alt_m,vn,ve", high).gnss.position[:, 2], high[:, 3])


def test_latitudes_beyond_the_poles_are_refused_or_dropped(made):
    rows = track(made)
    rows[:, 2] = 120.0 + np.arange(len(rows)) * 1e-5
    with pytest.raises(MissionError, match=r"beyond ±90°, and the longitudes are not: .* swapped; accepted"):
        fixes("time,lon,lat,alt", rows[:, :4])
    rows[3, 1:3] = 999.0
    assert len(fixes("time,lat,lon,alt", rows[:, :4]).gnss.time) == len(rows) - 1


def test_longitudes_from_0_to_360(made):
    rows = track(made)
    around = rows.copy()
    around[:, 2] %= 360
    assert (rows[:, 2] < 0).all()
    np.testing.assert_allclose(
        fixes("time,lat,lon,alt", around[:, :4]).gnss.position,
        fixes("time,lat,lon,alt", rows[:, :4]).gnss.position,
    )


@pytest.mark.parametrize(
    ("text", "quantity", "sign"),
    [
        ("vel_enu_0", "east", 1), ("velocity_y_enu", "north", 1), ("vel_enu_u", "up", 1),
        ("v_x_ned", "north", 1), ("vel_ned[2]", "down", 1), ("nwu_velocity.y", "east", -1),
        ("velocity_west", "east", -1), ("vel_w", "east", -1), ("v_south", "north", -1),
        ("baroaltitude", "height", 1), ("geoaltitude", "height", 1),
        ("Speed 2D (m/s)", "speed", 1), ("gps_speed_3d", "speed", 1), ("Speed2D", "speed", 1),
    ],
)  # fmt: skip
def test_components_of_velocities_in_other_frames(text, quantity, sign):
    found = heading_of(text)
    assert (found.quantity, found.sign) == (quantity, sign)


def test_a_vertical_acceleration_is_no_accuracy():
    assert heading_of("VerticalAcc (g)").quantity == "force"
    assert heading_of("VerticalAcc (m)").quantity == "vertical_sigma"


def test_the_receivers_height_is_better_than_the_barometers():
    assert heading_of("geoaltitude").rank < heading_of("baroaltitude").rank


@pytest.mark.parametrize("text", ["vx", "velocity_x", "linear_velocity.x", "wind_vel_x", "vel_ned_enu_x"])
def test_velocities_without_a_frame_are_not_read(text):
    assert heading_of(text) is None


def imu(header, factors):
    """Return the samples of an IMU that turns slowly in the units of a file."""
    time = np.arange(0, 5, 0.01)
    rates = np.outer(np.sin(time), [0.2, 0.1, 0.3])
    forces = np.column_stack((np.zeros((time.size, 2)), np.full(time.size, -9.80665)))
    rows = np.column_stack((time, rates * factors[0], forces * factors[1]))
    text = "\n".join((header, *(",".join(f"{x:.12g}" for x in row) for row in rows)))
    found = find_imu([read_sheet("imu.csv", text.encode())])
    np.testing.assert_allclose(found.samples, np.column_stack((rates, forces)), rtol=1e-9, atol=1e-9)
    return found


@pytest.mark.parametrize(
    ("rate", "per_rad", "force", "per_metre"),
    [
        ("deg/h", 3600 * 180 / np.pi, "ug", 1e6 / 9.80665), ("rpm", 30 / np.pi, "cm/s^2", 100),
        ("mdps", 1000 * 180 / np.pi, "Gal", 100), ("°/hr", 3600 * 180 / np.pi, "mm/s²", 1000),
    ],
)  # fmt: skip
def test_rare_units_in_headings(rate, per_rad, force, per_metre):
    header = ",".join(
        ("time", *(f"gyro_{a} [{rate}]" for a in "xyz"), *(f"acc_{a} [{force}]" for a in "xyz"))
    )
    imu(header, (per_rad, per_metre))


def test_millidegrees_beside_mg_are_found_by_their_size():
    found = imu("time,gx,gy,gz,ax,ay,az", (1000 * 180 / np.pi, 1000 / 9.80665))
    assert found.gyro.unit == "m°/s" and found.gyro.source.startswith("guessed")


@pytest.mark.parametrize("start", [0, 30, 60, 90, 130])
def test_cm_per_s2_are_not_read_as_milli_g(start):
    made = tables(start, start + 60)
    rows, gnss = made.imu, made.gnss
    fixes = GnssLog(
        gnss[:, 0], np.column_stack((np.radians(gnss[:, 1:3]), gnss[:, 3])), gnss[:, 4:7],
        gnss[:, 7:10], gnss[:, 10:13], np.zeros(3), 0.0,
    )  # fmt: skip
    header = "time,gx,gy,gz,ax,ay,az"

    def found(per_metre, units=None):
        lines = (",".join(f"{x:.9g}" for x in row) for row in rows * ([1.0] * 4 + [per_metre] * 3))
        read = find_imu([read_sheet("imu.csv", "\n".join((header, *lines)).encode(), units)])
        refuse_cm_per_s2(read, fixes)
        return read

    with pytest.raises(MissionError, match=r"cm/s² \(981\) or mg .*--unit HEADING=cm/s²"):
        found(100)
    named = found(100, dict.fromkeys(("ax", "ay", "az"), "[cm/s²]"))
    np.testing.assert_allclose(named.samples[:, 3:], rows[:, 4:], rtol=1e-6, atol=1e-6)
    assert found(1000 / 9.80665).accelerometer.unit == "mg"


@pytest.mark.parametrize(
    ("spelling", "kind", "factor"),
    [("g/16384", "acceleration", 9.80665 / 16384), ("°/s/131", "angular rate", np.pi / 180 / 131),
     ("dps/16.4", "angular rate", np.pi / 180 / 16.4), ("uT/6.66", "magnetic field", 1 / 6.66)],
)  # fmt: skip
def test_raw_counts_have_a_unit_over_a_number(spelling, kind, factor):
    unit = unit_of(kind, spelling)
    assert UNITS[kind][unit] == pytest.approx(factor)
    assert unit_of(kind, "bread/256") == unit_of(kind, "g/0") == unit_of("length", spelling) == ""


def test_raw_counts_are_read_in_files_and_streams(made):
    imu = made[0][:200].copy()
    imu[:, 1:4] *= 131 * 180 / np.pi
    imu[:, 4:] *= 16384 / 9.80665
    header = (
        "time,"
        + ",".join(f"g{axis} (°/s/131)" for axis in "xyz")
        + "".join(f",a{a} (g/16384)" for a in "xyz")
    )
    lines = [",".join(f"{x:.12g}" for x in row) for row in imu]
    found = find_imu([read_sheet("imu.csv", "\n".join((header, *lines)).encode())])
    np.testing.assert_allclose(found.samples, made[0][:200, 1:], rtol=1e-6)
    assert "force_x[g/16384]" in str(guess_columns([header, *lines]))
    assert ColumnMap.of("force_x[g/256],force_y[g/256],force_z[g/256]").columns[0].scale == 9.80665 / 256
