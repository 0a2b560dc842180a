"""Time zones: what abbreviations and offsets of zones in time stamps stand for.

The abbreviations are those of RFC 5322, section 4.3, and of the IANA time zone database where they stand for
one offset only. BST, IST, AST and the like stand for several, so a stamp with one of them is not understood.
"""

from __future__ import annotations

import math
import re

_HOUR, _MINUTE = 3600.0, 60.0
"""[s]."""
_HOURS = {
    "Z": 0, "UTC": 0, "UT": 0, "GMT": 0, "WET": 0, "WEST": 1, "CET": 1, "CEST": 2, "MEZ": 1, "MESZ": 2,
    "EET": 2, "EEST": 3, "MSK": 3, "EST": -5, "EDT": -4, "CST": -6, "CDT": -5, "MST": -7, "MDT": -6,
    "PST": -8, "PDT": -7, "AKST": -9, "AKDT": -8, "HST": -10, "JST": 9, "KST": 9, "AEST": 10, "AEDT": 11,
    "ACST": 9.5, "ACDT": 10.5, "AWST": 8, "NZST": 12, "NZDT": 13, "SGT": 8, "HKT": 8, "SAST": 2,
}  # fmt: skip
"""Hours east of Greenwich."""
PATTERN = r"(?:Z|(?:UTC|GMT)?[+-]\d{2}:?(?:\d{2})?|[A-Z]{2,5})"
"""A zone in a stamp, as a regular expression without groups."""
_OFFSET = re.compile(r"(?:UTC|GMT)?([+-])(\d{2}):?(\d{2})?")


def offset_of(zone: str | None) -> float:
    """Return by how much a zone is ahead of UTC [s]: 0 for none, NaN for one that is not known."""
    if not zone:
        return 0.0
    if found := _OFFSET.fullmatch(zone):
        size = int(found[2]) * _HOUR + int(found[3] or 0) * _MINUTE
        return -size if found[1] == "-" else size
    return _HOURS[zone] * _HOUR if zone in _HOURS else math.nan
