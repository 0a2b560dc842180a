"""Airports: a few runways of the world to start a flight from, by the airport's ICAO code and the runway."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from types import MappingProxyType
from typing import Any

import numpy as np

from lab.base.files.mission_error import MissionError
from lab.base.parameters.toml_file import parse_toml
from lab.base.parameters.units import FOOT


@cache
def runways() -> Mapping[str, dict[str, float]]:
    """Return the runways by name, such as ``EGSS 22``: each as the ``[flight.runway]`` table of a plan.

    The height is the elevation above the sea: a flight from there is too low or too high by the height of
    the geoid there. The heading is the course of the geodesic to the other end.
    """
    from lab.flying.geodesy import geodesic  # noqa: PLC0415 - only needed by those who start there

    found = {}
    for code, airport in _airports().items():
        ends = {name: end for name, end in airport.items() if name != "name"}
        for (name, here), there in zip(ends.items(), reversed(ends.values()), strict=True):
            points = np.radians([here[:2], there[:2]])[..., None]
            course = float(geodesic(*points[0], *points[1])[1][0])
            found[f"{code} {name}"] = {
                "latitude_deg": here[0],
                "longitude_deg": here[1],
                "height_m": round(here[2] * FOOT, 1),
                "heading_deg": round(float(np.degrees(course)) % 360, 2),
            }
    return MappingProxyType(found)


def airport_names() -> dict[str, str]:
    """Return the names of the airports by their ICAO code."""
    return {code: airport["name"] for code, airport in _airports().items()}


def runway(name: str, where: str = "runway") -> dict[str, float]:
    """Return a runway by its name.

    Parameters
    ----------
    name
        ICAO code and runway, such as ``EGSS 22``.
    where
        Name in messages.

    Raises
    ------
    MissionError
        If it is not in the table, listing those that are.
    """
    wanted = " ".join(name.upper().split())
    if wanted in runways():
        return dict(runways()[wanted])
    close = difflib.get_close_matches(wanted, runways(), n=1)
    hint = f" Did you mean {close[0]}?" if close else ""
    raise MissionError(
        f"{where}: {name!r} is unknown.{hint} Accepted: {', '.join(runways())}, or a table with "
        "latitude_deg, longitude_deg, height_m and heading_deg"
    )


@cache
def _airports() -> dict[str, dict[str, Any]]:
    return parse_toml(files("lab.flying").joinpath("airports.toml").read_text("utf-8"))
