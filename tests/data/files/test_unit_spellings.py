"""The spellings of units in headings, each by the values that a csv with known motion has."""

from __future__ import annotations

import numpy as np
import pytest

from lab.data.files.unit_names import unit_of
from lab.data.sheets.column_names import heading_of
from lab.data.sheets.sheet import read_sheet
from lab.data.sheets.sheet_clock import find_clock
from lab.data.sheets.sheet_fixes import find_fixes
from lab.data.sheets.sheet_imu import find_imu

G = 9.80665
DEG = np.pi / 180
TIME = np.arange(0.0, 5.0, 0.05)
RATES = np.outer(np.sin(TIME), (0.2, 0.1, 0.3))
FORCES = np.column_stack((0.1 * np.cos(TIME), 0.2 * np.sin(TIME), np.full(TIME.size, -G)))
LATITUDE = 48.0 + TIME * 1e-4
SPEED, COURSE, HEIGHT = 12.0 + TIME, 300.0 + TIME, 180.0 + TIME

FORCE = {
    1.0: "acc_# (m.s-2)|acc_# [ms-2]|acc#_mss|Acc# (m/sec²)|accel #, m/s²|acc_# / m s^-2|a_# / (m/s²)"
    "|a# in m/s^2|Accel_# (meters/sec^2)|acc_# (meters per second squared)|acc_# <m/s^2>|acc_#{m/s^2}"
    "|acc_#_mpsps|a_# [m⋅s⁻²]",
    0.01: "a# [cm/s^2]|acc_#_cm_s2|acc_#_cmss|Acc# (gal)|acc_# [cm/s/s]|acc_#_cmps2|acc_# [cm*s^-2]",
    1e-3: "acc_#_mm_s2|acc_# [mm/s/s]",
    1e-5: "acc_# (mGal)",
    G: "a#(g's)|Accel # (gees)|acc_# [g0]|accel_#_gs|acc_# (G-force)|acc_# [standard gravity]",
    G * 1e-3: "acc_#(mG)|acc_#_mg|acc# (milli-g)|acc_# [10^-3 g]|acc_# [1e-3 g]|accel_#_mgs",
    G * 1e-6: "acc_# [µg]|acc_# [micro-g]",
    0.3048: "acc_#_fps2|acc_# (ft/sec²)|acc_#_ft_s2|acc_# (feet/s^2)",
}  # fmt: skip
RATE = {
    1.0: "gyr_# [rad.s-1]|gyr_# (rad·s⁻¹)|w# [1/s]|omega_# [rads/s]|gyro_# (radians/sec)|g# / rad/s",
    DEG: "gyro_#_dps|gyr_# [°/sec]|gyr_# (degrees/second)|gyro_# (deg s^-1)|gyro_# / °/s|gyro_# [° s⁻¹]"
    "|gyro#Dps",
    DEG / 60: "gyro_# [deg/min]",
    DEG / 1000: "gyro_#_mdps|gyro_# (millideg/s)",
    1e-3: "gyro_# (millirad/s)|gyro_#_mrad_s",
    DEG / 3600: "gyro_#_dph|gyro_# (deg/hr)",
    2 * np.pi / 60: "gyro_# [rev/min]",
}
SPEEDS = {
    1.0: "speed_ms|speed (m s^-1)|speed (m·s⁻¹)|gps_speed_ms-1|speed, m/s|Speed (metres per second)",
    1 / 3.6: "speed_kmh-1|speed (km h^-1)|speed [kilometers/hour]|speed (kms/h)|speed_in_kmh",
    1852 / 3600: "speed (kn)|speed (nm/h)|Speed(nmi/h)|sog_knots",
    0.44704: "Speed (mi/h)|speed [miles per hour]|speed (mi/hr)|speed_mph",
    0.3048: "Speed (feet/sec)|speed (feet per second)",
    0.3048 / 60: "speed_fpm",
    0.01: "speed_cm_s|ground_speed_cmps",
    1e-3: "speed_mm_s",
}
HEIGHTS = {
    1.0: "alt_mamsl|altitude_in_m|Altitude (mtr)|alt [m a.s.l.]|height / m",
    0.3048: "alt_ft|alt(ft.)|Altitude (ft MSL)|altitude in feet",
    1000.0: "alt_km",
    0.1: "alt (dm)",
    0.01: "alt_cm",
}
LATITUDES = {
    1.0: "lat (dd)|Latitude (decimal degrees)|lat, deg",
    1e-7: "latE7|lat (1e-7 deg)|lat [deg*1e7]|lat_deg_e7|lat_1e7",
    1e-6: "latitudeE6|lat (microdegrees)|lat_e6",
    1 / 60: "lat (min)|Latitude (minutes)",
    1 / DEG: "lat_rad",
}
COURSES = {1.0: "course, deg", 0.01: "cog_cdeg|course (centideg)|course [0.01 deg]", 1 / DEG: "cog_rad"}
TIMES = {
    1e-3: "time(millisecond)|time, ms|t_in_ms",
    1e-6: "time (microsec)|timestamp / µs",
    1e-9: "time (nanosec)",
    0.01: "time [10ms]|time (centiseconds)|time [cs]",
    0.1: "time (0.1 s)",
    1e-4: "time [100us]|time (0.1ms)",
    3600.0: "time (hr)",
}


