"""Progress: what a long computation tells while it runs."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Takes what is computed now, and the part of it that is done, from 0 to 1."""


class StoppedError(ValueError):
    """Work that was cancelled before any part of it was done."""
