"""NMEA: files and streams have the values of pynmeagps; what is broken is left out and counted."""

from __future__ import annotations

import io
import math
import struct
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from live_streams import capture, decoded, fixes
from pynmeagps import NMEAReader
from writers import nmea as writer
from writers.nmea import sentence

from lab.data.formats import reader_of
from lab.data.protocols import receiver_file
from lab.data.protocols.catalogue import make_decoder
from lab.data.protocols.nmea_encoder import NmeaEncoder
from lab.data.rebuild.derived_motion import body_rates
from lab.data.rebuild.import_settings import ImportSettings
from lab.data.streams.reception import Reception
from lab.data.streams.transport import Chunk
from lab.missions import MissionError, mission
from lab.missions.flight_import import prepare_import

KNOT = 1852 / 3600
CASE = next(Path(__file__).parents[3].glob("../shared/cases/12-*"), Path("../shared/cases/12-"))
CAPTURES = {"ubx_gpsd_neo-m8u.expected.jsonl": 2, "ubx_gnss_imu_walk_1730_head256k.ubx": 88}
"""Streams with sentences, and how many times of day these are of."""


def epoch(second: int, *kinds: str) -> bytes:
    """Return the sentences of one time of day."""
    clock = f"12{second // 60:02d}{second % 60:02d}.00"
    text = {
        "RMC": f"GNRMC,{clock},A,4807.038,N,01131.000,E,022.4,084.4,230324,003.1,W",
        "GGA": f"GNGGA,{clock},4807.038,N,01131.000,E,4,08,0.9,545.4,M,46.9,M,,",
        "GST": f"GNGST,{clock},,,,,3.0,4.0,5.0",
        "VTG": "GNVTG,084.4,T,,M,022.4,N,41.5,K,A",
    }
    return "".join(sentence(text[kind]) for kind in kinds).encode()


@pytest.mark.parametrize("name", CAPTURES)
def test_captured_sentences_have_the_values_of_pynmeagps(name):
    data = capture(name)
    expected: dict[object, dict[str, float]] = {}
    for _, message in NMEAReader(io.BytesIO(data), nmeaonly=False, quitonerror=0):
        if message is None or message.msgID not in ("GGA", "RMC") or message.lat == "":
            continue
        one = expected.setdefault(message.time, {})
        one |= {"latitude": message.lat, "longitude": message.lon}
        if message.msgID == "GGA":
            one |= {"altitude": message.alt + message.sep, "satellites": message.numSV}
        else:
            course = math.radians(message.cog or 0.0)
            one |= {
                "north": message.spd * KNOT * math.cos(course),
                "east": message.spd * KNOT * math.sin(course),
            }
    rows = decoded(make_decoder("nmea"), data).fix
    rows = rows[rows["fix_type"] > 1]
    assert len(rows) == len(expected) == CAPTURES[name]
    for row, one in zip(rows, expected.values(), strict=True):
        assert np.degrees(row["latitude"]) == pytest.approx(one["latitude"], abs=1e-9)
        assert np.degrees(row["longitude"]) == pytest.approx(one["longitude"], abs=1e-9)
        if "altitude" in one:
            assert row["height"] == pytest.approx(one["altitude"], abs=1e-9)
            assert row["satellites"] == one["satellites"]
        if "north" in one and not np.isnan(row["velocity_n"][0]):
            assert row["velocity_n"][:2] == pytest.approx((one["north"], one["east"]), abs=1e-9)


def test_sentences_of_one_time_make_one_fix():
    decoder = make_decoder("nmea")
    (first, _) = decoded(
        decoder, epoch(0, "RMC", "GGA", "GST", "VTG") + epoch(1, "RMC", "GGA", "GST", "VTG")
    ).fix
    assert np.degrees(first["latitude"]) == pytest.approx(48 + 7.038 / 60, abs=1e-12)
    assert np.degrees(first["longitude"]) == pytest.approx(11 + 31 / 60, abs=1e-12)
    assert (first["height"], first["fix_type"], first["sea_level"]) == (pytest.approx(592.3), 6, 0)
    speed = 22.4 * KNOT
    course = math.radians(84.4)
    assert first["velocity_n"][:2] == pytest.approx((speed * math.cos(course), speed * math.sin(course)))
    assert np.isnan(first["velocity_n"][2])
    assert (first["horizontal_sigma"], first["vertical_sigma"]) == (pytest.approx(math.sqrt(12.5)), 5.0)
    assert first["utc"] == 1711195200  # 2024-03-23 12:00


