"""The short form of the attack on a served laboratory: a few by each door, the same ones every time."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from doors import DOORS, besiege

from tests.security.conftest import serving

ATTACKS = 24


@pytest.mark.proof
def test_a_served_laboratory_holds_whatever_comes(tmp_path: Path) -> None:
    wrong: list[str] = []

    def broken(what: str, sent: Iterable[tuple[str, bytes]]) -> None:
        wrong.append(f"{what}; the last was {list(sent)[-1:]}")

    with serving(tmp_path, "--visitors", "run") as served:
        rng = np.random.default_rng(10)
        siege = besiege(served, rng, lambda number: number >= ATTACKS, broken)
        # In a thread of its own: a browser of other tests may leave a loop running in this one.
        with ThreadPoolExecutor(1) as thread:
            count = thread.submit(lambda: asyncio.run(siege)).result()
    assert wrong == []
    assert count.keys() == DOORS.keys()
