"""Tracks: the true path, the estimated path and the GPS fixes of a flight, in the form of map files."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any
from xml.sax.saxutils import escape

import numpy as np

from lab.base.arrays import FloatArray
from lab.experiment.result import Result
from lab.missions import LogMission, Mission, Recording
from lab.motion.frames import ecef
from lab.motion.frames.rotation import wrap
from lab.run.provenance import facts_block, facts_of_mission
from lab.views.envelope import thin_path

HEIGHTS = (
    "Heights are above the WGS-84 ellipsoid, in metres. Maps expect heights above sea level, which are "
    "less by the height of the geoid (from -106 m to +85 m): the track appears too high by this amount if "
    "it is positive, and too low if it is negative."
)
"""Remark about heights: the lab has no geoid model."""

FIXES = "GPS fixes"

_NO_XML = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@dataclass(frozen=True, eq=False)
class Track:
    """A line in time.

    Attributes
    ----------
    name : str
        Title of the track.
    time : (n,) array
        Time from the start of the flight [s].
    position : (n, 3) array
        Latitude, longitude within ±180° [°], height [m]; finite.
    """

    name: str
    time: FloatArray
    position: FloatArray

    @classmethod
    def of(cls, name: str, time: FloatArray, position: FloatArray) -> Track:
        """Return a track of latitude, longitude [rad] and height [m], without what is not known."""
        known = np.isfinite(position).all(axis=1)
        latitude, longitude, height = position[known].T
        degrees = np.column_stack((np.degrees(latitude), np.degrees(wrap(longitude)), height))
        return cls(name, time[known], degrees)

    def thinned(self, count: int) -> Track:
        """Return at most so many points, chosen so that the line keeps its length and its turns."""
        metres = ecef.position(np.column_stack((np.radians(self.position[:, :2]), self.position[:, 2])))
        kept = thin_path(metres, count)
        return Track(self.name, self.time[kept], self.position[kept])

    def every(self, step: float) -> Track:
        """Return the points that are at least a time apart [s], the first and the last among them."""
        number = np.floor((self.time - self.time[:1]) / step + 1e-6)
        kept = np.append(True, np.diff(number) > 0)[: len(self.time)]
        kept[-1:] = True
        return Track(self.name, self.time[kept], self.position[kept])


@dataclass(frozen=True, eq=False)
class Tracks:
    """The paths of a flight: the truth, the fixes and the solution, as far as they exist.

    Attributes
    ----------
    title, description : str
        For people.
    true, estimated, fixes : Track or None
        The true path, or the reference of a log; the navigator's; the GPS fixes.
    facts : mapping
        What made them; see `lab.run.provenance`.
    """

    title: str
    description: str
    true: Track | None
    estimated: Track | None
    fixes: Track | None
    facts: Mapping[str, Any] = field(default_factory=dict)

    @property
    def origin(self) -> str:
        """What made the tracks, as text of XML."""
        return xml(f"\n{facts_block(self.facts)}") if self.facts else ""

    @property
    def known(self) -> tuple[Track, ...]:
        """Those there are."""
        return tuple(one for one in (self.true, self.estimated, self.fixes) if one is not None)


def make_tracks(source: Result | Mission) -> Tracks:
    """Return where a flight was.

    Parameters
    ----------
    source
        A run, or a mission.

    Raises
    ------
    MissionError
        If a mission cannot be read.
    """
    if isinstance(source, Result):
        return replace(_of_result(source), facts=source.facts)
    facts = facts_of_mission(source)
    if isinstance(source, LogMission):
        return replace(_of_log(source), facts=facts)
    recording = source.recording
    track = _make_track("Flight", recording.time - recording.time[0], recording.position)
    return Tracks(
        source.title or source.name, f"{source.description}\n{HEIGHTS}".strip(), track, None, None, facts
    )


def make_recording(source: Result | Mission) -> Recording:
    """Return a flight as a flight csv holds it: the estimated one of a run, the recorded one of a mission.

    Raises
    ------
    MissionError
        If a mission cannot be read, or is a log.
    """
    if not isinstance(source, Result):
        return source.recording
    solution = source.solution_arrays
    latitude, longitude, height = solution.position.T
    return Recording(source.time, latitude, wrap(longitude), height, solution.velocity_n, source.euler)


def xml(text: str) -> str:
    """Return text as it stands in XML; characters XML does not have become �."""
    return escape(_NO_XML.sub("\ufffd", text), {'"': "&quot;"})


def _of_result(result: Result) -> Tracks:
    truth, mission = result.truth_arrays, result.mission
    seed = f" with {result.realisation}" if result.realisation else ""
    return Tracks(
        mission.title or mission.name,
        f"INS Lab: {mission.name}{seed}, navigated by {_navigator(result)}.\n{HEIGHTS}",
        None if truth is None else _make_track(result.truth_word.capitalize(), truth.time, truth.position),
        _make_track("Estimate", result.time, result.solution_arrays.position),
        _make_track(FIXES, result.fixes.time, result.fixes.position),
    )


def _make_track(name: str, time: FloatArray, position: FloatArray) -> Track | None:
    """Return a track; None without two points that are known."""
    track = Track.of(name, time, position)
    return track if len(track.time) >= 2 else None


def _navigator(result: Result) -> str:
    return result.algorithm or f"the model {result.experiment.navigator.model}"


def _of_log(mission: LogMission) -> Tracks:
    log = mission.log
    reference, gnss = log.reference, log.gnss
    return Tracks(
        mission.title,
        f"{mission.description}\n{HEIGHTS}".strip(),
        None if reference is None else _make_track("Reference", reference.time, reference.position),
        None,
        _make_track(FIXES, gnss.time - gnss.latency, gnss.position),
    )
