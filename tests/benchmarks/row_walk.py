"""Row walk: the functions that one row of a csv goes through, from the file to the flight for the navigator.

``python -m tests.benchmarks.row_walk [FILE...]`` imports a flight, or without files one with vertical
velocities. It prints each function with its calls, and then how many functions in how many rooms run at all,
and how many of them hand the row on: what they return, or yield, holds as many rows as the file, or the text
of the last one.
Properties, comprehensions and generators count as functions. A room is a folder.
"""

from __future__ import annotations

import dataclasses
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

import lab
from lab.missions import flight_import

ROOT = Path(lab.__file__).parents[1]
ROWS = 997
"""Rows of the csv: a number that hardly anything else in the laboratory has."""
DEEPEST = 4
"""How deep the row is looked for in what a function returns."""

Function = tuple[str, str]


def flight() -> str:
    """Return the csv of a flight with vertical velocities, whose heights have noise of 4 m."""
    t = 0.2 * np.arange(ROWS)
    north, east, down = 21 + np.sin(t / 9), 18 + np.cos(t / 9), -3 * np.sin(2 * np.pi * t / 25)
    noise = np.random.default_rng(0).normal(0, 4, t.size)
    height = 800 + 3 * 25 / (2 * np.pi) * (1 - np.cos(2 * np.pi * t / 25)) + noise
    latitude, longitude = 47 + np.cumsum(north) * 0.2 / 111_170, 9 + np.cumsum(east) * 0.2 / 76_050
    names = "time_s,lat_deg,lon_deg,alt_m,vel_n_m_s,vel_e_m_s,vel_d_m_s"
    rows = zip(t, latitude, longitude, height, north, east, down, strict=True)
    cells = (f"{a:.2f},{b:.8f},{c:.8f},{d:.2f},{e:.3f},{f:.3f},{g:.3f}" for a, b, c, d, e, f, g in rows)
    return "\n".join((names, *cells, ""))


def holds(value: Any, rows: int, text: str, depth: int = DEEPEST) -> bool:
    """Return whether a value holds as many rows, or the text of the last of them."""
    if isinstance(value, str | bytes):
        return (text if isinstance(value, str) else text.encode()) in value
    if isinstance(value, np.ndarray):
        return value.ndim > 0 and len(value) == rows
    if depth == 0:
        return False
    inside: Iterable[Any] = ()
    if isinstance(value, Mapping):
        inside = value.values()
    elif isinstance(value, list | tuple):
        inside = value[:100]
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        inside = (getattr(value, one.name, None) for one in dataclasses.fields(value))
    return any(holds(one, rows, text, depth - 1) for one in inside)


def walk(paths: list[Path], rows: int, text: str) -> tuple[Counter[Function], set[Function]]:
    """Return the calls of each function that runs when files are imported, and those that hand the row on."""
    calls: Counter[Function] = Counter()
    on: set[Function] = set()

    def seen(frame: FrameType, event: str, value: Any) -> None:
        file = frame.f_code.co_filename
        if event not in ("call", "return") or not file.startswith(f"{ROOT}/lab/"):
            return
        one = file[len(str(ROOT)) + 1 :], frame.f_code.co_qualname
        if event == "call":
            calls[one] += 1
        elif one not in on and holds(value, rows, text):
            on.add(one)

    flight_import.prepare_import(paths)  # once before: what is imported and compiled is no part of the walk
    sys.setprofile(seen)
    try:
        flight_import.prepare_import(paths)
    finally:
        sys.setprofile(None)
    return calls, on


def room(one: Function) -> str:
    """Return the folder of a function."""
    return str(Path(one[0]).parent)


def main(names: list[str]) -> None:
    """Print the walk."""
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(name) for name in names] or [Path(folder) / "flight.csv"]
        if not names:
            paths[0].write_text(flight())
        lines = paths[0].read_text(errors="replace").split()
        calls, on = walk(paths, len(lines) - 1, lines[-1])
    for one, count in sorted(calls.items()):
        print(f"{'row' if one in on else '   '} {count:6} {one[0]} {one[1]}")
    for what, functions in (("run", set(calls)), ("hand the row on", on)):
        files, rooms = {one[0] for one in functions}, {room(one) for one in functions}
        print(f"{len(functions)} functions of {len(files)} files in {len(rooms)} rooms {what}")


if __name__ == "__main__":
    main(sys.argv[1:])
