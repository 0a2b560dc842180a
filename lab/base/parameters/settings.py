"""Settings: parameters that carry label, unit, bounds, documentation and default in one place.

Widgets, TOML files, ``--set path=value`` and the documentation are all derived from these declarations; no
bound is written twice. Values are in datasheet units; the code that uses them converts once.
"""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
import param

from lab.base.notebook_card import NotebookCard
from lab.base.parameters.setting_error import RefusedValueError, SettingError, UnknownSettingError
from lab.base.parameters.setting_kinds import AxisQuantity, Intervals, describe, listing, paragraph
from lab.base.parameters.setting_text import MAX_PATH, value_of

_MAX_SHOWN = 60
"""Most characters of a value that a message shows."""


class Derived(NamedTuple):
    """Another form of a setting; only the setting itself is stored and written to files.

    Attributes
    ----------
    declaration : AxisQuantity
        Declaration of the displayed and accepted value.
    setting : str
        Dotted path of the setting.
    form : callable
        Converts the setting to the displayed value.
    back : callable
        Converts the accepted value to the setting.
    """

    declaration: AxisQuantity
    setting: str
    form: Callable[[Any], Any]
    back: Callable[[Any], Any]


class Settings(NotebookCard, param.Parameterized):
    """A group of settings: parameters and further groups, addressed by dotted paths.

    A subclass declares a group inside it with `group`. Every instance owns its groups.
    """

    CARD = "settings"
    OTHER_FORMS: ClassVar[tuple[str, ...]] = ()
    """Dotted paths of the other forms of settings."""

    def derived(self, path: str) -> Derived:
        """Return the other form for one of the paths in `OTHER_FORMS`."""
        raise KeyError(path)

    def __init__(self, **values: Any) -> None:
        cls = type(self)
        groups = {name: self.param[name].class_() for name in _declared_names(cls) if _is_group(cls, name)}
        super().__init__(**groups)
        for name, value in values.items():
            self.set(name, value)

    def __setattr__(self, name: str, value: Any) -> None:
        # Without this, a misspelt setting would be accepted as a new attribute without effect.
        if not name.startswith("_") and not hasattr(type(self), name):
            raise SettingError(_unknown_name_message(name, name, "", self))
        super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        # Completion in a notebook lists the settings and what one does with them, without the machinery.
        mine = [cls for cls in type(self).__mro__ if issubclass(cls, Settings)]
        public = {name for cls in mine for name in vars(cls) if not name.startswith("_")}
        methods = {name for name in public if callable(getattr(type(self), name)) and name not in _HIDDEN}
        return [*_declared_names(type(self)), *sorted(methods - set(_declared_names(type(self))))]

    def __repr__(self) -> str:
        return listing(type(self).__name__, self.leaves())

    def getdoc(self) -> str:
        """Return what IPython shows for ``?``: the class, and each setting with unit, bounds and meaning."""
        # In IPython, param appends a table in colours to the docstring, without units.
        about = inspect.cleandoc((type(self).__doc__ or "").partition("\x1b[")[0])
        parts = []
        for name, value in ((name, getattr(self, name)) for name in _declared_names(type(self))):
            if isinstance(value, Settings):
                parts.append(f"{name}.{{{', '.join(_declared_names(type(value)))}}}")
            else:
                parts.append(paragraph(name, type(self).param[name], value))
        return "\n\n".join((about.rstrip(), *parts))

    def groups(self) -> dict[str, Settings]:
        """Return the groups directly inside this one, by name."""
        return {
            name: getattr(self, name) for name in _declared_names(type(self)) if _is_group(type(self), name)
        }

    def leaves(self, prefix: str = "") -> Iterator[tuple[str, Settings, str]]:
        """Iterate over every setting as (dotted path, owning group, name within the group)."""
        groups = self.groups()
        for name in _declared_names(type(self)):
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
                raise _refused_error(path, value, form.declaration, error) from error
            path = form.setting
        owner, name = self._find(path)
        current = getattr(owner, name)
        if isinstance(current, Settings):
            if isinstance(value, Settings):
                value = value.to_dict()
            if not isinstance(value, Mapping):
                names = ", ".join(_declared_names(type(current)))
                raise SettingError(f"{path}: is a group of settings ({names}), not a value")
            self._check_once(path, value)
            for key, item in value.items():
                self.set(f"{path}.{key}", item)
            return
        try:
            setattr(owner, name, _accept(type(owner).param[name], value))
        except (ValueError, TypeError, OverflowError) as error:
            raise _refused_error(path, value, owner.param[name], error) from error

    def set_text(self, path: str, text: str) -> None:
        """Set the value at a dotted path from a text, which its declaration reads (`setting_text`).

        Raises
        ------
        SettingError
            If there is no such setting, or it does not accept the value.
        """
        if len(path) > MAX_PATH:
            raise UnknownSettingError(
                f"{_format_value(path)}: there is no setting with a name of {len(path)} characters"
            )
        declaration = self.declaration(path)
        try:
            value = value_of(declaration, text.strip())
        except ValueError as error:
            raise _refused_error(path, text, declaration, error) from error
        self.set(path, value)

    def set_texts(self, assignments: Sequence[str]) -> None:
        """Apply assignments ``path=value`` as `set_text`; `OTHER_FORMS` last, as they depend on others.

        Raises
        ------
        SettingError
            At the first text that is not an assignment or is not accepted.
        """
        pairs = [_assignment(text) for text in assignments]
        for path, text in sorted(pairs, key=lambda pair: pair[0] in self.OTHER_FORMS):
            self.set_text(path, text)

    def to_dict(self) -> dict[str, Any]:
        """Return all settings as nested plain dictionaries, ready for TOML, without the unset (None) ones."""
        out: dict[str, Any] = {}
        groups = self.groups()
        for name in _declared_names(type(self)):
            value = groups[name].to_dict() if name in groups else _to_plain(getattr(self, name))
            if value is not None:
                out[name] = value
        return out

    def update(self, values: Mapping[str, Any]) -> Self:
        """Apply all settings of a nested mapping, all or nothing, and return self.

        Raises
        ------
        SettingError
            If a key does not exist or a value is not accepted; then nothing is changed.
        """
        trial = self.copy()
        for name, value in values.items():
            trial.set(name, value)
        self._accept(trial)
        return self

    def copy(self) -> Self:
        """Return an independent copy."""
        twin = type(self)()
        twin._accept(self)
        return twin

    def _accept(self, other: Self) -> None:
        # Only differences, because setting a parameter is far slower than reading it, and notifies every
        # watcher.
        cls = type(self)
        for name in _declared_names(cls):
            mine, value = getattr(self, name), getattr(other, name)
            if _is_group(cls, name):
                mine._accept(value)
            elif value != mine:
                self.set(name, value)

    def _check_once(self, path: str, group: Mapping[str, Any]) -> None:
        """Raise `SettingError` if a group gives a setting in two forms."""
        for other in self.OTHER_FORMS:
            names = [whole.removeprefix(f"{path}.") for whole in (other, self.derived(other).setting)]
            if all(name in group for name in names):
                raise SettingError(f"{path}: {' and '.join(names)} are two forms of one setting; give one")

    def declaration(self, path: str) -> param.Parameter:
        """Return the declaration of the setting at a dotted path: unit, bounds, label and documentation.

        Raises
        ------
        SettingError
            If there is no such setting.
        """
        if path in self.OTHER_FORMS:
            return self.derived(path).declaration
        owner, name = self._find(path)
        return owner.param[name]

    def _find(self, path: str) -> tuple[Settings, str]:
        owner: Settings = self
        *heads, name = path.split(".")
        walked = ""
        for head in heads:
            if head not in _declared_names(type(owner)):
                raise UnknownSettingError(_unknown_name_message(path, head, walked, owner))
            if not _is_group(type(owner), head):
                raise UnknownSettingError(
                    f"{path}: {walked}{head} is a single setting, with nothing inside it"
                )
            owner, walked = getattr(owner, head), f"{walked}{head}."
        if name not in _declared_names(type(owner)):
            raise UnknownSettingError(_unknown_name_message(path, name, walked, owner))
        return owner, name


