"""Missions: flights by name: the shipped ones, the user's own, and the functions that add new ones.

In: a name, a file to import, or a plan to fly. Out: a `Mission` with its `Recording`, or a `LogMission` with
its `SensorLog`; a library that loses nothing when two write to it.

Read first: `mission` (what a mission is), `catalogue` (how a name is found), `flight_import` (from a file to
a mission).

>>> from lab.missions import mission, missions
>>> sorted(missions())[:2]
['los_angeles', 'montreal']
>>> mission("montreal").recording.time[1]
np.float64(0.055)
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from lab.base.files.mission_error import MissionError
from lab.data.files.sensor_log_csv import read_sensor_log
from lab.data.log.sensor_log import SensorLog
from lab.missions.catalogue import (
    broken_missions,
    mission,
    missions,
    names_in_words,
    own_folder,
    shipped_folder,
)
from lab.missions.log_mission import LogMission
from lab.missions.mission import Mission
from lab.motion.recordings.flight_csv import read_flight_csv, write_flight_csv
from lab.motion.recordings.recording import Recording

if TYPE_CHECKING:
    from lab.data.rebuild.import_settings import ImportSettings
    from lab.flying.flight import Flight, fly
    from lab.flying.flight_plan import FlightPlan, read_plan
    from lab.missions.flight_import import FlightImport, prepare_import
    from lab.missions.flown_mission import fly_mission
    from lab.missions.library import add_log, add_mission, delete_mission, describe_mission, rename_mission

__all__ = [
    "Flight",
    "FlightImport",
    "FlightPlan",
    "ImportSettings",
    "LogMission",
    "Mission",
    "MissionError",
    "Recording",
    "SensorLog",
    "add_log",
    "add_mission",
    "broken_missions",
    "delete_mission",
    "describe_mission",
    "fly",
    "fly_mission",
    "mission",
    "missions",
    "names_in_words",
    "own_folder",
    "prepare_import",
    "read_flight_csv",
    "read_plan",
    "read_sensor_log",
    "rename_mission",
    "shipped_folder",
    "write_flight_csv",
]


_HOMES = {
    "Flight": "lab.flying.flight",
    "FlightImport": "lab.missions.flight_import",
    "FlightPlan": "lab.flying.flight_plan",
    "ImportSettings": "lab.data.rebuild.import_settings",
    "add_log": "lab.missions.library",
    "add_mission": "lab.missions.library",
    "delete_mission": "lab.missions.library",
    "describe_mission": "lab.missions.library",
    "fly": "lab.flying.flight",
    "fly_mission": "lab.missions.flown_mission",
    "prepare_import": "lab.missions.flight_import",
    "read_plan": "lab.flying.flight_plan",
    "rename_mission": "lab.missions.library",
}
"""Modules of what is imported at its first use: a run flies, imports and writes no mission."""


def __getattr__(name: str) -> Any:
    """Import what makes missions at its first use."""
    if name not in _HOMES:
        raise AttributeError(f"module 'lab.missions' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return __all__
