"""``ins-lab run``: the table, the verdict, the JSON, where settings come from, the file written."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

from asking import ask, refused
from polar_flights import over_the_pole

from lab.missions import mission
from lab.motion.recordings.flight_csv import write_flight_csv


def test_a_run_shows_its_errors_as_an_aligned_table() -> None:
    answer = ask("run", "los_angeles", "--seed", "5")
    assert answer.exit_code == 0
    table_of_errors, _, verdict = answer.stdout.partition("\n\n")
    assert verdict.startswith("Verdict (1 run, errors and innovations): Consistent")
    header, *rows = table_of_errors.splitlines()
    assert header.split()[:4] == ["quantity", "unit", "rms", "max"]
    ends = {len(line) for line in (header, *rows)}
    assert len(ends) == 1, "the last column of numbers is not aligned to the right"


def test_a_run_as_json_holds_what_repeats_it(tmp_path: Path) -> None:
    arguments = ["run", "los_angeles", "--set", "sensors.gyro.noise_density=0.02", "--seed", "5", "--json"]
    first = json.loads(ask(*arguments).stdout)
    assert first["mission"] == "los_angeles"
    assert first["seed"] == 5
    assert first["settings"]["sensors"]["gyro"]["noise_density"] == [0.02] * 3
    assert all(row["rms"] <= row["max"] for row in first["summary"])
    assert (first["schema_version"], first["out"], first["budget"]) == (1, None, None)
    assert json.loads(ask(*arguments).stdout) | {"made": first["made"]} == first
    with_budget = json.loads(ask(*arguments, "--with", "budget").stdout)
    assert with_budget.pop("budget")["quantities"][0]["quantity"] == "position east"
    assert with_budget | {"made": first["made"]} == {
        name: value for name, value in first.items() if name != "budget"
    }
    other = json.loads(ask(*arguments[:-2], "6", "--json").stdout)
    assert other["summary"] != first["summary"]


def test_a_run_says_what_is_wrong_with_its_filter_and_what_to_try() -> None:
    arguments = ("run", "los_angeles", "--set", "navigator.p0_scale=0.1", "--set", "navigator.q_scale=0.1")
    text = ask(*arguments).stdout.partition("\n\n")[2]
    assert re.search(r"Q is (9\.\d|10|11) times too small\. \(1 more\)", text)
    assert "P₀ is about" in text
    assert text.count("Try: Multiply") == 2
    verdict = json.loads(ask(*arguments, "--json").stdout)["verdict"]
    assert verdict["consistent"] is False
    assert [finding["quantity"] for finding in verdict["findings"]] == ["Q", "P0"]
    assert verdict["headline"] in text


def test_settings_come_from_the_file_then_from_set_then_from_the_options(tmp_path: Path) -> None:
    config = tmp_path / "settings.toml"
    config.write_text(
        'mission = "montreal"\nseed = 3\n[sensors.gps]\nperiod = 2.0\n[navigator]\nr_scale = 4\n'
    )
    answer = ask(
        *(
            "run",
            "los_angeles",
            "--config",
            str(config),
            "--set",
            "navigator.r_scale=9",
            "--seed",
            "8",
            "--json",
        )
    )
    settings = json.loads(answer.stdout)["settings"]
    assert settings["mission"] == "los_angeles"
    assert settings["seed"] == 8
    assert settings["sensors"]["gps"]["period"] == 2.0
    assert settings["navigator"]["r_scale"] == 9


def test_a_run_takes_the_sensors_of_a_card_then_those_of_set() -> None:
    flags = ["--card", "STIM300", "--set", "sensors.gyro.flicker=3", "--json"]
    sensors = json.loads(ask("run", "los_angeles", *flags).stdout)["settings"]["sensors"]
    assert sensors["gyro"]["noise_density"] == [0.0025] * 3
    assert sensors["gyro"]["flicker"] == [3.0] * 3
    assert sensors["gyro"]["range"] > 150  # of which the card has no source: off


def test_a_flight_csv_is_a_mission_too(tmp_path: Path) -> None:
    source = mission("los_angeles").recording_path
    copy = shutil.copy(source, tmp_path / "mine.csv.gz")
    named = json.loads(ask("run", "los_angeles", "--json").stdout)
    bare = json.loads(ask("run", str(copy), "--json").stdout)
    assert bare["summary"] == named["summary"]


def test_a_folder_with_one_mission_is_that_mission(tmp_path: Path) -> None:
    source = mission("los_angeles")
    assert source.path is not None
    for path in (source.path, source.recording_path):
        shutil.copy(path, tmp_path)
    assert ask("run", str(tmp_path), "--json").exit_code == 0
    shutil.copy(source.path, tmp_path / "second.toml")
    refused(ask("run", str(tmp_path)), "second.toml", "los_angeles.toml")


def test_a_broken_flight_is_named_with_row_and_column(tmp_path: Path) -> None:
    flight = tmp_path / "flight.csv"
    flight.write_text("time_s,latitude_deg\n0,1\n")
    refused(ask("run", str(flight)), "flight.csv", "longitude_deg")


def test_the_result_is_written_once_and_replaced_only_when_told(tmp_path: Path) -> None:
    import xarray

    out = tmp_path / "run.nc"
    answer = ask("run", "los_angeles", "--out", str(out), "--json")
    assert answer.exit_code == 0, answer.stderr
    assert json.loads(answer.stdout)["out"] == str(out)
    with xarray.open_datatree(out) as tree:
        assert tree.groups
    before = out.read_bytes()
    refused(ask("run", "los_angeles", "--out", str(out)), "exists already", "--force")
    assert out.read_bytes() == before
    assert ask("run", "los_angeles", "--out", str(out), "--force", "--seed", "9").exit_code == 0
    assert out.read_bytes() != before
    assert [path.name for path in tmp_path.iterdir()] == ["run.nc"]


def test_a_flight_over_the_pole_runs(tmp_path: Path) -> None:
    path = tmp_path / "pole.csv"
    write_flight_csv(path, over_the_pole(3.0, duration=60.0))
    answer = ask("run", str(path), "--json")
    assert answer.exit_code == 0, answer.output
    largest = {row["quantity"]: row["max"] for row in json.loads(answer.stdout)["summary"]}
    assert max(largest[f"position {axis}"] for axis in ("east", "north", "up")) < 5