def test_a_fix_does_not_wait_for_the_next_one():
    decoder = make_decoder("nmea")
    assert len(decoder.feed(epoch(0, "RMC", "GGA", "GST")).fix) == 0  # may have more kinds
    assert len(decoder.feed(epoch(1, "RMC", "GGA")).fix) == 1
    assert len(decoder.feed(epoch(1, "GST")).fix) == 1
    # A lost sentence costs the wait, and not the fix.
    assert len(decoder.feed(epoch(2, "RMC", "GST")).fix) == 0
    found = decoder.feed(epoch(3, "RMC", "GGA", "GST")).fix
    assert len(found) == 2
    assert np.isnan(found["height"][0])
    assert (
        found["end"][0]
        == sum(len(epoch(0, *kinds)) for kinds in (("RMC", "GGA", "GST"),) * 2)
        + len(epoch(2, "RMC", "GST"))
        - 2
    )


def test_the_sentence_of_u_blox_alone_is_a_flight(tmp_path):
    """PUBX,00 has km/h, a velocity down, accuracies, and heights above the ellipsoid (UBX-13003221)."""
    place = "PUBX,00,{:06d}.00,4717.{:05d},N,00833.91522,E,546.589,{}"
    motion = ",2.1,3.4,36.000,90.00,-0.5,,0.9,1.2,0.8,9,0,0"
    kinds = ["G3"] * 20 + ["NF", "TT", "DR"]
    lines = [sentence(place.format(120000 + n, 11437 + n, kind) + motion) for n, kind in enumerate(kinds)]
    (tmp_path / "drive.nmea").write_text("".join(lines))
    flight = receiver_file.read_nmea([tmp_path / "drive.nmea"], {})
    assert len(flight.time) == 21
    assert list(flight.unmeasured[0].rows) == [False] * 20 + [True]
    np.testing.assert_allclose(np.degrees(flight.latitude[0]), 47 + 17.11437 / 60, atol=1e-12)
    np.testing.assert_allclose(flight.height, 546.589)
    np.testing.assert_allclose(flight.velocity_n[:20], np.tile((0.0, 10.0, -0.5), (20, 1)), atol=1e-9)
    assert any("above the ellipsoid" in remark for remark in flight.remarks)
    fix = decoded(make_decoder("nmea"), "".join(lines).encode()).fix
    np.testing.assert_allclose(fix["horizontal_sigma"][:20], 2.1)
    np.testing.assert_allclose(fix["vertical_sigma"][:20], 3.4)


def said(quality: str, status: str, mode: str, clock: str = "120000.00") -> str:
    """Return the sentences of a time of day in which a receiver says how it came to its position."""
    place = "4807.038,N,01131.000,E"
    return sentence(f"GNRMC,{clock},{status},{place},022.4,084.4,230324,,,{mode}") + sentence(
        f"GNGGA,{clock},{place},{quality},08,0.9,545.4,M,46.9,M,,"
    )


@pytest.mark.parametrize(
    ("quality", "status", "mode", "kind"),
    [
        ("1", "A", "A", 3), ("2", "A", "D", 4), ("3", "A", "P", 3), ("4", "A", "R", 6), ("5", "A", "F", 5),
        ("1", "A", "", 3), ("0", "V", "N", 1), ("0", "V", "", 1), ("6", "V", "E", -2), ("6", "A", "E", -2),
        ("6", "A", "", -2), ("1", "V", "E", -2), ("7", "V", "M", -3), ("7", "A", "", -3), ("8", "V", "S", 16),
        ("8", "A", "S", 16), ("1", "A", "S", 16), ("1", "V", "A", -4), ("1", "V", "", -4),
    ],
)  # fmt: skip
def test_the_kind_of_a_fix_is_that_of_the_standard(quality, status, mode, kind):
    (row,) = decoded(make_decoder("nmea"), said(quality, status, mode).encode()).fix
    assert row["fix_type"] == kind
    assert np.isnan(row["latitude"]) == (kind == 1)


