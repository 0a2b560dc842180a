"""Setting kinds: the parameter classes of settings, their accepted values, and both in words.

The words are those of cards, completion and ``?``.
"""

from __future__ import annotations

import math
import numbers
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
import param
from numpy.typing import NDArray

Bounds = tuple[float | None, float | None]


class Quantity(param.Number):
    """One number with a unit, finite and within bounds.

    Parameters
    ----------
    default
        Default value, in `unit`.
    unit
        Displayed unit, such as ``"s"`` or ``"°/s/√Hz"``; empty for pure numbers.
    **kwargs
        As for `param.Number`: ``bounds``, ``softbounds`` (the range of a slider), ``step``, ``label``,
        ``doc``.
    """

    __slots__ = ["unit"]

    def __init__(self, default: float, *, unit: str = "", **kwargs: Any) -> None:
        object.__setattr__(self, "unit", unit)
        super().__init__(default=default, **kwargs)

    def _validate(self, val: Any) -> None:
        super()._validate(val)
        if val is not None and not _is_finite(val):
            raise ValueError(f"{val} is not a finite number")


class AxisQuantity(param.Parameter):
    """Several numbers of one unit, one for each named axis; a single number sets all axes.

    Parameters
    ----------
    default
        One number for all axes, or one for each.
    unit
        Unit as shown to a person.
    axes
        Names of the components, in order.
    bounds, softbounds
        Hard limits, and the range of a slider, for every component.
    step
        Step of the widget.
    **kwargs
        As for `param.Parameter`: ``label``, ``doc``.
    """

    __slots__ = ["axes", "bounds", "softbounds", "step", "unit"]

    def __init__(
        self,
        default: float | Sequence[float],
        *,
        unit: str = "",
        axes: Sequence[str] = ("x", "y", "z"),
        bounds: Bounds = (None, None),
        softbounds: Bounds | None = None,
        step: float | None = None,
        **kwargs: Any,
    ) -> None:
        for name, value in {
            "axes": tuple(axes),
            "bounds": bounds,
            "softbounds": softbounds,
            "step": step,
            "unit": unit,
        }.items():
            object.__setattr__(self, name, value)
        super().__init__(default=self.broadcast(default), **kwargs)

    def __set__(self, obj: Any, value: Any) -> None:
        super().__set__(obj, self.broadcast(value))

    def broadcast(self, value: Any) -> tuple[float, ...]:
        """Return one number for each axis, from one for all or one for each.

        Raises
        ------
        ValueError
            If it is neither, not finite, or out of bounds.
        """
        count = len(self.axes)
        components = (value,) * count if isinstance(value, numbers.Real) else value
        if isinstance(components, np.ndarray):
            components = components.tolist()
        if not isinstance(components, Sequence) or isinstance(components, str) or len(components) != count:
            raise ValueError(f"needs one number, or {count} ({', '.join(self.axes)}); got {value!r}")
        low, high = self.bounds
        for axis, number in zip(self.axes, components, strict=True):
            if not _is_finite(number):
                raise ValueError(f"{axis}: {number!r} is not a finite number")
            if (low is not None and number < low) or (high is not None and number > high):
                raise ValueError(f"{axis}: {number:g} is not{range_text(self.bounds)} {self.unit}".rstrip())
        return tuple(float(number) for number in components)


class QuantityOrNone(param.Parameter):
    """A number, or one for each named axis, or unset (None).

    Parameters
    ----------
    unset
        Word for the unset state, such as ``"matched"``; the word is also accepted as a value.
    unit
        Unit as shown to a person.
    axes
        Names of the components, in order; none for a single number.
    bounds
        Hard limits of every component.
    **kwargs
        As for `param.Parameter`: ``label``, ``doc``.
    """

    __slots__ = ["axes", "bounds", "unit", "unset"]

    def __init__(
        self,
        *,
        unset: str,
        unit: str = "",
        axes: Sequence[str] = (),
        bounds: Bounds = (None, None),
        **kwargs: Any,
    ) -> None:
        for name, value in {"axes": tuple(axes), "bounds": bounds, "unit": unit, "unset": unset}.items():
            object.__setattr__(self, name, value)
        super().__init__(default=None, allow_None=True, **kwargs)

    def __set__(self, obj: Any, value: Any) -> None:
        super().__set__(obj, self._checked(value))

    def _checked(self, value: Any) -> float | tuple[float, ...] | None:
        if value is None or value == self.unset:
            return None
        number = AxisQuantity(0.0, unit=self.unit, axes=self.axes or ("value",), bounds=self.bounds)
        numbers = number.broadcast(value)
        return numbers if self.axes else numbers[0]


