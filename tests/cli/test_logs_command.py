"""Commands on sensor logs: the folder is the mission, and what was repaired and assumed is said."""

from __future__ import annotations

import json

import pytest
from asking import ask, refused
from sensor_logs import tables, write

from lab.missions.catalogue import OWN_FOLDER_VARIABLE


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    """Return a folder of missions with a log, the same without reference, and a broken one."""
    folder = tmp_path_factory.mktemp("own")
    flown = tables(60, 90)
    repeated = flown._replace(imu=flown.imu.repeat([2, *[1] * (len(flown.imu) - 1)], axis=0))
    write(folder / "drive", repeated, 'title = "To work"')
    write(folder / "blind", flown)
    (folder / "blind" / "ref.csv").unlink()
    write(folder / "broken", flown)
    (folder / "broken" / "imu.csv").write_text("t_s\n1\n")
    return folder


@pytest.fixture(autouse=True)
def listed(own, monkeypatch):
    monkeypatch.setenv(OWN_FOLDER_VARIABLE, str(own))


def test_logs_are_listed(own):
    answer = ask("missions")
    assert answer.exit_code == 0
    assert "To work" in answer.stdout
    assert "sensor log" in answer.stdout
    assert "mission broken left out" in answer.stderr
    assert "imu.csv" in answer.stderr
    (facts,) = [entry for entry in json.loads(ask("missions", "--json").stdout) if entry["name"] == "drive"]
    assert abs(facts["duration_s"] - 30) < 0.1


def test_a_run_says_what_was_repaired_and_assumed(own):
    for mission in ("drive", str(own / "drive"), str(own / "drive" / "log.toml")):
        answer = ask("run", mission, "--seed", "4")
        assert answer.exit_code == 0, answer.stderr
        assert "position north" in answer.stdout
        assert "- 1 IMU sample with the time of the one before was dropped." in answer.stdout
        assert "- Levelled in motion" in answer.stdout
        assert "seed has no effect" in answer.stdout
        assert "Verdict (1 run, innovations only)" in answer.stdout
    facts = json.loads(ask("run", "drive", "--json").stdout)
    assert "mean" in facts["summary"][0]
    assert any("Levelled in motion" in remark for remark in facts["remarks"])


def test_a_run_without_reference_shows_innovations(own, tmp_path):
    answer = ask("run", "blind", "--out", str(tmp_path / "blind.nc"))
    assert answer.exit_code == 0, answer.stderr
    assert "p white" in answer.stdout
    assert "There is no reference" in answer.stdout
    assert (tmp_path / "blind.nc").is_file()
    facts = json.loads(ask("run", "blind", "--json").stdout)
    assert facts["summary"] is None


def test_models_are_compared_and_seeds_and_budget_refused(own):
    answer = ask("compare", "blind", "--models", "phi")
    assert answer.exit_code == 0, answer.stderr
    assert "/ 6" in answer.stdout
    refused(
        ask("compare", "blind", "--models", "phi", "--seeds", "3"), "runs of a sensor log", "accepted is one"
    )
    refused(ask("budget", "blind"), "The true flight and the true biases", "the error budget needs")
    refused(ask("run", "broken"), "imu.csv", "1 rows; accepted are at least 10")


def test_a_stretch_of_a_log_is_given_in_the_clock_of_its_file(own):
    answer = ask("run", "drive", "--from", "1065", "--to", "1085", "--vehicle", "aeroplane")
    assert answer.exit_code == 0, answer.stderr
    assert "- The navigated part is 1065 to 1085 s of the file's clock, as requested." in answer.stdout
    assert "- Time 0 is 1065 s in the clock of the file" in answer.stdout
    settings = json.loads(ask("run", "drive", "--from", "1065", "--heading", "20", "--json").stdout)[
        "settings"
    ]
    assert settings["navigator"]["log_from"] == 1065
    assert settings["navigator"]["initial_heading"] == 20
    refused(ask("run", "drive", "--from", "5", "--to", "30"), "within 1060 to 1090 s of the file's clock")
    refused(ask("run", "drive", "--vehicle", "bicycle"), "vehicle", "aeroplane, car, boat, copter")
    refused(ask("run", "montreal", "--from", "5"), "--from", "for sensor logs")
