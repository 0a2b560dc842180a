"""MicroStrain: captured and published packets have the values that the maker's library reads in them."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from live_streams import capture, decoded, fixes, hexadecimal, motion

from lab.data.protocols.catalogue import make_decoder
from lab.data.protocols.mip import MipEncoder
from lab.data.protocols.samples import FIX_2D, FIX_3D, FIX_DIFFERENTIAL, FIX_RTK, FIX_RTK_FLOAT, NO_FIX

G = 9.80665
EXAMPLE = hexadecimal(
    "75 65 80 4C 0A D5 00 00 00 05 5E E6 7C C0 0A D6 00 00 00 01 4E 43 4A 00 0E 04 3D 9E E8 8D 38 7F "
    "DB 00 BF 7A AF 03 0E 05 BB 0C 1E 30 BB 57 2E 68 BB AA 24 AE 0E 07 BC 8A AC 80 BC 72 C5 0E BC C4 "
    "E2 C1 0E 08 3E EE 3D 9F BD 66 DA DD C0 AF DE F5 91 96 "
)
"""LORD-MicroStrain/mip_sdk, test/data/packet_example_cpp_check.txt, with the values of its example."""
OTHERS = hexadecimal(
    "75 65 01 00 DB 05 75 65 01 1A 02 01 08 09 01 01 00 01 C2 00 08 09 01 01 00 01 C2 00 08 09 01 01 "
    "00 01 C2 00 7A 91 75 65 0C 08 08 0D 00 80 03 D5 04 05 64 46 "
)
"""Commands of the same file, all with a right checksum."""
UNFINISHED = hexadecimal(
    "75 65 01 00 00 00 75 65 01 0A 02 01 08 09 01 01 00 01 C2 00 00 00 75 65 0C 00 02 01"
)
"""Packets of the same file without one."""


def packet(descriptors: int, *fields: tuple[int, bytes]) -> bytes:
    """Return a packet with its sums, computed as the protocol's document does."""
    payload = b"".join(bytes((len(data) + 2, kind)) + data for kind, data in fields)
    whole = bytes((0x75, 0x65, descriptors, len(payload))) + payload
    first = second = 0
    for byte in whole:
        first = (first + byte) & 0xFF
        second = (second + first) & 0xFF
    return whole + bytes((first, second))


def test_the_published_packet_has_the_published_values():
    decoder = make_decoder("mip")
    (row,) = decoded(decoder, OTHERS + UNFINISHED + EXAMPLE).imu
    assert row["time"] == pytest.approx(23.067, abs=1e-12)
    np.testing.assert_allclose(row["force"] / G, (0.077592, 0.000061, -0.979233), atol=5.1e-7)
    np.testing.assert_allclose(row["rate"], (-0.002138, -0.003283, -0.005192), atol=5.1e-7)
    assert (decoder.statistics.frames, decoder.statistics.unknown) == (4, 3)
    assert decoder.statistics.skipped == len(UNFINISHED)
    assert decoder.statistics.failed >= 3


def test_all_captured_packets_are_read():
    data = capture("mip_sdk_mip_data.bin")
    decoder = make_decoder("mip")
    imu = decoded(decoder, data).imu
    seen = decoder.statistics
    assert (seen.frames, seen.skipped, seen.failed, seen.unknown) == (8384, 0, 0, 8384 - 4473)
    # Walked by hand: each field, where it says that it stands.
    at, times, forces, rates = 0, [], [], []
    while at < len(data):
        place, last = at + 4, at + 4 + data[at + 3]
        fields = {}
        while data[at + 2] == 0x80 and place < last:
            fields[data[place + 1]] = data[place + 2 : place + data[place]]
            place += data[place]
        if 0x04 in fields:
            times.append(int.from_bytes(fields[0xD5], "big"))
            forces.append(struct.unpack(">3f", fields[0x04]))
            rates.append(struct.unpack(">3f", fields[0x05]))
        at = last + 2
    assert (times[0], len(times)) == (282809000000, 4473)
    np.testing.assert_allclose(imu["time"], np.array(times) * 1e-9, rtol=1e-15)
    np.testing.assert_array_equal(imu["rate"], rates)
    np.testing.assert_allclose(imu["force"], np.array(forces) * G, rtol=1e-15)
    np.testing.assert_allclose(imu["force"][0] / G, (0.0174176, -0.0066653, -0.9856401), atol=1e-7)
    np.testing.assert_allclose(np.diff(imu["time"]), 0.008, atol=1e-12)


