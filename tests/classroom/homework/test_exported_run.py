"""Exported runs of a homework: sealed in every format, and repeated with the key alone."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lab import Result, ResultError, export_track, open_result
from lab.classroom.homework.grading import grade, list_files
from lab.classroom.homework.homework_file import Keyed, homework_text, make_homework, read_homework, write_key
from tests.cli.asking import ask

SOURCE = """title = "Find it"
text = "Something is wrong."
change = ["navigator"]
[settings]
mission = "los_angeles"
trajectory.imu_rate = 20
[hidden]
faults = ["latency"]
settings = { sensors.gyro.bias = [0.04372, 0.0, 0.0] }
[[goal]]
text = "NEES below 50."
condition = "nees < 50"
"""
WRITERS: dict[str, Callable[[Result, Path], Any]] = {
    "run.nc": lambda result, path: result.to_netcdf(path),
    "run.json": lambda result, path: path.write_text(result.to_json(), "utf-8"),
    "run.html": lambda result, path: result.report(path),
    "run.tum": export_track,
    "run.kml": export_track,
    "errors.pdf": lambda result, path: result.plot.errors().save(path),
}


@pytest.fixture(scope="module")
def keyed(tmp_path_factory: pytest.TempPathFactory) -> Keyed:
    path = tmp_path_factory.mktemp("source") / "find.toml"
    path.write_text(SOURCE, encoding="utf-8")
    return make_homework(path)


@pytest.fixture(scope="module")
def exports(keyed: Keyed, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with what a student exported of a run with another seed, in his own lab."""
    folder = tmp_path_factory.mktemp("exports")
    (folder / ".find.homework").write_text(homework_text(keyed), "utf-8")
    experiment = read_homework(folder / ".find.homework").experiment_with(
        {"navigator.q_scale": 0.5, "seed": 77}
    )
    result = experiment.run()
    for name, write in WRITERS.items():
        write(result, folder / name)
    return folder


def test_nobody_repeats_it_without_the_key(exports: Path, keyed: Keyed) -> None:
    saved = open_result(exports / "run.nc")
    kind, name, sealed = saved.sealed.split()
    assert (kind, name) == ("homework", keyed.homework.name)
    assert "77" not in str(saved.facts["settings"])
    assert len(sealed) > 80
    with pytest.raises(ResultError, match=r"sealed \(homework\).*grade FOLDER --key"):
        saved.run()


def test_the_command_repeats_each_with_the_key(exports: Path, keyed: Keyed, tmp_path: Path) -> None:
    write_key(tmp_path / "find.key", keyed)
    answer = ask("grade", str(exports), "--key", str(tmp_path / "find.key"))
    assert answer.exit_code == 0
    rows = {row["file"]: row for row in csv.DictReader(io.StringIO(answer.stdout))}
    assert set(rows) == set(WRITERS)
    for row in rows.values():
        assert (row["status"], row["remark"]) == (
            "repeated",
            "its run gives the same figures to the last bit",
        )
        assert row["settings"] == "navigator.q_scale=0.5"
        assert float(row["nees"]) > 0
    assert f"{len(WRITERS)} exports repeated to the last bit" in answer.stderr


def test_a_changed_export_is_found_out(exports: Path, keyed: Keyed, tmp_path: Path) -> None:
    text = (exports / "run.tum").read_text("utf-8")
    (tmp_path / "other.tum").write_text(text.replace("q_scale = 0.5", "q_scale = 0.6"), "utf-8")
    (tmp_path / "shown.tum").write_text(text.replace("imu_rate = 20", "imu_rate = 10"), "utf-8")
    (tmp_path / "foreign.tum").write_text(text.replace(keyed.homework.name, "0" * 16), "utf-8")
    at = text.index('sealed = "homework') + 60
    (tmp_path / "seal.tum").write_text(
        text[:at] + ("A" if text[at] != "A" else "B") + text[at + 1 :], "utf-8"
    )
    (tmp_path / "none.tum").write_text("0 0 0\n", "utf-8")
    rows = {row["file"]: row for row in grade(list_files(tmp_path), keyed)}
    assert rows["other.tum"]["status"] == "different"
    assert "with the same versions" in rows["other.tum"]["remark"]
    for name, words in {
        "shown.tum": "does not let you change it",
        "foreign.tum": f"accepted are those of {keyed.homework.name}",
        "seal.tum": "sealed for another key, or has been changed",
        "none.tum": "says nothing of what made it",
    }.items():
        assert rows[name]["status"] == "refused"
        assert words in rows[name]["remark"]
