"""``ins-lab scoreboard``: the kept results without data, a run with data, and clear answers to wrong uses."""

from __future__ import annotations

import json
from pathlib import Path

import public_sets
import pytest
from asking import ask, refused

from lab.experiment.scoreboard import comparison
from lab.experiment.scoreboard.registry import PROGRAMS, data_sets
from lab.experiment.scoreboard.results import kept_rows


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Navigate with the lab alone; the tests of the experiment have the others."""
    monkeypatch.setattr(comparison, "PROGRAMS", PROGRAMS[:1])


def test_without_data_it_shows_what_is_kept() -> None:
    answer = ask("scoreboard")
    assert answer.exit_code == 0
    for about in data_sets().values():
        assert f"{about.name}: {about.title}\n{about.source}, {about.licence}" in answer.stdout
    assert "worse than the best of the others" in answer.stdout
    assert "SHA-256 of the files as registered]" in answer.stdout
    assert "0.647" in answer.stdout
    assert ask("scoreboard", "kf_gins").stdout.count("kf_gins: ") == 1


def test_json_has_rows_with_what_they_rest_on() -> None:
    found = json.loads(ask("scoreboard", "rtkx_walk", "--json").stdout)
    assert (found["schema"], found["schema_version"]) == ("ins-lab scoreboard answer", 1)
    (one,) = found["sets"]
    assert one["licence"] == "BSD-3-Clause"
    assert one["standing"]["rests_on"].startswith("horizontal, rms, 2 outages")
    assert [row["program"] for row in one["rows"]] == list(PROGRAMS)


@pytest.mark.usefixtures("alone")
def test_a_folder_is_run_and_its_rows_are_kept(tmp_path: Path) -> None:
    public_sets.kf_gins(tmp_path / "kf_gins")
    file = tmp_path / "results.json"
    answer = ask("scoreboard", "--data", str(tmp_path), "--keep", str(file))
    assert answer.exit_code == 0, answer.output
    assert "no SHA-256 of these files was known before" in answer.stdout
    assert "KF-GINS, published" in answer.stdout
    assert "nclt is not in" in answer.stderr
    assert "nothing is fetched" in answer.stderr
    kept = {one.key: one.row for one in kept_rows(file)}
    assert kept["kf_gins", "INS Lab"].outcome == "run"
    assert kept["kf_gins", "INS Lab"].outages > 1
    assert kept["nclt", "INS Lab"].outcome == "data not at hand"
    # The next run is compared with these files.
    again = ask("scoreboard", "kf_gins", "--data", str(tmp_path / "kf_gins"), "--keep", str(file))
    assert "SHA-256 of the files as at the first result" in again.stdout
    (tmp_path / "kf_gins" / "IMU.txt").write_bytes(b"0 1 2 3 4 5 6\n" * 10)
    refused(
        ask("scoreboard", "kf_gins", "--data", str(tmp_path), "--keep", str(file)),
        "IMU.txt: is another file",
        "github.com/i2Nav-WHU/KF-GINS",
    )
    assert kept_rows(file)[0].key == ("rtkx_walk", "INS Lab")


@pytest.mark.usefixtures("alone")
def test_one_set_may_be_in_a_folder_of_any_name(tmp_path: Path) -> None:
    folder = public_sets.kf_gins(tmp_path / "downloads")
    answer = ask("scoreboard", "kf_gins", "--data", str(folder), "--json")
    assert json.loads(answer.stdout)["sets"][0]["rows"][0]["outcome"] == "run"


@pytest.mark.usefixtures("alone")
def test_a_damaged_file_is_named(tmp_path: Path) -> None:
    folder = public_sets.navego(tmp_path / "navego_adis16405", public_sets.made(60.0))
    path = folder / "imu1.mat"
    path.write_bytes(path.read_bytes()[:2000])
    cut = ask("scoreboard", "navego_adis16405", "--data", str(tmp_path))
    refused(cut, "imu1.mat", "ends within an element")
    path.write_bytes(b"\x89HDF\r\n")
    refused(ask("scoreboard", "navego_adis16405", "--data", str(tmp_path)), "without -v7.3")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere"], ["there is no data set of this name", "accepted: rtkx_walk"]),
        (["--data", "nowhere"], ["there is no such folder"]),
        (["--data", __file__], ["is a file; accepted is a folder"]),
        (["--keep", "a.json"], ["accepted with --data"]),
        (["--data", ".", "--keep", "a.csv"], ["accepted is a JSON file"]),
        (["--data", "."], ["has no set", "folders in it named rtkx_walk"]),
        (
            ["nclt", "--data", "."],
            ["named nclt; it is published at", "nothing is fetched"],
        ),
    ],
)
def test_wrong_uses_are_answered(
    arguments: list[str], words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    refused(ask("scoreboard", *arguments), *words)


@pytest.mark.usefixtures("alone")
def test_a_short_set_is_refused_with_its_length(tmp_path: Path) -> None:
    public_sets.kf_gins(tmp_path / "kf_gins", 60)
    refused(ask("scoreboard", "--data", str(tmp_path)), "no outage of 60 s fits")


@pytest.mark.usefixtures("alone")
def test_a_set_that_is_refused_does_not_take_the_others_along(tmp_path: Path) -> None:
    public_sets.kf_gins(tmp_path / "kf_gins")
    (tmp_path / "nclt").mkdir()
    (tmp_path / "nclt" / "ms25.csv").write_text("1,2\n")
    (tmp_path / "nclt" / "gps.csv").write_text("1,2\n")
    file = tmp_path / "results.json"
    answer = ask("scoreboard", "--data", str(tmp_path), "--keep", str(file))
    assert answer.exit_code == 2
    assert "kf_gins: car" in answer.stdout
    assert "ms25.csv: line 1 is '1,2'; accepted are 10 numbers a row" in answer.stderr
    kept = {one.key: one.row.outcome for one in kept_rows(file)}
    assert (kept["kf_gins", "INS Lab"], kept["nclt", "INS Lab"]) == ("run", "data not at hand")
