"""UBX: files and streams have the values of pyubx2 and gpsd; what is broken is left out and counted."""

from __future__ import annotations

import io
import json
import math
import struct
from datetime import UTC, datetime, timedelta

import numpy as np
import pymap3d
import pytest
from live_streams import capture, decoded, fixes, motion
from pyubx2 import GET, UBXMessage, UBXReader
from writers import ubx as writer
from writers.nmea import sentence
from writers.ubx import WEEK, message, pvt

from lab.data.formats import read_raw, reader_of
from lab.data.protocols import receiver_file
from lab.data.protocols.catalogue import make_decoder
from lab.data.protocols.stream_decoder import StreamDecoder
from lab.data.protocols.ubx import MEAS_TICK, RAW_TICK, UbloxEncoder, Ubx
from lab.data.streams.reception import Reception
from lab.data.streams.transport import Chunk
from lab.missions import MissionError, mission

M8U, F9P = "ubx_gpsd_neo-m8u.log", "ubx_gpsd_zed-f9p-hp.log"
WALK = "ubx_gnss_imu_walk_1730_head256k.ubx"


def messages(data: bytes, name: str) -> list:
    """Return the messages of a name that pyubx2 reads."""
    reader = UBXReader(io.BytesIO(data), protfilter=2, quitonerror=0)
    return [message for _, message in reader if message is not None and message.identity == name]


@pytest.mark.parametrize(("name", "count"), [(M8U, 3), (F9P, 29), (WALK, 89)])
def test_captured_fixes_have_the_values_of_pyubx2(name, count):
    data = capture(name)
    decoder = StreamDecoder("ublox", (Ubx(),))
    rows, expected = decoded(decoder, data).fix, messages(data, "NAV-PVT")
    assert len(rows) == len(expected) == count
    assert decoder.statistics.failed == 0
    for row, one in zip(rows, expected, strict=True):
        assert np.degrees([row["latitude"], row["longitude"]]) == pytest.approx((one.lat, one.lon), abs=1e-12)
        assert row["height"] == pytest.approx(one.height * 1e-3, abs=1e-12)
        speeds = [one.velN, one.velE, one.velD]
        assert row["velocity_n"] == pytest.approx([speed * 1e-3 for speed in speeds], abs=1e-12)
        sigma = [row["horizontal_sigma"], row["vertical_sigma"], row["speed_sigma"]]
        assert sigma == pytest.approx([1e-3 * one.hAcc, 1e-3 * one.vAcc, 1e-3 * one.sAcc])
        assert row["satellites"] == one.numSV
        assert row["fix_type"] == {0: 4 if one.diffSoln else 3, 1: 5, 2: 6}[one.carrSoln]
        clock = one.hour * 3600 + one.min * 60 + one.second + one.nano * 1e-9
        assert row["utc"] % 86400 == pytest.approx(clock % 86400, abs=1e-6)


def gpsd(message: str) -> dict[int, dict[str, float]]:
    """Return the lines of gpsd for a message, by their time tag; it repeats lines."""
    lines = map(
        json.loads,
        filter(
            lambda line: f'"UBX-{message}"' in line,
            capture("ubx_gpsd_neo-m8u.expected.jsonl").decode().splitlines(),
        ),
    )
    return {line["timeTag"]: line for line in lines}


@pytest.mark.parametrize(
    ("message", "imu", "tick", "count"),
    [("ESF-RAW", "raw", RAW_TICK, 290), ("ESF-MEAS", "meas", MEAS_TICK, 58)],
)
def test_captured_samples_have_the_values_of_gpsd(message, imu, tick, count):
    expected = gpsd(message)
    rows = decoded(StreamDecoder("ublox", (Ubx(imu),)), capture(M8U)).imu
    assert len(rows) == count
    compared = 0
    for row in rows:
        line = expected.get(round(row["time"] / tick))
        if line is None:
            continue
        compared += 1
        if "acc_x" in line:
            assert row["force"] == pytest.approx([line[f"acc_{axis}"] for axis in "xyz"], abs=5.1e-6)
        if "gyro_x" in line:
            assert np.degrees(row["rate"]) == pytest.approx(
                [line[f"gyro_{axis}"] for axis in "xyz"], abs=5.1e-6
            )
            assert row["temperature"] == pytest.approx(line["gyro_temp"])
    assert compared >= 0.98 * len(expected)
    assert compared >= 0.9 * count


