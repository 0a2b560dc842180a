"""NMEA logs, read as an independent decoder reads them; what is broken is left out and counted."""

from __future__ import annotations

import struct
from datetime import UTC, datetime

import numpy as np
import pytest
from pynmeagps import NMEAReader
from writers import nmea as writer
from writers.nmea import sentence

from lab.data.formats import reader_of
from lab.data.protocols import receiver_file
from lab.data.rebuild.derived_motion import body_rates
from lab.missions import MissionError, mission
from lab.missions.flight_import import prepare_import


@pytest.fixture
def file(tmp_path):
    """Return a function that writes text and reads it as NMEA."""

    def read(text: str | bytes, units=None):
        path = tmp_path / "log.txt"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        assert reader_of(path).name == receiver_file.NMEA
        return receiver_file.read_nmea([path], units or {})

    return read


def fixes(count: int, kind: str = "GGA", start: int = 0) -> list[str]:
    """Return sentences a second apart on the way north."""
    lines = []
    for i in range(count):
        clock = f"{120000 + start + i:06d}.00"
        where = f"4500.{i:05d},N,07330.00000,W"
        lines.append(
            {
                "GGA": f"GPGGA,{clock},{where},1,08,0.9,{100 + i:.1f},M,-31.0,M,,",
                "GNS": f"GNGNS,{clock},{where},AAN,08,0.9,{100 + i:.1f},-31.0,,",
                "RMC": f"GPRMC,{clock},A,{where},19.438445,0.0,170524,,,A",
                "VTG": "GPVTG,90.0,T,,M,19.438445,N,36.0,K,A",
            }[kind]
        )
    return [sentence(line) for line in lines]


def test_an_independent_decoder_reads_the_same(file):
    written = writer.write(mission("montreal").recording)
    flight = file(written)
    theirs = [NMEAReader.parse(line) for line in written.splitlines(keepends=True)]
    gga = [one for one in theirs if one.msgID == "GGA"]
    rmc = [one for one in theirs if one.msgID == "RMC"]
    assert len(gga) == len(flight.time) == flight.rows_read
    assert not flight.dropped
    for values, name in ((flight.latitude, "lat"), (flight.longitude, "lon")):
        np.testing.assert_allclose(np.degrees(values), [getattr(p, name) for p in gga], rtol=0, atol=2e-10)
    np.testing.assert_allclose(flight.height, [p.alt + p.sep for p in gga], rtol=0, atol=1e-9)
    speed = np.array([p.spd for p in rmc]) * 1852 / 3600
    course = np.radians([p.cog or 0.0 for p in rmc])
    np.testing.assert_allclose(flight.velocity_n[:, 0], speed * np.cos(course), atol=1e-9)
    np.testing.assert_allclose(flight.velocity_n[:, 1], speed * np.sin(course), atol=1e-9)


def test_time_goes_on_over_midnight_with_and_without_a_date(file):
    written = writer.write(mission("montreal").recording).decode()
    expected = writer.START.hour * 3600 + 58 * 60 + 30 + np.arange(1026) / writer.RATE
    with_date, without = file(written), file("".join(x for x in written.splitlines(True) if "GGA" in x))
    np.testing.assert_allclose(with_date.time, expected, rtol=0, atol=1e-9)
    np.testing.assert_allclose(without.time, expected, rtol=0, atol=1e-9)
    assert with_date.remarks[0] == "Time counts from 2024-05-17 00:00 UTC."
    assert without.velocity_n is None


def test_a_recording_that_is_taken_up_days_later_goes_on_days_later(file):
    recording = mission("montreal").recording
    first = writer.write(recording, datetime(2023, 12, 31, 10, 0, tzinfo=UTC), rate=1.0)
    second = writer.write(recording, datetime(2024, 1, 2, 9, 0, tzinfo=UTC), rate=1.0)
    flight = file(first + second)
    np.testing.assert_allclose(flight.time[206] - flight.time[0], 47 * 3600, atol=1e-9)


def test_the_climb_is_the_slope_of_the_heights(file):
    recording = mission("montreal").recording
    flight = file(writer.write(recording))
    down = np.interp(
        flight.time - flight.time[0], recording.time - recording.time[0], recording.velocity_n[:, 2]
    )
    # Heights rounded to 0.1 m, 10 of them from knot to knot.
    assert np.sqrt(np.mean((flight.velocity_n[:, 2] - down)[10:-10] ** 2)) < 0.1


