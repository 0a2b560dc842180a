"""VectorNav layout: where each field stands in a binary message, of the groups and fields its header names.

References
----------
VectorNav, *VN-100 User Manual* UM001 and *VN-200 User Manual* UM004, "User configurable binary output".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from lab.data.protocols.framing import MORE, NONE

COMMON, TIME, IMU_GROUP, GPS, ATTITUDE, INS, GPS2 = range(7)
"""Groups, by their bit in the second byte of a message."""

Field = tuple[int, int]
"""Group, and bit in the group's word."""

_VARIABLE = -1  # size of a field that states its own
_SIZES: tuple[tuple[int, ...], ...] = (
    (8, 8, 8, 12, 16, 12, 24, 12, 12, 24, 20, 28, 2, 4, 8),
    (8, 8, 8, 2, 8, 8, 8, 4, 4, 1),
    (2, 12, 12, 12, 4, 4, 16, 12, 12, 12, 12, 2, 40),
    (8, 8, 2, 1, 1, 24, 24, 12, 12, 12, 4, 4, 2, 28, _VARIABLE),
    (2, 12, 16, 36, 12, 12, 12, 12, 12, 12, 28, 24),
    (2, 24, 24, 12, 12, 12, 12, 12, 12, 4, 4, 68, 64),
    (8, 8, 2, 1, 1, 24, 24, 12, 12, 12, 4, 4, 2, 28, _VARIABLE),
)
"""Bytes of each field, by group and bit. Bits beyond these, and an eighth group, are in no public manual."""
_SATELLITE = 8
"""Bytes of SatInfo for each satellite, after two of which the first is their number."""
_MAX_SATELLITES = 64
"""Most satellites in SatInfo: receivers of VectorNav track 72 channels, of which a message has fewer."""
_HEADER = 2  # bytes: start and groups
_CHECK = 2  # bytes of the CRC
_KEPT = 64
"""Layouts that are kept: a device sends up to three; bytes at random ask for any number."""
LONGEST = 2048
"""Longest message [bytes]: all fields of all groups with the most satellites have 1903."""


@dataclass(frozen=True, eq=False)
class Layout:
    """One kind of message.

    Attributes
    ----------
    size : int
        Bytes of the whole message.
    at : dict
        Place of each field in it.
    """

    size: int
    at: Mapping[Field, int]


class Layouts:
    """Finds the layout of a message; those without a field of variable length are kept."""

    def __init__(self) -> None:
        self._kept: dict[bytes, Layout] = {}

    def of(self, data: bytes | bytearray, begin: int) -> Layout | int:
        """Return the layout of the message that begins at a place, `MORE` or `NONE`."""
        if len(data) - begin < _HEADER:
            return MORE
        groups = data[begin + 1]
        if not groups or groups >> len(_SIZES):
            return NONE
        first = _HEADER + 2 * groups.bit_count()
        if len(data) - begin < first:
            return MORE
        header = bytes(data[begin + 1 : begin + first])
        kept = self._kept.get(header)
        if kept is not None:
            return kept
        return self._walked(data, begin, header, first)

    def _walked(self, data: bytes | bytearray, begin: int, header: bytes, first: int) -> Layout | int:
        at: dict[Field, int] = {}
        place, word, fixed = first, 1, True
        for group, sizes in enumerate(_SIZES):
            if not header[0] >> group & 1:
                continue
            fields = header[word] | header[word + 1] << 8
            word += 2
            if fields >> len(sizes):
                return NONE
            for bit, size in enumerate(sizes):
                if not fields >> bit & 1:
                    continue
                at[group, bit] = place
                if size != _VARIABLE:
                    place += size
                    continue
                fixed = False
                if begin + place >= len(data):
                    return MORE
                if data[begin + place] > _MAX_SATELLITES:
                    return NONE
                place += 2 + _SATELLITE * data[begin + place]
        layout = Layout(place + _CHECK, at)
        if not at or layout.size > LONGEST:
            return NONE
        if fixed:
            if len(self._kept) == _KEPT:
                del self._kept[next(iter(self._kept))]
            self._kept[header] = layout
        return layout