def group(settings: type[Settings], doc: str) -> Any:
    """Declare a group of settings inside another; every instance of the owner gets its own group."""
    return param.ClassSelector(class_=settings, default=None, allow_None=True, doc=doc)


_HIDDEN = {"check_change", "declaration", "derived", "getdoc", "groups", "leaves", "set_text", "set_texts"}
"""Public methods that are called by the lab and by IPython only."""

# Cached, because declarations do not change, and a moving slider reads them a thousand times.
_NAMES: dict[type[Settings], tuple[str, ...]] = {}
_GROUPS: dict[type[Settings], frozenset[str]] = {}


def _declared_names(cls: type[Settings]) -> tuple[str, ...]:
    if cls not in _NAMES:
        _NAMES[cls] = tuple(name for name in cls.param.objects("existing") if name != "name")
    return _NAMES[cls]


def _is_group(cls: type[Settings], name: str) -> bool:
    if cls not in _GROUPS:
        kinds = {name: getattr(cls.param[name], "class_", None) for name in _declared_names(cls)}
        _GROUPS[cls] = frozenset(
            name for name, kind in kinds.items() if isinstance(kind, type) and issubclass(kind, Settings)
        )
    return name in _GROUPS[cls]


def _assignment(text: str) -> tuple[str, str]:
    path, sign, value = (part.strip() for part in text.partition("="))
    if not sign or not path:
        raise SettingError(f"{_format_value(text)}: expected path=value, such as sensors.gps.period=0.5")
    return path, value


def _accept(parameter: param.Parameter, value: Any) -> Any:
    if isinstance(parameter, param.Number) and isinstance(value, bool):
        raise TypeError("true and false are not numbers")
    if isinstance(parameter, param.Integer) and isinstance(value, float) and value.is_integer():
        return int(value)
    if isinstance(parameter, Intervals) and isinstance(value, Sequence) and not isinstance(value, str):
        return [tuple(item) if isinstance(item, list) else item for item in value]
    return value


def _to_plain(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return [_to_plain(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def _refused_error(
    path: str, value: Any, declaration: param.Parameter, error: Exception
) -> RefusedValueError:
    reason = _reason(error)
    return RefusedValueError(
        f"{path} = {_format_value(value)}: not accepted; accepted is {describe(declaration)}."
        f"{f' ({reason})' if reason else ''}"
    )


def _format_value(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= _MAX_SHOWN else text[: _MAX_SHOWN - 3] + "..."


def _reason(error: Exception) -> str:
    """Return what a kind of setting says; nothing if it is a sentence of param or Python for programmers."""
    first = str(error).partition("\n")[0].rstrip(".")
    return "" if " parameter '" in first or "not supported between" in first else first


def _unknown_name_message(path: str, key: str, walked: str, owner: Settings) -> str:
    names = _declared_names(type(owner))
    close = difflib.get_close_matches(key, names, n=1) or [name for name in names if key and key in name]
    inside = [f"{walked}{leaf}" for leaf, _, name in owner.leaves() if name == key]
    hint = f" Did you mean {walked}{close[0]}?" if close else ""
    hint = hint or (f" Did you mean {' or '.join(inside)}?" if inside else "")
    where = f"in {walked.rstrip('.')}" if walked else "at the top level"
    return f"{path}: there is no setting {key!r} {where}.{hint} Accepted: {', '.join(names)}"