class Intervals(param.List):
    """A list of (start, end) times in seconds, each with end > start >= 0."""

    def _validate(self, val: Any) -> None:
        super()._validate(val)
        for interval in val or []:
            ok = isinstance(interval, Sequence) and not isinstance(interval, str) and len(interval) == 2
            if not ok or not all(_is_finite(t) for t in interval):
                raise ValueError(f"{interval!r} is not a pair of times [start, end] in seconds")
            if not 0 <= interval[0] < interval[1]:
                raise ValueError(f"{interval!r}: must start at 0 s or later, and end after its start")


class MatrixOrNone(param.Parameter):
    """A covariance: unset (None), its diagonal, or the whole symmetric positive semidefinite matrix.

    Parameters
    ----------
    size
        Number of rows, or the possible numbers.
    diagonal_only
        True refuses off-diagonal elements.
    rows
        Name of each row, and the displayed unit of its σ.
    **kwargs
        As for `param.Parameter`: ``label``, ``doc``.
    """

    __slots__ = ["diagonal_only", "rows", "sizes"]

    def __init__(
        self,
        *,
        size: int | tuple[int, ...],
        diagonal_only: bool = False,
        rows: Sequence[tuple[str, str]] = (),
        **kwargs: Any,
    ) -> None:
        object.__setattr__(self, "sizes", (size,) if isinstance(size, int) else size)
        object.__setattr__(self, "rows", tuple(rows))
        object.__setattr__(self, "diagonal_only", diagonal_only)
        super().__init__(default=None, allow_None=True, **kwargs)

    def __set__(self, obj: Any, value: Any) -> None:
        super().__set__(obj, None if value is None else self._covariance(value))

    def _covariance(self, value: Any) -> tuple[Any, ...]:
        try:
            matrix = np.array(value)
        except ValueError as error:
            raise ValueError("has rows of different lengths") from error
        if matrix.dtype.kind not in "iuf":
            raise ValueError("has entries that are not numbers")
        matrix = matrix.astype(np.float64)
        self._check(matrix)
        rows = matrix.tolist()
        return tuple(rows) if matrix.ndim == 1 else tuple(tuple(row) for row in rows)

    def _check(self, matrix: NDArray[np.float64]) -> None:
        shapes = [shape for n in self.sizes for shape in ((n,), (n, n))]
        if matrix.shape not in shapes:
            raise ValueError(f"has shape {matrix.shape}, expected {' or '.join(map(str, shapes))}")
        if not np.all(np.isfinite(matrix)):
            raise ValueError("has entries that are not finite")
        full = np.diag(matrix) if matrix.ndim == 1 else matrix
        if self.diagonal_only and np.count_nonzero(full - np.diag(np.diag(full))):
            raise ValueError("has off-diagonal elements, and only the diagonal is used here")
        if not np.allclose(full, full.T, rtol=1e-9, atol=0):
            raise ValueError("is not symmetric")
        # Scaled to unit diagonal, since entries in metres and in rad/s differ by many orders of magnitude.
        scale = np.sqrt(np.clip(np.diag(full), 0, None))
        if np.any(np.diag(full) < 0):
            raise ValueError(f"has a negative variance at row {int(np.argmin(np.diag(full))) + 1}")
        scale[scale == 0] = 1
        smallest = float(np.linalg.eigvalsh(full / np.outer(scale, scale))[0])
        if smallest < -1e-9:
            raise ValueError(f"is not positive semidefinite: smallest eigenvalue, scaled, {smallest:.3g}")


def describe(parameter: param.Parameter) -> str:
    """Describe what a parameter accepts, such as ``"a number from 0 to 10 °/s"``."""
    unit = f" {parameter.unit}" if getattr(parameter, "unit", "") else ""
    for kind, words in _WORDS.items():
        if isinstance(parameter, kind):
            return words(parameter, unit)
    return "text" if isinstance(parameter, param.String) else (parameter.doc or "another value")


