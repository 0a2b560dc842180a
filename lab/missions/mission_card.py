"""Mission card: a mission, or a log, shown in Jupyter: key facts, ground track and height as inline SVG."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lab.earth import radii
from lab.ecef import near_pole, way
from lab.missions.recording import Recording
from lab.missions.sensor_log import SensorLog

if TYPE_CHECKING:
    from lab.missions.log_mission import LogMission
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
    if isinstance(recording, str):
        return _card(mission, f"<p>No recording: {escape(recording)}</p>")
    facts = {
        "Aircraft": mission.aircraft,
        "Airport": mission.airport,
        **_facts(recording),
        "Origin": mission.origin,
        "Ended early": mission.ending,
    }
    position = np.stack((recording.latitude, recording.longitude, recording.height), axis=-1)
    return _card(mission, _body(facts, recording.time, position))


def log_html(mission: LogMission, log: SensorLog | str) -> str:
    """Return a card of a log as HTML.

    Parameters
    ----------
    mission
        What to show.
    log
        Its log, or the reason why there is none.
    """
    if isinstance(log, str):
        return _card(mission, f"<p>No log: {escape(log)}</p>")
    repairs = "".join(f"<li>{escape(repair)}</li>" for repair in log.repairs)
    gnss = log.gnss
    body = _body(_log_facts(log) | {"Origin": mission.origin}, gnss.time, gnss.position)
    return _card(mission, f"{body}{f'<ul>{repairs}</ul>' if repairs else ''}")


def _card(mission: Mission, body: str) -> str:
    title = f"<b>{escape(mission.title or mission.name)}</b> <code>{escape(mission.name)}</code>"
    description = f"<p>{escape(mission.description)}</p>" if mission.description else ""
    return f"<div>{title}{description}{body}</div>"


def _body(facts: dict[str, str], time: FloatArray, position: FloatArray) -> str:
    """Return a table of facts beside the ground track and the height of positions (n, 3) at times (n,)."""
    rows = "".join(
        f'<tr><td style="text-align:left">{name}</td><td style="text-align:left">{escape(text)}</td></tr>'
        for name, text in facts.items()
        if text
    )
    return (
        '<div style="display:flex;flex-wrap:wrap;gap:16px;align-items:flex-start">'
        f'<table style="max-width:440px">{rows}</table>{_track(position)}{_profile(time, position[:, 2])}'
        "</div>"
    )


def _log_facts(log: SensorLog) -> dict[str, str]:
    gnss, start = log.gnss, np.degrees(log.gnss.position[0, :2])
    gaps = f"{len(log.gaps)}, {np.diff(log.gaps, axis=1).sum():.3g} s in all" if len(log.gaps) else "none"
    span = "" if log.reference is None else f"{np.ptp(log.reference.time):.1f} s, {_known(log)}"
    arm = ", ".join(f"{length:g}" for length in gnss.lever_arm)
    return {
        "Duration": f"{log.duration:.2f} s",
        "IMU": f"{len(log.dtheta)} samples, {1 / np.median(np.diff(log.time)):.4g} Hz",
        "GPS": f"{len(gnss.time)} fixes, {1 / np.median(np.diff(gnss.time)):.3g} Hz",
        "Gaps of the IMU": gaps,
        "Reference": span or "none",
        "Start": f"{start[0]:.5f}° latitude, {start[1]:.5f}° longitude",
        "Antenna": f"{arm} m forward, right, down of the IMU" if gnss.lever_arm.any() else "",
        "Latency": f"{gnss.latency:g} s" if gnss.latency else "",
    }


def _known(log: SensorLog) -> str:
    assert log.reference is not None
    parts = {"velocity": log.reference.velocity_n, "attitude": log.reference.euler}
    return ", ".join(("position", *(word for word, part in parts.items() if np.isfinite(part).any())))


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


def _track(position: FloatArray) -> str:
    latitude, longitude = position[:, 0], np.unwrap(position[:, 1])
    meridian, transverse = radii(np.sin(latitude))
    east = (longitude - longitude[0]) * transverse * np.cos(latitude[0])
    north = (latitude - latitude[0]) * meridian
    if near_pole(latitude).any():
        level = position * (1, 1, 0)
        north, east, _ = way(np.broadcast_to(level[0], level.shape), level).T
    span = max(float(np.ptp(east)), float(np.ptp(north)), 1.0)
    x = 110 + 190 * (east - (east.max() + east.min()) / 2) / span
    y = 118 - 190 * (north - (north.max() + north.min()) / 2) / span
    caption = f"Ground track, north up, {span / 1000:.2f} km across"
    return _figure(220, caption, x, y, f'<circle cx="{x[0]:.1f}" cy="{y[0]:.1f}" r="4" fill="#2a9d55"/>')


def _profile(time: FloatArray, height: FloatArray) -> str:
    low, high, duration = float(height.min()), float(height.max()), float(time[-1] - time[0])
    x = 15 + 290 * (time - time[0]) / max(duration, 1e-9)
    y = 213 - 190 * (height - low) / max(high - low, 1.0)
    caption = f"Height, {low:.0f} to {high:.0f} m, over {duration:.0f} s"
    return _figure(320, caption, x, y, "")


def _figure(width: int, caption: str, x: FloatArray, y: FloatArray, mark: str) -> str:
    picked = np.unique(np.linspace(0, len(x) - 1, _POINTS).astype(int))
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x[picked], y[picked], strict=True))
    return (
        f'<svg width="{width}" height="226" role="img" aria-label="{escape(caption)}" style="{_STYLE}">'
        f'<text x="4" y="13" fill="currentColor">{escape(caption)}</text>'
        f'<polyline points="{points}" fill="none" stroke="#1f77b4" stroke-width="1.5"/>{mark}</svg>'
    )
