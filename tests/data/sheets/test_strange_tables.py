"""Tables of makers and of spreadsheets that nobody here had seen: what they say is read, or asked for."""

import time

import numpy as np
import pytest
from phone_drive import drive, trajectory

from lab.base.files.mission_error import MissionError, QuestionError
from lab.base.parameters.units import FOOT, KNOT, STANDARD_GRAVITY
from lab.data.clock.stamps import seconds_of_texts
from lab.data.formats import read_raw
from lab.data.sheets.column_names import heading_of
from lab.data.sheets.sheet_cells import numbers_of_cells
from lab.data.sheets.sheet_layout import find_layout
from lab.missions.flight_import import read_log

AT = np.arange(1.0, 99.0, 0.5)
TRUTH = trajectory().at(AT)
LATITUDE, LONGITUDE = np.degrees(TRUTH.latitude), np.degrees(TRUTH.longitude)
SPEED = np.hypot(*TRUTH.velocity_n[:, :2].T)
COURSE = np.degrees(np.arctan2(TRUTH.velocity_n[:, 1], TRUTH.velocity_n[:, 0])) % 360


def write(path, head, *columns, separator=",", form="%.10g"):
    """Write columns of numbers or texts below a header."""
    cells = [[one if isinstance(one, str) else form % one for one in column] for column in columns]
    rows = (separator.join(row) for row in zip(*cells, strict=True))
    path.write_text("\n".join((head, *rows, "")), "utf-8")
    return path


def track(path, head="time,lat,lon,altitude_m", *, before=(), at=AT, separator=","):
    """Write the drive as time, latitude, longitude and height, with columns before them."""
    return write(path, head, *before, at, LATITUDE, LONGITUDE, TRUTH.height, separator=separator)


def is_the_drive(flight, height=TRUTH.height):
    np.testing.assert_allclose(np.degrees(flight.latitude), LATITUDE, atol=2e-6)
    np.testing.assert_allclose(np.degrees(flight.longitude), LONGITUDE, atol=2e-6)
    np.testing.assert_allclose(flight.height, height, atol=0.5)
    np.testing.assert_allclose(flight.time - flight.time[0], AT - AT[0], atol=2e-3)


@pytest.mark.parametrize(
    ("text", "quantity", "unit"),
    [
        ("acc_x_dashboard", "force_x", ""),
        ("gyro_z_below_suspension", "rate_z", ""),
        ("bmi160_a_y[mg]", "force_y", "mg"),
        ("bmi160_g_y[mDeg]", "rate_y", "m°/s"),
        ("加速度X(g)", "force_x", "g"),
        ("角速度Z(°/s)", "rate_z", "°/s"),
        ("GPS高度(m)", "height", "m"),
        ("Ускорение Y (м/с²)", "force_y", "m/s²"),
        ("Prędkość kątowa X (rad/s)", "rate_x", "rad/s"),
        ("Vinkelhastighet X (rad/s)", "rate_x", "rad/s"),
        ("north(m/s)", "north", "m/s"),
        ("TOW [0.001 s]", "time", "ms"),
        ("ts", "time", ""),
        ("enhanced_speed", "speed", ""),
        ("speed_meters_per_second", "speed", "m/s"),
    ],
)
def test_a_heading_says(text, quantity, unit):
    found = heading_of(text)
    assert (found.key, found.unit) == (quantity, unit)


@pytest.mark.parametrize(
    "text", ["acc_x_bias", "gyro_y_std", "acc_x_rms_10s", "Ts[deg.C]", "north", "north (m)"]
)
def test_a_heading_does_not_say(text):
    assert heading_of(text) is None


def test_sensors_may_be_counted():
    known = find_layout(b"Time,lat,altitude1,altitude2,altitude3\n", "a.csv").known
    assert [one.key for one in known[2:]] == ["height"] * 3


@pytest.mark.parametrize("heads", ["Acceleration_1,Acceleration_2,Acceleration_3", "acc1,acc2,acc3"])
def test_vectors_may_be_counted_from_one(heads):
    known = find_layout(f"Time,{heads}\n".encode(), "a.csv").known
    assert [one.key for one in known[1:]] == ["force_x", "force_y", "force_z"]
    known = find_layout(b"Time,acc_0,acc_1,acc_2,acc_3\n", "a.csv").known
    assert [one.key for one in known[1:4]] == ["force_x", "force_y", "force_z"]


