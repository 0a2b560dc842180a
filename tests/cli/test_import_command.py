"""``ins-lab import``: a file in, a report, and a mission out that can be run."""

from __future__ import annotations

import io
import json
import re
import sys
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from asking import ask, refused

from lab.base.files.mission_error import QuestionError
from lab.cli.import_flight import _answered
from lab.missions import ImportSettings, Recording, mission, missions, write_flight_csv

sys.path.insert(0, str(Path(__file__).parents[1]))
from sensor_logs import IMU, POSITION, VELOCITY, tables, write_csv
from writers import WRITERS


@pytest.fixture(autouse=True)
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an empty folder of one's own missions; the command is given in another one."""
    folder = tmp_path / "own"
    monkeypatch.setenv("INS_LAB_MISSIONS", str(folder))
    monkeypatch.chdir(tmp_path)
    return folder


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    path = tmp_path / "flight.csv"
    write_flight_csv(path, mission("montreal").recording)
    return path


def changed(path: Path, **values: np.ndarray) -> Path:
    recording = mission("montreal").recording
    names = ("time", "latitude", "longitude", "height", "velocity_n", "euler")
    write_flight_csv(path, Recording(**({name: getattr(recording, name) for name in names} | values)))
    return path


def test_the_command_that_follows_takes_a_name_with_spaces(flight: Path) -> None:
    answer = ask("import", str(flight), "--name", "my flight")
    assert answer.stdout.splitlines()[-1] == 'Added: my flight. Navigate it: ins-lab run "my flight"'


def test_a_flight_becomes_a_mission_that_runs(flight: Path) -> None:
    answer = ask("import", str(flight), "--name", "mine", "--title", "My flight")
    assert answer.exit_code == 0, answer.output
    assert "Verdict: plausible" in answer.stdout
    assert "the samples as they are" in answer.stdout
    assert answer.stdout.splitlines()[-1] == "Added: mine. Navigate it: ins-lab run mine"
    added = missions()["mine"]
    assert added.title == "My flight"
    assert added.tags == ("imported",)
    np.testing.assert_allclose(
        added.recording.velocity_n, mission("montreal").recording.velocity_n, atol=1e-7
    )
    ran = ask("run", "mine")
    assert ran.exit_code == 0, ran.output
    assert "Verdict" in ran.stdout


def test_the_name_is_the_files_where_none_is_given(flight: Path) -> None:
    assert "Added: flight." in ask("import", str(flight)).stdout
    assert "Added: flight_2." in ask("import", str(flight)).stdout


def test_a_name_that_is_taken_is_refused_unless_forced(flight: Path) -> None:
    ask("import", str(flight), "--name", "mine")
    refused(ask("import", str(flight), "--name", "mine"), "'mine'")
    assert ask("import", str(flight), "--name", "mine", "--force").exit_code == 0


def test_a_preview_is_one_html_file_and_adds_nothing(flight: Path, tmp_path: Path) -> None:
    answer = ask("import", str(flight), "--preview")
    assert answer.stdout.splitlines()[-1] == "Preview: flight.csv.preview.html"
    html = (tmp_path / "flight.csv.preview.html").read_text()
    shown, fetched = "Ground track" in html, re.search(r"<(script|link)[^>]{1,200} (src|href)=", html)
    assert shown
    assert fetched is None
    assert "flight" not in missions()


def test_an_implausible_flight_is_added_only_on_request(tmp_path: Path) -> None:
    euler = mission("montreal").recording.euler * (1, 1, -1)
    path = changed(tmp_path / "mirrored.csv", euler=euler)
    answer = ask("import", str(path))
    assert answer.exit_code == 2
    assert "Verdict: implausible" in answer.stdout
    assert "--implausible" in answer.stderr
    assert "mirrored" not in missions()
    assert ask("import", str(path), "--implausible").exit_code == 0
    assert "mirrored" in missions()


def test_the_report_as_json(flight: Path) -> None:
    facts = json.loads(ask("import", str(flight), "--json", "--name", "mine").stdout)
    assert facts["verdict"] == "plausible"
    assert facts["added"] == "mine"
    assert facts["has_log"] is False
    assert {"group": "File", "name": "Format", "value": "INS Lab flight csv"} in facts["rows"]


