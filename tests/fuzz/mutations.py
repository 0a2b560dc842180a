"""Mutations: damage to files, such as disks, loggers and people with bad intentions do."""

from __future__ import annotations

import struct

import numpy as np

WORDS = (
    b"", b" ", b"nan", b"-inf", b"1e308", b"-1e-320", b"9" * 400, b"0x1p3", b"-0", b"\0", b"\xff\xfe", b'"',
    b"'", b"#", b"1_000", "١".encode(), b"1,5", b"\r", b"\n\n", b",,,,", b"$GPGGA,", b"*00", b"<", b"]]>",
    b"&amp;", b"&x;", b"<!DOCTYPE a [<!ENTITY x 'y'>]>", b"<trkpt>", b"</trkseg>", b"2024-13-45T99:99:99Z",
    b"9999-12-31T23:59:59+14:00", b"\xa3\x95\x80", b"\x1f\x8b", b"\x2f\x73\x13\x20\x25\x0c\xbb\x12",
    b"[65535] ", b"%n%s", b"${x}", b"../../",
)  # fmt: skip
NUMBERS = tuple(
    struct.pack(form, value)
    for form, values in (
        ("<H", (0, 1, 255, 32767, 65535)),
        ("<I", (0, 2**31 - 1, 2**32 - 1)),
        ("<Q", (0, 2**63, 2**64 - 1)),
        ("<f", (float("nan"), float("inf"), 3e38, -1e-40)),
        ("<d", (float("nan"), float("-inf"), 1e308, 5e-324)),
    )
    for value in values
)


def mutated(seed: bytes, rng: np.random.Generator) -> bytes:
    """Return a file with a few damages, mostly one to four."""
    data = bytearray(seed)
    for _ in range(int(rng.geometric(0.4))):
        DAMAGES[int(rng.integers(len(DAMAGES)))](data, rng)
    return bytes(data)


def _place(data: bytearray, rng: np.random.Generator) -> int:
    # Half of the damages go where the header is.
    end = len(data) if rng.random() < 0.5 else min(len(data), 2000)
    return int(rng.integers(end + 1))


def _flip(data: bytearray, rng: np.random.Generator) -> None:
    if data:
        data[min(_place(data, rng), len(data) - 1)] ^= 1 << int(rng.integers(8))


def _noise(data: bytearray, rng: np.random.Generator) -> None:
    at, size = _place(data, rng), int(rng.integers(1, 64))
    data[at : at + size] = rng.integers(0, 256, size, dtype=np.uint8).tobytes()


def _insert(data: bytearray, rng: np.random.Generator) -> None:
    at = _place(data, rng)
    data[at:at] = WORDS[int(rng.integers(len(WORDS)))]


def _replace(data: bytearray, rng: np.random.Generator) -> None:
    word = WORDS[int(rng.integers(len(WORDS)))]
    at = _place(data, rng)
    data[at : at + int(rng.integers(12))] = word


def _number(data: bytearray, rng: np.random.Generator) -> None:
    number = NUMBERS[int(rng.integers(len(NUMBERS)))]
    at = _place(data, rng)
    data[at : at + len(number)] = number


def _remove(data: bytearray, rng: np.random.Generator) -> None:
    at = _place(data, rng)
    del data[at : at + int(rng.choice((1, 2, 10, 300, 5000)))]


def _cut(data: bytearray, rng: np.random.Generator) -> None:
    del data[_place(data, rng) :]


def _repeat(data: bytearray, rng: np.random.Generator) -> None:
    at, size = _place(data, rng), int(rng.choice((1, 3, 20, 90, 1000)))
    if len(data) < 200_000:
        data[at:at] = bytes(data[at : at + size]) * int(rng.choice((1, 2, 50)))


def _swap(data: bytearray, rng: np.random.Generator) -> None:
    first, second, size = _place(data, rng), _place(data, rng), int(rng.integers(1, 500))
    piece = bytes(data[first : first + size])
    data[second : second + size] = piece


def _swap_lines(data: bytearray, rng: np.random.Generator) -> None:
    lines = bytes(data).split(b"\n")
    first, second = rng.integers(len(lines), size=2)
    lines[first], lines[second] = lines[second], lines[first]
    data[:] = b"\n".join(lines)


DAMAGES = (
    _flip, _flip, _noise, _insert, _insert, _replace, _replace, _number, _number, _remove, _cut, _repeat,
    _swap, _swap_lines,
)  # fmt: skip