@pytest.mark.parametrize(
    ("heads", "scale", "pace", "unit"),
    [
        ("lat,lon", 1e6, 1.0, "1e-6°"),
        ("lat,lon", 1e7, 1 / KNOT, "1e-7°"),
        ("position_lat,position_long", 2**31 / 180, 1.0, "semicircles"),
    ],
)
def test_the_motion_shows_the_unit_of_whole_coordinates(tmp_path, heads, scale, pace, unit):
    whole = np.rint(LATITUDE * scale), np.rint(LONGITUDE * scale)
    path = write(tmp_path / "a.csv", f"time,{heads},altitude_m,speed", AT, *whole, TRUTH.height, SPEED * pace)
    flight = read_raw([path])
    is_the_drive(flight)
    assert {one.unit for one in flight.units[:2]} == {unit}


def test_fit_has_semicircles_without_a_speed_too(tmp_path):
    whole = np.rint(np.array((LATITUDE, LONGITUDE)) * 2**31 / 180)
    head = "time,position_lat,position_long,altitude_m"
    is_the_drive(read_raw([write(tmp_path / "a.csv", head, AT, *whole, TRUTH.height)]))


def test_tinygps_writes_hundredths_of_knots_and_centimetres(tmp_path):
    whole = np.rint(
        (AT * 1000, LATITUDE * 1e6, LONGITUDE * 1e6, TRUTH.height * 100, SPEED / KNOT * 100, COURSE * 100)
    )
    is_the_drive(read_raw([write(tmp_path / "a.csv", "millis,lat,lon,GPS alt,speed,course", *whole)]))


def test_heights_beside_a_speed_in_feet_per_second_are_feet(tmp_path):
    columns = AT, LATITUDE, LONGITUDE, TRUTH.height / FOOT, SPEED / FOOT
    flight = read_raw([write(tmp_path / "a.csv", "UNIXTIME,LAT,LON,ALT,HORZV", *columns)])
    is_the_drive(flight)
    assert any("HORZV is in ft/s" in one and '--unit "ALT=m"' in one for one in flight.remarks)


def test_numbers_that_may_be_radians_are_asked_for(tmp_path):
    columns = AT, TRUTH.latitude, TRUTH.longitude, TRUTH.height
    path = write(tmp_path / "a.csv", "time,lat,lon,height_m", *columns, form="%.14g")
    with pytest.raises(QuestionError, match="are radians, or degrees") as asked:
        read_raw([path])
    is_the_drive(read_raw([path], asked.value.choices["rad"]))
    # A velocity decides, and so does a place that no radians have.
    velocity = write(tmp_path / "b.csv", "time,lat,lon,height_m,speed", *columns, SPEED, form="%.14g")
    is_the_drive(read_raw([velocity]))
    is_the_drive(read_raw([track(tmp_path / "c.csv")]))


@pytest.mark.parametrize(
    ("heading", "names", "ends"),
    [
        ("MMSI", ("367123456", "338222222"), None),
        ("icao24", ("3c6444", "4ca7b4"), None),
        ("device", ("left", "right"), None),
        ("device", ("left_sensor", "right_sensor"), ("…sor", "…sor")),
        ("device", ("buoy number 1", "buoy number 2"), ("…r 1", "…r 2")),
    ],
)
def test_one_of_several_vehicles_is_read(tmp_path, heading, names, ends):
    there, twice = LATITUDE + 0.5, np.repeat(np.arange(AT.size), 2)
    columns = (
        [names[i % 2] for i in range(2 * AT.size)],
        AT[twice],
        np.ravel((LATITUDE, there), "F"),
        LONGITUDE[twice],
        TRUTH.height[twice],
    )
    flight = read_raw([write(tmp_path / "a.csv", f"{heading},time,lat,lon,altitude_m", *columns)])
    is_the_drive(flight)
    taken, other = ends or names
    assert any(
        f"{heading} is {taken} in the rows that are read, and not {other}" in one for one in flight.remarks
    )


def test_rows_of_several_kinds_are_all_read(tmp_path):
    measured = drive()
    samples = np.column_stack((measured.time, measured.rate, measured.force))
    places = np.column_stack((measured.at, measured.position))
    imu = [f"IMU,{one[0]:.3f},,,,{','.join(map(str, one[1:].round(5)))}" for one in samples]
    fixes = [f"GPS,{one[0]:.3f},{','.join(map(str, one[1:].round(8)))},,,,,," for one in places]
    rows = sorted(imu + fixes, key=lambda row: float(row.split(",")[1]))
    path = tmp_path / "a.csv"
    head = "sensor,time,lat,lon,altitude_m,gx_rad_s,gy_rad_s,gz_rad_s,ax_mps2,ay_mps2,az_mps2"
    path.write_text("\n".join((head, *rows, "")))
    log = read_log([path])
    assert (len(log.gnss.time), len(log.time)) == (measured.at.size, measured.time.size)


def test_a_number_of_each_row_is_no_vehicle(tmp_path):
    numbers = [f"{i}" for i in range(AT.size)]
    is_the_drive(read_raw([track(tmp_path / "a.csv", "trackid,time,lat,lon,altitude_m", before=[numbers])]))


