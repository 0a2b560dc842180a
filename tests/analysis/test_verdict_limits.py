"""The limits of rooms: each is documented, cannot be changed by chance, and holds where it is used."""

from __future__ import annotations

import re
from dataclasses import FrozenInstanceError, fields, replace

import numpy as np
import pytest

import lab.analysis.verdicts.limits
import lab.navigation.alignment.limits
from lab.analysis.verdicts import limits
from lab.analysis.verdicts.finding import is_right, judge_size
from lab.analysis.verdicts.finding_table import FINDINGS
from lab.analysis.verdicts.outliers import outliers
from lab.analysis.verdicts.sums import Squares

ROOMS = (lab.analysis.verdicts.limits.VERDICT, lab.navigation.alignment.limits.ALIGNMENT)


@pytest.mark.parametrize("room", ROOMS, ids=lambda one: type(one).__name__)
def test_each_limit_is_documented_and_frozen(room: object) -> None:
    entries = re.findall(r"^    (\w[\w, ]*) : ", str(type(room).__doc__), re.M)
    named = [name for entry in entries for name in entry.split(", ")]
    assert named == [field.name for field in fields(room)]  # type: ignore[arg-type]
    with pytest.raises(FrozenInstanceError):
        setattr(room, named[0], 1.0)


def test_other_limits_hold_as_soon_as_they_stand_in_the_room(monkeypatch: pytest.MonkeyPatch) -> None:
    squares = Squares(np.array(1.4e4), np.array(1e4))
    assert not judge_size(squares, FINDINGS["Q"], "noise")
    monkeypatch.setattr(limits, "VERDICT", replace(limits.VERDICT, wrong_factor=1.3))
    assert judge_size(squares, FINDINGS["Q"], "noise")


def test_a_smaller_doubt_widens_the_interval(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "VERDICT", replace(limits.VERDICT, wrong_factor=1.0))
    assert not is_right(150.0, 100.0)  # 99.8 % of χ² with 100 degrees of freedom are below 146
    monkeypatch.setattr(limits, "VERDICT", replace(limits.VERDICT, doubt=1e-4))
    assert is_right(150.0, 100.0)


def test_a_larger_chance_finds_smaller_outliers(monkeypatch: pytest.MonkeyPatch) -> None:
    errors = np.random.default_rng(3).normal(size=(60, 6))
    errors[30, 0] = 5.0
    assert not outliers(errors)[30]
    monkeypatch.setattr(limits, "VERDICT", replace(limits.VERDICT, outlier_chance=1e-3))
    assert outliers(errors)[30]
