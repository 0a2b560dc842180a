"""Bounds of the grading: a run without end, one that takes the memory, and one that ends its process."""

from __future__ import annotations

import inspect
import os
from collections.abc import Mapping
from pathlib import Path
from threading import Event
from typing import Any
from unittest.mock import patch

import pytest

from lab.classroom.homework import bounded_runs
from lab.classroom.homework.bounded_runs import FIGURES, BoundedRuns, Examined, StartError, examine
from lab.classroom.homework.grading import GRADED, NOT_RUN, grade, list_files
from lab.classroom.homework.hand_in import HandIn, write_hand_in
from lab.classroom.homework.hidden_experiment import HiddenExperiment
from lab.classroom.homework.homework import Judge
from lab.classroom.homework.homework_file import make_homework
from lab.cli.grade import grade as grade_command

SOURCE = """title = "Find it"
text = "Something is wrong."
change = ["navigator.r_scale"]
[settings]
mission = "los_angeles"
[hidden]
faults = ["r"]
[[goal]]
condition = "nees < 5"
"""
ENDLESS, GREEDY, DEADLY, HONEST = 2.0, 3.0, 4.0, 5.0


def greedy(_experiment: HiddenExperiment) -> None:
    bytearray(64 * 2**30)


def hostile(judge: Judge, changes: Mapping[str, Any]) -> Examined:
    """Stand for `examine` with settings that do harm; called in the process."""
    what = changes["navigator.r_scale"]
    if what == GREEDY:
        with patch.object(HiddenExperiment, "run", greedy):
            return examine(judge, changes)
    if what == DEADLY:
        os._exit(9)
    if what == ENDLESS:
        Event().wait()
    high, low = divmod(os.getpid(), 1000)  # the table has six digits
    return Examined(dict.fromkeys(FIGURES, 0.0) | {"nees": high, "nis": low}, [True])


@pytest.mark.proof
def test_a_hostile_run_costs_its_own_row_only(tmp_path: Path) -> None:
    (tmp_path / "find.toml").write_text(SOURCE, encoding="utf-8")
    keyed, folder = make_homework(tmp_path / "find.toml"), tmp_path / "handed"
    folder.mkdir()
    values = (HONEST, ENDLESS, HONEST, GREEDY, DEADLY, HONEST)
    for number, value in enumerate(values):
        handed = HandIn(f"Ada {number}", {"navigator.r_scale": value})
        write_hand_in(folder / f"{number}.handin", keyed.homework, handed)
    with BoundedRuns(keyed, seconds=5, memory=1, examining=hostile) as examining:
        rows = grade(list_files(folder), keyed, examining=examining)
    assert [row["status"] for row in rows] == [GRADED, NOT_RUN, GRADED, NOT_RUN, NOT_RUN, GRADED]
    assert [row["points"] for row in rows] == ["1", "0", "1", "0", "0", "1"]
    assert [row["remark"] for row in rows if row["status"] == NOT_RUN] == [
        "cannot be run: its run takes more than 5 s (--seconds), and was stopped",
        "cannot be run: its run needs more than 1 GB of memory (--memory)",
        "cannot be run: its run ended the process; it may need more than 1 GB (--memory)",
    ]
    processes = {1000 * int(row["nees"]) + int(row["nis"]) for row in rows if row["status"] == GRADED}
    assert len(processes) == 3
    assert os.getpid() not in processes
    for process in processes:
        assert not Path(f"/proc/{process}").exists()


def test_a_process_that_does_not_start_costs_no_points(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "find.toml").write_text(SOURCE, encoding="utf-8")
    keyed = make_homework(tmp_path / "find.toml")
    monkeypatch.setattr(bounded_runs, "key_text", lambda _keyed: "")
    with BoundedRuns(keyed) as examining, pytest.raises(StartError, match="at its start"):
        examining(keyed.judge, {})


def test_the_command_has_the_bounds_of_the_class() -> None:
    options = inspect.signature(grade_command).parameters
    assert options["seconds"].default == bounded_runs.SECONDS
    assert options["memory"].default == bounded_runs.MEMORY
