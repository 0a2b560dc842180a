"""``ins-lab judge``: what a filter did, what each sentence rests on, and logs without a filter."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from estimator_logs import px4
from typer.testing import CliRunner
from writers import WRITERS
from xplane_simulator import montreal

import lab
from dashboards.command_line import app
from lab import Experiment, MissionError


def answer(*words: object) -> tuple[int, str, str]:
    found = CliRunner().invoke(app, ["judge", *map(str, words)])
    return found.exit_code, found.stdout, found.stderr


@pytest.fixture
def overconfident(tmp_path) -> Path:
    """Return a log of PX4 whose position innovations are too large from 140 s on, by a factor of 3."""
    rng = np.random.default_rng(1)
    time = np.arange(100.0, 180.0, 0.2)
    innovations = rng.normal(size=(len(time), 11))
    innovations[time > 140, 3:5] *= 3
    path = tmp_path / "copter.ulg"
    path.write_bytes(px4(time, innovations, np.ones(innovations.shape), resets={"reset_count_pos_ne": 150.0}))
    return path


def test_findings_events_and_flags_stand_in_the_answer(overconfident) -> None:
    code, out, _ = answer(overconfident)
    assert code == 0
    # The stretch begins at an edge of one of forty parts of the log.
    assert re.search("From 1(38|39|40)[.][0-9] s to 179.8 s the GPS position innovations are 3 times", out)
    assert "EKF2 reset the horizontal position at 150.0 s. [estimator_status.reset_count_pos_ne]" in out
    assert "What its own flags say: estimator_status.innovation_check_flags: nothing rejected." in out


def test_each_statement_rests_on_something(overconfident) -> None:
    code, out, _ = answer(overconfident, "--json")
    facts = json.loads(out)
    assert code == 0
    assert facts["consistent"] is False
    said = [*facts["findings"], *facts["remarks"], *facts["comparisons"]]
    assert said
    assert all(one["evidence"] for one in said)
    assert all(one["source"] for one in (*facts["events"], *facts["measurements"]))


def test_our_own_innovations_are_judged_as_anyones(tmp_path) -> None:
    experiment = Experiment()
    experiment.navigator.r_scale = 0.1
    experiment.run().to_csv(tmp_path / "run")
    found = lab.judge(tmp_path / "run" / "innovations.csv")
    assert {one.quantity for one in found.verdict.findings} == {"R position", "R velocity"}
    assert found.verdict.findings[0].factor == pytest.approx(10, rel=0.3)


@pytest.mark.parametrize("name", ["GPX", "PX4 ULog", "ArduPilot DataFlash"])
def test_a_log_without_a_filter_is_refused_in_one_sentence(tmp_path, name) -> None:
    path = tmp_path / "log"
    content = WRITERS[name](montreal(20))
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    code, out, error = answer(path)
    assert code == 2
    assert not out
    assert "innovations" in error
    assert "ccepted" in error
    with pytest.raises(MissionError):
        lab.judge(path)


def test_a_damaged_file_is_refused(tmp_path, overconfident) -> None:
    path = tmp_path / "cut.ulg"
    path.write_bytes(overconfident.read_bytes()[:700])
    code, out, error = answer(path)
    assert (code, out) == (2, "")
    assert "no innovations that EKF2 fused" in error
    assert answer(tmp_path / "none.ulg")[0] == 2
