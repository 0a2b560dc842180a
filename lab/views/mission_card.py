"""Mission card: what a notebook shows of a mission, a log, and the import of a file."""

from __future__ import annotations

from html import escape
from itertools import groupby

import numpy as np

from lab.base.files.mission_error import MissionError
from lab.data.clock.limits import LIMITS
from lab.data.log.log_section import cut_section
from lab.data.log.sensor_log import SensorLog
from lab.data.rebuild.import_report import ImportReport
from lab.missions.catalogue import mission as find_mission
from lab.missions.log_mission import LogMission
from lab.missions.mission import Mission
from lab.motion.recordings.recording import Recording
from lab.views.thumbnail import picture

CARD_WIDTH = 400
"""Width of the picture [px]."""


def mission_html(mission: Mission) -> str:
    """Return a card of a mission as HTML; if its recording cannot be read, the reason."""
    try:
        recording = mission.recording
    except MissionError as error:
        return _card(mission, f"<p>No recording: {escape(str(error))}</p>")
    facts = {
        "Aircraft": mission.aircraft,
        "Airport": mission.airport,
        **_facts(recording),
        "Origin": mission.origin,
        "Ended early": mission.ending,
    }
    return _card(mission, _body(facts, picture(mission, CARD_WIDTH)))


def log_html(mission: LogMission) -> str:
    """Return a card of a log as HTML; if it cannot be read, the reason."""
    try:
        log = mission.log
    except MissionError as error:
        return _card(mission, f"<p>No log: {escape(str(error))}</p>")
    repairs = "".join(f"<li>{escape(repair)}</li>" for repair in cut_section(log).repairs)
    body = _body(_log_facts(log) | {"Origin": mission.origin}, picture(mission, CARD_WIDTH))
    return _card(mission, f"{body}{f'<ul>{repairs}</ul>' if repairs else ''}")


def title_of_mission(name: str) -> str:
    """Return the title of a mission; its name if it has none, or cannot be found any more."""
    try:
        return find_mission(name).title or name
    except MissionError:
        return name


def _card(mission: Mission, body: str) -> str:
    title = f"<b>{escape(mission.title or mission.name)}</b> <code>{escape(mission.name)}</code>"
    description = f"<p>{escape(mission.description)}</p>" if mission.description else ""
    return f"<div>{title}{description}{body}</div>"


def _body(facts: dict[str, str], picture: str) -> str:
    """Return a table of facts beside a picture."""
    rows = "".join(
        f'<tr><td style="text-align:left">{name}</td><td style="text-align:left">{escape(text)}</td></tr>'
        for name, text in facts.items()
        if text
    )
    return (
        '<div style="display:flex;flex-wrap:wrap;gap:16px;align-items:flex-start">'
        f'<table style="max-width:440px">{rows}</table>{picture}</div>'
    )


def _log_facts(log: SensorLog) -> dict[str, str]:
    gnss, start = log.gnss, np.degrees(log.gnss.position[0, :2])
    span = "" if log.reference is None else f"{np.ptp(log.reference.time):.1f} s, {_known_parts(log)}"
    arm = ", ".join(f"{length:g}" for length in gnss.lever_arm)
    return {
        "Duration": f"{log.duration:.2f} s",
        "IMU": f"{len(log.dtheta)} samples, {1 / np.median(np.diff(log.time)):.4g} Hz",
        "GPS": f"{len(gnss.time)} fixes, {1 / np.median(np.diff(gnss.time)):.3g} Hz",
        "Gaps of the IMU": _gaps(log),
        "Reference": span or "none",
        "Start": f"{start[0]:.5f}° latitude, {start[1]:.5f}° longitude",
        "Antenna": f"{arm} m forward, right, down of the IMU" if gnss.lever_arm.any() else "",
        "Latency": f"{gnss.latency:g} s" if gnss.latency else "",
    }


