"""``ins-lab compare``: error models side by side."""

from __future__ import annotations

import json

from asking import ask


def test_models_are_compared_on_the_same_flights() -> None:
    arguments = ("compare", "los_angeles", "--models", "phi", "--seeds", "2", "--seed", "5")
    header, row = ask(*arguments).stdout.splitlines()
    assert header.split()[0] == "model"
    assert header.split()[-1] == "verdict"
    assert row.startswith("phi")
    assert "/ 15" in row
    assert "Consistent" in row
    (phi,) = json.loads(ask(*arguments, "--json").stdout)
    assert phi["model"] == "phi"
    assert f"{phi['position']:.3f}" in row
    assert phi["refusal"] == ""


def test_all_models_are_compared_where_none_is_named() -> None:
    from lab.experiment.ensembles.comparison import models

    answer = ask("compare", "los_angeles", "--json")
    assert [row["model"] for row in json.loads(answer.stdout)] == list(models())