def test_all_samples_have_the_numbers_of_pyubx2():
    data = capture(M8U)
    rows = iter(decoded(StreamDecoder("ublox", (Ubx("raw"),)), data).imu)
    units = {
        14: ("rate", 0),
        13: ("rate", 1),
        5: ("rate", 2),
        16: ("force", 0),
        17: ("force", 1),
        18: ("force", 2),
    }
    for raw in messages(data, "ESF-RAW"):
        words = [getattr(raw, f"data_{number:02d}") for number in range(1, 71)]
        for begin in range(0, 70, 7):
            row = next(rows)
            for word in words[begin : begin + 7]:
                if word[3] in units:
                    name, axis = units[word[3]]
                    value = int.from_bytes(word[:3], "little", signed=True)
                    unit = math.radians(2**-12) if name == "rate" else 2**-10
                    assert row[name][axis] == pytest.approx(value * unit, rel=1e-12)
    assert next(rows, None) is None


def test_the_faster_message_of_the_imu_goes_before_the_slower_one():
    rows = decoded(make_decoder("ublox"), capture(M8U)).imu
    assert len(rows) == 290
    assert not np.isnan(rows["rate"]).any()
    np.testing.assert_allclose(np.diff(rows["time"]), 0.01, atol=1.1e-3)  # its tags jitter by 1 ms


def test_sentences_beside_messages_make_no_second_fix():
    data = capture(WALK)
    assert len(decoded(make_decoder("nmea"), data).fix) == 88
    assert len(decoded(make_decoder("ublox"), data).fix) == 89


def test_what_is_encoded_is_read_by_us_and_by_pyubx2():
    samples, fix = motion(500), fixes(5)
    data = UbloxEncoder().encode(samples, fix)
    found = decoded(make_decoder("ublox"), data)
    np.testing.assert_allclose(found.imu["rate"], samples["rate"], atol=math.radians(2**-13) + 1e-12)
    np.testing.assert_allclose(found.imu["force"], samples["force"], atol=2**-11 + 1e-12)
    np.testing.assert_allclose(found.imu["time"], samples["time"], atol=RAW_TICK)
    for name in ("latitude", "longitude"):
        np.testing.assert_allclose(found.fix[name], fix[name], atol=1e-9)
    read = messages(data, "NAV-PVT")
    assert [message.velE for message in read] == [8500] * 5


def test_a_triad_a_message_makes_a_sample_with_the_other_one_unknown():
    samples, parts = motion(500), []
    for row in samples:
        force = zip((16, 17, 18), row["force"] / 2**-10, strict=True)
        rate = zip((14, 13, 5), np.degrees(row["rate"]) / 2**-12, strict=True)
        for words in (force, (*rate, (12, 2500))):
            data = [kind << 24 | round(float(value)) & 0xFFFFFF for kind, value in words]
            head = struct.pack("<IHH", round(row["time"] / MEAS_TICK), len(data) << 11, 0)
            payload = head + struct.pack(f"<{len(data)}I", *data)
            parts.append(UBXMessage(b"\x10", b"\x02", GET, payload=payload).serialize())
    found = decoded(make_decoder("ublox"), b"".join(parts)).imu
    np.testing.assert_allclose(found["force"][::2], samples["force"], atol=2**-11 + 1e-12)
    np.testing.assert_allclose(found["rate"][1::2], samples["rate"], atol=math.radians(2**-13) + 1e-12)
    np.testing.assert_allclose(found["time"][1::2], samples["time"], atol=MEAS_TICK)
    assert np.isnan(found["rate"][::2]).all() and np.isnan(found["force"][1::2]).all()


def test_sentences_go_before_messages_without_a_velocity():
    place = message("NAV-POSLLH", iTOW=1000, lon=11.5, lat=48.1, height=500_000, hAcc=2000)
    words = [
        sentence(f"GNRMC,1200{i:02d}.00,A,4807.038,N,01131.000,E,22.4,84.4,230324,,,A") for i in range(9)
    ]
    found = decoded(make_decoder("ublox"), b"".join(place + one.encode() for one in words)).fix
    assert np.isfinite(found["velocity_n"][:, 0]).sum() == 9
    assert len(found) <= 10
    assert len(decoded(make_decoder("ublox"), place).fix) == 1


def test_the_tags_go_on_when_they_start_again():
    samples = motion(300)
    samples["time"] += 655.36 - 8.5
    found = decoded(make_decoder("ublox"), UbloxEncoder().encode(samples, fixes(0))).imu
    np.testing.assert_allclose(np.diff(found["time"]), 0.01, atol=2 * RAW_TICK)


NOW = 2315 * WEEK + 100_000_000


@pytest.fixture
def file(tmp_path):
    """Return a function that writes bytes and reads them as UBX."""

    def read(data: bytes, units=None):
        path = tmp_path / "log.ubx"
        path.write_bytes(data)
        assert reader_of(path).name == receiver_file.UBX
        return receiver_file.read_ubx([path], units or {}).measured()

    return read