@pytest.mark.parametrize("by", ["delta time", "reference time"])
def test_increments_are_divided_by_their_interval(by):
    angle, velocity = struct.pack(">3f", 0.25, -0.5, 1), struct.pack(">3f", 0.5, 0.25, -0.125)
    time = (0xD6, struct.pack(">Q", 125_000_000)) if by == "delta time" else None
    packets = [
        packet(
            0x80, (0xD5, struct.pack(">Q", stamp)), (0x07, angle), (0x08, velocity), *([time] if time else [])
        )
        for stamp in (10**9, 1_125_000_000)
    ]
    imu = decoded(make_decoder("mip"), b"".join(packets)).imu
    assert len(imu) == (2 if time else 1)
    assert imu["rate"][-1].tolist() == [2, -4, 8]
    np.testing.assert_allclose(imu["force"][-1], np.array((4, 2, -1)) * G, rtol=1e-15)


def test_a_receiver_makes_fixes():
    place = struct.pack(">4d2fH", 44.5, -73.25, 150.0, 180.0, 1.5, 2.5, 0x1F)
    velocity = struct.pack(">8fH", 1.0, 2.0, -0.5, 0, 0, 0, 0.25, 0, 0x3F)
    info, time = struct.pack(">BBHH", 6, 14, 0, 7), struct.pack(">dHH", 300_000.2, 2200, 1)
    (fix,) = decoded(
        make_decoder("mip"), packet(0x81, (0x03, place), (0x05, velocity), (0x0B, info), (0x09, time))
    ).fix
    assert np.degrees([fix["latitude"], fix["longitude"]]) == pytest.approx((44.5, -73.25), abs=1e-12)
    assert (fix["height"], fix["week_time"], fix["satellites"], fix["fix_type"]) == (150, 300_000.2, 14, 6)
    assert fix["velocity_n"].tolist() == [1, 2, -0.5]
    invalid = struct.pack(">4d2fH", 44.5, -73.25, 150.0, 180.0, 1.5, 2.5, 0)
    (fix,) = decoded(make_decoder("mip"), packet(0x91, (0x03, invalid))).fix
    assert np.isnan(fix["latitude"])


def test_each_kind_of_fix_is_sent_as_the_maker_numbers_it():
    """FixType in LORD-MicroStrain/mip_sdk, src/mip/definitions/data_gnss.h."""
    numbers = {NO_FIX: 3, FIX_2D: 1, FIX_3D: 0, FIX_DIFFERENTIAL: 7, FIX_RTK_FLOAT: 5, FIX_RTK: 6}
    fix = fixes(len(numbers))
    fix["fix_type"] = list(numbers)
    data = MipEncoder().encode(motion(0), fix)
    sent, at = [], 0
    while at < len(data):
        place, last = at + 4, at + 4 + data[at + 3]
        while place < last:
            if data[place + 1] == 0x0B:
                sent.append(data[place + 2])
            place += data[place]
        at = last + 2
    assert sent == list(numbers.values())
    found = decoded(make_decoder("mip"), data).fix
    np.testing.assert_array_equal(found["fix_type"][1:], fix["fix_type"][1:])
    assert np.isnan(found["latitude"]).tolist() == [True, *[False] * (len(fix) - 1)]


def test_what_is_encoded_is_read_again():
    imu, fix = motion(300), fixes(3)
    decoder = make_decoder("mip")
    found = decoded(decoder, MipEncoder().encode(imu, fix))
    assert decoder.statistics.skipped == decoder.statistics.failed == 0
    for name in ("rate", "force"):
        np.testing.assert_allclose(found.imu[name], imu[name], rtol=2e-7, atol=1e-7)
    np.testing.assert_allclose(found.imu["magnetic"], imu["magnetic"], rtol=2e-7)
    for name in ("time", "latitude", "longitude", "height", "velocity_n", "horizontal_sigma", "week_time"):
        np.testing.assert_allclose(found.fix[name], fix[name], rtol=0, atol=1e-7)
