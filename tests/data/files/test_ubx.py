"""UBX files, read as an independent decoder reads them; what is broken is left out and counted."""

from __future__ import annotations

import io

import numpy as np
import pymap3d
import pytest
from pyubx2 import UBX_PROTOCOL, UBXReader
from writers import ubx as writer
from writers.nmea import sentence
from writers.ubx import WEEK, message, pvt

from lab.data.formats import read_raw, reader_of
from lab.data.protocols import receiver_file
from lab.missions import MissionError, mission

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


def test_an_independent_decoder_reads_the_same(file):
    written = writer.write(mission("montreal").recording)
    flight = file(written)
    theirs = [one for _, one in UBXReader(io.BytesIO(written), protfilter=UBX_PROTOCOL)]
    fixes = [one for one in theirs if one.identity == "NAV-PVT"]
    assert len(fixes) == len(flight.time) == flight.rows_read
    assert not flight.dropped
    for values, name in ((flight.latitude, "lat"), (flight.longitude, "lon")):
        np.testing.assert_allclose(np.degrees(values), [getattr(p, name) for p in fixes], rtol=0, atol=1e-12)
    np.testing.assert_allclose(flight.height, [1e-3 * p.height for p in fixes], rtol=0, atol=1e-9)
    velocity = 1e-3 * np.array([(p.velN, p.velE, p.velD) for p in fixes])
    np.testing.assert_allclose(flight.velocity_n, velocity, rtol=0, atol=1e-12)
    assert "vertical velocity" not in flight.made


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


@pytest.mark.parametrize("kind", ["POSLLH", "SOL", "POSECEF"])
@pytest.mark.parametrize("lost", [{"fix": 0}, {"fix": 5}, {"accuracy": 40_000_000}])
def test_points_without_a_fix_are_left_out(file, kind, lost):
    parts = [by_parts(kind, i, **(lost if i in (3, 4) else {})) for i in range(20)]
    flight = file(b"".join(parts))
    assert len(flight.time) == 18
    assert [(one.reason, one.count) for one in flight.dropped] == [("without a fix", 2)]


@pytest.mark.parametrize("lost", [{"fixType": 0}, {"gnssFixOk": 0}, {"fixType": 5}])
def test_fixes_of_nav_pvt_that_are_none_are_left_out(file, lost):
    flight = file(b"".join(north(10) + north(2, 10, **lost) + north(10, 12)))
    assert len(flight.time) == 20
    (dropped,) = flight.dropped
    assert dropped.count == 2
    assert dropped.reason.startswith("without a fix")


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
