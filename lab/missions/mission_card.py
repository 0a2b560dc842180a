"""Mission card: a mission shown in Jupyter: key facts, ground track and height as inline SVG."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lab.earth import radii
from lab.ecef import near_pole, way
from lab.missions.recording import Recording

if TYPE_CHECKING:
    from lab.missions.mission import Mission

FloatArray = NDArray[np.float64]

_POINTS = 400
_STYLE = "font-size:11px;font-family:sans-serif"


def mission_html(mission: Mission, recording: Recording | str) -> str:
    """Return a card of a mission as HTML.

    Parameters
    ----------
    mission
        What to show.
    recording
        Its recording, or the reason why there is none.
    """
    title = f"<b>{escape(mission.title or mission.name)}</b> <code>{escape(mission.name)}</code>"
    description = f"<p>{escape(mission.description)}</p>" if mission.description else ""
    if isinstance(recording, str):
        return f"<div>{title}{description}<p>No recording: {escape(recording)}</p></div>"
    facts = {
        "Aircraft": mission.aircraft,
        "Airport": mission.airport,
        **_facts(recording),
        "Origin": mission.origin,
    }
    rows = "".join(
        f'<tr><td style="text-align:left">{name}</td><td style="text-align:left">{escape(text)}</td></tr>'
        for name, text in facts.items()
        if text
    )
    return (
        f'<div>{title}{description}<div style="display:flex;flex-wrap:wrap;gap:16px;align-items:flex-start">'
        f'<table style="max-width:440px">{rows}</table>{_track(recording)}{_profile(recording)}</div></div>'
    )


def _facts(recording: Recording) -> dict[str, str]:
    speed = np.linalg.norm(recording.velocity_n, axis=1)
    step = np.median(np.diff(recording.time))
    path = np.sum(np.diff(recording.time) * (speed[1:] + speed[:-1]) / 2)
    roll = np.degrees(recording.euler[:, 0])
    start = np.degrees([recording.latitude[0], recording.longitude[0]])
    return {
        "Duration": f"{recording.duration:.2f} s, {len(recording.time)} samples every {1000 * step:.3g} ms",
        "Start": f"{start[0]:.5f}° latitude, {start[1]:.5f}° longitude",
        "Height": f"{recording.height.min():.0f} to {recording.height.max():.0f} m above the ellipsoid",
        "Speed": f"up to {speed.max():.1f} m/s over the Earth",
        "Path": f"{path / 1000:.2f} km",
        "Roll": f"{roll.min():.0f}° to {roll.max():.0f}°",
    }


def _track(recording: Recording) -> str:
    meridian, transverse = radii(np.sin(recording.latitude))
    turn = np.unwrap(recording.longitude) - recording.longitude[0]
    east = turn * transverse * np.cos(recording.latitude[0])
    north = (recording.latitude - recording.latitude[0]) * meridian
    if near_pole(recording.latitude).any():
        level = np.stack((recording.latitude, recording.longitude, np.zeros_like(turn)), axis=-1)
        north, east, _ = way(np.broadcast_to(level[0], level.shape), level).T
    span = max(float(np.ptp(east)), float(np.ptp(north)), 1.0)
    x = 110 + 190 * (east - (east.max() + east.min()) / 2) / span
    y = 118 - 190 * (north - (north.max() + north.min()) / 2) / span
    caption = f"Ground track, north up, {span / 1000:.2f} km across"
    return _figure(220, caption, x, y, f'<circle cx="{x[0]:.1f}" cy="{y[0]:.1f}" r="4" fill="#2a9d55"/>')


def _profile(recording: Recording) -> str:
    low, high = float(recording.height.min()), float(recording.height.max())
    x = 15 + 290 * (recording.time - recording.time[0]) / recording.duration
    y = 213 - 190 * (recording.height - low) / max(high - low, 1.0)
    caption = f"Height, {low:.0f} to {high:.0f} m, over {recording.duration:.0f} s"
    return _figure(320, caption, x, y, "")


def _figure(width: int, caption: str, x: FloatArray, y: FloatArray, mark: str) -> str:
    picked = np.unique(np.linspace(0, len(x) - 1, _POINTS).astype(int))
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x[picked], y[picked], strict=True))
    return (
        f'<svg width="{width}" height="226" role="img" aria-label="{escape(caption)}" style="{_STYLE}">'
        f'<text x="4" y="13" fill="currentColor">{escape(caption)}</text>'
        f'<polyline points="{points}" fill="none" stroke="#1f77b4" stroke-width="1.5"/>{mark}</svg>'
    )
