"""NMEA encoder: fixes as a receiver sends them, in RMC, GGA and GST; a solution also in VTG and HDT.

References
----------
NMEA 0183 4.11: at most 82 characters with ``$`` and the end of the line; talker IN for integrated navigation;
heights in GGA are above sea level, and the geoid above the ellipsoid stands beside them.
"""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta

import numpy as np
from numpy.typing import NDArray

from lab.base.parameters.units import KNOT
from lab.data.protocols.framing import xor8
from lab.data.protocols.samples import FIX_DIFFERENTIAL, FIX_RTK, FIX_RTK_FLOAT, NO_FIX
from lab.data.protocols.sending import FrameEncoder, sent_fix
from lab.data.protocols.sent_solution import SentSolution

_QUALITIES = {FIX_DIFFERENTIAL: 2, FIX_RTK: 4, FIX_RTK_FLOAT: 5}  # quality of GGA; 1 is any other fix
TALKER = "IN"
"""Talker of a solution: integrated navigation."""
LARGEST_SPEED = 9999.999
"""Largest speed that has room [kn, km/h]."""
LARGEST_HEIGHT = 99999.99
"""Largest height that has room [m]."""
_DECIMALS = 5  # of minutes of a solution: 2 cm, and GGA has no room for more
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)  # zero of the time of a fix


class HeadingEncoder(FrameEncoder):
    """A `FrameEncoder` that sends headings as receivers with two antennas and compasses do, and no speeds."""

    def encode_readings(self, reading: NDArray[np.void]) -> bytes:
        """Return headings as sentences HDT.

        Parameters
        ----------
        reading : (k,) array of `lab.data.protocols.samples.READING`
            Readings; those without a heading are left out.
        """
        shown = reading["heading"][np.isfinite(reading["heading"])]
        return b"".join(_checked(f"GNHDT,{_bearing(math.degrees(one), 4)},T") for one in shown.tolist())


class NmeaEncoder(HeadingEncoder):
    """Writes fixes; the protocol has no samples, and no vertical velocity.

    Positions are sent to 1e-7 minutes; the height in GGA is above the ellipsoid.
    """

    name = "nmea"

    def _fix(self, row: np.void) -> bytes:
        fix = sent_fix(row)
        seconds = fix.utc if math.isfinite(fix.utc) else fix.week_time
        now = _EPOCH + timedelta(milliseconds=round(1e3 * seconds))
        clock = f"{now:%H%M%S}.{now.microsecond // 1000:03d}"
        if fix.kind <= NO_FIX:
            return _checked(f"GNRMC,{clock},V,,,,,,,{now:%d%m%y},,,N") + _checked(
                f"GNGGA,{clock},,,,,0,00,,,M,,M,,"
            )
        place = f"{_angle(fix.latitude, 2, 'NS')},{_angle(fix.longitude, 3, 'EW')}"
        geoid = "" if row["sea_level"] else "0.0"
        quality = _QUALITIES.get(fix.kind, 1)
        text = _checked(f"GNRMC,{clock},A,{place},{fix.speed / KNOT:.5f},{fix.course:.5f},{now:%d%m%y},,,A")
        text += _checked(
            f"GNGGA,{clock},{place},{quality},{fix.satellites:02d},1.0,{fix.height:.4f},M,{geoid},M,,"
        )
        if math.isfinite(row["horizontal_sigma"]):
            level = f"{fix.horizontal_sigma:.4f}"
            text += _checked(f"GNGST,{clock},,,,,{level},{level},{fix.vertical_sigma:.4f}")
        return text


def encode_sentences(solution: SentSolution, talker: str = TALKER) -> bytes:
    """Return a solution as GGA, RMC, VTG, GST and HDT; what is not known is an empty field.

    GST is left out without a position, HDT without a true heading.

    Parameters
    ----------
    solution
        The solution.
    talker
        The two letters before the names of the sentences.
    """
    clock = date = ""
    if math.isfinite(solution.utc):
        now = _EPOCH + timedelta(milliseconds=round(1e3 * solution.utc))
        clock, date = f"{now:%H%M%S}.{now.microsecond // 1000:03d}", f"{now:%d%m%y}"
    heading = ""
    if solution.has_attitude and solution.has_heading:
        heading = f"HDT,{_bearing(float(solution.euler[2]), 3)},T"
    if not solution.has_position:
        bodies = [f"GGA,{clock},,,,,0,00,,,M,,M,,", f"RMC,{clock},V,,,,,,,{date},,,N", "VTG,,T,,M,,N,,K,N"]
        return b"".join(_checked(talker + body) for body in (*bodies, heading) if body)
    quality, mode = (6, "E") if solution.coasts else (1, "A")
    place = (
        f"{_angle(solution.latitude, 2, 'NS', _DECIMALS)},{_angle(solution.longitude, 3, 'EW', _DECIMALS)}"
    )
    height, geoid = _field(solution.sea_height, 2, LARGEST_HEIGHT), _field(solution.geoid, 1, LARGEST_HEIGHT)
    knots = _field(solution.speed / KNOT, 3, LARGEST_SPEED)
    course = "" if math.isnan(solution.course) else _bearing(solution.course, 2)
    north, east, down = (_field(one, 3, LARGEST_HEIGHT) for one in solution.position_sigma.tolist())
    bodies = [
        f"GGA,{clock},{place},{quality},,,{height},M,{geoid},M,,",
        f"RMC,{clock},A,{place},{knots},{course},{date},,,{mode}",
        f"VTG,{course},T,,M,{knots},N,{_field(3.6 * solution.speed, 3, LARGEST_SPEED)},K,{mode}",
        f"GST,{clock},,,,,{north},{east},{down}",
        heading,
    ]
    return b"".join(_checked(talker + body) for body in bodies if body)


def _field(value: float, decimals: int, largest: float) -> str:
    """Return a number; an empty field where it is not known or has no room."""
    return f"{value:.{decimals}f}" if abs(value) <= largest else ""


def _bearing(degrees: float, decimals: int) -> str:
    """Return an angle from 0 up to, not including, 360°, also after rounding."""
    return f"{round(degrees % 360, decimals) % 360:.{decimals}f}"


def _angle(degrees: float, width: int, sides: str, decimals: int = 7) -> str:
    """Return degrees and minutes, and the letter of the side."""
    one = 10**decimals
    # In whole units of the last digit, so that 59.99999' is not rounded to 60'.
    minutes = round(abs(degrees) * 60 * one)
    rest = f"{minutes % (60 * one) / one:0{decimals + 3}.{decimals}f}"
    return f"{minutes // (60 * one):0{width}d}{rest},{sides[int(degrees < 0)]}"


def _checked(body: str) -> bytes:
    return f"${body}*{xor8(body.encode()):02X}\r\n".encode()
