"""Field text: the value of a setting as a field shows it, what a person types, and the labels beside it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import param

from lab.base.parameters.setting_kinds import Intervals, MatrixOrNone, QuantityOrNone

FOLLOWS = "follows the sensor"
"""Stands in the field of a setting of the filter that is not given."""


def shown(value: Any) -> str:
    """Return a value as text: equal components once, empty if unset."""
    if value is None:
        return ""
    if isinstance(value, bool | str):
        return str(value)
    if isinstance(value, int | float):
        return f"{value:.6g}" if isinstance(value, float) else str(value)
    parts = [
        "–".join(f"{float(t):.12g}" for t in part) if isinstance(part, tuple) else shown(part)
        for part in value
    ]
    return (
        parts[0] if parts and len(set(parts)) == 1 and not isinstance(value[0], tuple) else ", ".join(parts)
    )


def parse_field(declaration: param.Parameter, text: str) -> Any:
    """Return the entered value; the setting itself checks it."""
    text = text.strip()
    if isinstance(declaration, param.Integer):
        whole = number(text)
        return int(whole) if isinstance(whole, float) and whole.is_integer() else whole
    if isinstance(declaration, Intervals):
        stretches = [part.replace("–", "-").split("-") for part in text.replace(" ", "").split(",") if part]
        return [tuple(number(t) for t in stretch) for stretch in stretches]
    if isinstance(declaration, QuantityOrNone):
        return per_axis(text, declaration.axes) if numbers(text) else None
    if isinstance(declaration, MatrixOrNone):
        variances = numbers(text)
        return _square(variances, declaration.sizes) if variances else None
    return text


def per_axis(text: str, axes: Sequence[str]) -> Any:
    """Return the number in a text, or one for each axis; a single number applies to all axes."""
    found = numbers(text)
    if len(found) == 1:
        return found * len(axes) if axes else found[0]
    return found


def _square(numbers: tuple[Any, ...], sizes: tuple[int, ...]) -> tuple[Any, ...]:
    size = math.isqrt(len(numbers))
    if size not in sizes or size * size != len(numbers) or size == 1:
        return numbers
    return tuple(numbers[row * size : (row + 1) * size] for row in range(size))


def numbers(text: str) -> tuple[float | str, ...]:
    """Return the numbers in a text; a single comma inside a number is a decimal comma."""
    decimal_comma = text.count(",") == 1 and ", " not in text
    return tuple(number(part) for part in (text if decimal_comma else text.replace(",", " ")).split())


def number(text: str) -> float | str:
    """Return the number in a text, with a point or a comma; the text itself if it is not a number."""
    try:
        return float(text.replace(",", "."))
    except ValueError:
        return text


def field_label(declaration: param.Parameter) -> str:
    """Return the label of a field: the name of the setting, and its unit."""
    unit = getattr(declaration, "unit", "")
    return f"{declaration.label} [{unit}]" if unit else str(declaration.label)


def describe_empty_field(declaration: param.Parameter) -> str:
    """Return what an empty field shows."""
    if isinstance(declaration, Intervals):
        return "none, or stretches such as 60–75, 120–130"
    if follows_sensor(declaration):
        return FOLLOWS
    return str(declaration.unset) if isinstance(declaration, QuantityOrNone) else ""


def follows_sensor(declaration: param.Parameter) -> bool:
    """Return whether a setting of the filter follows the sensor until it is given."""
    return isinstance(declaration, MatrixOrNone) or getattr(declaration, "unset", "") == "matched"
