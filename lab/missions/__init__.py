"""Missions: the shipped missions, the user's own, and the functions that add new ones.

>>> from lab.missions import mission, missions
>>> sorted(missions())[:2]
['los_angeles', 'montreal']
>>> mission("montreal").recording.time[1]
np.float64(0.055)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lab.flying.flight import Flight, fly
from lab.flying.flight_plan import FlightPlan
from lab.flying.plan_kinds import read_plan
from lab.logs.sensor_log import SensorLog
from lab.logs.sensor_log_csv import read_sensor_log
from lab.missions.catalogue import (
    broken_missions,
    mission,
    missions,
    names_in_words,
    own_folder,
    shipped_folder,
)
from lab.missions.flown_mission import fly_mission
from lab.missions.library import add_log, add_mission, delete_mission, describe_mission, rename_mission
from lab.missions.log_mission import LogMission
from lab.missions.mission import Mission
from lab.recordings.flight_csv import read_flight_csv, write_flight_csv
from lab.recordings.mission_error import MissionError
from lab.recordings.recording import Recording

if TYPE_CHECKING:
    from lab.importing.import_settings import ImportSettings
    from lab.missions.flight_import import FlightImport, prepare_import

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


def __getattr__(name: str) -> Any:
    """Import the rebuilding of flights at its first use: SciPy is slow to import."""
    if name in {"FlightImport", "prepare_import"}:
        from lab.missions import flight_import  # noqa: PLC0415

        return getattr(flight_import, name)
    if name == "ImportSettings":
        from lab.importing.import_settings import ImportSettings  # noqa: PLC0415

        return ImportSettings
    raise AttributeError(f"module 'lab.missions' has no attribute {name!r}")