def test_a_wrong_checksum_and_a_missing_one_are_counted(file):
    lines = fixes(12)
    lines[4] = lines[4].replace("104.0", "904.0")
    lines[7] = lines[7].partition("*")[0] + "\r\n"
    flight = file("".join(lines))
    assert len(flight.time) == 10
    assert flight.height.max() < 100
    assert [(drop.count, drop.first_row) for drop in flight.dropped] == [(2, 5)]
    assert flight.rows_read == 12
    # Sentences without positions are no loss: some receivers write theirs with 00 for a checksum.
    again = file("".join(line for one in fixes(12) for line in (one, "$PGLOR,2,PWR,mA,26.0*00\r\n")))
    assert again.rows_read == 12
    assert not again.dropped


def test_heights_that_too_few_points_have_are_named(file):
    heights = fixes(50)
    lines = [*fixes(50, "RMC"), *(line for i, line in enumerate(heights) if i % 5)]
    flight = file("".join(sorted(lines, key=lambda line: line.split(",")[1])))
    assert flight.height is None
    assert any("heights are not used: they are known at 80%" in remark for remark in flight.remarks)


def test_epochs_without_a_fix_are_counted(file):
    lines = fixes(12)
    lines[3] = sentence("GPGGA,120003.00,,,,,0,00,99.9,,M,,M,,")
    lines[6] = sentence("GPGGA,120006.00,4500.00006,N,07330.00000,W,0,08,0.9,100.0,M,-31.0,M,,")
    flight = file("".join(lines))
    assert [(drop.reason, drop.count, drop.first_row) for drop in flight.dropped] == [("without a fix", 2, 4)]


@pytest.mark.parametrize("kinds", [("GNS", "VTG"), ("GGA", "VTG"), ("GGA", "RMC"), ("RMC", "GGA"), ("RMC",)])
def test_sentences_of_one_time_are_one_point(file, kinds):
    lines = [line for group in zip(*(fixes(20, kind) for kind in kinds), strict=True) for line in group]
    flight = file("".join(lines))
    assert len(flight.time) == 20
    np.testing.assert_allclose(flight.time, 43200 + np.arange(20.0))
    if kinds == ("RMC",):
        assert flight.height is None
        assert flight.velocity_n is None
    else:
        np.testing.assert_allclose(flight.height, 69.0 + np.arange(20))
        assert np.hypot(*flight.velocity_n[:, :2].T) == pytest.approx(np.full(20, 10.0), rel=1e-6)


def test_a_logger_may_write_before_a_sentence_and_other_things_between(file):
    lines = fixes(10)
    lines[2] = "2024-05-17 12:00:02.113 " + lines[2]
    lines[5] = "$GPGGA,1200" + lines[5]
    lines.insert(4, "boot: receiver ready $$$\r\n" + "x" * 5000 + "\n")
    flight = file("".join(lines))
    assert len(flight.time) == 10


@pytest.mark.parametrize("noise", [0.3, 1.5])
def test_a_standing_receiver_is_no_impossible_flight(tmp_path, noise):
    """Course of noise, heights that wander and jump by 5 m: nothing of it is the vehicle's motion."""
    rng = np.random.default_rng(5)
    lines = []
    for i in range(120):
        clock = f"{120000 + i // 120 * 100 + i // 2 % 60:06d}.{5 * (i % 2)}0"
        height = 100 + noise * rng.normal() - (5.0 if i > 70 else 0.0)
        where = f"4500.{round(100 + 30 * noise * rng.normal()):05d},N,07330.00000,W"
        lines += [
            f"GPGGA,{clock},{where},1,08,0.9,{height:.3f},M,-31.0,M,,",
            f"GPVTG,{rng.uniform(0, 360):.1f},T,,M,{abs(rng.normal(scale=noise)):.2f},N,,K,A",
        ]
    path = tmp_path / "standing.nmea"
    path.write_text("".join(sentence(line) for line in lines))
    made = prepare_import(path)
    assert made.report.verdict != "implausible", made.report
    rates = np.linalg.norm(body_rates(made.recording.time, made.recording.euler), axis=1)
    assert np.degrees(rates.max()) < 150
    assert np.abs(made.recording.velocity_n[:, 2]).max() < 10


