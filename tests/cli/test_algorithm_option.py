"""``--algorithm FILE.py:Name``: an algorithm of one's own, run, compared, and refused with what is wrong."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from asking import ask, refused

from dashboards.serve_command import free_port

TEXT = """\
import numpy as np
from lab import Estimate

class Still:
    def navigate(self, imu, fixes, start):
        n = imu.time.size
        print("navigating")
        parts = (start.position, start.velocity_n, start.q_nb, np.ones(9))
        return Estimate(*(np.tile(part, (n, 1)) for part in parts))

class Broken:
    def navigate(self, imu, fixes, start):
        return np.linalg.inv(np.zeros((3, 3)))
"""


@pytest.fixture
def mine(tmp_path: Path) -> str:
    path = tmp_path / "mine.py"
    path.write_text(TEXT)
    return str(path)


def test_it_runs_and_is_not_judged_by_what_it_does_not_give(mine: str) -> None:
    answer = ask("run", "los_angeles", "--algorithm", f"{mine}:Still")
    assert answer.exit_code == 0, answer.stderr
    assert answer.stdout.startswith("quantity")
    assert "navigating" in answer.stderr
    assert answer.stdout.splitlines()[-1].startswith("Verdict: Unknown")
    facts = json.loads(ask("run", "los_angeles", "--algorithm", f"{mine}:Still", "--json").stdout)
    assert facts["algorithm"] == "Still"
    assert facts["verdict"]["consistent"] is None


def test_it_stands_beside_the_models_and_its_failure_is_a_row(mine: str) -> None:
    own = ("--algorithm", f"{mine}:Still", "--algorithm", f"{mine}:Broken")
    _, phi, still, broken = ask("compare", "los_angeles", "--models", "phi", *own).stdout.splitlines()
    assert phi.startswith("phi")
    assert still.split()[0] == "Still"
    assert still.count("unknown") == 2
    assert "Does not run: Broken: raised an exception: mine.py, line 13, in navigate: LinAlgError" in broken
    rows = json.loads(ask("compare", "los_angeles", "--models", "phi", *own, "--json").stdout)
    assert rows[1]["nees"] is None
    assert rows[2]["refusal"].endswith("LinAlgError: Singular matrix")


@pytest.mark.parametrize("command", ["run", "compare", "serve"])
def test_what_cannot_be_loaded_is_refused(command: str, mine: str) -> None:
    arguments = ["los_angeles"] if command != "serve" else ["--no-browser", "--port", str(free_port())]
    refused(ask(command, *arguments, "--algorithm", mine), "accepted is FILE.py:Name")
    refused(
        ask(command, *arguments, "--algorithm", f"{mine}:Nobody"), "algorithms in the file: Broken, Still"
    )


def test_a_failure_of_its_own_is_reported_as_its_own(mine: str) -> None:
    answer = ask("run", "los_angeles", "--algorithm", f"{mine}:Broken")
    refused(
        answer, "Broken: raised an exception: mine.py, line 13, in navigate: LinAlgError: Singular matrix"
    )