def test_a_last_column_without_a_heading_moves_nothing(tmp_path):
    columns = AT - AT[0], LATITUDE, LONGITUDE, TRUTH.height, 7 + 0 * AT
    rows = [column[::2] for column in columns]
    flight = read_raw([write(tmp_path / "a.csv", "time,lat,lon,altitude_m", *rows)])
    np.testing.assert_allclose(np.degrees(flight.latitude), LATITUDE[::2], atol=1e-6)


@pytest.mark.parametrize("of_week", [False, True])
def test_rtklib_writes_two_cells_under_one_heading(tmp_path, of_week):
    first = [
        f"2288 {292800 + t:.3f}" if of_week else f"2023/11/15 09:{20 + int(t) // 60}:{t % 60:06.3f}"
        for t in AT
    ]
    head = "%  GPST  latitude(deg) longitude(deg)  height(m)"
    path = track(tmp_path / "a.pos", head, at=first, separator="  ")
    path.write_text("% program   : RTKLIB ver.2.4.3\n%\n" + path.read_text())
    is_the_drive(read_raw([path]))


def test_rows_may_be_numbered_below_no_heading(tmp_path):
    numbers = [f'"{i + 1}"' for i in range(AT.size)]
    is_the_drive(read_raw([track(tmp_path / "a.csv", before=[numbers])]))


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("1.015,5", 1015.5),
        ("1 015,5", 1015.5),
        ("1\u202f015.5", 1015.5),
        ("12'001'015.5", 12001015.5),
        ("1.015", 1.015),
    ],
)
def test_thousands_are_marked_as_in_other_countries(text, number):
    import pandas as pd

    np.testing.assert_allclose(numbers_of_cells(pd.Series([text, "3"]), False)[0], (number, 3))


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("0 days 09:20:01.015000", 33601.015),
        ("Wed Nov 15 09:20:01.015000 2023", 1700040001.015),
        ("2023年11月15日 09:20:01.015", 1700040001.015),
    ],
)
def test_stamps_of_pandas_and_of_china(text, seconds):
    np.testing.assert_allclose(seconds_of_texts([text]), seconds, atol=1e-4)


def test_a_counter_of_16_bits_goes_on(tmp_path):
    columns = (AT * 1000 + 60_000) % 2**16, LATITUDE, LONGITUDE, TRUTH.height
    is_the_drive(read_raw([write(tmp_path / "a.csv", "time_ms,lat,lon,altitude_m", *columns)]))


def test_stamps_that_lost_their_seconds_are_refused(tmp_path):
    lost = [f"11/15/2023 09:{20 + int(t) // 60}" for t in AT]
    path = track(tmp_path / "a.csv", at=lost)
    with pytest.raises(MissionError, match="have no seconds"):
        read_raw([path])


@pytest.mark.parametrize("rate", [10, 20])
def test_the_motion_contradicts_a_guessed_unit_of_time(tmp_path, rate):
    fine = np.arange(1.0, 99.0, 1 / rate)
    truth = trajectory().at(fine)
    north, east, _ = truth.velocity_n.T
    columns = fine * rate, np.degrees(truth.latitude), np.degrees(truth.longitude), truth.height, north, east
    path = write(tmp_path / "a.csv", "time,lat,lon,altitude_m,vn_m_s,ve_m_s", *columns, form="%.12g")
    with pytest.raises(MissionError, match=f'--unit "time=s/{rate}"'):
        read_raw([path])
    flight = read_raw([path], {"time": f"s/{rate}"})
    np.testing.assert_allclose(np.ptp(flight.time), np.ptp(fine), rtol=1e-6)


def test_minus_one_is_no_position(tmp_path):
    lost = (AT > 40) & (AT < 45)
    columns = (
        AT,
        np.where(lost, -1, LATITUDE),
        np.where(lost, -1, LONGITUDE),
        np.where(lost, -1, TRUTH.height),
    )
    flight = read_raw([write(tmp_path / "a.csv", "time,lat,lon,altitude_m", *columns)])
    assert len(flight.time) == (~lost).sum()
    assert np.degrees(flight.latitude).min() > 48


def test_a_position_that_never_changes_is_of_the_remote_control(tmp_path):
    columns = AT, 48.19 + 0 * AT, 11.59 + 0 * AT, LATITUDE, LONGITUDE, TRUTH.height
    head = "time,{0}_gps_latitude,{0}_gps_longitude,{1}_gps_latitude,{1}_gps_longitude,altitude_m"
    head = head.format("controller", "product")
    is_the_drive(read_raw([write(tmp_path / "a.csv", head, *columns)]))


