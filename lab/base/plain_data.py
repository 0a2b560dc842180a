"""Plain data: what JSON can hold, without NaN, infinity, arrays or named tuples."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any


def to_plain_data(data: Any) -> Any:
    """Return data in a form for JSON, which has no NaN, infinity or NumPy numbers; these become None."""
    if isinstance(data, Mapping):
        return {str(key): to_plain_data(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [to_plain_data(value) for value in data]
    if hasattr(data, "tolist"):
        return to_plain_data(data.tolist())
    return None if isinstance(data, float) and not math.isfinite(data) else data
