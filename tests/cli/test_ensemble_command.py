"""``ins-lab ensemble``: its table and JSON are those of the ensemble; Ctrl-C keeps what is done."""

from __future__ import annotations

import contextlib
import json
import threading
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from asking import ask, refused
from stopping import cannot_stop, stopped

from lab import Experiment, run_ensemble
from lab.experiment.ensembles.seeds import at_fast_rate

FEW = ("ensemble", "los_angeles", "--set", "trajectory.imu_rate=50", "--seed", "5")
OUTAGE = ("--set", "sensors.gps.outages=[[40, 60]]")


def experiment() -> Experiment:
    return Experiment(mission="los_angeles", seed=5).update({"trajectory.imu_rate": 50.0})


def test_it_shows_errors_consistency_and_the_verdict(tmp_path: Path) -> None:
    out = tmp_path / "runs.nc"
    answer = ask(*FEW, *OUTAGE, "--seeds", "3", "--out", str(out), "--workers", "1")
    assert answer.exit_code == 0, answer.output
    same = experiment()
    same.set("sensors.gps.outages", [(40.0, 60.0)])
    ensemble = run_ensemble(same, 3)
    lines = answer.stdout.splitlines()
    assert lines[0].startswith("los_angeles: 3 runs in ")
    assert "per second" in lines[0]
    heading = next(line.split() for line in lines if line.startswith("attitude heading"))
    assert heading[2:4] == ["°", f"{ensemble.coverage['rms'].iloc[8]:.3f}"]
    ends = np.sqrt(np.mean(ensemble.at_outage_ends.astype(float) ** 2, axis=0))
    assert heading[-2:] == [f"{ends[0, 8]:.3f}", f"{ends[1, 8]:.3f}"]
    assert f"ends of the GPS outages: {np.hypot(*ends[0, :2]):.3f} m rms" in answer.stdout
    assert f"NEES: {ensemble.at_fixes.mean_of_all('nees'):.2f} / 15" in lines
    assert f"NIS: {ensemble.at_fixes.mean_of_all('nis'):.2f} / 6" in lines
    assert f"Verdict (3 runs, errors and innovations): {ensemble.verdict.headline}" in answer.stdout
    with xr.open_datatree(out) as found:
        assert found["runs"].seed.values.tolist() == [5, 6, 7]
    refused(ask(*FEW, "--seeds", "3", "--out", str(out)), "exists already", "--force")
    assert ask(*FEW, "--seeds", "2", "--out", str(out), "--force", "--json").exit_code == 0
    with xr.open_datatree(out) as found:
        assert found["runs"].seed.values.tolist() == [5, 6]


def test_json_is_that_of_the_ensemble_with_what_the_command_adds() -> None:
    found = json.loads(ask(*FEW, "--seeds", "2", "--fast", "--json").stdout)
    ensemble = run_ensemble(at_fast_rate(experiment()), 2)
    added = {name: found.pop(name) for name in ("wanted", "seconds", "out")}
    assert added["wanted"] == 2
    assert added["seconds"] > 0
    assert added["out"] is None
    same = json.loads(json.dumps(ensemble.to_dict(ensemble.with_advice_tried())))
    assert found | {"made": ""} == same | {"made": ""}
    assert found["changed"]["navigator.filter_rate"] == 20.0


def test_what_a_card_assumes_is_said() -> None:
    answer = ask(*FEW, "--seeds", "1", "--card", "BMI270")
    assert answer.stdout.startswith("los_angeles: 1 run in ")
    assert "- Assumed as typical of the grade" in answer.stdout


def test_an_algorithm_of_ones_own_is_run_with_many_seeds(tmp_path: Path) -> None:
    from document_files import algorithm

    algorithm(tmp_path / "my_filter.py")
    own = f"{tmp_path / 'my_filter.py'}:MyFilter"
    found = json.loads(ask(*FEW, "--seeds", "2", "--algorithm", own, "--json").stdout)
    assert found["algorithm"] == "MyFilter"
    assert found["runs"] == 2


@cannot_stop
@pytest.mark.parametrize("as_json", [True, False])
def test_ctrl_c_shows_the_runs_that_are_done(as_json: bool, tmp_path: Path) -> None:
    out = tmp_path / "runs.nc"
    answer = stopped(*FEW, "--seeds", "100000", "--out", str(out), *(["--json"] if as_json else []))
    assert answer.returncode == 130, answer.stderr
    assert "Traceback" not in answer.stderr
    with xr.open_datatree(out) as found:
        done = found["runs"].seed.size
        assert found["runs"].seed.values.tolist() == list(range(5, 5 + done))
    assert answer.stderr.splitlines()[-1] == f"ins-lab: stopped after {done} of 100,000 runs"
    if as_json:
        facts = json.loads(answer.stdout)
        assert (facts["wanted"], facts["runs"], facts["seeds"]) == (100_000, done, [[5, 4 + done]])
    else:
        assert answer.stdout.startswith(f"los_angeles: {done} of 100,000 runs in ")
        assert "Verdict (" in answer.stdout


def test_ctrl_c_before_the_first_run_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    pressed = threading.Event()
    pressed.set()
    monkeypatch.setattr("lab.cli.ensemble.interrupted", lambda: contextlib.nullcontext(pressed))
    answer = ask(*FEW, "--seeds", "3")
    assert answer.exit_code == 130
    assert answer.stdout == ""
    assert "stopped before the first of 3 runs was done" in answer.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], ["MISSION"]),
        (["montrael"], ["Did you mean montreal?"]),
        (["montreal", "--seeds", "0"], ["--seeds", "greater than or equal to 1"]),
        (["montreal", "--seeds", "1.5"], ["--seeds", "integer"]),
        (["montreal", "--seeds", "99999999999"], ["--seeds", "1000000"]),
        (["montreal", "--seed", "4294967295", "--seeds", "300"], ["from 0 to 4294967295"]),
        (["montreal", "--workers", "0"], ["--workers", "greater than or equal to 1"]),
        (["montreal", "--out", "runs.csv"], ["--out runs.csv", "ending in .nc"]),
        (["montreal", "--out", "nowhere/runs.nc"], ["no folder nowhere"]),
        (["montreal", "--no-assumed"], ["needs --card"]),
        (["montreal", "--fast=2"], ["--fast", "does not take a value"]),
        (["montreal", "--algorithm", "nowhere.py:A", "--seeds", "2"], ["nowhere.py", "no such file"]),
    ],
)
def test_what_is_wrong_is_answered_with_what_is_accepted(arguments: list[str], words: list[str]) -> None:
    refused(ask("ensemble", *arguments), *words)