def cases(table):
    return [(heading, factor) for factor, headings in table.items() for heading in headings.split("|")]


def sheet(headings, columns):
    header = ";".join(headings)
    rows = np.column_stack(columns)
    text = "\n".join((header, *(";".join(f"{x:.15g}" for x in row) for row in rows)))
    return read_sheet("log.csv", text.encode())


def samples(gyros, forces, per_rate=1.0, per_force=1.0):
    headings = ["time_s", *(gyros.replace("#", a) for a in "xyz"), *(forces.replace("#", a) for a in "xyz")]
    return find_imu([sheet(headings, (TIME, RATES / per_rate, FORCES / per_force))]).samples


@pytest.mark.parametrize(("heading", "factor"), cases(FORCE))
def test_accelerations(heading, factor):
    np.testing.assert_allclose(samples("gyro_#_rad_s", heading, 1.0, factor)[:, 3:], FORCES, rtol=1e-9)


@pytest.mark.parametrize(("heading", "factor"), cases(RATE))
def test_rates(heading, factor):
    np.testing.assert_allclose(samples(heading, "acc_#_m_s2", factor)[:, :3], RATES, rtol=1e-9)


def fixes(**changed):
    columns = {"time_s": TIME, "lat_deg": LATITUDE, "lon_deg": LATITUDE, "alt_m": HEIGHT, "speed_m_s": SPEED,
               "course_deg": COURSE}  # fmt: skip
    for old, (heading, factor) in changed.items():
        columns = {heading if one == old else one: values / factor if one == old else values
                   for one, values in columns.items()}  # fmt: skip
    return find_fixes([sheet(list(columns), list(columns.values()))])


@pytest.mark.parametrize(("heading", "factor"), cases(SPEEDS))
def test_speeds(heading, factor):
    np.testing.assert_allclose(fixes(speed_m_s=(heading, factor)).speed, SPEED, rtol=1e-9)


@pytest.mark.parametrize(("heading", "factor"), cases(HEIGHTS))
def test_heights(heading, factor):
    found = fixes(alt_m=(heading, factor))
    np.testing.assert_allclose(found.gnss.position[:, 2], HEIGHT, rtol=1e-9)
    assert found.units[2].source == "named in the heading"


@pytest.mark.parametrize(("heading", "factor"), cases(LATITUDES))
def test_latitudes(heading, factor):
    other = heading.replace("atitude", "ongitude").replace("L", "l").replace("lat", "lon")
    found = fixes(lat_deg=(heading, factor), lon_deg=(other, factor))
    np.testing.assert_allclose(np.degrees(found.gnss.position[:, 0]), LATITUDE, rtol=1e-9)


@pytest.mark.parametrize(("heading", "factor"), cases(COURSES))
def test_courses(heading, factor):
    found = fixes(course_deg=(heading, factor)).course
    np.testing.assert_allclose(np.degrees(found) % 360, COURSE, rtol=1e-9)


@pytest.mark.parametrize(("heading", "factor"), cases(TIMES))
def test_times(heading, factor):
    found = find_clock(sheet([heading, "lat", "lon"], (TIME / factor, LATITUDE, LATITUDE)), fast=False)
    np.testing.assert_allclose(found.time, TIME, rtol=1e-9, atol=1e-9)
    assert not found.guessed


@pytest.mark.parametrize(
    ("kind", "text"),
    [("speed", "metres"), ("speed", "m/min"), ("angular rate", "degrees"), ("length", "100 ft"),
     ("time", "1e7"), ("acceleration", "2g"), ("acceleration", "m/s"), ("speed", "m/s2"), ("angle", "0 deg"),
     ("length", "e-3")],
)  # fmt: skip
def test_what_is_no_unit(kind, text):
    assert unit_of(kind, text) == ""


@pytest.mark.parametrize(
    "heading", ["GPS Latitude (deg/s)", "longitude [rad/s]", "course_dps", "speed (°/s)"]
)
def test_a_rate_is_no_place_and_no_speed(heading):
    """Columns that were exchanged with their units, and not with their headings, are not read."""
    found = heading_of(heading)
    assert found is None or found.quantity == "rate"
    assert heading_of("heading (degs)").unit == "°"
    below = read_sheet("log.csv", b"Time,Latitude,Longitude,Altitude\ns,deg/s,deg,m\n0,1,2,3\n1,1,2,3\n")
    assert [one.quantity for one in below.headings] == ["time", "longitude", "height"]
