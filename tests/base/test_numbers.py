"""Numbers as people read them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from lab.base.numbers import format_number

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    ("number", "text"),
    [(100.0, "100"), (9812.0, "9800"), (0.000123, "0.00012"), (1.04, "1"), (1.0e12, "1" + "0" * 12)],
)
def test_no_number_has_an_exponent(number: float, text: str) -> None:
    assert format_number(number) == text


def test_no_share_is_1e_02_percent() -> None:
    """Two digits of 100 are written so by Python itself."""
    sources = [path for room in ("lab", "dashboards") for path in (ROOT / room).rglob("*.py")]
    assert [str(path) for path in sources if re.search(r"\.[12]g} %", path.read_text())] == []