@pytest.mark.parametrize(
    ("body", "kind"),
    [
        (
            "GNGNS,120000.00,4807.038,N,01131.000,E,{},08,0.9,545.4,46.9,,",
            {"AN": 3, "EN": -2, "AE": 3, "NN": 1, "RR": 6, "SN": 16, "MN": -3},
        ),
        (
            "GPGLL,4807.038,N,01131.000,E,120000.00,{}",
            {"A": 3, "A,A": 3, "V,E": -2, "A,E": -2, "V,S": 16, "V": -4, "V,M": -3},
        ),
        ("GPRMC,120000.00,{},4807.038,N,01131.000,E,1.0,2.0,230324,,,E", {"A": -2, "V": -2}),
    ],
)
def test_each_sentence_with_a_position_says_its_kind(body, kind):
    for words, expected in kind.items():
        (row,) = decoded(make_decoder("nmea"), sentence(body.format(words)).encode()).fix
        assert row["fix_type"] == expected, words


def drive(*parts: tuple[int, str, str, str]) -> bytes:
    """Return a drive of numbers of seconds, each with a quality, a status and a mode."""
    text, second = "", 0
    for count, quality, status, mode in parts:
        for _ in range(count):
            clock = f"12{second // 60:02d}{second % 60:02d}.00"
            north = f"4807.{5398 * second % 1_000_000:06d},N"  # 10 m/s
            text += (
                said(quality, status, mode, clock)
                .replace("4807.038,N", north)
                .replace("022.4,084.4", "019.438,000.0")
            )
            second += 1
    return "".join(sentence(line[1 : line.index("*")]) for line in text.splitlines()).encode()


def test_positions_that_are_no_measurement_are_counted_and_kept_only_when_asked(tmp_path):
    path = tmp_path / "tunnel.nmea"
    path.write_bytes(drive((40, "1", "A", "A"), (5, "6", "V", "E"), (3, "7", "V", "M"), (4, "1", "V", "A"),
                           (2, "0", "V", "N"), (40, "1", "A", "A")))  # fmt: skip
    made = prepare_import(path, ImportSettings(vehicle="car", longest_gap=20.0))
    assert len(made.flight.raw.time) == 80
    left_out = [row.value for row in made.report.rows if row.name == "Left out"]
    assert [text.split(" (")[0] for text in left_out] == [
        "2 × without a fix",
        "5 × without a fix: the receiver estimated the position",
        "3 × without a fix: the position was typed in",
        "4 × without a fix: the receiver warns of the position",
    ]
    kept = prepare_import(path, ImportSettings(vehicle="car", longest_gap=20.0, positions="all"))
    assert len(kept.flight.raw.time) == 92
    assert kept.report.verdict == "questionable"
    assert any(reason.startswith("5 of 92 positions are kept") for reason in kept.report.reasons)
    reception = Reception("nmea")
    assert len(reception.accept(Chunk(0.0, path.read_bytes()))[1]) == 80
    assert [text.split()[0] for text in reception.fixes.positions] == ["5", "3", "4"]


@pytest.fixture(params=["made here", "the case"])
def folder(request, tmp_path):
    """Return a folder with the drive of a simulator, and one by dead reckoning alone."""
    if request.param == "made here":
        (tmp_path / "simulator.nmea").write_bytes(drive((105, "8", "V", "S")))
        (tmp_path / "dead_reckoning.nmea").write_bytes(drive((105, "6", "V", "E")))
        return tmp_path
    if not CASE.is_dir():
        pytest.skip(f"no folder {CASE}")
    return CASE


def test_drives_without_a_measurement_are_named(folder):
    car = ImportSettings(vehicle="car")
    simulated = prepare_import(folder / "simulator.nmea", car).report
    assert simulated.verdict == "questionable"
    assert "105 of 105 positions are simulated: the receiver runs in its simulator mode." in simulated.reasons
    reckoned = folder / "dead_reckoning.nmea"
    with pytest.raises(
        MissionError, match=r"105 from row 2 on: without a fix: the receiver est.*positions=all"
    ):
        prepare_import(reckoned, car)
    kept = prepare_import(reckoned, ImportSettings(vehicle="car", positions="all")).report
    assert kept.reasons[0].startswith(
        "105 of 105 positions are kept that are without a fix: the receiver est"
    )


