"""Text files of GnssLogger: rows of several kinds, with fixes of the receiver and fused ones."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from foreign_tables import UNIX, phone
from phone_drive import LATITUDE, LONGITUDE, drive, trajectory
from scipy.spatial.transform import Rotation

from lab.data.sheets.gnss_logger import split_tables
from lab.data.sheets.sensor_csv import recognises
from lab.missions import MissionError
from lab.missions.flight_import import read_log
from lab.motion.frames.magnetic_field import magnetic_field

NEW = (
    "Fix,Provider,LatitudeDegrees,LongitudeDegrees,AltitudeMeters,SpeedMps,AccuracyMeters,BearingDegrees,"
    "UnixTimeMillis,SpeedAccuracyMps,BearingAccuracyDegrees,elapsedRealtimeNanos,VerticalAccuracyMeters"
)
OLD = "Fix,Provider,Latitude,Longitude,Altitude,Speed,Accuracy,(UTC)TimeInMs"
SENSORS = (
    "UncalAccel,utcTimeMillis,elapsedRealtimeNanos,UncalAccelXMps2,UncalAccelYMps2,UncalAccelZMps2,"
    "BiasXMps2,BiasYMps2,BiasZMps2",
    "UncalGyro,utcTimeMillis,elapsedRealtimeNanos,UncalGyroXRadPerSec,UncalGyroYRadPerSec,"
    "UncalGyroZRadPerSec,DriftXRadPerSec,DriftYRadPerSec,DriftZRadPerSec",
)


def millis(time):
    return round((UNIX + time) * 1e3)


def nanos(time):
    return round((1000 + time) * 1e9)


def text(header, providers=("GPS", "FLP", "NLP"), sensors=True):
    """Return a file: the fused fixes are 200 m beside the receiver's, those of the network have no height."""
    one = drive()
    lines = ["# ", "# Header Description:", "# ", "# Version: v3.0.5.6 Platform: 13", "# ",
             "# Raw,utcTimeMillis,TimeNanos,LeapSecond", "# ",
             *(f"# {line}" for line in SENSORS), f"# {header}", "# "]  # fmt: skip
    rows = []
    for t, w, f in zip(one.time, phone(one.rate), phone(one.force), strict=True):
        for kind, values in (("UncalAccel", f), ("UncalGyro", w)):
            cells = ",".join(f"{value:.9f}" for value in values)
            rows.append((t, f"{kind},{millis(t)},{nanos(t)},{cells},0.0,0.0,0.0"))
    for t, (lat, lon, height), speed, course in zip(one.at, one.position, one.speed, one.course, strict=True):
        for provider in providers:
            beside = 0.0 if provider == "GPS" else 0.002
            place = f"{lat + beside:.9f},{lon:.9f},{'' if provider == 'NLP' else f'{height:.4f}'},{speed:.6f}"
            more = f",{course:.6f},{millis(t)},0.2,2.0,{nanos(t)},3.0" if header == NEW else f",{millis(t)}"
            rows.append((t, f"Fix,{provider},{place},3.03{more}"))
        rows.append((t, f"Raw,{millis(t)},{round(t * 1e9)},18"))
    rows.sort(key=lambda row: row[0])
    kept = [row for _, row in rows if sensors or not row.startswith("Uncal")]
    return "\n".join((*lines, *kept, ""))


def test_sensors_and_fixes_of_the_receiver_are_read(tmp_path):
    path = tmp_path / "gnss_log.txt"
    path.write_text(text(NEW))
    assert recognises(path.read_bytes()[:4096])
    one, log = drive(), read_log([path], vehicle="car")
    at = log.time[1:] + log.epoch - 1000
    seen = np.column_stack([np.interp(at, one.time, column) for column in one.rate.T])
    np.testing.assert_allclose(log.rates[0], seen, atol=1e-6)
    np.testing.assert_allclose(log.gnss.time + log.epoch - 1000, one.at, atol=1e-6)
    np.testing.assert_allclose(np.degrees(log.gnss.position[:, 0]), one.position[:, 0], atol=1e-8)
    np.testing.assert_allclose(log.gnss.velocity_n[:, :2], one.velocity, atol=1e-4)
    np.testing.assert_allclose(log.gnss.position_sigma, np.tile((2, 2, 3), (one.at.size, 1)), rtol=1e-3)
    np.testing.assert_allclose(log.gnss.velocity_sigma[:, :2], 0.2)
    said = " ".join(log.repairs)
    assert "no σ of its velocity" not in said and "no σ of its vertical velocity" not in said


