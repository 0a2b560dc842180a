"""Live verdict: what the innovations of a stream say so far, as the batch run on its log says it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from lab.analysis.verdicts.verdict import Verdict
from lab.base.cache import StageCache
from lab.data.log.sensor_log import SensorLog
from lab.experiment.experiment import Experiment
from lab.experiment.log_run import run_log
from lab.experiment.result import Result
from lab.live.stream_settings import stream_settings
from lab.missions.log_mission import LogMission
from lab.navigation.settings import NavigatorSettings
from lab.sensors.suite import SensorSuite

ROOM = 64 * 2**20
"""Room for the stages of one verdict [bytes]."""


@dataclass(frozen=True, eq=False, repr=False)
class StreamedMission(LogMission):
    """A log that is in memory only.

    Attributes
    ----------
    streamed : SensorLog
        The log.
    """

    streamed: SensorLog = None  # type: ignore[assignment]  # given always; the fields before it have defaults

    @cached_property
    def log(self) -> SensorLog:
        """The log."""
        return self.streamed

    def log_of(self, vehicle: str = "") -> SensorLog:
        """Return the log; the vehicle is in the settings."""
        return self.streamed

    @cached_property
    def content_hash(self) -> str:
        """Nothing: each run has a cache of its own."""
        return ""


def run_batch(log: SensorLog, sensors: SensorSuite, navigator: NavigatorSettings) -> Result:
    """Return the batch run on the log of a stream.

    Parameters
    ----------
    log
        The log so far.
    sensors, navigator
        The assumptions of the filter.

    Raises
    ------
    MissionError, SettingError, ValueError
        As `lab.experiment.log_run.run_log`.
    """
    experiment = Experiment(mission=log.name)
    experiment.sensors.update(sensors.to_dict())
    experiment.navigator.update(navigator.to_dict())
    mission = StreamedMission(log.name, Path(), title=log.name, streamed=log)
    return run_log(experiment, mission, StageCache(limit=ROOM), lambda _stage, _part: None)


def judge_stream(log: SensorLog, sensors: SensorSuite, navigator: NavigatorSettings) -> Verdict:
    """Return the verdict on the log of a stream; arguments and exceptions as of `run_batch`.

    Settings that do not hold for a stream have no effect (`lab.live.stream_settings`).
    """
    return run_batch(log, *stream_settings(sensors, navigator)).verdict
