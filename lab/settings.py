"""Settings: parameters that carry label, unit, bounds, documentation and default in one place.

Widgets, TOML files, ``--set path=value`` and the documentation are all derived from these declarations;
nobody writes a bound twice. Values are in the units a datasheet uses; the code that consumes them converts
once.
"""

from __future__ import annotations

import difflib
import math
import numbers
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
import param
from numpy.typing import NDArray

from lab.settings_card import settings_html

Bounds = tuple[float | None, float | None]


class SettingError(ValueError):
    """A setting that does not exist, or a value it does not accept; the message says what is accepted."""


class Quantity(param.Number):
    """One number with a unit, finite and within bounds.

    Parameters
    ----------
    default
        Default value, in `unit`.
    unit
        Unit as shown to a person, such as ``"s"`` or ``"°/s/√Hz"``; empty for pure numbers.
    **kwargs
        As for `param.Number`: ``bounds``, ``softbounds`` (what a slider shows), ``step``, ``label``, ``doc``.
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
        Hard limits, and the range a slider shows, for every component.
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
            If it is neither, not finite, or beyond the bounds.
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
                raise ValueError(f"{axis}: {number:g} is not{_range(self.bounds)} {self.unit}".rstrip())
        return tuple(float(number) for number in components)


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
        Number of rows, or the numbers there may be.
    diagonal_only
        True refuses off-diagonal elements.
    rows
        Name of each row, and the unit in which a person reads and writes its σ.
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


class Derived(NamedTuple):
    """Another way to give a setting: what is kept, and written to files, is the setting itself.

    Attributes
    ----------
    declaration : AxisQuantity
        What is shown and accepted.
    setting : str
        Dotted path of the setting it is another form of.
    form : callable
        Takes the setting to what is shown.
    back : callable
        Takes what is accepted to the setting.
    """

    declaration: AxisQuantity
    setting: str
    form: Callable[[Any], Any]
    back: Callable[[Any], Any]


class Settings(param.Parameterized):
    """A group of settings, itself made of parameters and of further groups, addressed by dotted paths.

    A subclass declares a group inside it with `group`. Every instance owns its groups.
    """

    OTHER_FORMS: ClassVar[tuple[str, ...]] = ()
    """Dotted paths with which settings can be given in another form."""

    def derived(self, path: str) -> Derived:
        """Return the other form of a setting that one of `OTHER_FORMS` stands for."""
        raise KeyError(path)

    def __init__(self, **values: Any) -> None:
        cls = type(self)
        groups = {name: self.param[name].class_() for name in _declared(cls) if _is_group(cls, name)}
        super().__init__(**groups)
        for name, value in values.items():
            self.set(name, value)

    def __setattr__(self, name: str, value: Any) -> None:
        # Without this a misspelt setting would be accepted as a new attribute and change nothing.
        if not name.startswith("_") and not hasattr(type(self), name):
            raise SettingError(_unknown(name, name, "", self))
        super().__setattr__(name, value)

    def groups(self) -> dict[str, Settings]:
        """Return the groups directly inside this one, by name."""
        return {name: getattr(self, name) for name in _declared(type(self)) if _is_group(type(self), name)}

    def leaves(self, prefix: str = "") -> Iterator[tuple[str, Settings, str]]:
        """Iterate over every setting as (dotted path, owning group, name within the group)."""
        groups = self.groups()
        for name in _declared(type(self)):
            path = f"{prefix}{name}"
            if name in groups:
                yield from groups[name].leaves(f"{path}.")
            else:
                yield path, self, name

    def get(self, path: str) -> Any:
        """Return the value at a dotted path.

        Raises
        ------
        SettingError
            If there is no such setting.
        """
        if path in self.OTHER_FORMS:
            form = self.derived(path)
            return form.form(self.get(form.setting))
        owner, name = self._find(path)
        return getattr(owner, name)

    def set(self, path: str, value: Any) -> None:
        """Set the value at a dotted path; a mapping sets a whole group.

        Raises
        ------
        SettingError
            If there is no such setting, or it does not accept the value.
        """
        if path in self.OTHER_FORMS:
            form = self.derived(path)
            try:
                value = form.back(form.declaration.broadcast(value))
            except (ValueError, TypeError, OverflowError) as error:
                raise _refused(path, value, form.declaration, error) from error
            path = form.setting
        owner, name = self._find(path)
        current = getattr(owner, name)
        if isinstance(current, Settings):
            if isinstance(value, Settings):
                value = value.to_dict()
            if not isinstance(value, Mapping):
                names = ", ".join(_declared(type(current)))
                raise SettingError(f"{path}: is a group of settings ({names}), not a value")
            self._check_once(path, value)
            for key, item in value.items():
                self.set(f"{path}.{key}", item)
            return
        try:
            setattr(owner, name, _accept(type(owner).param[name], value))
        except (ValueError, TypeError, OverflowError) as error:
            raise _refused(path, value, owner.param[name], error) from error

    def set_text(self, assignment: str) -> None:
        """Apply one ``path=value`` assignment, the value written as in TOML (strings need no quotes).

        Raises
        ------
        SettingError
            If it is not an assignment, the setting does not exist, or the value is not accepted.
        """
        path, sign, text = (part.strip() for part in assignment.partition("="))
        if not sign or not path:
            raise SettingError(f"{assignment!r}: expected path=value, such as sensors.gps.period=0.5")
        try:
            value = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            value = text
        if path not in self.OTHER_FORMS:
            owner, name = self._find(path)
            if isinstance(owner.param[name], param.String) and not isinstance(value, str):
                value = text
            if isinstance(owner.param[name], param.Boolean) and text in {"True", "False"}:  # as in Python
                value = text == "True"
        self.set(path, value)

    def set_texts(self, assignments: Sequence[str]) -> None:
        """Apply assignments as `set_text`, `OTHER_FORMS` last: what they mean may depend on the others.

        Raises
        ------
        SettingError
            At the first that is not accepted.
        """
        for assignment in sorted(
            assignments, key=lambda text: text.partition("=")[0].strip() in self.OTHER_FORMS
        ):
            self.set_text(assignment)

    def to_dict(self) -> dict[str, Any]:
        """Return all settings as nested plain dictionaries, ready for TOML, without the unset (None) ones."""
        out: dict[str, Any] = {}
        groups = self.groups()
        for name in _declared(type(self)):
            value = groups[name].to_dict() if name in groups else _plain(getattr(self, name))
            if value is not None:
                out[name] = value
        return out

    def update(self, values: Mapping[str, Any]) -> Self:
        """Set everything in a nested mapping, all or nothing, and return self.

        Raises
        ------
        SettingError
            If a key does not exist or a value is not accepted; nothing is changed then.
        """
        trial = self.copy()
        for name, value in values.items():
            trial.set(name, value)
        self._take(trial)
        return self

    def copy(self) -> Self:
        """Return an independent copy."""
        twin = type(self)()
        twin._take(self)
        return twin

    def _repr_html_(self) -> str:
        return settings_html(self)

    def _take(self, other: Self) -> None:
        # Only what differs: setting a parameter costs far more than reading it, and tells every watcher.
        for path, owner, name in other.leaves():
            value = getattr(owner, name)
            if value != self.get(path):
                self.set(path, value)

    def _check_once(self, path: str, group: Mapping[str, Any]) -> None:
        """Refuse a group that gives a setting in two forms."""
        for other in self.OTHER_FORMS:
            names = [whole.removeprefix(f"{path}.") for whole in (other, self.derived(other).setting)]
            if all(name in group for name in names):
                raise SettingError(f"{path}: {' and '.join(names)} are two forms of one setting; give one")

    def _find(self, path: str) -> tuple[Settings, str]:
        owner: Settings = self
        *heads, name = path.split(".")
        walked = ""
        for head in heads:
            if head not in _declared(type(owner)):
                raise SettingError(_unknown(path, head, walked, owner))
            if not _is_group(type(owner), head):
                raise SettingError(f"{path}: {walked}{head} is a single setting, with nothing inside it")
            owner, walked = getattr(owner, head), f"{walked}{head}."
        if name not in _declared(type(owner)):
            raise SettingError(_unknown(path, name, walked, owner))
        return owner, name


def group(settings: type[Settings], doc: str) -> Any:
    """Declare a group of settings inside another; every instance of the owner gets its own."""
    return param.ClassSelector(class_=settings, default=None, allow_None=True, doc=doc)


def describe(parameter: param.Parameter) -> str:
    """Say in words what a parameter accepts, such as ``"a number from 0 to 10 °/s"``."""
    unit = f" {parameter.unit}" if getattr(parameter, "unit", "") else ""
    for kind, words in _WORDS.items():
        if isinstance(parameter, kind):
            return words(parameter, unit)
    return "text" if isinstance(parameter, param.String) else (parameter.doc or "another value")


def _either(options: Iterable[object]) -> str:
    return " or ".join(str(option) for option in options)


def _range(bounds: Bounds | None) -> str:
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
    param.Integer: lambda p, u: f"a whole number{_range(p.bounds)}{u}",
    param.Number: lambda p, u: f"a number{_range(p.bounds)}{u}",
    MatrixOrNone: lambda p, u: (
        f"{_either(p.sizes)} variances"
        + (
            ""
            if p.diagonal_only
            else f", or a symmetric positive semidefinite {_either(f'{n} × {n}' for n in p.sizes)} matrix"
        )
    ),
    AxisQuantity: lambda p, u: (
        f"one number, or {len(p.axes)} ({', '.join(p.axes)}), each{_range(p.bounds)}{u}"
    ),
}


# Declarations do not change, and every slider that moves asks for them a thousand times.
_NAMES: dict[type[Settings], tuple[str, ...]] = {}
_GROUPS: dict[type[Settings], frozenset[str]] = {}


def _declared(cls: type[Settings]) -> tuple[str, ...]:
    if cls not in _NAMES:
        _NAMES[cls] = tuple(name for name in cls.param.objects("existing") if name != "name")
    return _NAMES[cls]


def _is_group(cls: type[Settings], name: str) -> bool:
    if cls not in _GROUPS:
        kinds = {name: getattr(cls.param[name], "class_", None) for name in _declared(cls)}
        _GROUPS[cls] = frozenset(
            name for name, kind in kinds.items() if isinstance(kind, type) and issubclass(kind, Settings)
        )
    return name in _GROUPS[cls]


def _is_finite(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond the largest float
        return False


def _accept(parameter: param.Parameter, value: Any) -> Any:
    if isinstance(parameter, param.Number) and isinstance(value, bool):
        raise TypeError("true and false are not numbers")
    if isinstance(parameter, param.Integer) and isinstance(value, float) and value.is_integer():
        return int(value)
    if isinstance(parameter, Intervals) and isinstance(value, Sequence) and not isinstance(value, str):
        return [tuple(item) if isinstance(item, list) else item for item in value]
    return value


def _plain(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def _refused(path: str, value: Any, declaration: param.Parameter, error: Exception) -> SettingError:
    return SettingError(
        f"{path} = {_show(value)}: not accepted; accepted is {describe(declaration)}. ({_reason(error)})"
    )


def _show(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _reason(error: Exception) -> str:
    return str(error).partition("\n")[0].rstrip(".")


def _unknown(path: str, key: str, walked: str, owner: Settings) -> str:
    names = _declared(type(owner))
    close = difflib.get_close_matches(key, names, n=1) or [name for name in names if key and key in name]
    inside = [f"{walked}{leaf}" for leaf, _, name in owner.leaves() if name == key]
    hint = f" Did you mean {walked}{close[0]}?" if close else ""
    hint = hint or (f" Did you mean {' or '.join(inside)}?" if inside else "")
    where = f"in {walked.rstrip('.')}" if walked else "at the top level"
    return f"{path}: there is no setting {key!r} {where}.{hint} Accepted: {', '.join(names)}"