def north(count: int, first: int = 0, **changes) -> list[bytes]:
    """Return fixes a second apart on the way north at 10 m/s."""
    return [
        pvt(NOW + 1000 * i, 45 + 9e-5 * i, -73.5, 100.0 + i, (10.0, 0.5, -1.0), **changes)
        for i in range(first, first + count)
    ]


def by_parts(kind: str, i: int, *, fix: int = 3, accuracy: int = 300) -> bytes:
    """Return what older receivers send instead: 60° N 10° E, rising and going north and east."""
    of_week = (NOW + 1000 * i) % WEEK
    lat, height = 60 + 9e-5 * i, 50.0 + 2 * i
    x, y, z = (round(100 * one) for one in pymap3d.geodetic2ecef(lat, 10.0, height))
    dx, dy, dz = (round(100 * one) for one in pymap3d.enu2uvw(5.0, 10.0, 2.0, lat, 10.0))
    status = message("NAV-STATUS", iTOW=of_week, gpsFix=fix, gpsFixOk=int(fix > 0))
    return {
        "POSLLH": message("NAV-POSLLH", iTOW=of_week, lon=10.0, lat=lat, height=round(1e3 * height),
                          hAcc=accuracy * 10)
                  + status
                  + message("NAV-VELNED", iTOW=of_week, velN=1000, velE=500, velD=-200),
        "SOL": message("NAV-SOL", iTOW=of_week, week=2315, gpsFix=fix, gpsfixOK=int(fix > 0), ecefX=x,
                       ecefY=y, ecefZ=z, pAcc=accuracy, ecefVX=dx, ecefVY=dy, ecefVZ=dz),
        "POSECEF": message("NAV-POSECEF", iTOW=of_week, ecefX=x, ecefY=y, ecefZ=z, pAcc=accuracy)
                   + status
                   + message("NAV-TIMEGPS", iTOW=of_week, week=2315, leapS=18, weekValid=1, towValid=1)
                   + message("NAV-VELECEF", iTOW=of_week, ecefVX=dx, ecefVY=dy, ecefVZ=dz),
    }[kind]  # fmt: skip


def test_time_goes_on_over_the_end_of_a_week(file):
    flight = file(writer.write(mission("montreal").recording))
    np.testing.assert_allclose(flight.time, 604_800 - 90 + np.arange(1026) / 5, rtol=0, atol=1e-9)
    assert flight.remarks[0] == "Time is that of GPS, from the start of its week on 2024-05-12."


def test_a_recording_that_is_taken_up_weeks_later_goes_on_weeks_later(file):
    later = [pvt(NOW + 3 * WEEK + 1000 * i, 45.0, -73.5, 100.0, (0, 0, 0)) for i in range(5)]
    flight = file(b"".join(north(5) + later))
    np.testing.assert_allclose(np.diff(flight.time)[4], 3 * 604_800 - 4, rtol=0, atol=1e-9)


def test_a_receiver_without_a_date_begins_a_week_without_a_name(file):
    parts = north(5, validDate=0)
    flight = file(b"".join(parts))
    np.testing.assert_allclose(flight.time, 100_000 + np.arange(5.0), rtol=0, atol=1e-9)
    assert flight.remarks[0] == "Time is that of GPS, from the start of a week that the file does not name."


@pytest.mark.parametrize("kind", ["POSLLH", "SOL", "POSECEF"])
def test_what_older_receivers_send_is_the_same_flight(file, kind):
    flight = file(b"".join(by_parts(kind, i) for i in range(20)))
    i = np.arange(20)
    np.testing.assert_allclose(flight.time, 100_000 + i, rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.degrees(flight.latitude), 60 + 9e-5 * i, rtol=0, atol=1e-7)
    np.testing.assert_allclose(np.degrees(flight.longitude), 10.0, rtol=0, atol=2e-7)
    np.testing.assert_allclose(flight.height, 50 + 2 * i, rtol=0, atol=0.01)
    np.testing.assert_allclose(flight.velocity_n, np.tile((10.0, 5.0, -2.0), (20, 1)), rtol=0, atol=0.01)
    named = "2024-05-19" if kind != "POSLLH" else "does not name"
    assert named in flight.remarks[0]
    rows = decoded(make_decoder("ublox"), b"".join(by_parts(kind, k) for k in range(20)), 7).fix
    np.testing.assert_array_equal(rows["latitude"], flight.latitude)
    np.testing.assert_allclose(rows["velocity_n"], flight.velocity_n, atol=1e-12)
    # The accuracy that SOL and POSECEF give is that in three dimensions.
    np.testing.assert_allclose(rows["horizontal_sigma"], 3.0 if kind == "POSLLH" else 3.0 / math.sqrt(3))
    utc = (datetime(2024, 5, 19, tzinfo=UTC) + timedelta(seconds=100_000 - 18)).timestamp()
    np.testing.assert_array_equal(rows["utc"], np.nan if kind == "POSLLH" else utc + i)


