"""NMEA: sentences have the values that pynmeagps reads in them, and a fix comes with its last sentence."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest
from live_streams import capture, decoded, fixes
from pynmeagps import NMEAReader
from writers.nmea import sentence

from lab.data.protocols.catalogue import decoder_of
from lab.data.protocols.nmea_encoder import NmeaEncoder

KNOT = 1852 / 3600
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
    rows = decoded(decoder_of("nmea"), data).fix
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
    decoder = decoder_of("nmea")
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
    decoder = decoder_of("nmea")
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


def test_no_fix_is_said():
    empty = sentence("GNRMC,120000.00,V,,,,,,,230324,,,N") + sentence("GNGGA,120000.00,,,,,0,00,99.9,,,,,,")
    (row,) = decoded(decoder_of("nmea"), empty.encode()).fix
    assert row["fix_type"] == 1
    assert np.isnan(row["latitude"])


def test_a_height_above_the_sea_is_marked():
    (row,) = decoded(
        decoder_of("nmea"), sentence("GPGGA,120000,4807.038,N,01131.000,E,1,08,0.9,545.4,M,,M,,").encode()
    ).fix
    assert (row["height"], row["sea_level"]) == (545.4, 1)


def test_damaged_sentences_are_dropped():
    whole = epoch(0, "RMC", "GGA")
    decoder = decoder_of("nmea")
    stream = (
        whole.replace(b"4807", b"4817") + b"$GPGGA,1200" + b"$$" + epoch(1, "GGA") + b"$GPGGA" + b"\xb5" * 90
    )
    assert len(decoded(decoder, stream).fix) == 1
    assert (decoder.statistics.frames, decoder.statistics.failed) == (1, 2)


def test_what_is_encoded_is_read_again():
    fix = fixes(5)
    fix["fix_type"] = (3, 4, 5, 6, 3)
    found = decoded(decoder_of("nmea"), NmeaEncoder().encode(fix[:0], fix)).fix
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