def requirement(parameter: param.Parameter, value: Any = None, name: str = "") -> str:
    """Return a short sentence with the name of a setting and its limits, for a person whose value is refused.

    Parameters
    ----------
    parameter
        The declaration of the setting.
    value
        The refused value.
    name
        Name of the setting; its label by default.

    Examples
    --------
    >>> requirement(Quantity(1.0, bounds=(1e-6, 1e6), label="Q scale"))
    'Q scale must be between 0.000001 and 1,000,000.'
    """
    name = name or str(parameter.label)
    axes = getattr(parameter, "axes", ())
    if axes and isinstance(value, Sequence) and not isinstance(value, str) and len(value) != len(axes):
        return f"{name} needs one number, or {len(axes)}: {', '.join(axes)}."
    if isinstance(parameter, Intervals):
        return f"{name} must be intervals of time in seconds, such as 60–75, 120–130."
    low, high = getattr(parameter, "bounds", None) or (None, None)
    if low is None or high is None:
        return f"{name} must be {describe(parameter)}."
    kind = "a whole number " if isinstance(parameter, param.Integer) else ""
    unit = f" {parameter.unit}" if getattr(parameter, "unit", "") else ""
    unset = f", or {parameter.unset}" if isinstance(parameter, QuantityOrNone) else ""
    return f"{name} must be {kind}between {_format_plain(low)} and {_format_plain(high)}{unit}{unset}."


def _format_plain(number: float) -> str:
    """Return a number without an exponent, and with commas between the thousands."""
    text = f"{number:,.10f}"
    return text.rstrip("0").rstrip(".")


def _join_options(options: Iterable[object]) -> str:
    return " or ".join(str(option) for option in options)


def range_text(bounds: Bounds | None) -> str:
    """Return bounds in words with a space before them, such as ``" from 0 to 10"``; empty without any."""
    low, high = bounds or (None, None)
    if low is None and high is None:
        return ""
    if high is None:
        return f" from {low:.10g}"
    return f" up to {high:.10g}" if low is None else f" from {low:.10g} to {high:.10g}"


_WORDS: dict[type[param.Parameter], Callable[[Any, str], str]] = {
    param.Boolean: lambda p, u: "true or false",
    param.Selector: lambda p, u: "one of " + ", ".join(str(option) for option in p.objects),
    Intervals: lambda p, u: "a list of [start, end] pairs in seconds, such as [[60, 75]]",
    param.Integer: lambda p, u: f"a whole number{range_text(p.bounds)}{u}",
    param.Number: lambda p, u: f"a number{range_text(p.bounds)}{u}",
    MatrixOrNone: lambda p, u: (
        f"{_join_options(p.sizes)} variances"
        + (
            ""
            if p.diagonal_only
            else ", or a symmetric positive semidefinite "
            f"{_join_options(f'{n} × {n}' for n in p.sizes)} matrix"
        )
    ),
    QuantityOrNone: lambda p, u: (
        (f"one number, or {len(p.axes)} ({', '.join(p.axes)}), each" if p.axes else "a number")
        + f"{range_text(p.bounds)}{u}, or {p.unset}"
    ),
    AxisQuantity: lambda p, u: (
        f"one number, or {len(p.axes)} ({', '.join(p.axes)}), each{range_text(p.bounds)}{u}"
    ),
}


def _is_finite(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond the largest float
        return False


def value_text(declaration: param.Parameter, value: Any) -> str:
    """Return a value with its unit; one number for all axes if they are equal, and ``-`` if it is unset."""
    if value is None or value in ([], ""):
        return "-"
    if isinstance(value, tuple) and all(isinstance(item, float) for item in value):
        text = ", ".join(f"{item:g}" for item in (value[:1] if len(set(value)) == 1 else value))
    else:
        text = f"{value:g}" if isinstance(value, float) else str(value)
    return f"{text} {getattr(declaration, 'unit', '')}".rstrip()


def brief_value(declaration: param.Parameter, value: Any) -> str:
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
            brief_value(leaf[1].param[leaf[2]], getattr(leaf[1], leaf[2])),
        )
        for leaf in leaves
    ]
    width = max((len(name) for name, _ in lines), default=0)
    return "\n".join((f"{title} (* is changed):", *(f"{name:<{width}}  {text}" for name, text in lines)))
