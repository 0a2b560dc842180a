"""The table of findings: each row is complete English, is used, and no finding is worded outside it."""

from __future__ import annotations

import ast
import re
from itertools import product
from pathlib import Path
from string import Formatter

import numpy as np
import pytest

import lab.analysis
from lab.analysis.verdicts import advice_table, finding_table
from lab.analysis.verdicts.advice_table import ADVICE
from lab.analysis.verdicts.finding import Advice, Change, Wording, judge_size
from lab.analysis.verdicts.finding_table import EXPLANATIONS, FINDING_NAMES, FINDINGS, SENSORS, VALUES
from lab.analysis.verdicts.hypotheses import R_CHANNELS
from lab.analysis.verdicts.imu_causes import CAUSES
from lab.analysis.verdicts.sums import Squares
from lab.base.parameters.setting_error import SettingError
from lab.data.checks.imu_axes import ImuAxes
from lab.run.experiment_settings import ExperimentSettings

TABLES = {Path(one.__file__).name for one in (advice_table, finding_table)}
TREES = {
    path.name: ast.parse(path.read_text("utf-8")) for path in Path(lab.analysis.__file__).parent.rglob("*.py")
}
NUMBERS = (
    *("root", "factor", "multiply", "size", "scale", "begin", "end", "seconds", "latency", "length", "sigma"),
    *("time", "percent", "expected", "part", "degrees", "windows", "ratio", "without", "nis"),
    *("before", "after"),
)
WORDS = {
    "kind": ("position", "velocity down"),
    "axis": ("north",),
    "aid": ("height", "airspeed"),
    "sensor": SENSORS,
    "group": ("attitude", "accelerometer bias"),
    "block": ("gyro", "accelerometer bias"),
    "matrix": ("q", "p0"),
    "quantity": ("NEES",),
    "direction": ("too small", "too large"),
    "side": ("late", "early"),
    "cause": tuple(CAUSES),
    "explanation": ("a gyro misalignment of 3°",),
    "rival": ("R 3 × too small",),
    "values": tuple(text.format(group="attitude") for text in VALUES.values()),
    "unit": ("mg",),
    "model": ("phi",),
    "setting": ("barometer",),
    "switch": ("navigator.estimate_misalignments",),
    "settings": ("sensors.gyro.misalignment to 3",),
    "states": ("the misalignments",),
    "sigmas": ("1 % of the gyros",),
    "p0": ([1.0],),
    "arm": ([0.5, 0.0, 0.0],),
    "place": ("1 m right",),
    "since": ("30 s", "the start"),
    "channel": ("the forward gyro",),
    "first": ("forward",),
    "second": ("right",),
    "last": ("1 s early",),
    "axes": ("forward", "forward and the right"),
    "effect": ("The errors are 2 × as large as the filter says.",),
    "which": ("The forward axis of gyros and accelerometers has the wrong sign.",),
    "remedy": (ImuAxes(np.eye(3), np.diag((-1.0, 1.0, 1.0))).remedy,),
    "ranges": ("±2000 °/s",),
    "rejected": (7,),
    "offered": (100,),
    "number": (7,),
    "fixes": (100,),
    "back": (-90,),
}
"""What may stand in each field. A row with a field that is not here is not complete."""
FIELDS = WORDS | dict.fromkeys(NUMBERS, (2.0, 0.5))


def fields(*texts: str) -> list[str]:
    return sorted({name for text in texts for _, name, _, _ in Formatter().parse(text) if name})


def filled(*texts: str) -> list[dict[str, object]]:
    """Return all that the fields of some texts may be."""
    names = fields(*texts)
    return [dict(zip(names, chosen, strict=True)) for chosen in product(*(FIELDS[name] for name in names))]


def check_english(text: str) -> None:
    assert text[0].isupper() or text[0].isdigit(), text
    assert text.endswith("."), text
    assert not re.search(r"[{}]|  |\.\.", text), text
    assert not re.search(r"\b[Aa] [aeiou]|\b[Aa]n [^aeiouAEIOMR]", text), text


def parts(changes: tuple[Change, ...]) -> list[str]:
    """Return the texts of changes that may have fields."""
    return [text for one in changes for text in (one.path, one.value) if isinstance(text, str)]


def every_advice() -> list[Advice]:
    return [*ADVICE.values(), *(Advice(row.advice, row.changes) for row in FINDINGS.values() if row.advice)]