@pytest.mark.parametrize("kind", ["POSLLH", "SOL", "POSECEF"])
@pytest.mark.parametrize("lost", [{"fix": 0}, {"fix": 5}, {"accuracy": 40_000_000}])
def test_points_without_a_fix_are_left_out(file, kind, lost):
    parts = [by_parts(kind, i, **(lost if i in (3, 4) else {})) for i in range(20)]
    flight = file(b"".join(parts))
    assert len(flight.time) == 18
    assert [(one.reason, one.count) for one in flight.dropped] == [("without a fix", 2)]


@pytest.mark.parametrize(
    ("lost", "kind", "words"),
    [
        ({"fixType": 0}, 1, "without a fix"),
        ({"fixType": 5}, 1, "without a fix"),
        ({"hAcc": 20_000_000}, 1, "without a fix"),
        ({"gnssFixOk": 0}, -4, "without a fix: the receiver warns of the position"),
        ({"fixType": 1}, -2, "without a fix: the receiver estimated the position"),
        ({"fixType": 1, "gnssFixOk": 0}, -2, "without a fix: the receiver estimated the position"),
    ],
)
def test_fixes_of_nav_pvt_that_are_none_are_left_out_with_the_reason(file, lost, kind, words):
    data = b"".join(north(10) + north(2, 10, **lost) + north(10, 12))
    flight = file(data)
    assert len(flight.time) == 20
    (dropped,) = flight.dropped
    assert (dropped.count, dropped.first_row) == (2, 11)
    assert dropped.reason.startswith(words)
    kinds = decoded(make_decoder("ublox"), data).fix["fix_type"]
    assert kinds.tolist() == 10 * [3] + 2 * [kind] + 10 * [3]
    reception = Reception("ublox")
    assert len(reception.accept(Chunk(0.0, data))[1]) == 20
    assert len(reception.fixes.positions) == (kind < 0)


def test_dead_reckoning_beside_satellites_is_used_and_named(file):
    flight = file(b"".join(north(10) + north(5, 10, fixType=4)))
    assert len(flight.time) == 15
    assert (
        "5 of 15 positions are of satellites combined with the receiver's dead reckoning." in flight.remarks
    )


def test_a_broken_message_is_left_out_and_counted(file):
    parts = north(20)
    parts[7] = parts[7][:40] + bytes([parts[7][40] ^ 1]) + parts[7][41:]
    flight = file(b"".join(parts))
    assert len(flight.time) == 19
    assert [(one.reason, one.count, one.first_row) for one in flight.dropped] == [
        ("messages with a wrong checksum", 1, 8)
    ]


def test_noise_text_and_a_cut_last_message_do_no_harm(file):
    noise = np.random.default_rng(1).bytes(300)
    cut = north(1, 20)[0][:50]
    flight = file(noise.join([b"text\r\n", *north(20), cut]))
    assert len(flight.time) == 20
    assert not flight.dropped


def test_sentences_with_a_position_are_read_in_their_place(tmp_path):
    path = tmp_path / "mixed.log"
    gga = [
        sentence(f"GPGGA,{120000 + i}.00,4500.{540 * i:05d},N,07330.00000,W,1,08,0.9,{100 + i},M,-31.0,M,,")
        for i in range(10)
    ]
    path.write_bytes(b"".join(a + b.encode() for a, b in zip(north(10), gga, strict=True)))
    assert reader_of(path).name == "NMEA 0183"
    assert len(read_raw(path).time) == 10


def test_messages_without_a_position_say_so(tmp_path):
    path = tmp_path / "raw.ubx"
    path.write_bytes(b"".join(message("NAV-CLOCK", iTOW=1000 * i, clkB=1) for i in range(50)))
    with pytest.raises(
        MissionError, match="u-blox UBX, 50 sound messages, none with position or IMU: turn on NAV-PVT"
    ):
        read_raw(path)


def test_a_receiver_that_never_has_a_fix_is_refused(file):
    with pytest.raises(MissionError, match=r"0 of 8 points can be used \(8 from row 1 on: without a fix\)"):
        file(b"".join(north(8, fixType=0)))


def test_an_end_of_messages_that_only_look_like_positions_is_quick(file):
    """A file of beginnings of messages takes no longer than its size says."""
    data = b"".join(north(5)) + b"\xb5b\x01\x07\x5c\x00" * 200_000
    flight = file(data)
    assert len(flight.time) == 5
    assert flight.dropped[0].count >= 199_900
