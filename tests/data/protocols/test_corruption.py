"""Corruption: every undamaged frame is kept, and no damaged one taken where the check has 16 bits."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from live_streams import capture, damaged, decoded, fixes, motion
from writers.vectornav_lines import lines

from lab.data.protocols.catalogue import ENCODERS, make_decoder
from lab.data.protocols.samples import Samples
from lab.data.protocols.sbf import SbfEncoder
from lab.data.protocols.stream_decoder import StreamDecoder
from lab.data.protocols.text_lines import TextEncoder, TextLines
from lab.data.protocols.ubx import Ubx
from lab.data.protocols.vectornav import VectorNavAscii, VectorNavBinary

COUNT = 20_000


def encoded(name: str) -> bytes:
    """Return a stream of a device that sends samples and fixes."""
    return ENCODERS[name]().encode(motion(COUNT), fixes(COUNT // 100))


STREAMS: dict[
    str, tuple[str, bool, Callable[[], bytes]]
] = {  # protocol, whether its check has 16 bits, stream
    "vectornav": ("vectornav", True, lambda: encoded("vectornav")),
    "vectornav lines": (
        "vectornav",
        False,
        lambda: lines("VNIMU", motion(COUNT), fixes(0)),
    ),
    "VN-100": ("vectornav", True, lambda: 40 * capture("vn100_bin_waves_F00294.bin")[64:]),
    "xsens": ("xsens", False, lambda: encoded("xsens")),
    "MTi": ("xsens", False, lambda: 50 * capture("xsens_mti_einride_1.bin")),
    "mip": ("mip", True, lambda: encoded("mip")),
    "3DM": ("mip", True, lambda: capture("mip_sdk_mip_data.bin")),
    "memsense": ("memsense", False, lambda: encoded("memsense")),
    "ublox": ("ublox", True, lambda: encoded("ublox")),
    "NEO-M8U": ("ublox", True, lambda: 40 * capture("ubx_gpsd_neo-m8u.log")),
    "mavlink": ("mavlink", True, lambda: encoded("mavlink")),
    "septentrio": ("septentrio", True, lambda: SbfEncoder().encode(motion(0), fixes(COUNT // 10))),
    "witmotion": ("witmotion", False, lambda: encoded("witmotion")),
    "phone": ("phone", True, lambda: encoded("phone")),
    "text": ("text", False, lambda: TextEncoder().encode(motion(COUNT), fixes(0))),
}


def decoder_for(protocol: str) -> StreamDecoder | TextLines:
    """Return a decoder of the protocol alone: NMEA makes a fix of several sentences with 8 bits each."""
    alone = {"vectornav": (VectorNavBinary(), VectorNavAscii()), "ublox": (Ubx("raw"),)}
    return StreamDecoder(protocol, alone[protocol]) if protocol in alone else make_decoder(protocol)


def by_end(found: Samples) -> dict[tuple[str, int], list[bytes]]:
    """Return the rows of a stream by their frame, without the times of clocks that are continued."""
    rows: dict[tuple[str, int], list[bytes]] = {}
    for name, found_rows in found._asdict().items():
        array = found_rows.copy()
        array["time"] = 0
        if name == "imu":
            array["count"] = 0
        for row, end in zip(array, array["end"].tolist(), strict=True):
            rows.setdefault((name, end), []).append(row.tobytes())
    return rows


@pytest.mark.proof
@pytest.mark.parametrize("part", [1e-4, 1e-3])
@pytest.mark.parametrize("stream", STREAMS)
def test_undamaged_frames_are_kept_and_damaged_ones_are_not(stream, part):
    protocol, strong, make = STREAMS[stream]
    data = make()
    frames = by_end(decoded(decoder_for(protocol), data))
    ends = np.array(sorted({end for _, end in frames}))
    broken, places = damaged(data, part, np.random.default_rng(7))
    decoder = decoder_for(protocol)
    found = by_end(decoded(decoder, broken))
    # A damaged byte belongs to the frame that ends next.
    hit = set(ends[np.minimum(np.searchsorted(ends, places, side="right"), len(ends) - 1)].tolist())
    whole = {key: rows for key, rows in frames.items() if key[1] not in hit}
    lost = [key for key in whole if key not in found]
    changed = [key for key, rows in found.items() if key not in frames or rows != frames[key]]
    assert len(whole) < len(frames)
    assert lost == []
    if strong:
        assert changed == []
    else:
        # One of 256 damaged frames fits a check of 8 bits, and lines without one hold any digit.
        assert len(changed) <= (1.0 if protocol == "text" else 0.02) * len(hit) + 1
    assert decoder.statistics.failed + decoder.statistics.unknown > 0


@pytest.mark.parametrize(
    ("protocol", "sync"),
    [
        ("vectornav", b"\xfa"),
        ("xsens", b"\xfa"),
        ("mip", b"\x75"),
        ("mip", b"\x75\x65"),
        ("memsense", b"\xff"),
        ("ublox", b"\xb5"),
        ("ublox", b"\xb5\x62"),
        ("mavlink", b"\xfd"),
        ("nmea", b"$"),
    ],
)
def test_sync_bytes_that_stand_twice_are_survived(protocol, sync):
    imu, fix = motion(50), fixes(3)
    encoder = ENCODERS[protocol]()
    frames = [encoder.encode(imu[at : at + 1], fix[:0]) for at in range(50)]
    frames += [encoder.encode(imu[:0], fix[at : at + 1]) for at in range(3)]
    plain = decoded(make_decoder(protocol), b"".join(frames))
    doubled = decoded(make_decoder(protocol), b"".join(sync + frame for frame in frames))
    assert (len(doubled.imu), len(doubled.fix)) == (len(plain.imu), len(plain.fix))
    assert len(plain.imu) + len(plain.fix) >= 3


LONG_HEADS = {
    "vectornav": "fa20ff0f",
    "xsens": "faff36fe",
    "mip": "756580ff",
    "ublox": "b5620107000f",
    "mavlink": "fdff0000000101690000",
    "memsense": "ffffffff26ff14",
}
"""Heads of frames that are longer than what follows here."""


@pytest.mark.parametrize("protocol", LONG_HEADS)
def test_frames_hidden_by_a_long_one_that_never_ends_come_at_the_end(protocol):
    data = bytes.fromhex(LONG_HEADS[protocol]) + ENCODERS[protocol]().encode(motion(1), fixes(0))
    decoder = make_decoder(protocol)
    assert len(decoder.feed(data[:-1]).imu) == 0
    decoder = make_decoder(protocol)
    assert len(decoder.feed(data).imu) + len(decoder.finish().imu) == 1


@pytest.mark.parametrize("protocol", ["vectornav", "mip", "ublox", "mavlink"])
def test_bytes_that_change_places_are_noticed(protocol):
    frame = ENCODERS[protocol]().encode(motion(1), fixes(0))
    for at in range(20, len(frame) - 3):
        swapped = frame[:at] + frame[at + 1 : at + 2] + frame[at : at + 1] + frame[at + 2 :]
        assert len(decoded(make_decoder(protocol), swapped).imu) == (swapped == frame)
