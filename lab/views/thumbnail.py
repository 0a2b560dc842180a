"""Thumbnail: ground track and height of a flight as one small picture (SVG) for light and dark pages."""

from __future__ import annotations

from html import escape

import numpy as np

from lab.base.arrays import FloatArray
from lab.missions.log_mission import LogMission
from lab.missions.mission import Mission
from lab.motion.frames.displacement import metres_per_radian
from lab.motion.frames.ecef import displacement, near_pole

WIDTH, HEIGHT = 320, 200
"""Size of the scalable drawing [px]."""

_MARGIN = 14.0
"""Space around the track [px]."""
_TRACK = 138.0
"""Height of the part with the track [px]."""
_LONGEST_BAR = 90.0
"""Longest bar of the scale [px]."""
_PROFILE_TOP, _PROFILE_BOTTOM = 162.0, 194.0
"""Vertical limits of the height profile [px]."""
_MAX_SAMPLES = 20_000
"""Largest number of samples of a recording that are used."""
_MAX_POINTS = 500
"""Largest number of points of the track: more than the width of the drawing in pixels."""
_COLUMNS = 150
"""Number of columns of the height profile, each from its smallest to its largest height."""


def picture(mission: Mission, width: int = WIDTH) -> str:
    """Return the picture of a mission's flight, or of the fixes of its log, shown at a width [px].

    Raises
    ------
    MissionError
        If the recording or the log is not acceptable.
    """
    if isinstance(mission, LogMission):
        return thumbnail(mission.log.gnss.time, mission.log.gnss.position, width)
    flight = mission.recording
    return thumbnail(flight.time, flight.position, width)


def thumbnail(time: FloatArray, position: FloatArray, width: int = WIDTH) -> str:
    """Return the picture of a flight: its track, north up and to scale, above its height over time.

    Parameters
    ----------
    time : (n,) array
        Times [s].
    position : (n, 3) array
        Geodetic latitude, longitude [rad] and height [m].
    width
        Default width of the picture [px].
    """
    stride = -(-len(time) // _MAX_SAMPLES)
    east, north = _plane(position[::stride])
    span_east, span_north = float(np.ptp(east)), float(np.ptp(north))
    scale = min(
        (WIDTH - 2 * _MARGIN) / max(span_east, 1.0), (_TRACK - 2 * _MARGIN) / max(span_north, 1.0)
    )  # px per metre, the same in both directions
    x = WIDTH / 2 + scale * (east - (east.max() + east.min()) / 2)
    y = _TRACK / 2 - scale * (north - (north.max() + north.min()) / 2)
    low, high = float(position[:, 2].min()), float(position[:, 2].max())
    ends = dict.fromkeys((f"{low:.0f}", f"{high:.0f}"))
    heights = f"{' to '.join(ends)} m".replace("-", "\u2212")
    across = _length(max(span_east, span_north))
    words = f"Ground track, north up, {across} across; height {heights}"
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" width="{width}" height="{width * HEIGHT // WIDTH}" role="img" '
        f'aria-label="{escape(words)}" style="font:11px Roboto,sans-serif">'
        f'<polyline class="track" points="{_thinned(x, y)}" fill="none" stroke="#2f86d6" stroke-width="1.8" '
        f'stroke-linejoin="round"/><circle cx="{x[0]:.1f}" cy="{y[0]:.1f}" r="3.5" fill="#2a9d55"/>'
        f"{_scale_bar(scale)}{_profile(time, position[:, 2], low, high)}"
        f'<text x="2" y="{_PROFILE_TOP - 5:.0f}" fill="currentColor" opacity=".7">Height {heights}</text>'
        "</svg>"
    )


def _plane(position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return east and north of the first position [m]; the path may cross a pole or the date line."""
    latitude, longitude = position[:, 0], np.unwrap(position[:, 1])
    if near_pole(latitude).any():
        level = position * (1, 1, 0)
        north, east, _ = displacement(np.broadcast_to(level[0], level.shape), level).T
        return east, north
    north, east = metres_per_radian(np.array([(latitude.max() + latitude.min()) / 2]), 0.0)
    return (longitude - longitude[0]) * east, (latitude - latitude[0]) * north


def _thinned(x: FloatArray, y: FloatArray) -> str:
    """Return points without invisible ones."""
    points = np.round(np.column_stack((x, y)) * 2) / 2
    points = points[np.concatenate(([True], (np.diff(points, axis=0) != 0).any(axis=1)))]
    picked = points[np.unique(np.linspace(0, len(points) - 1, _MAX_POINTS).astype(int))]
    return " ".join(f"{a:g},{b:g}" for a, b in picked)


def _scale_bar(scale: float) -> str:
    """Return a scale bar of a round length, just above the height profile."""
    longest = _LONGEST_BAR / scale
    decade = 10.0 ** np.floor(np.log10(longest))
    length = max(step * decade for step in (1, 2, 5) if step * decade <= longest * (1 + 1e-9))
    right, bar, y = WIDTH - 4.0, length * scale, _PROFILE_TOP - 8
    return (
        f'<path class="scale" d="M{right - bar:.2f} {y - 4:g}v4H{right:g}v-4" fill="none" '
        f'stroke="currentColor" opacity=".7"/><text x="{right - bar - 5:.1f}" y="{y + 3:g}" '
        f'text-anchor="end" fill="currentColor" opacity=".7">{_length(length)}</text>'
    )


def _profile(time: FloatArray, height: FloatArray, low: float, high: float) -> str:
    """Return the height over time as a filled curve."""
    duration = max(float(time[-1] - time[0]), 1e-9)
    column = np.minimum(((time - time[0]) / duration * _COLUMNS).astype(int), _COLUMNS - 1)
    starts = np.flatnonzero(np.concatenate(([True], np.diff(column) != 0)))
    edges = np.column_stack((np.maximum.reduceat(height, starts), np.minimum.reduceat(height, starts)))
    x = 2 + (WIDTH - 4) * (column[starts] + 0.5) / _COLUMNS
    y = _PROFILE_BOTTOM - (_PROFILE_BOTTOM - _PROFILE_TOP) * (edges - low) / max(high - low, 1.0)
    line = " ".join(f"{a:.1f},{b:.1f}" for a, pair in zip(x, y, strict=True) for b in dict.fromkeys(pair))
    base = HEIGHT - 2
    return (
        f'<polygon points="{x[0]:.1f},{base} {line} {x[-1]:.1f},{base}" fill="#2f86d6" opacity=".18"/>'
        f'<polyline class="height" points="{line}" fill="none" stroke="#2f86d6" stroke-width="1.2"/>'
    )


def _length(metres: float) -> str:
    return f"{metres / 1000:.3g} km" if metres >= 1000 else f"{metres:.3g} m"
