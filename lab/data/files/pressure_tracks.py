"""Pressure tracks: the second copy of a track in a file, with pressure altitudes as its heights.

Converters of IGC files write both, the pressure altitudes first, since GPX and KML have one height.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_OF_PRESSURE = re.compile(r"(?i)pres(?:s|alt)|baro")
"""In the name of a track whose heights are pressure altitudes: PRESALTTRK of GPSBabel, or barometric."""
_MAX_NAME = 40
"""Most characters of a name that are reported: the file is hostile."""


class _Extent(NamedTuple):
    points: int
    start: float


def pressure_copies(
    names: Mapping[int, str], track: NDArray[np.int64], time: NDArray[np.float64]
) -> dict[int, str]:
    """Return the tracks with pressure altitudes of which the file has a copy with other heights.

    Parameters
    ----------
    names
        Names of tracks, by number.
    track, time : (n,) arrays
        Of each point: the number of its track, and its time [s].

    Returns
    -------
    dict
        A sentence on each, by number of the track.
    """
    numbers, first, counts = np.unique(track, return_index=True, return_counts=True)
    extents = {
        int(number): _Extent(int(count), float(time[at]))
        for number, at, count in zip(numbers, first, counts, strict=True)
    }
    of_pressure = {number for number in extents if _OF_PRESSURE.search(names.get(number, ""))}
    others = {extent for number, extent in extents.items() if number not in of_pressure}
    return {
        number: f"The track {names[number][:_MAX_NAME]} is not used: its heights are pressure altitudes, and "
        "the file has the same track with others."
        for number in sorted(of_pressure)
        if extents[number] in others
    }