@pytest.mark.parametrize("name", FINDINGS)
def test_a_row_is_complete_english_with_all_fields_filled(name: str) -> None:
    row = FINDINGS[name]
    for one in filled(row.quantity, row.sentence, row.advice, "{direction}", *parts(row.changes)):
        finding = row.finding(2.0, "", **one)
        check_english(finding.sentence)
        check_english(finding.advice or "None.")
        assert "{" not in f"{finding.quantity}{finding.changes}"


@pytest.mark.parametrize("advice", every_advice(), ids=lambda one: one.text[:40])
def test_advice_names_settings_that_exist(advice: Advice) -> None:
    experiment = ExperimentSettings()
    for one in filled(advice.text, *parts(advice.changes)):
        text, changes = advice.filled(**one)
        check_english(text)
        named = re.findall(r"\b(?:navigator|sensors)(?:\.[a-z]\w*)+", text)
        for path in [*named, *(change.path for change in changes)]:
            experiment.get(path)  # raises a SettingError that lists those that exist


def test_a_setting_that_does_not_exist_is_found() -> None:
    with pytest.raises(SettingError):
        ExperimentSettings().get("navigator.estimate_everything")


@pytest.mark.parametrize("name", [*CAUSES, "GPS latency", "GPS lever arm", "GPS correlation"])
def test_an_explanation_has_its_article(name: str) -> None:
    text = EXPLANATIONS[name].format(size="2", percent="3", degrees="4")
    check_english(f"Seen is {text}.")
    assert text.startswith(("a ", "an "))


def strings(tree: ast.AST) -> set[str]:
    return {
        one.value for one in ast.walk(tree) if isinstance(one, ast.Constant) and isinstance(one.value, str)
    }


def test_every_row_is_used() -> None:
    used = set().union(*(strings(tree) for name, tree in TREES.items() if name not in TABLES))
    rows = (*advice_table.TABLES["findings"].values(), *advice_table.TABLES["foreign"].values())
    within = {row["advised"] for row in rows if "advised" in row} | strings(TREES["advice_table.py"])
    assert set(FINDINGS) - used == {"axes exchanged, wrong sign", "axes exchanged, wrong signs"}  # composed
    assert set(ADVICE) - used - within == set()


def calls(tree: ast.AST, *names: str) -> list[ast.Call]:
    return [
        one
        for one in ast.walk(tree)
        if isinstance(one, ast.Call) and getattr(one.func, "id", getattr(one.func, "attr", "")) in names
    ]


@pytest.mark.parametrize("file", sorted(TREES.keys() - TABLES))
def test_no_finding_is_worded_outside_the_table(file: str) -> None:
    tree = TREES[file]
    if file not in ("finding.py", "suggestion.py"):
        assert not calls(tree, "Finding", "Wording", "Advice", "Suggestion")
    for call in calls(tree, "replace", "Suggestion"):
        for keyword in call.keywords:
            if keyword.arg in ("sentence", "advice", "quantity"):
                value = keyword.value
                assert not isinstance(value, ast.JoinedStr), ast.unparse(call)
                assert not isinstance(value, ast.Constant) or value.value == "", ast.unparse(call)


@pytest.mark.parametrize("name", R_CHANNELS)
def test_an_r_of_the_hypotheses_is_a_name(name: str) -> None:
    assert name in FINDING_NAMES


@pytest.mark.parametrize("name", CAUSES)
def test_an_error_of_an_inertial_sensor_is_a_name(name: str) -> None:
    assert name in FINDING_NAMES


def test_a_number_is_rounded_and_a_factor_of_a_setting_too() -> None:
    row = Wording("R", "It is {factor} × {direction}, {part:.3f}.", "Multiply by {multiply}.",
                  (Change("navigator.r", "{multiply}", True),))  # fmt: skip
    finding = row.finding(9876.5, "", None, (0, 3), "too small", factor=9876.5, multiply=0.12345, part=0.5)
    assert finding.sentence == "It is 9900 × too small, 0.500."
    assert finding.advice == "Multiply by 0.12."
    assert finding.changes == (Change("navigator.r", 0.12, True, (0, 3)),)
    with pytest.raises(KeyError):
        row.finding(1.0, "", factor=1.0)


def test_a_variance_is_judged_in_the_words_of_its_row() -> None:
    (entry,) = judge_size(Squares(np.array(400.0), np.array(100.0)), FINDINGS["Q"], "noise")
    finding = entry.finding
    assert finding.sentence == "Errors grow 2 times as fast as the filter claims: Q is 4 times too small."
    assert (finding.quantity, finding.direction, finding.factor) == ("Q", "too small", 4.0)
    assert finding.changes == (Change("navigator.q_scale", 4.0, True),)