def test_a_text_of_digits_is_refused_at_once(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("// a\n" + "9" * 60_000)
    begin = time.process_time()
    with pytest.raises(MissionError, match="its format is unknown"):
        read_raw([path])
    assert time.process_time() - begin < 5


def test_subtitles_are_named(tmp_path):
    path = tmp_path / "DJI_0001.SRT"
    path.write_text(
        "1\n00:00:01,000 --> 00:00:01,033\nFrameCnt: 1 [latitude: 48.2] [longitude: 11.6]\n\n" * 20
    )
    with pytest.raises(MissionError, match="subtitles"):
        read_raw([path])


def test_movella_dot_counts_microseconds_and_degrees(tmp_path):
    measured = drive()
    t, w, f = measured.time, np.degrees(measured.rate) * (1, -1, -1), measured.force * (1, -1, -1)
    head = "PacketCounter,SampleTimeFine,Euler_X,Euler_Y,Euler_Z,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z"
    imu = write(tmp_path / "dot.csv", head, np.arange(t.size), t * 1e6, *(0 * t,) * 3, *f.T, *w.T)
    imu.write_text("sep=,\nDeviceTag:,Xsens DOT\nOutputRate:,100Hz\n" + imu.read_text())
    fixes = write(tmp_path / "gps.csv", "time (s),lat,lon,altitude_m", measured.at, *measured.position.T)
    log = read_log([imu, fixes])
    np.testing.assert_allclose(np.diff(log.time), 0.01, atol=1e-6)
    np.testing.assert_allclose(log.rates[0].std(axis=0), measured.rate.std(axis=0), rtol=0.05)


def test_the_gyro_of_the_same_place_is_taken(tmp_path):
    measured = drive()
    other = {
        "rate": measured.rate[:, [1, 0, 2]] * (1, -1, 1),
        "force": measured.force[:, [1, 0, 2]] * (1, -1, 1),
    }
    head = "time,gyro_{0}_wheel,gyro_{1}_wheel,gyro_{2}_wheel,gyro_{0}_roof,gyro_{1}_roof,gyro_{2}_roof,"
    head += "acc_{0}_roof,acc_{1}_roof,acc_{2}_roof,acc_{0}_wheel,acc_{1}_wheel,acc_{2}_wheel"
    rates = np.hstack((other["rate"], measured.rate, measured.force, other["force"]))
    imu = write(tmp_path / "imu.csv", head.format(*"xyz"), measured.time, *rates.T)
    fixes = write(tmp_path / "gps.csv", "time,lat,lon,altitude_m", measured.at, *measured.position.T)
    log = read_log([imu, fixes])
    assert any("Gyros: gyro_x_roof" in one for one in log.repairs)


def test_phones_of_the_decimeter_challenge(tmp_path):
    measured = drive()
    head = "MessageType,utcTimeMillis,elapsedRealtimeNanos,MeasurementX,MeasurementY,MeasurementZ"
    head += ",BiasX,BiasY,BiasZ"
    rows = [
        f"{kind},{1.7e12 + 1000 * t:.0f},{1e9 * t:.0f},{y:.6f},{x:.6f},{-z:.6f},0,0,0"
        for i, t in enumerate(measured.time)
        for kind, (x, y, z) in (("UncalAccel", measured.force[i]), ("UncalGyro", measured.rate[i]))
    ]
    imu = tmp_path / "device_imu.csv"
    imu.write_text("\n".join((head, *rows, "")))
    fixes = write(
        tmp_path / "truth.csv", "MessageType,LatitudeDegrees,LongitudeDegrees,AltitudeMeters,UnixTimeMillis",
        ["Fix"] * measured.at.size, *measured.position.T, 1.7e12 + 1000 * measured.at, form="%.15g",
    )  # fmt: skip
    log = read_log([imu, fixes])
    assert abs(np.median(log.rates[1][:, 2]) + STANDARD_GRAVITY) < 0.2
    np.testing.assert_allclose(log.rates[0].std(axis=0), measured.rate.std(axis=0), rtol=0.05)


def test_a_unit_guessed_by_the_motion_needs_a_motion(tmp_path):
    measured = drive()
    bare = measured.force + np.array(
        (0, 0, STANDARD_GRAVITY)
    )  # without gravity, some 1.3 long: the numbers could be g
    head = "time,gyro_x,gyro_y,gyro_z,linear_acc_x,linear_acc_y,linear_acc_z"
    imu = write(tmp_path / "imu.csv", head, measured.time, *measured.rate.T, *bare.T)
    fixes = write(tmp_path / "gps.csv", "time,lat,lon,altitude_m", measured.at, *measured.position.T)
    with pytest.raises(MissionError, match="without gravity"):
        read_log([imu, fixes])
