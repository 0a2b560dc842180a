"""Run: the frozen arrays of one run, all settings that made it, and the memory that it needs.

In: the truth, the sensors and the solution of one run, as arrays. Out: a `Run`, of which analysis, datasets
and plots are functions.

Read first: `run` (the arrays), `experiment_settings` (all settings, and their TOML form), `memory`.
"""

from __future__ import annotations

import warnings
from typing import Any


def __getattr__(name: str) -> Any:
    """Return `ResultError`, which version 0.1 had here; warns, and goes after 0.2."""
    if name != "ResultError":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from lab.run.run import ResultError  # noqa: PLC0415 - at its first use

    warnings.warn("lab.run.ResultError is lab.ResultError now", DeprecationWarning, stacklevel=2)
    return ResultError
