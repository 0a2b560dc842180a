"""Numbers as people read them."""

from __future__ import annotations

import numpy as np


def format_number(number: float, digits: int = 2) -> str:
    """Return a number, rounded to some digits, as people write it: 9800, and not 9.8e+03."""
    return np.format_float_positional(round_digits(number, digits), trim="-")


def round_digits(number: float, digits: int = 2) -> float:
    """Return a number, rounded to some digits."""
    return float(f"{number:.{digits}g}")
