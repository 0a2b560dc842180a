"""Sent solution: what a navigator knows at a moment, in units of other programs, and as a line of JSON."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.plain_data import to_plain_data


@dataclass(frozen=True)
class SentSolution:
    """A solution; NaN stands for what is not known.

    Attributes
    ----------
    time : float
        Host's monotonic clock at the sample [s]; of a replay, that of its recording.
    utc : float
        UTC since 1970 by the receiver's fixes [s].
    unix : float
        UTC since 1970 by the clock of the computer [s]; of a replay, when it was sent.
    phase : str
        One of `lab.live.live_state.PHASES`.
    coasts : bool
        Whether the position has had no fix for some seconds.
    latitude, longitude : float
        WGS 84 [°]; longitude from -180 up to, not including, 180.
    height : float
        [m], above what `is_above_sea` says.
    is_above_sea : bool or None
        Whether heights are above sea level, and not above the ellipsoid; None where that is not known.
    geoid : float
        Height of the geoid above the ellipsoid [m].
    position_covariance : (3, 3) array
        North, east, down [m²].
    velocity_n, velocity_sigma : (3,) arrays
        North, east, down [m/s].
    euler, euler_sigma : (3,) arrays
        Roll, pitch, true heading [°]. The heading is from 0 to 360.
    has_heading : bool
        Whether something shows the heading; else it is relative to an unknown direction.
    attitude_covariance : (3, 3) array
        Of a small rotation about north, east, down [rad²].
    rate : (3,) array
        Angular rate forward, right, down [°/s].
    fixes_used, fixes_rejected : int
        Fixes so far.
    """

    time: float
    utc: float
    unix: float
    phase: str
    coasts: bool
    latitude: float
    longitude: float
    height: float
    is_above_sea: bool | None
    geoid: float
    position_covariance: FloatArray
    velocity_n: FloatArray
    velocity_sigma: FloatArray
    euler: FloatArray
    euler_sigma: FloatArray
    has_heading: bool
    attitude_covariance: FloatArray
    rate: FloatArray
    fixes_used: int = 0
    fixes_rejected: int = 0

    @property
    def has_position(self) -> bool:
        """Whether there is a position."""
        return math.isfinite(self.latitude + self.longitude + self.height)

    @property
    def has_attitude(self) -> bool:
        """Whether there is an attitude."""
        return bool(np.isfinite(self.euler).all())

    @property
    def sea_height(self) -> float:
        """Height above sea level [m]; NaN where it is not known."""
        if self.is_above_sea is None:
            return math.nan
        return self.height if self.is_above_sea else self.height - self.geoid

    @property
    def ellipsoid_height(self) -> float:
        """Height above the ellipsoid [m]; NaN where it is not known."""
        if self.is_above_sea is None:
            return math.nan
        return self.height + self.geoid if self.is_above_sea else self.height

    @property
    def position_sigma(self) -> FloatArray:
        """σ north, east, down [m]."""
        return np.sqrt(np.maximum(np.diagonal(self.position_covariance), 0.0))

    @property
    def speed(self) -> float:
        """Horizontal speed [m/s]."""
        return math.hypot(self.velocity_n[0], self.velocity_n[1])

    @property
    def course(self) -> float:
        """Course over ground, 0 to 360 [°]; NaN while the speed is no larger than its σ."""
        spread = math.hypot(self.velocity_sigma[0], self.velocity_sigma[1])
        if not self.speed > (spread if math.isfinite(spread) else 0.0):
            return math.nan
        return math.degrees(math.atan2(self.velocity_n[1], self.velocity_n[0])) % 360


def row_of(solution: SentSolution) -> dict[str, Any]:
    """Return a solution with units in the names, as JSON can hold it; None for what is not known.

    Times have microseconds, latitude and longitude 0.01 mm, and other numbers seven digits: a line fits into
    a datagram.
    """
    row: dict[str, Any] = {
        "time_s": round(solution.time, 6),
        "unix_time_s": round(solution.unix, 6),
        "utc_s": round(solution.utc, 6),
        "phase": solution.phase,
        "latitude_deg": round(solution.latitude, 10),
        "longitude_deg": round(solution.longitude, 10),
        "height_ellipsoid_m": _round_value(solution.ellipsoid_height),
        "height_sea_m": _round_value(solution.sea_height),
    }
    row |= _name_axes(solution.position_sigma, "{}_sigma_m", _NED)
    row |= _name_axes(solution.velocity_n, "velocity_{}_m_s", _NED)
    row |= _name_axes(solution.velocity_sigma, "velocity_{}_sigma_m_s", _NED)
    row |= _name_axes(solution.euler, "{}_deg", _EULER)
    row |= _name_axes(solution.euler_sigma, "{}_sigma_deg", _EULER)
    row["heading_is_known"] = solution.has_heading
    row |= _name_axes(solution.rate, "rate_{}_deg_s", _BODY)
    row["position_covariance_ned_m2"] = _round_value(solution.position_covariance.tolist())
    row["attitude_covariance_ned_rad2"] = _round_value(solution.attitude_covariance.tolist())
    row |= {"fixes_used": solution.fixes_used, "fixes_rejected": solution.fixes_rejected}
    found: dict[str, Any] = to_plain_data(row)
    return found


def json_line(solution: SentSolution) -> bytes:
    """Return a solution as a line of JSON, with its end."""
    return json.dumps(row_of(solution), allow_nan=False, separators=(",", ":")).encode() + b"\n"


_NED: Final = ("north", "east", "down")
_EULER: Final = ("roll", "pitch", "heading")
_BODY: Final = ("forward", "right", "down")


def _name_axes(values: FloatArray, name: str, words: tuple[str, ...]) -> dict[str, float]:
    return {
        name.format(word): _round_value(value) for word, value in zip(words, values.tolist(), strict=True)
    }


def _round_value(value: Any) -> Any:
    """Return a number, or each of nested lists, with seven digits."""
    return [_round_value(one) for one in value] if isinstance(value, list) else float(f"{value:.7g}")
