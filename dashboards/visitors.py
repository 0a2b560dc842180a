"""Visitors: what whoever opens the page may do; whoever starts the server decides."""

from __future__ import annotations

import os

VARIABLE = "INS_LAB_VISITORS"
"""Environment variable that decides it for ``panel serve``; no visitor can set it."""

CHOICES = ("run", "edit")
"""Run: all missions and settings. Edit: also add, change, delete, fly and record missions."""

_decided: dict[str, str] = {}
"""What the server of this process decided, which overrules the environment."""


def allow(choice: str) -> None:
    """Decide what visitors of this process may do.

    Raises
    ------
    ValueError
        If it is none of the choices.
    """
    if choice not in CHOICES:
        raise ValueError(f"visitors = {choice!r}; accepted is one of {', '.join(CHOICES)}")
    _decided[VARIABLE] = choice


def may_edit() -> bool:
    """Return whether visitors may change the missions of this computer and use its network.

    Where nothing was decided they may not: ``panel serve`` listens on all addresses.
    """
    return _decided.get(VARIABLE, os.environ.get(VARIABLE)) == "edit"
