"""``ins-lab lesson``: the list of lessons, and the check of a file."""

from __future__ import annotations

import json
from pathlib import Path

from asking import ask, refused

GOOD = """title = "Mine"
[settings]
mission = "los_angeles"
trajectory.imu_rate = 50
[[step]]
title = "One"
text = "Two."
settings = { navigator.r_scale = 0.1 }
check = "nis < 2"
solution = { navigator.r_scale = %s }
"""


def test_the_list_has_the_lessons_that_ship_and_those_of_a_folder(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(GOOD % "1.0", encoding="utf-8")
    (tmp_path / "broken.toml").write_text("title = 3", encoding="utf-8")
    header, broken, mine, *rest = ask("lesson", "list", str(tmp_path)).stdout.splitlines()
    assert header.split()[:2] == ["name", "origin"]
    assert broken.startswith("broken")
    assert "step: there is none" in broken
    assert mine.split()[:3] == ["mine", "own", "Mine"]
    assert len(rest) >= 20
    entries = json.loads(ask("lesson", "list", "--json").stdout)
    assert {entry["origin"] for entry in entries} == {"shipped", "gallery"}
    refused(ask("lesson", "list", str(tmp_path / "none")), "is not a folder", "accepted")


def test_check_says_what_is_wrong_and_where(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(GOOD % "1.0", encoding="utf-8")
    assert "Mine: steps: 1, to solve: 1" in ask("lesson", "check", str(path)).stdout
    path.write_text(GOOD % "0.0", encoding="utf-8")
    said = "mine.toml, line ", ": step 1: solution", "r_scale", "accepted is"
    refused(ask("lesson", "check", str(path)), *said)
    refused(ask("lesson", "check", str(tmp_path / "none.toml")), "none.toml")
    refused(ask("lesson", "check", "."), "ins-lab: .: cannot be read")


def test_check_runs_the_solution(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    for factor, code in (("1.0", 0), ("0.2", 1)):
        path.write_text(GOOD % factor, encoding="utf-8")
        answer = ask("lesson", "check", "--run", str(path))
        assert answer.exit_code == code
        assert "step 1: the check refuses the step as it begins (right): nis" in answer.stdout
        assert ("refuses the solution (WRONG)" in answer.stdout) == bool(code)


def test_serve_refuses_a_folder_that_is_none(tmp_path: Path) -> None:
    refused(ask("serve", "--lessons", str(tmp_path / "none")), "--lessons", "is not a folder")
