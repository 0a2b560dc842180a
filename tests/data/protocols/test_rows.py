"""Rows: what of a damaged frame is refused: a number out of its range, whichever it is."""

from __future__ import annotations

import math

import pytest

from lab.data.protocols.decoder import Statistics
from lab.data.protocols.limits import Limits
from lab.data.protocols.rows import LARGEST_HEIGHT, LARGEST_SPEED, Rows
from lab.data.protocols.samples import FIX_3D, NO_FIX

FIX = {"place": (0.8, 0.2, 500.0), "velocity_n": (1.0, 2.0, 3.0)}
"""A fix as any receiver sends it."""


@pytest.mark.parametrize(
    "damage",
    [
        {"place": (math.pi, 0.2, 500.0)},
        {"place": (math.nan, 0.2, 500.0)},
        {"place": (0.8, -7.0, 500.0)},
        {"place": (0.8, 0.2, -1.1 * LARGEST_HEIGHT)},
        {"velocity_n": (0.0, -1.1 * LARGEST_SPEED, 0.0)},
    ],
    ids=("latitude", "no latitude", "longitude", "height", "velocity_n"),
)
def test_a_fix_with_one_number_out_of_its_range_is_refused(damage: dict[str, object]) -> None:
    statistics = Statistics()
    rows = Rows(statistics, Limits())
    rows.add_fix(0, fix_type=FIX_3D, **FIX)  # type: ignore[arg-type]
    rows.add_fix(0, fix_type=FIX_3D, **FIX | damage)  # type: ignore[arg-type]
    rows.add_fix(0, fix_type=NO_FIX, **FIX | damage)  # type: ignore[arg-type]
    assert rows.taken().fix["fix_type"].tolist() == [
        FIX_3D,
        NO_FIX,
    ]  # without a fix, nothing of it is believed
    assert statistics.refused == 1
