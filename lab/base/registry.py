"""Registry: the functions by which objects of earlier files use those of later files.

A result is displayed by a view, and an experiment is swept over many runs, but neither may import what does
it. The later file registers its functions, by kind and name; the object finds them. A function is registered
as ``"module:function"`` and imported when it is first used, so registration is fast.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

_FUNCTIONS: dict[str, dict[str, str]] = {}


def register(kind: str, name: str, function: str) -> None:
    """Register a function.

    Parameters
    ----------
    kind
        What the function does: ``"card"``, ``"plot"``, ``"result"``, ``"sweep"``, ``"ensemble"``,
        ``"experiment"`` or ``"source"``.
    name
        Name of the card, the plot, the method or the kind of addresses.
    function
        The function as ``"module:function"``.
    """
    _FUNCTIONS.setdefault(kind, {})[name] = function


def names(kind: str) -> tuple[str, ...]:
    """Return the names of the functions of a kind, in the order of their registration."""
    return tuple(_FUNCTIONS.get(kind, ()))


def find(kind: str, name: str) -> Callable[..., Any]:
    """Return a registered function; it is imported at its first use.

    Raises
    ------
    KeyError
        If there is no such function.
    """
    module, _, function = _FUNCTIONS[kind][name].partition(":")
    found: Callable[..., Any] = getattr(importlib.import_module(module), function)
    return found