@given(cuts=st.lists(st.integers(0, 4000), max_size=30), damage=st.lists(st.integers(0, 4000), max_size=5))
def test_any_cut_of_the_bytes_gives_the_same_rows(cuts, damage):
    data = bytearray(drive((12, "1", "A", "A"), (3, "6", "V", "E")) + epoch(59, "RMC", "GGA", "GST", "VTG"))
    for place in damage:
        data[place % len(data)] ^= 1
    whole, decoder = decoded(make_decoder("nmea"), bytes(data)), make_decoder("nmea")
    ends = [0, *sorted(cut % len(data) for cut in cuts), len(data)]
    parts = [decoder.feed(bytes(data[a:b])).fix for a, b in pairwise(ends)]
    assert np.concatenate([*parts, decoder.finish().fix]).tobytes() == whole.fix.tobytes()


@pytest.mark.parametrize("date", ["", "ZDA first", "ZDA last"])
def test_time_goes_on_after_midnight_with_zda_and_without_a_date(date):
    data = ""
    for clock, day in (("235958.00", "31,12,2023"), ("235959.00", "31,12,2023"), ("000000.00", "01,01,2024")):
        zda = sentence(f"GPZDA,{clock},{day},00,00")
        gga = sentence(f"GPGGA,{clock},4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,")
        data += {"": gga, "ZDA first": zda + gga, "ZDA last": gga + zda}[date]
    begin = datetime(2023, 12, 31, tzinfo=UTC).timestamp() if date else 0
    utc = decoded(make_decoder("nmea"), data.encode()).fix["utc"]
    assert (utc - begin).tolist() == [86398, 86399, 86400]


def test_a_missing_height_of_the_geoid_is_the_last_one_known(file):
    lines = track(20)
    lines[5:9] = [line.partition("*")[0][1:].replace("-31.0", "") for line in lines[5:9]]
    lines[5:9] = [sentence(line) for line in lines[5:9]]
    np.testing.assert_allclose(file("".join(lines)).height, 69.0 + np.arange(20))
    np.testing.assert_allclose(file("".join(lines[5:])).height, 74.0 + np.arange(15))  # known later only


def test_sound_sentences_without_a_position_are_named():
    data = sentence("GPGSV,1,1,04,01,40,083,46,04,17,308,41,09,07,344,39,12,33,190,45").encode() * 100
    reception = Reception()
    for second in range(3):
        reception.accept(Chunk(float(second), data))
    assert reception.described.endswith("sound messages, none with position: turn on GGA and RMC.")


def test_a_height_above_the_sea_is_marked():
    (row,) = decoded(
        make_decoder("nmea"), sentence("GPGGA,120000,4807.038,N,01131.000,E,1,08,0.9,545.4,M,,M,,").encode()
    ).fix
    assert (row["height"], row["sea_level"]) == (545.4, 1)


def test_damaged_sentences_are_dropped():
    whole = epoch(0, "RMC", "GGA")
    decoder = make_decoder("nmea")
    stream = (
        whole.replace(b"4807", b"4817") + b"$GPGGA,1200" + b"$$" + epoch(1, "GGA") + b"$GPGGA" + b"\xb5" * 90
    )
    assert len(decoded(decoder, stream).fix) == 1
    assert (decoder.statistics.frames, decoder.statistics.failed) == (1, 2)


def test_what_is_encoded_is_read_again():
    fix = fixes(5)
    fix["fix_type"] = (3, 4, 5, 6, 3)
    found = decoded(make_decoder("nmea"), NmeaEncoder().encode(fix[:0], fix)).fix
    assert found["fix_type"].tolist() == fix["fix_type"].tolist()
    for name, bound in (
        ("latitude", 1e-10),
        ("longitude", 1e-10),
        ("height", 1e-4),
        ("utc", 1e-6),
        ("vertical_sigma", 0),
    ):
        np.testing.assert_allclose(found[name], fix[name], rtol=0, atol=bound)
    np.testing.assert_allclose(found["velocity_n"][:, :2], fix["velocity_n"][:, :2], atol=1e-5)


