"""Streams for the tests of live decoders: captures, motion at rest, and what damages them."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
import pytest

from lab.data.protocols.decoder import Decoder
from lab.data.protocols.samples import FIX, IMU, Samples, join_samples

RATE = 100.0


def capture(name: str) -> bytes:
    """Return a captured stream, or skip the test: captures are not shipped."""
    named = os.environ.get("INS_LAB_CAPTURES")
    folder = Path(named) if named else Path(__file__).parents[2] / "shared" / "captures"
    path = folder / name
    if not path.is_file():
        pytest.skip(f"no {name} in {folder}: INS_LAB_CAPTURES names the folder of captures")
    return path.read_bytes()


def decoded(decoder: Decoder, data: bytes, step: int | None = None) -> Samples:
    """Return all samples of a stream that is fed in pieces."""
    step = step or max(len(data), 1)
    parts = [decoder.feed(data[at : at + step]) for at in range(0, len(data), step)]
    return join_samples([*parts, decoder.finish()])


def motion(count: int, seed: int = 1) -> np.ndarray:
    """Return samples of an IMU that is carried, all fields known."""
    rng = np.random.default_rng(seed)
    imu = np.zeros(count, IMU)
    imu["time"] = 7.0 + np.arange(count) / RATE
    imu["count"] = -1
    imu["rate"] = 0.5 * np.sin(imu["time"][:, None] + [0, 1, 2]) + 0.01 * rng.standard_normal((count, 3))
    imu["force"] = [0.3, -0.2, -9.8] + 0.5 * rng.standard_normal((count, 3))
    imu["magnetic"] = [2e-5, 1e-6, 4.4e-5] + 1e-7 * rng.standard_normal((count, 3))
    imu["temperature"], imu["pressure"] = 24.5, 101_325.0
    return imu


def fixes(count: int) -> np.ndarray:
    """Return a fix a second of a receiver that moves north-east, all fields known."""
    fix = np.zeros(count, FIX)
    fix["time"] = 7.2 + np.arange(count)
    fix["week_time"] = 300_000.2 + np.arange(count)
    fix["utc"] = 1_700_000_000.2 + np.arange(count)
    fix["latitude"] = math.radians(-45.9) + 1e-6 * np.arange(count)
    fix["longitude"] = math.radians(170.5) + 2e-6 * np.arange(count)
    fix["height"] = 29.25
    fix["velocity_n"] = [6.25, 8.5, -0.5]
    fix["horizontal_sigma"], fix["vertical_sigma"], fix["speed_sigma"] = 1.5, 2.5, 0.25
    fix["satellites"], fix["fix_type"] = 12, 3
    return fix


def damaged(data: bytes, part: float, rng: np.random.Generator) -> tuple[bytes, np.ndarray]:
    """Return a stream of which this part of the bytes has another value, and where."""
    places = np.flatnonzero(rng.random(len(data)) < part)
    stream = np.frombuffer(data, np.uint8).copy()
    stream[places] ^= rng.integers(1, 256, len(places), dtype=np.uint8)
    return stream.tobytes(), places


def hexadecimal(text: str) -> bytes:
    """Return bytes written in hexadecimal digits."""
    return bytes.fromhex("".join(text.split()))