def test_units_and_settings_are_passed_on(tmp_path: Path) -> None:
    data = tmp_path / "Data.csv"
    content = WRITERS["MSFS/FSX fsLogger csv"](mission("montreal").recording)
    assert isinstance(content, bytes)
    data.write_bytes(content)
    answer = ask("import", str(data), "--unit", "Plane_Altitude=ft", "--set", "curve=air data", "--name", "a")
    assert "ft (given by you)" in answer.stdout
    assert "rebuilt from air data" in answer.stdout
    refused(ask("import", str(data), "--unit", "Plane_Altitude"), "COLUMN=UNIT")
    refused(ask("import", str(data), "--set", "curve=wind"), "velocity", "air data")
    refused(ask("import", str(data), "--set", "curves=position"), "Did you mean curve?")


@pytest.mark.proof
@pytest.mark.parametrize("settings", [[], ["--as", "log"]])
def test_a_log_becomes_a_flight_or_a_log(tmp_path: Path, settings: list[str]) -> None:
    path = tmp_path / "sitl.ulg"
    content = WRITERS["PX4 ULog"](mission("montreal").recording)
    assert isinstance(content, bytes)
    path.write_bytes(content)
    answer = ask("import", str(path), *settings, "--name", "sitl")
    assert answer.exit_code == 0, answer.output
    assert ("--as log adds" in answer.stdout) is (not settings)
    origin = missions()["sitl"].origin
    assert (origin == "sensor log") is bool(settings)


def test_a_long_gap_of_the_imu_is_told_when_the_log_is_added(tmp_path: Path) -> None:
    source = tables(60, 90)
    time = source.imu[:, 0] - source.imu[0, 0]
    write_csv(tmp_path / "imu.csv", IMU, source.imu[(time < 20) | (time > 26)])
    write_csv(tmp_path / "gnss.csv", (*POSITION, *VELOCITY[:2]), source.gnss[:, :6])
    paths = [str(tmp_path / name) for name in ("imu.csv", "gnss.csv")]
    answer = ask("import", *paths, "--as", "log", "--name", "gap")
    assert answer.exit_code == 0, answer.output
    said = "The IMU has 1 gap of more than 2 s, up to 6"
    assert said in " ".join(answer.stdout.split())
    asked = ask("import", *paths, "--as", "log", "--name", "gap of a car", "--vehicle", "car", "--json")
    facts = json.loads(asked.stdout)
    assert (facts["added"], facts["vehicle"]) == ("gap of a car", "car")
    assert any(said in repair for repair in facts["repairs"])


def test_what_cannot_be_imported_is_answered_with_what_can(tmp_path: Path, flight: Path) -> None:
    (tmp_path / "poem.txt").write_text("no flight\n")
    refused(ask("import", "poem.txt"), "poem.txt", "Accepted: ", "INS Lab flight csv")
    refused(ask("import", "nowhere.csv"), "nowhere.csv")
    refused(ask("import", str(flight), "--as", "log"), "no IMU and GPS", "PX4 ULog")


def test_help_names_every_setting() -> None:
    text = " ".join(ask("import", "--help").stdout.split())
    for name in ImportSettings().to_dict():
        assert f" {name}" in text


class _Terminal(io.StringIO):
    """The keyboard of a person."""

    def isatty(self) -> bool:
        return True


def test_a_question_is_asked_again_until_its_answer_is_one_of_the_words(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", _Terminal("perhaps\nknots\n"))
    question = QuestionError("speed: unit unknown", {"m/s": {"speed": "m/s"}, "knots": {"speed": "kn"}})

    def read(said: dict[str, str]) -> dict[str, str]:
        if not said:
            raise question
        return said

    found: Any = _answered([Path("a.csv")], {}, cast("Any", read))
    assert found == ({"speed": "kn"}, {"speed": "kn"})
    assert "'perhaps' is not one of m/s, knots" in capsys.readouterr().err
