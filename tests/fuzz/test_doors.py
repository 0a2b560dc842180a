"""The short form of the attack on a served laboratory: a few by each door, the same ones every time."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from doors import DOORS, besiege

from tests.security.conftest import serving

ATTACKS = 24


def test_a_served_laboratory_holds_whatever_comes(tmp_path: Path) -> None:
    wrong: list[str] = []

    def broken(what: str, sent: Iterable[tuple[str, bytes]]) -> None:
        wrong.append(f"{what}; the last was {list(sent)[-1:]}")

    with serving(tmp_path, "--visitors", "run") as served:
        rng = np.random.default_rng(10)
        count = asyncio.run(besiege(served, rng, lambda number: number >= ATTACKS, broken))
    assert wrong == []
    assert count.keys() == DOORS.keys()
