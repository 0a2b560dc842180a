"""Attacks on the decoders of live streams."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from further_outputs import FORMS, NOTHING, printed
from live_streams import fixes, motion
from sketch_outputs import SKETCHES, TWO_DEVICES, of_two_devices
from text_outputs import OUTPUTS

from lab.data.protocols.catalogue import DECODERS, ENCODERS, make_decoder
from lab.data.protocols.limits import Limits
from lab.data.protocols.samples import FIX, IMU, READING, Samples

DECODER_NAMES = {f"live {name}": name for name in DECODERS}
"""Name of each decoder, by that under which it is attacked."""


def seed(name: str, count: int = 200) -> bytes:
    """Return a stream of a device."""
    return ENCODERS[name]().encode(motion(count), fixes(max(count // 50, 2)))


def seeds(name: str) -> list[bytes]:
    """Return streams of a device: of text, all that people own."""
    if name != "text":
        return [seed(name)]
    texts = [make().text for make in OUTPUTS.values()] + [
        printed(form)[0] for form in (FORMS | SKETCHES).values()
    ]
    texts += [of_two_devices(form)[0] for form in TWO_DEVICES.values()]
    return [seed(name), *(text.encode()[:8000] for text in (*texts, *NOTHING.values()))]


_CHECKS: tuple[tuple[str, str, Any], ...] = (
    ("mip", "passes_fletcher16", True),
    ("ubx", "passes_fletcher16", True),
    ("xsens", "sum8", mock.ANY),
    ("memsense", "sum8", mock.ANY),
    ("nmea", "xor8", mock.ANY),
    ("vectornav", "xor8", mock.ANY),
    ("vectornav", "crc16_xmodem", mock.ANY),
    ("sbf", "crc16_xmodem", mock.ANY),
    ("novatel", "_crc", mock.ANY),
    ("witmotion", "sum8", mock.ANY),
    ("bno085", "sum8", mock.ANY),
    ("mavlink", "crc16_mcrf4xx", mock.ANY),
    ("phone_line", "has_valid_checksum", True),
)
"""File and name of each check of a frame, and what it returns when all frames pass."""


@contextmanager
def unchecked() -> Iterator[None]:
    """Let all frames pass their checks: without it, hardly any damaged content is read."""
    with ExitStack() as stack:
        for file, name, answer in _CHECKS:
            stack.enter_context(
                mock.patch(f"lab.data.protocols.{file}.{name}", mock.Mock(return_value=answer))
            )
        yield


def same(one: Samples, other: Samples) -> bool:
    """Return whether samples are the same to the last bit."""
    return all(mine.tobytes() == others.tobytes() for mine, others in zip(one, other, strict=True))


def attack_decoder(name: str, data: bytes, step: int) -> Samples:
    """Decode hostile bytes: nothing is raised, little is held, and samples are within the limits."""
    decoder = make_decoder(name)
    parts = []
    for at in range(0, len(data), step):
        parts.append(decoder.feed(data[at : at + step]))
        assert decoder.held <= decoder.longest
    parts.append(decoder.finish())
    assert decoder.held == 0
    assert 0 <= decoder.statistics.skipped <= len(data) == decoder.statistics.bytes
    limits = Limits()
    for imu, fix, reading in parts:
        assert (imu.dtype, fix.dtype, reading.dtype) == (IMU, FIX, READING)
        assert not (np.abs(imu["rate"]) > limits.rate).any()
        assert not (np.abs(imu["force"]) > limits.force).any()
        assert not (np.abs(fix["latitude"]) > math.pi / 2).any()
        assert not (np.abs(reading["heading"]) > 2 * math.pi).any()
        assert not (np.abs(reading["speed"]) > 400).any()
        assert ((imu["end"] > 0) & (imu["end"] <= len(data))).all()
    return Samples(*(np.concatenate(rows) for rows in zip(*parts, strict=True)))
