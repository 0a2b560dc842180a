"""Faults that a verdict once took for others, alone and in pairs, each with the draws that misled it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import pytest

from tests.benchmarks.faults import FAULTS, experiment


class Case(NamedTuple):
    """Faults, the run into which they are injected, and what was accused beside them."""

    faults: tuple[str, ...]
    mission: str
    grade: str
    seed: int
    settings: Mapping[str, object]


SILENT: dict[str, object] = {
    f"sensors.{name}.{setting}": value
    for name in ("barometer", "heading", "odometer")
    for setting, value in (("fitted", True), ("outages", [(0.0, 1e6)]))
}
"""Other sensors without a reading, whose states touch no others: the filter is that of other tests."""
CASES = {
    "noise of a time is no correlation": Case(
        ("bad constellation × 5, 20 s",), "montreal", "tactical", 2, {"trajectory.imu_rate": 50.0}
    ),
    "a saturated axis hides its bias": Case(("accelerometer range",), "los_angeles", "industrial", 3, {}),
    "a latency in turns is no outlier": Case(
        ("latency 0.5 s", "GPS position variance ÷ 10"),
        "pacific",
        "industrial",
        1018,
        {"trajectory.imu_rate": 50.0},
    ),
    "fixes move the navigator off the airspeed": Case(
        ("outliers of 100 m, 5 %", "R ÷ 10"),
        "pacific",
        "tactical",
        1017,
        {"trajectory.imu_rate": 50.0, "sensors.gps.period": 0.2, "sensors.airspeed.fitted": True} | SILENT,
    ),
}


@pytest.mark.parametrize("case", CASES.values(), ids=list(CASES))
def test_faults_are_named_and_nothing_else_is_accused(case: Case) -> None:
    run = experiment(case.mission, case.grade, case.seed)
    for name in case.faults:
        run = FAULTS[name].inject(run)
    for path, value in case.settings.items():
        run.set(path, value)
    said = {finding.quantity for finding in run.run().verdict.findings}
    assert all(said & set(FAULTS[name].names) for name in case.faults)
    assert said <= {quantity for name in case.faults for quantity in FAULTS[name].names}
