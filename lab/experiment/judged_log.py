"""Judged log: a filter that is not ours, judged by its innovations, the fixes of its log and our smoother."""

from __future__ import annotations

import os
from pathlib import Path

from lab.analysis.verdicts import limits
from lab.analysis.verdicts.foreign_track import Compared, Statement, compare_positions
from lab.analysis.verdicts.foreign_verdict import ForeignVerdict, judge_foreign
from lab.base.files.mission_error import MissionError
from lab.base.parameters.setting_error import SettingError
from lab.base.progress import Progress
from lab.data.filter_logs import read_filter_log, sensors_beside
from lab.data.log.filter_log import FilterLog
from lab.data.log.sensor_log import SensorLog
from lab.experiment.experiment import Experiment
from lab.experiment.log_file import write_mission
from lab.navigation.filters.error_models import POS

_COMPARED = 2000
"""Most samples of our solution that are compared: more depend on each other."""


def judge(
    path: str | os.PathLike[str], *, smoother: bool = False, progress: Progress | None = None
) -> ForeignVerdict:
    """Judge the filter in a log: PX4's EKF2, ArduPilot's EKF2 and EKF3, or any filter's csv of innovations.

    Parameters
    ----------
    path
        The log.
    smoother
        Whether its positions are compared with our smoothed solution of the same sensors.
    progress
        Called with a phrase and the fraction done.

    Raises
    ------
    MissionError
        If the file cannot be read, or holds no innovations of a filter.

    Examples
    --------
    >>> lab.judge("flight.ulg").verdict.headline  # doctest: +SKIP
    """
    say = (lambda _phrase, _part: None) if progress is None else progress
    say("reading", 0.0)
    log = read_filter_log(Path(path))
    say("reading the sensors", 0.3)
    sensors = sensors_beside(Path(path))
    known = None if isinstance(sensors, str) else sensors
    further = []
    if smoother:
        say("smoothing", 0.4)
        further = [_no_smoother(str(sensors)) if known is None else _compare_with_smoothed(log, known)]
    return judge_foreign(log, known, further)


def _no_smoother(why: str) -> Compared:
    return Compared(Statement("It is not compared with our smoother.", why))


def _compare_with_smoothed(log: FilterLog, sensors: SensorLog) -> Compared:
    """Return the comparison with our smoothed solution, if that is consistent itself."""
    if log.lane.track is None:
        return _no_smoother("the log does not give its positions")
    try:
        with write_mission(sensors, "log") as place:
            experiment = Experiment(mission=place)
            experiment.navigator.smoother = True
            result = experiment.run()
            ours = result.verdict
            arrays, time = result.solution_arrays, result.time
    except (MissionError, SettingError) as error:
        return _no_smoother(str(error))
    own = result.evidence.innovations.nis
    if not float(own.mean) < limits.VERDICT.consistent_nis:  # smaller ones are those of a careful filter
        return _no_smoother(
            f"our own innovations are larger on this log than our filter says: {ours.headline}"
        )
    sigma = arrays.variance[:, POS] ** 0.5
    rows = slice(None, None, max(1, len(time) // _COMPARED))
    found = compare_positions(
        log.lane.track, "our smoothed solution", time[rows] + sensors.epoch, arrays.position[rows],
        sigma[rows], arrays.velocity_n[rows],
    )  # fmt: skip
    # Where they contradict each other, ours may be wrong, so that this alone accuses nobody.
    return (
        _no_smoother("too few of its positions have a time of ours")
        if found is None
        else Compared(found.statement)
    )
