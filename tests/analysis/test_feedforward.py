"""A navigator that runs free beyond the linear model is blamed, unless the errors are known and right."""

from __future__ import annotations

import numpy as np
import pytest

from lab.analysis.feedforward import FreeRun, judge
from lab.analysis.verdicts.finding import Finding, Verdict
from lab.analysis.verdicts.sums import Squares
from lab.experiment.experiment import Experiment

FAR, NEAR = (FreeRun(float(np.radians(drift)), float(np.radians(0.8))) for drift in (2.0, 0.5))


@pytest.mark.parametrize(
    ("quantity", "nees", "named"),
    [
        ("GPS outliers", None, "feedforward"),
        ("GPS outliers", 1.05, "GPS outliers"),
        ("GPS outliers", 4.0, "feedforward"),
        ("NEES between fixes", 1.05, "feedforward"),
    ],
)
def test_what_is_wrong_beside_right_errors_keeps_its_name(quantity, nees, named):
    finding = Finding(quantity, "not modelled", 1.0, "It is wrong.", "Mend it.", "seen")
    verdict = Verdict("It is wrong.", (finding,), "1 run, errors and innovations")
    navigator = Experiment().navigator
    navigator.correction = "feedforward"
    squares = None if nees is None else Squares(np.array(60 * nees), np.array(60.0))
    (found,) = judge(FAR, verdict, navigator, squares).findings
    assert found.quantity == named


@pytest.mark.parametrize(("quantity", "named"), [("R airspeed", "feedforward"), ("R position", "R position")])
def test_a_small_drift_is_suspected_where_only_other_sensors_disagree(quantity, named):
    finding = Finding(quantity, "too small", 4.0, "It is wrong.", "Mend it.", "seen")
    verdict = Verdict("It is wrong.", (finding,), "1 run, errors and innovations")
    navigator = Experiment().navigator
    navigator.correction = "feedforward"
    (found,) = judge(NEAR, verdict, navigator, Squares(np.array(240.0), np.array(60.0))).findings
    assert found.quantity == named


def test_sensors_are_not_blamed_for_a_navigator_that_runs_free() -> None:
    """It is off what the heading sensor measures; with feedback, neither is named."""
    remarks = {}
    for correction in ("feedforward", "feedback"):
        made = Experiment(mission="los_angeles", seed=2)
        made.update({"trajectory": {"imu_rate": 50.0}, "navigator": {"correction": correction}})
        made.set("sensors.gyro.bias_sigma", 1.0)
        made.set("sensors.heading.fitted", True)
        remarks[correction] = " ".join(made.run().remarks)
    assert "Feedforward: the attitude error of the free-running navigator" in remarks["feedforward"]
    assert "innovations of heading" not in remarks["feedforward"]
    assert "innovations of heading" not in remarks["feedback"]
    assert "Feedforward" not in remarks["feedback"]
