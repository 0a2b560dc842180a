"""``ins-lab budget``: the sources of error."""

from __future__ import annotations

import json

import numpy as np
import pytest
from asking import ask, refused


def test_a_budget_is_a_table_that_sums_to_its_total() -> None:
    answer = ask("budget", "los_angeles", "--set", "sensors.gps.period=2", "--at", "60")
    assert answer.exit_code == 0, answer.stderr
    header, *rows = answer.stdout.splitlines()
    assert header.split()[:3] == ["source", "position", "[m]"]
    assert rows[-1].startswith("total")
    columns = [[float(cell) for cell in row.split()[-6:]] for row in rows]
    for metres, percent in ((0, 1), (2, 3), (4, 5)):
        assert sum(row[metres] ** 2 for row in columns[:-1]) == pytest.approx(
            columns[-1][metres] ** 2, rel=0.02
        )
        assert sum(row[percent] for row in columns[:-1]) == pytest.approx(100, abs=1)
    assert [sum(row[1::2]) for row in columns[:-1]] == sorted(
        (sum(row[1::2]) for row in columns[:-1]), reverse=True
    )


def test_a_budget_as_json_has_every_component_and_what_the_filter_believes() -> None:
    answer = json.loads(ask("budget", "los_angeles", "--set", "navigator.r_scale=100", "--json").stdout)
    quantities = {row["quantity"]: row for row in answer["quantities"]}
    assert answer["mission"] == "los_angeles"
    assert answer["settings"]["navigator"]["r_scale"] == 100
    assert answer["seed"] == 1 and answer["versions"]["numpy"] == np.__version__
    east = quantities["position east"]
    assert east["unit"] == "m"
    assert east["believed"] > 1.5 * east["total"]
    assert sum(source["percent"] for source in east["sources"]) == pytest.approx(100)


def test_a_budget_names_what_it_leaves_out() -> None:
    answer = ask(
        *("budget", "los_angeles", "--set", "sensors.gps.outlier_rate=0.1"),
        *("--set", "navigator.gate=0.999"),
    )
    assert "Not in the budget: sensors.gps.outlier_rate" in answer.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--at", "1000"], ["--at 1000", "from 0 to 105"]),
        (["--at", "-1"], ["--at -1", "from 0 to 105"]),
        (["--set", "navigator.model=nonlinear"], ["linear model", "phi"]),
        (["--set", "navigator.modell=phi"], ["there is no setting"]),
    ],
)
def test_a_budget_that_cannot_be_made_says_why(arguments: list[str], words: list[str]) -> None:
    refused(ask("budget", "los_angeles", *arguments), *words)
