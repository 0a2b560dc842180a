"""``ins-lab sweep``: the syntax of --over, its table, files and JSON, and what Ctrl-C keeps."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from asking import ask, refused
from hypothesis import given
from hypothesis import strategies as st
from stopping import cannot_stop, stopped

from lab import Experiment
from lab.base.parameters.toml_file import toml_text
from lab.cli.app import CommandError
from lab.cli.sweep import parse_range, parse_values, split_values
from lab.sensors.cards import card

SLOW = ("--set", "trajectory.imu_rate=50")
NUMBERS = st.floats(1e-6, 1e6)


@given(low=NUMBERS, high=NUMBERS, count=st.integers(2, 200))
def test_a_range_has_its_ends_and_equal_distances(low: float, high: float, count: int) -> None:
    if low == high:
        return
    values = parse_range("a.b", f"{low!r}:{high!r}:{count}")
    assert len(values) == count
    assert (values[0], values[-1]) == (low, high)
    # Fourteen digits are kept: each value is off by 5e-14 of itself at most, and a difference has two.
    assert np.ptp(np.diff(values)) <= 2.1e-13 * max(low, high)


@given(low=NUMBERS, high=NUMBERS, count=st.integers(2, 200))
def test_a_logarithmic_range_has_its_ends_and_equal_ratios(low: float, high: float, count: int) -> None:
    if low == high:
        return
    values = parse_range("a.b", f" {low!r} : {high!r} : log : {count} ")
    assert len(values) == count
    assert (values[0], values[-1]) == (low, high)
    assert np.ptp(np.diff(np.log(values))) <= 2.1e-13 * max(1.0, abs(math.log(high / low)))


def test_a_range_has_the_numbers_that_a_person_would_write() -> None:
    assert parse_range("a", "0:1:11") == [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]
    assert parse_range("a", "0.01:100:log:5") == [0.01, 0.1, 1.0, 10.0, 100.0]
    assert parse_range("a", "2:1:3") == [2.0, 1.5, 1.0]


TEXTS = st.text(
    st.characters(categories=["L", "N"], include_characters=".-_/ "), min_size=1, max_size=8
).filter(lambda text: text == text.strip())


@given(
    st.lists(st.one_of(TEXTS, st.lists(TEXTS, min_size=1).map(lambda one: f"[{','.join(one)}]")), min_size=1)
)
def test_commas_separate_values_and_not_what_is_inside_a_list(values: list[str]) -> None:
    assert split_values("a.b", ",".join(values)) == values
    assert split_values("a.b", " , ".join(f'"{value}"' for value in values)) == values


@given(st.text(max_size=30))
def test_any_text_is_a_list_of_values_or_refused_in_words(text: str) -> None:
    """Whatever is written after --over, the answer is values, or a message."""
    for path in ("navigator.q_scale", "sensors.gps.outages", "navigator.model", "mission"):
        try:
            assert isinstance(parse_values(Experiment(), path, text), list)
        except ValueError as error:  # `SettingError` and `CommandError` are some
            assert "--over" in str(error)
    try:
        assert all(map(math.isfinite, parse_range("a.b", text)))
    except CommandError as error:
        assert str(error).startswith("--over a.b")


def test_colons_and_commas_in_quotes_may_be_in_the_name_of_a_mission() -> None:
    found = parse_values(Experiment(), "mission", 'C:\\flight.csv,"a, b.csv"')
    assert found == ["C:\\flight.csv", "a, b.csv"]


def test_values_are_read_as_by_set() -> None:
    assert parse_values(Experiment(), "navigator.states", "15,21") == [15, 21]
    assert parse_values(Experiment(), "navigator.smoother", "true, false") == [True, False]
    assert parse_values(Experiment(), "sensors.gps.outages", "[[60, 70], [80, 90]],[]") == [
        [[60, 70], [80, 90]],
        [],
    ]


def test_a_swept_card_is_that_of_ins_lab_run() -> None:
    """With what --set says, over the card; and with --no-assumed."""
    same = ("--set", "navigator.alignment=10", "--seed", "3", "--no-assumed", *SLOW, "--json")
    swept = json.loads(
        ask("sweep", "los_angeles", "--over", "card=BMI270,STIM300", "--seeds", "1", *same).stdout
    )
    for name, point in zip(("BMI270", "STIM300"), swept["points"], strict=True):
        alone = json.loads(ask("run", "los_angeles", "--card", name, *same).stdout)
        assert point["values"] == {"card": name}
        result = Experiment.from_toml(toml_text(alone["settings"])).run()
        # Every third sample is on the path: 3 has no factor in common with the 50 from fix to fix.
        errors = [result.errors[kind].to_numpy()[::3] for kind in ("position", "velocity", "attitude")]
        sizes = [np.linalg.norm(errors[0], axis=1), np.linalg.norm(errors[1], axis=1), errors[2][:, 2]]
        for kind, size in zip(("position", "velocity", "heading"), sizes, strict=True):
            assert point[kind]["rms"] == pytest.approx(np.sqrt(np.mean(size**2)), rel=1e-9)
        assert point["nees"]["mean"] == pytest.approx(alone["nees"]["mean"], rel=1e-9)
        assert point["nees"]["expected"] == alone["nees"]["expected"]
        assert alone["settings"]["navigator"]["alignment"] == 10


def test_a_given_p0_does_not_keep_a_card_from_bringing_its_filter(tmp_path: Path) -> None:
    """As with ins-lab run, --set comes after the card, which leaves a filter with a given P0 as it is."""
    P0 = [1.0] * 3 + [0.1] * 3 + [1e-4] * 3 + [1e-6] * 3 + [1e-4] * 3 + [1e-6] * 6
    same = ("--set", f"navigator.p0={P0}", "--seed", "3", *SLOW)
    out = tmp_path / "cards.nc"
    over = ("--over", "card=STIM300", "--seeds", "1", "--out", str(out))
    swept = json.loads(ask("sweep", "los_angeles", *over, *same, "--json").stdout)
    alone = json.loads(ask("run", "los_angeles", "--card", "STIM300", *same, "--json").stdout)
    assert alone["settings"]["navigator"]["states"] == 21
    assert swept["points"][0]["nees"]["mean"] == pytest.approx(alone["nees"]["mean"], rel=1e-9)
    with xr.open_dataset(out) as found:
        assert Experiment.from_toml(found.attrs["settings"]).navigator.p0 == tuple(P0)


def test_its_table_has_a_row_for_each_combination_and_both_files_all_runs(tmp_path: Path) -> None:
    sweep = (
        "sweep", "--over", "mission=los_angeles,montreal", "--over", "navigator.q_scale=0.1:10:log:2",
        "--seeds", "2", *SLOW,
    )  # fmt: skip
    answer = ask(*sweep, "--out", str(tmp_path / "sweep.nc"))
    assert answer.exit_code == 0, answer.output
    header, *rows = answer.stdout.splitlines()
    assert header.split()[:2] == ["mission", "q_scale"]
    assert [row.split()[:2] for row in rows] == [
        ["los_angeles", "0.1"],
        ["los_angeles", "10"],
        ["montreal", "0.1"],
        ["montreal", "10"],
    ]
    assert all(row.split()[-1] == "2" for row in rows)
    assert ask(*sweep, "--out", str(tmp_path / "sweep.csv")).stdout == answer.stdout
    with xr.open_dataset(tmp_path / "sweep.nc") as found:
        there = found.sel(mission="montreal", q_scale=10.0)
        position = np.sqrt((there.rms[:, :3] ** 2).sum("quantity").mean("seed"))
        assert f" {float(position):.3f} " in rows[-1]
        assert f"{float(there.nees.mean()):.2f} / 15" in rows[-1]
        nees = found.nees.values.reshape(-1)
    table = pd.read_csv(tmp_path / "sweep.csv", comment="#")
    assert list(table.columns[:3]) == ["mission", "q_scale", "seed"]
    assert np.allclose(table["nees"], nees, rtol=1e-11)
    refused(ask(*sweep, "--out", str(tmp_path / "sweep.csv")), "exists already", "--force")


def test_what_cards_assume_and_lack_is_said() -> None:
    answer = ask("sweep", "los_angeles", "--over", "card=BMI270,STIM300", "--seeds", "1", *SLOW)
    loaded = Experiment()
    card("BMI270").load(loaded)
    # The sheet of the other one is complete.
    assert answer.stdout.splitlines()[-1] == f"- BMI270: {loaded.sensors.card_remark()}"
    assert "- STIM300" not in answer.stdout
    same = ("--card", "BMI270", "--over", "navigator.q_scale=1", "--seeds", "1")
    one = json.loads(ask("sweep", "los_angeles", *same, *SLOW, "--json").stdout)
    assert one["remarks"] == [loaded.sensors.card_remark()]


def test_runs_without_a_result_are_shown_with_the_reason() -> None:
    answer = ask(
        "sweep", "los_angeles", "--over", "navigator.model=phi,nonlinear", "--set", "navigator.smoother=true",
        "--seeds", "1", *SLOW,
    )  # fmt: skip
    assert answer.exit_code == 0
    last = next(line for line in answer.stdout.splitlines() if line.startswith("nonlinear"))
    assert last.split()[-1] == "0"
    assert "- 1 of 2 runs: navigator.smoother" in answer.stdout


@cannot_stop
@pytest.mark.parametrize("ending", ["csv", "nc"])
def test_ctrl_c_shows_and_writes_the_runs_that_are_done(ending: str, tmp_path: Path) -> None:
    out = tmp_path / f"sweep.{ending}"
    over = ("--over", "navigator.q_scale=0.1:10:log:11", "--seeds", "500")
    answer = stopped("sweep", "los_angeles", *over, *SLOW, "--json", "--out", str(out))
    assert answer.returncode == 130, answer.stderr
    assert "Traceback" not in answer.stderr
    facts = json.loads(answer.stdout)
    assert 0 < facts["done"] < facts["wanted"] == 5500
    assert sum(point["runs"] for point in facts["points"]) == facts["done"]
    assert f"{5500 - facts['done']} of 5500 runs: not done, because the sweep was stopped" in facts["refused"]
    assert answer.stderr.splitlines()[-1] == f"ins-lab: stopped after {facts['done']:,} of 5,500 runs"
    if ending == "csv":
        known = pd.read_csv(out, comment="#")["nis"].notna().sum()
    else:
        with xr.open_dataset(out) as found:
            known = int(found.nis.notnull().sum())
    assert known == facts["done"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], ["--over"]),
        (["montreal"], ["--over"]),
        (["--over", "navigator.q_scale=1,2"], ["MISSION", "--over mission=NAME"]),
        (["montrael", "--over", "navigator.q_scale=1,2"], ["Did you mean montreal?"]),
        (["montreal", "--over", "navigator.q_scale"], ["accepted is PATH=A,B,C", "LOW:HIGH:log:N"]),
        (["montreal", "--over", "navigator.q_scale="], ["accepted is PATH=A,B,C"]),
        (["montreal", "--over", "=1,2"], ["accepted is PATH=A,B,C"]),
        (["montreal", "--over", "navigator.q_scal=1,2"], ["Did you mean navigator.q_scale?"]),
        (["montreal", "--over", "navigator.q_scale=1,,2"], ["a value between commas is empty"]),
        (["montreal", "--over", "navigator.q_scale=1,1"], ["1 is in the list twice"]),
        (["montreal", "--over", "navigator.q_scale=a,b"], ["'a'", "a number from"]),
        (["montreal", "--over", "navigator.q_scale=nan"], ["'nan'", "a number from"]),
        (["montreal", "--over", "navigator.q_scale=0.1:10"], ["whole number N"]),
        (["montreal", "--over", "navigator.q_scale=0.1:10:log"], ["whole number N"]),
        (["montreal", "--over", "navigator.q_scale=1:2:3:4:5"], ["accepted is PATH"]),
        (["montreal", "--over", "navigator.q_scale=0.1:10:lin:3"], ["lin is no kind of range"]),
        (["montreal", "--over", "navigator.q_scale=0:10:log:3"], ["LOW and HIGH above 0"]),
        (["montreal", "--over", "navigator.q_scale=0.1:10:1"], ["2 to 10,000 values"]),
        (["montreal", "--over", "navigator.q_scale=0.1:10:99999999"], ["2 to 10,000 values"]),
        (["montreal", "--over", "navigator.q_scale=1:1:3"], ["two different numbers"]),
        (["montreal", "--over", "navigator.q_scale=1:1e999:3"], ["two different numbers"]),
        (["montreal", "--over", "navigator.model=phi:psi:3"], ["one of phi"]),
        (["montreal", "--over", "navigator=1,2"], ["is a group of settings"]),
        (["montreal", "--over", "seed=1,2"], ["every sweep runs over seeds", "--seeds N"]),
        (["montreal", "--over", "navigator.q_scale=1,2", "--over", "navigator.q_scale=3"], ["there twice"]),
        (
            ["montreal", "--over", "navigator.q_scale=1:2:9999", "--over", "navigator.r_scale=1:2:9999"],
            ["99,980,001"],
        ),
        (["montreal", "--over", "navigator.q_scale=1:2:9999", "--seeds", "1000"], ["9,999,000", "1,000,000"]),
        (["montreal", "--over", "navigator.q_scale=1,2", "--set", "navigator.q_scale=3"], ["one of the two"]),
        (["montreal", "--over", "card=ADIS1647"], ["Did you mean ADIS16470?"]),
        (["montreal", "--over", "card=STIM300,stim300"], ["'STIM300' is in the list twice"]),
        (["montreal", "--over", "card=STIM300", "--card", "BMI270"], ["--card", "one of the two"]),
        (["montreal", "--over", "mission=los_angeles"], ["--over mission does not name it"]),
        (["--over", "mission=montreal,montrael"], ["Did you mean montreal?"]),
        (["--over", "mission=montreal,montreal"], ["'montreal' is in the list twice"]),
        (["montreal", "--over", "navigator.filter_rate=10,20", "--fast"], ["accepted without fast"]),
        (["montreal", "--over", "navigator.q_scale=1,2", "--out", "sweep.txt"], ["ending in .nc or .csv"]),
        (["montreal", "--over", "navigator.q_scale=1,2", "--out", "nowhere/a.nc"], ["no folder nowhere"]),
        (["montreal", "--over", "navigator.q_scale=1,2", "--seeds", "0"], ["--seeds"]),
        (["montreal", "--over", "navigator.q_scale=1,2", "--workers", "-1"], ["--workers"]),
        (["montreal", "--over", "navigator.q_scale=1,2", "--no-assumed"], ["needs --card"]),
    ],
)
def test_what_is_wrong_is_answered_with_what_is_accepted(arguments: list[str], words: list[str]) -> None:
    refused(ask("sweep", *arguments), *words)
