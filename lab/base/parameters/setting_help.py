"""Setting help: a setting's value, unit and accepted values in words, for cards, completion and ``?``."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import param

from lab.base.parameters.setting_kinds import describe, range_text


def value_text(declaration: param.Parameter, value: Any) -> str:
    """Return a value with its unit; one number for all axes if they are equal, and ``-`` if it is unset."""
    if value is None or value in ([], ""):
        return "-"
    if isinstance(value, tuple) and all(isinstance(item, float) for item in value):
        text = ", ".join(f"{item:g}" for item in (value[:1] if len(set(value)) == 1 else value))
    else:
        text = f"{value:g}" if isinstance(value, float) else str(value)
    return f"{text} {getattr(declaration, 'unit', '')}".rstrip()


def brief(declaration: param.Parameter, value: Any) -> str:
    """Return value, unit and bounds in a few words, such as ``"0.05 °/s/√Hz, from 0 to 10"``."""
    if isinstance(declaration, param.Selector):
        return f"{value}, {describe(declaration)}"
    text, bounds = value_text(declaration, value), range_text(getattr(declaration, "bounds", None))
    if text in {"", "-"}:
        unit = getattr(declaration, "unit", "")
        return f"not set;{bounds} {unit}".rstrip() if bounds else f"not set; {describe(declaration)}"
    return f"{text},{bounds}" if bounds else text


def paragraph(name: str, declaration: param.Parameter, value: Any) -> str:
    """Return the lines about a setting: name, value, what is accepted, and its documentation."""
    return (
        f"{name} = {value_text(declaration, value)}\n"
        f"    accepted: {describe(declaration)}\n"
        f"    {declaration.doc or ''}".rstrip()
    )


def is_changed(leaf: tuple[str, param.Parameterized, str]) -> bool:
    """Return whether a setting, as `Settings.leaves` gives it, has another value than its default."""
    _, owner, name = leaf
    return bool(getattr(owner, name) != owner.param[name].default)


def listing(title: str, leaves: Iterable[tuple[str, param.Parameterized, str]]) -> str:
    """Return settings as text for a terminal: a line each with value, unit and bounds; ``*`` is changed."""
    lines = [
        (
            f"{'*' if is_changed(leaf) else ' '} {leaf[0]}",
            brief(leaf[1].param[leaf[2]], getattr(leaf[1], leaf[2])),
        )
        for leaf in leaves
    ]
    width = max((len(name) for name, _ in lines), default=0)
    return "\n".join((f"{title} (* is changed):", *(f"{name:<{width}}  {text}" for name, text in lines)))