def test_a_slow_course_that_is_left_out_is_the_last_one_known(file):
    lines = [line for pair in zip(fixes(20, "GGA"), fixes(20, "VTG"), strict=True) for line in pair]
    for i in range(11, 21, 2):
        lines[i] = sentence("GPVTG,,T,,M,1.943844,N,3.6,K,A")
    flight = file("".join(lines))
    np.testing.assert_allclose(flight.velocity_n[5:10, :2], np.tile((0.0, 1.0), (5, 1)), atol=1e-6)
    assert not flight.dropped


def ubx(kind: int, payload: bytes) -> bytes:
    """Return a frame of u-blox's binary protocol."""
    frame = struct.pack("<BBH", 1, kind, len(payload)) + payload
    a = b = 0
    for byte in frame:
        a = (a + byte) & 255
        b = (b + a) & 255
    return b"\xb5\x62" + frame + bytes((a, b))


@pytest.mark.parametrize("size", [92, 3000, 60_000])
def test_binary_frames_between_the_sentences_are_left_out_and_counted(file, size):
    rng = np.random.default_rng(size)
    lines = [line.encode() for group in zip(fixes(12), fixes(12, "RMC"), strict=True) for line in group]
    lines[7] = lines[7].replace(b"10", b"11")
    pieces, frames = [], 0
    for i, line in enumerate(lines):
        pieces.append(line)
        for _ in range(4 if i % 2 else 0):
            payload = rng.integers(0, 256, size, dtype=np.uint8).tobytes()
            frame = ubx(7, b"\r\n$GNGGA,\n*00$" + bytes(20) + payload)
            pieces.append(frame)
            frames += len(frame)
    flight = file(b"# a capture\r\n" + b"".join(pieces) + frame[:50])
    assert len(flight.time) == 12
    np.testing.assert_allclose(flight.latitude, np.radians(45 + np.arange(12) * 1e-5 / 60), atol=1e-12)
    counted = int(next(one for one in flight.remarks if "binary" in one).split()[0])
    assert counted == pytest.approx(frames, rel=0.02, abs=400)  # line ends in the frames are not all seen
    assert sum(drop.count for drop in flight.dropped) < 0.2 * frames / 256**2 + 50


def test_frames_without_sentences_are_named(tmp_path):
    path = tmp_path / "capture.ubx"
    path.write_bytes(ubx(0x22, bytes(20)) * 50)
    with pytest.raises(
        MissionError, match="50 sound messages, none with position or IMU: turn on NAV-PVT and ESF-MEAS"
    ):
        reader_of(path)


@pytest.mark.parametrize("ends", ["\n", "\r\n", "\r"])
def test_lines_end_as_they_like(file, ends):
    assert len(file("".join(fixes(10)).replace("\r\n", ends)).time) == 10


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("".join(fixes(3)), "3 of 3 points"),
        ("".join(fixes(9)).replace("45", "46"), "none of its sentences can be used .9 with a wrong"),
        (
            "".join(sentence("GPGGA,120000,,,,,0,00,99.9,,M,,M,,") for _ in range(9)),
            "0 of 1 points.*without a fix",
        ),
    ],
)
def test_what_gives_no_flight_is_refused(file, text, words):
    with pytest.raises(MissionError, match=words):
        file(text)


def test_other_text_is_not_taken_for_nmea():
    assert not receiver_file.recognises_nmea(b"time,lat,lon\n1,2,3\n$GPGGA\n")
    assert not receiver_file.recognises_nmea(b"")


@pytest.mark.parametrize("dated", [True, False])
def test_the_leap_second_of_2016_lasts_a_second(file, dated):
    """23:59:60 is a second of its own, of the day that ends (ITU-R TF.460)."""
    clocks = [
        *(f"2359{second:02d}" for second in range(50, 61)),
        *(f"0000{second:02d}" for second in range(20)),
    ]
    text = ""
    for second, clock in enumerate(clocks):
        place = f"48{second * 0.01:07.4f},N,01130.0000,E"
        date = "311216" if clock.startswith("23") else "010117"
        text += sentence(f"GPGGA,{clock},{place},1,08,0.9,500.0,M,47.0,M,,")
        text += sentence(f"GPRMC,{clock},A,{place},36.0,0.0,{date},,") if dated else ""
    flight = file(text)
    np.testing.assert_allclose(np.diff(flight.time), 1.0)
    assert len(flight.time) == len(clocks)