def test_older_versions_have_one_clock_in_milliseconds_and_no_course(tmp_path):
    path = tmp_path / "gnss_log.txt"
    path.write_text(text(OLD))
    one, log = drive(), read_log([path], axes=("y", "x", "-z"), vehicle="car")
    np.testing.assert_allclose(log.gnss.time + log.epoch - UNIX, one.at, atol=1e-3)
    assert not np.isfinite(log.gnss.velocity_n).any()


def test_without_the_receiver_the_fused_fixes_are_read(tmp_path):
    path = tmp_path / "gnss_log.txt"
    path.write_text(text(NEW, ("FLP", "NLP")))
    log = read_log([path], vehicle="car")
    np.testing.assert_allclose(np.degrees(log.gnss.position[:, 0]), drive().position[:, 0] + 0.002, atol=1e-8)


def test_a_file_without_sensors_says_that_the_sensors_are_missing(tmp_path):
    path = tmp_path / "gnss_log.txt"
    path.write_text(text(NEW, sensors=False))
    with pytest.raises(MissionError, match="no complete gyros and accelerometers"):
        read_log([path], vehicle="car")


def test_many_short_rows_take_no_more_memory_than_long_ones():
    data = "\n".join((f"# {NEW}", *["Fix,a"] * 100_000)).encode()
    tracemalloc.start()
    try:
        split_tables(data)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 5 * len(data)


MAGNETOMETERS = {
    "UncalMag": "UncalMagXMicroT,UncalMagYMicroT,UncalMagZMicroT,BiasXMicroT,BiasYMicroT,BiasZMicroT",
    "Mag": "MagXMicroT,MagYMicroT,MagZMicroT",
}
IRON = np.array((-80.0, 25.0, 110.0))
"""What Android calls the bias of the uncalibrated field [µT]."""


@pytest.mark.proof
@pytest.mark.parametrize("kinds", [("UncalMag",), ("Mag",), ("UncalMag", "Mag")], ids="+".join)
def test_the_field_is_the_calibrated_one(tmp_path, kinds):
    """The uncalibrated rows give the bias beside the field with it; it is as good as the calibrated one."""
    one, place = drive(), np.radians((LATITUDE, LONGITUDE, 0.0))
    attitude = Rotation.from_quat(trajectory().at(one.time).q_nb, scalar_first=True)
    true = attitude.apply(magnetic_field(place), inverse=True)
    rows = []
    for t, field in zip(one.time[::10], phone(true[::10]), strict=True):
        for kind in kinds:
            cells = (*field,) if kind == "Mag" else (*(field + IRON), *IRON)
            rows.append(f"{kind},{millis(t)},{nanos(t)},{','.join(f'{value:.6f}' for value in cells)}")
    comments = [f"# {kind},utcTimeMillis,elapsedRealtimeNanos,{MAGNETOMETERS[kind]}" for kind in kinds]
    path = tmp_path / "gnss_log.txt"
    path.write_text("\n".join((*comments, text(NEW), *rows, "")))
    log = read_log([path], vehicle="car")
    taken = log.auxiliary.magnetometer
    at = taken.time + log.epoch - 1000
    seen = np.column_stack([np.interp(at, one.time, column) for column in true.T])
    np.testing.assert_allclose(taken.field, seen, atol=0.1)
    bare = tmp_path / "bare.txt"
    bare.write_text(text(NEW))
    np.testing.assert_array_equal(log.gnss.position, read_log([bare], vehicle="car").gnss.position)