def _gaps(log: SensorLog) -> str:
    """Return how many gaps were filled, and how many are too long for that."""
    parts = []
    if len(log.gaps):
        parts.append(f"{len(log.gaps)}, {np.diff(log.gaps, axis=1).sum():.3g} s in all, filled")
    if len(log.breaks):
        parts.append(f"{len(log.breaks)} of more than {LIMITS.longest_filled:g} s")
    return "; ".join(parts) or "none"


def _known_parts(log: SensorLog) -> str:
    assert log.reference is not None
    parts = {"velocity": log.reference.velocity_n, "attitude": log.reference.euler}
    return ", ".join(("position", *(word for word, part in parts.items() if np.isfinite(part).any())))


def _facts(recording: Recording) -> dict[str, str]:
    speed = np.linalg.norm(recording.velocity_n, axis=1)
    step = np.median(np.diff(recording.time))
    path = np.sum(np.diff(recording.time) * (speed[1:] + speed[:-1]) / 2)
    roll = np.degrees(recording.euler[:, 0])
    heights = f"{recording.height.min():.0f} to {recording.height.max():.0f}"
    start = np.degrees([recording.latitude[0], recording.longitude[0]])
    return {
        "Duration": f"{recording.duration:.2f} s, {len(recording.time)} samples every {1000 * step:.3g} ms",
        "Start": f"{start[0]:.5f}° latitude, {start[1]:.5f}° longitude",
        "Height": f"{heights} m above the ellipsoid".replace("-", "\u2212"),
        "Speed": f"up to {speed.max():.1f} m/s over the Earth",
        "Path": f"{path / 1000:.2f} km",
        "Roll": f"{roll.min():.0f}° to {roll.max():.0f}°",
    }


REPORT_STYLE = """
table { border-collapse: collapse; font: 13px/1.5 Roboto, sans-serif; width: 100%; }
th { text-align: left; font-weight: 500; padding: 10px 8px 2px 0;
     border-bottom: 1px solid rgba(128,128,128,.35); }
td { padding: 2px 10px 2px 0; vertical-align: top; overflow-wrap: anywhere; }
td:first-child { opacity: .7; white-space: nowrap; width: 1%; }
"""
"""Style of the tables on a page."""
_LEFT = ' style="text-align: left; vertical-align: top"'
"""Attribute of cells in a notebook, which aligns them to the right by itself."""


def import_report_html(report: ImportReport) -> str:
    """Return a report as HTML: the verdict with its reasons, and the rows."""
    reasons = "".join(f"<li>{escape(sentence)}</li>" for sentence in report.reasons)
    verdict = f"<p>Verdict: <b>{escape(report.verdict)}</b></p><ul>{reasons}</ul>"
    return verdict + rows_html(report, _LEFT)


def rows_html(report: ImportReport, attribute: str = "") -> str:
    """Return the rows of a report as an HTML table in groups, whose cells have an attribute."""
    parts = []
    for group, rows in groupby(report.rows, key=lambda row: row.group):
        parts.append(f'<tr><th colspan="2"{attribute}>{escape(group)}</th></tr>')
        # The note about the command line's --unit is omitted.
        kept = (row for row in rows if row.name or group != "Units")
        parts += [
            f"<tr><td{attribute}>{escape(row.name)}</td><td{attribute}>{escape(row.value)}</td></tr>"
            for row in kept
        ]
    return f"<table>{''.join(parts)}</table>"


def read_log_html(log: SensorLog | None, refused: str) -> str:
    """Return how the IMU and GPS data of a file were read as a log, or why they were not; else nothing."""
    if log is None and not refused:
        return ""
    rows = [refused] if log is None else cut_section(log).repairs
    cells = "".join(
        f'<tr><td style="white-space: normal; opacity: 1">{escape(row)}</td></tr>' for row in rows
    )
    return f"<table><tr><th>As a sensor log{' it is refused' if log is None else ''}</th></tr>{cells}</table>"
