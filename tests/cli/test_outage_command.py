"""``ins-lab outage``: the table, JSON, a file, and what is done after Ctrl-C."""

from __future__ import annotations

import json
import signal
from pathlib import Path
from typing import Any

import pytest
import xarray as xr
from asking import ask, refused
from sensor_logs import tables, write

from lab.base.progress import Progress
from lab.experiment.ensembles import outages

COMMAND = (
    *("outage", "los_angeles", "--set", "trajectory.imu_rate=50", "--seconds", "20", "--seeds", "4"),
    *("--cards", "STIM300, BMI088"),
)


def test_a_row_for_each_card_with_its_decision_and_what_limits_it() -> None:
    answer = ask(*COMMAND, "--wish", "8")
    assert answer.exit_code == 0, answer.output
    header, first, second, *rest = answer.stdout.splitlines()
    assert header.split("  ")[0] == "card"
    assert header.endswith("within 8 m")
    assert first.startswith("STIM300")
    assert second.startswith("BMI088")
    assert second.endswith("fail")
    said = "\n".join(rest)
    assert "matched to its sensors" in said
    assert "72 give one" in said


def test_json_and_a_file_have_the_same_figures(tmp_path: Path) -> None:
    out = tmp_path / "outages.nc"
    answer = ask(*COMMAND, "--json", "--out", str(out))
    form = json.loads(answer.stdout)
    assert (form["schema"], form["mission"], form["seconds"]) == ("ins-lab outages", "los_angeles", 20)
    assert [row["card"] for row in form["rows"]] == ["STIM300", "BMI088"]
    assert form["rows"][0]["to_m"] is None
    with xr.open_dataset(out, group="outages") as data:
        assert data.sizes["run"] == 4
        assert float(data.horizontal_95[0, -1]) == pytest.approx(form["rows"][0]["horizontal_95_m"])
    refused(ask(*COMMAND, "--out", str(out)), "exists already")
    assert ask(*COMMAND, "--out", str(out), "--force").exit_code == 0


def test_fast_and_exact_are_close() -> None:
    fast, exact = (
        json.loads(ask(*COMMAND, "--json", *more).stdout)["rows"][1]["horizontal_95_m"]
        for more in ((), ("--exact",))
    )
    assert fast != exact
    assert fast == pytest.approx(exact, rel=0.02)


def test_a_log_withholds_its_fixes(tmp_path: Path) -> None:
    folder = write(tmp_path / "drive", tables(10, 150))
    answer = ask("outage", str(folder), "--seconds", "20", "--set", "sensors.gyro.bias_sigma=0.3")
    assert answer.exit_code == 0, answer.output
    assert "withheld fixes" in answer.stdout
    assert "unknown for a log" in answer.stdout


def test_wrong_options_are_answered(tmp_path: Path) -> None:
    refused(ask("outage", "nowhere"), "nowhere")
    refused(ask("outage", "los_angeles", "--cards", "BMI888"), "there is no card", "BMI088")
    refused(ask("outage", "los_angeles", "--cards", ","), "there is no card ''")
    refused(ask("outage", "los_angeles", "--seconds", "500"), "does not fit into the flight")
    refused(ask("outage", "los_angeles", "--seconds", "0"), "accepted is a number of 1 or more")
    refused(ask("outage", "los_angeles", "--wish", "-3"), "wish: -3.0", "above 0")
    refused(ask("outage", "los_angeles", "--out", str(tmp_path / "a.csv")), "ending in .nc")
    assert ask("outage", "los_angeles", "--seeds", "0").exit_code == 2


def test_ctrl_c_prints_what_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    real = outages.outage

    def interrupted(*arguments: Any, progress: Progress, **options: Any) -> Any:
        def tell(words: str, fraction: float) -> None:
            progress(words, fraction)
            signal.raise_signal(signal.SIGINT)

        return real(*arguments, progress=tell, **options)

    monkeypatch.setattr(outages, "outage", interrupted)
    answer = ask(*COMMAND, "--seed", "700", "--workers", "1")
    assert answer.exit_code == 130
    assert "stopped" in answer.stderr
    assert "STIM300" in answer.stdout


def test_ctrl_c_before_the_first_run_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    real = outages.outage

    def interrupted(*arguments: Any, **options: Any) -> Any:
        signal.raise_signal(signal.SIGINT)
        return real(*arguments, **options)

    monkeypatch.setattr(outages, "outage", interrupted)
    answer = ask(*COMMAND, "--seed", "900")
    assert answer.exit_code == 130
    assert answer.stdout == ""
    assert "before the first" in answer.stderr