@pytest.fixture
def file(tmp_path):
    """Return a function that writes text and reads it as NMEA."""

    def read(text: str | bytes, units=None):
        path = tmp_path / "log.txt"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        assert reader_of(path).name == receiver_file.NMEA
        return receiver_file.read_nmea([path], units or {})

    return read


def track(count: int, kind: str = "GGA", start: int = 0) -> list[str]:
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
    lines = track(12)
    lines[4] = lines[4].replace("104.0", "904.0")
    lines[7] = lines[7].partition("*")[0] + "\r\n"
    flight = file("".join(lines))
    assert len(flight.time) == 10
    assert flight.height.max() < 100
    assert [(drop.count, drop.first_row) for drop in flight.dropped] == [(2, 5)]
    assert flight.rows_read == 12
    # Sentences without positions are no loss: some receivers write theirs with 00 for a checksum.
    again = file("".join(line for one in track(12) for line in (one, "$PGLOR,2,PWR,mA,26.0*00\r\n")))
    assert again.rows_read == 12
    assert not again.dropped


def test_heights_that_too_few_points_have_are_named(file):
    heights = track(50)
    lines = [*track(50, "RMC"), *(line for i, line in enumerate(heights) if i % 5)]
    flight = file("".join(sorted(lines, key=lambda line: line.split(",")[1])))
    assert flight.height is None
    assert any("heights are not used: they are known at 80%" in remark for remark in flight.remarks)


@pytest.mark.parametrize("kinds", [("GNS", "VTG"), ("GGA", "VTG"), ("GGA", "RMC"), ("RMC", "GGA"), ("RMC",)])
def test_sentences_of_one_time_are_one_point(file, kinds):
    lines = [line for group in zip(*(track(20, kind) for kind in kinds), strict=True) for line in group]
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
    lines = track(10)
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
    lines = [line for pair in zip(track(20, "GGA"), track(20, "VTG"), strict=True) for line in pair]
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
    lines = [line.encode() for group in zip(track(12), track(12, "RMC"), strict=True) for line in group]
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
    assert len(file("".join(track(10)).replace("\r\n", ends)).time) == 10


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("".join(track(3)), "3 of 3 points"),
        ("".join(track(9)).replace("45", "46"), "none of its sentences can be used .9 with a wrong"),
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
    assert not receiver_file.recognises(receiver_file.NMEA, b"time,lat,lon\n1,2,3\n$GPGGA\n")
    assert not receiver_file.recognises(receiver_file.NMEA, b"")


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


def _of_receivers(*senders: tuple[str, int, float]) -> bytes:
    """Return 60 s of sentences of receivers: the two letters of each, its rate [Hz] and its latitude [°]."""
    text = []
    for tick in range(600):
        for name, rate, latitude in senders:
            if tick % (10 // rate) == 0:
                clock = f"12{tick // 600:02d}{tick % 600 / 10:05.2f}"
                place = f"48{60 * (latitude - 48):08.5f},N,01131.00000,E"
                text += [sentence(f"{name}GGA,{clock},{place},4,08,0.9,545.4,M,46.9,M,,")]
                text += [sentence(f"{name}RMC,{clock},A,{place},022.4,084.4,230324,003.1,W")]
    return "".join(text).encode()


@pytest.mark.parametrize("rates", [(5, 5), (5, 1), (1, 5)])
def test_two_receivers_are_not_mixed(rates):
    data = _of_receivers(("GP", rates[0], 48.1), ("GN", rates[1], 48.10002))
    decoder = make_decoder("nmea")
    fix = decoder.feed(data).fix
    is_first = np.isclose(np.degrees(fix["latitude"]), 48.1, rtol=0, atol=1e-6)
    # The first ones come before both are known.
    assert is_first[12:].all() or not is_first[12:].any()
    assert is_first[-1] == (rates[0] >= rates[1])
    assert len(fix) >= 60 * max(rates) - 12
    assert "Sentences of two receivers come" in decoder.evidence


def test_a_receiver_that_uses_other_satellites_is_one():
    first, then = _of_receivers(("GP", 5, 48.1)), _of_receivers(("GN", 5, 48.1))
    decoder = make_decoder("nmea")
    half = first.index(b"$GPGGA,120030")
    fix = decoder.feed(first[:half] + then[then.index(b"$GNGGA,120030") :]).fix
    assert len(fix) >= 299
    assert not decoder.evidence
