"""Events: what was set to happen in a flight is found in its arrays, and when."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from lab.analysis.events import FAULTS, OUTAGE, REJECTED, SATURATED, Event, events, merge_close_events
from lab.analysis.observability import REST, manoeuvres
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result


@pytest.fixture(scope="module")
def eventful() -> Result:
    """Return a run with an outage and wild fixes."""
    made = Experiment(mission="los_angeles")
    made.set("trajectory.imu_rate", 50.0)
    made.set("sensors.gps.outages", [(60.0, 80.0)])
    made.set("sensors.gps.outlier_rate", 0.05)
    made.set("sensors.gps.outlier_size", 200.0)
    made.set("navigator.gate", 0.001)
    return made.run()


def of_kind(result: Result, kind: str) -> list[Event]:
    return [one for one in events(result) if one.kind == kind]


def test_an_outage_is_where_it_was_set_and_once(eventful: Result) -> None:
    assert [(one.start, one.end) for one in of_kind(eventful, OUTAGE)] == [(60.0, 80.0)]


def test_missing_fixes_of_no_outage_are_found_in_the_times_of_the_fixes(eventful: Result) -> None:
    times = eventful.fixes.time
    kept = (times < 30.5) | (times > 39.5)
    fewer = eventful.fixes._replace(
        **{
            name: value[kept]
            for name, value in eventful.fixes._asdict().items()
            if isinstance(value, np.ndarray) and value.shape[:1] == times.shape
        }
    )
    flags = eventful.solution_arrays.fix_rejected[kept]
    solution = eventful.solution_arrays._replace(fix_rejected=flags)
    found = of_kind(dataclasses.replace(eventful, fixes=fewer, solution_arrays=solution), OUTAGE)
    assert (found[0].start, found[0].end) == (times[times < 30.5][-1], times[times > 39.5][0])
    assert found[0].words == "no GPS fix"


def test_every_rejected_fix_is_in_an_event_and_no_other(eventful: Result) -> None:
    rejected = eventful.fixes.time[eventful.solution_arrays.fix_rejected]
    assert rejected.size > 2
    found = of_kind(eventful, REJECTED)
    assert all(any(one.start <= time <= one.end for one in found) for time in rejected)
    used = np.setdiff1d(eventful.fixes.time, rejected)
    assert not any(one.start <= time <= one.end for one in found for time in used)


def test_saturation_is_where_the_true_rate_is_beyond_the_range() -> None:
    made = Experiment(mission="los_angeles")
    made.set("trajectory.imu_rate", 50.0)
    made.set("sensors.gyro.range", 3.0)
    eventful = made.run()
    assert eventful.ideal is not None
    rate = np.abs(np.degrees(eventful.ideal.dtheta / eventful.ideal.dt)).max(axis=1)
    found = of_kind(eventful, SATURATED)
    assert found and {one.words for one in found} == {"saturated gyros"}
    for one in found:
        inside = (eventful.time[1:] >= one.start - 0.5) & (eventful.time[1:] <= one.end + 0.5)
        assert rate[inside].max() > 2.0
    beyond = eventful.time[1:][rate > 5.0]
    assert beyond.size
    assert all(any(one.start <= time <= one.end for one in found) for time in beyond)


def test_manoeuvres_are_those_of_the_observability_without_the_level_stretches(eventful: Result) -> None:
    found = [one for one in events(eventful) if one.kind not in FAULTS]
    flown = [one for one in manoeuvres(eventful.flown) if one.kind != "level stretch"]
    assert [(one.words, one.start) for one in found] == [(one.name, one.start) for one in flown]
    assert REST in {one.kind for one in found} or flown[0].kind != REST


def test_a_lane_has_a_bounded_number_of_events() -> None:
    many = [Event(REJECTED, at, at, "rejected fix") for at in np.arange(0.0, 10_000.0, 2.0)]
    brief = [Event("right turn", at, at + 1.0, "a turn") for at in np.arange(0.0, 10_000.0, 2.0)]
    found = merge_close_events(brief + many, 10_000.0)
    assert [(one.start, one.end, one.words) for one in found] == [(0.0, 9998.0, "rejected fixes")]
    assert len(merge_close_events(many[::10], 10_000.0)) == len(many[::10])
