"""Visitors: their permissions, set by the operator of the server."""

from __future__ import annotations

import os

VARIABLE = "INS_LAB_VISITORS"
"""Environment variable with the permission for ``panel serve``; visitors cannot set it."""

CHOICES = ("run", "edit")
"""Run: all missions and settings. Edit: also add, change, delete, fly and record missions."""

_decided: dict[str, str] = {}
"""Permission set by the server of this process; it overrides the environment."""


def allow(choice: str) -> None:
    """Set the permission of visitors of this process.

    Raises
    ------
    ValueError
        If it is not one of the choices.
    """
    if choice not in CHOICES:
        raise ValueError(f"visitors = {choice!r}; accepted is one of {', '.join(CHOICES)}")
    _decided[VARIABLE] = choice


def may_edit() -> bool:
    """Return whether visitors may change the missions of this computer and use its network.

    By default they may not, because ``panel serve`` listens on all addresses.
    """
    return _decided.get(VARIABLE, os.environ.get(VARIABLE)) == "edit"
