"""The list of the quantities of findings has every one that the verdict's code writes."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

import lab.analysis
from lab.analysis.verdicts.finding_names import FINDING_NAMES
from lab.analysis.verdicts.hypotheses import R_CHANNELS

PLACES = {"Finding": 0, "judge_size": 1}
"""The functions that take the quantity of a finding, and the place of that argument."""


def texts(argument: ast.expr) -> list[str]:
    """Return patterns of the texts that an argument writes; none if it is a variable."""
    if isinstance(argument, ast.IfExp):
        return texts(argument.body) + texts(argument.orelse)
    if isinstance(argument, ast.Constant):
        return [re.escape(str(argument.value))]
    if isinstance(argument, ast.JoinedStr):
        return [
            "".join(
                re.escape(str(part.value)) if isinstance(part, ast.Constant) else ".+"
                for part in argument.values
            )
        ]
    return []


def written() -> list[str]:
    found = set()
    room = Path(lab.analysis.__file__).parent
    for path in (*room.glob("*.py"), *(room / "verdicts").glob("*.py")):
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id in PLACES:
                found.update(texts(call.args[PLACES[call.func.id]]))
    return sorted(found)


@pytest.mark.parametrize("pattern", written())
def test_a_quantity_that_the_verdict_writes_is_in_the_list(pattern: str) -> None:
    assert any(re.fullmatch(pattern, name) for name in FINDING_NAMES)


@pytest.mark.parametrize("name", R_CHANNELS)
def test_an_r_of_the_hypotheses_is_in_the_list(name: str) -> None:
    assert name in FINDING_NAMES


def test_the_search_finds_the_quantities() -> None:
    assert {"NIS", "GPS\\ latency", "P0\\ .+", "feedforward", "gate"} <= set(written())
