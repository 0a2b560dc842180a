"""Cards: the datasheet numbers of real inertial sensors, each with its unit and its source, ready to load.

The catalogue is ``cards.toml`` beside this file; a card of your own has the same form. A number that has no
source is not on the card, and its term is off when the card is loaded. What datasheets call in-run bias
stability or instability is taken as the coefficient B of the Allan deviation, the setting ``flicker``.
"""

from __future__ import annotations

import difflib
import functools
import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lab.sensors.suite import SensorSuite
from lab.setting_kinds import AxisQuantity
from lab.settings import SettingError, Settings
from lab.units import TO_SI

CATALOGUE = Path(__file__).with_name("cards.toml")
"""The cards that ship with the lab."""
GRADES = ("consumer", "industrial", "tactical", "navigation", "own")
"""Grades of sensors, from the least to the most accurate; own ones come last."""
TRIADS = ("gyro", "accelerometer")
"""Groups of the settings of an IMU."""
GROUPS = (*TRIADS, "gps")
"""Groups of the settings of the sensors that a card may describe."""
CLASSIC = "MEMSense AccelRate3D"
"""The card of the default settings."""
EXPECTED = ("noise_density", "flicker", "bias_sigma", "scale_factor_sigma", "range", "bandwidth")
"""Terms of a triad a card should have; `Card.missing` names those it has not."""
MAX_BYTES = 2**20
"""Largest file of cards accepted [bytes]."""

_OF_THE_VEHICLE = frozenset({"vibration_density"})
"""Settings of a triad that say nothing of the sensor."""
_ALIKE = (
    ("°/s/√Hz", "°/h/√Hz", "°/√h"),
    ("µg/√Hz", "mg/√Hz", "m/s/√h", "ft/s/√h"),
    ("°/s", "°/h"),
    ("g", "mg", "µg"),
    ("%", "ppm"),
)
"""Units of the same kind, each of which is accepted for the others."""
_TEXTS = ("maker", "grade", "note")
_KEYS = (*_TEXTS, "sources", *GROUPS)


@dataclass(frozen=True)
class Datum:
    """A number of a card.

    Attributes
    ----------
    value : float or tuple of float
        The number, or one for each axis.
    unit : str
        Its unit, as the source has it.
    source : str
        Where it comes from: document and revision.
    """

    value: float | tuple[float, ...]
    unit: str
    source: str


@dataclass(frozen=True)
class Card:
    """What is known of a sensor.

    Attributes
    ----------
    name : str
        What the sensor is called.
    maker, grade, note : str
        Who makes it, one of `GRADES`, and what else should be known.
    terms : mapping of mappings of Datum
        The numbers, by group of the settings (``gyro``, ``accelerometer``, ``gps``) and name of the setting.
    """

    name: str
    maker: str
    grade: str
    note: str
    terms: Mapping[str, Mapping[str, Datum]]

    def settings(self) -> dict[str, dict[str, Any]]:
        """Return the settings of the sensors, for ``experiment.update({"sensors": card.settings()})``.

        A triad is set as a whole: a term that is not on the card is off, and without a range nothing
        saturates. The receiver is left as it is, but for what the card says of it.
        """
        suite = SensorSuite().groups()
        triads = () if set(self.terms) == {"gps"} else TRIADS
        out = {triad: _off(suite[triad]) for triad in triads}
        for group, terms in self.terms.items():
            into = out.setdefault(group, {})
            for name, datum in terms.items():
                into[name] = _in_setting_unit(datum, suite[group].param[name].unit)
        return out

    def missing(self) -> dict[str, list[str]]:
        """Return, by group, the labels of the expected terms the card has no source for."""
        suite = SensorSuite().groups()
        return {
            group: [
                suite[group].param[name].label
                for name in EXPECTED
                if name in suite[group].param and name not in self.terms.get(group, {})
            ]
            for group in TRIADS
        }

    def value(self, group: str, term: str) -> Any:
        """Return a number of the card in the unit of its setting; None if the card does not have it."""
        datum = self.terms.get(group, {}).get(term)
        return datum and _in_setting_unit(datum, SensorSuite().groups()[group].param[term].unit)

    def to_dict(self) -> dict[str, Any]:
        """Return the card as its TOML file has it."""
        sources = sorted({datum.source for terms in self.terms.values() for datum in terms.values()})
        keys = {source: f"source{number}" for number, source in enumerate(sources, 1)}
        card: dict[str, Any] = {"maker": self.maker, "grade": self.grade, "note": self.note}
        card["sources"] = {key: source for source, key in keys.items()}
        for group, terms in self.terms.items():
            card[group] = {
                name: {"value": _plain(datum.value), "unit": datum.unit, "source": keys[datum.source]}
                for name, datum in terms.items()
            }
        return {self.name: card}

    def to_toml(self) -> str:
        """Return the card as the text of a TOML file."""
        import tomli_w  # noqa: PLC0415 - only writing needs it

        return tomli_w.dumps(self.to_dict())


def cards() -> dict[str, Card]:
    """Return the cards of the catalogue by name, grade by grade."""
    return dict(_catalogue())


def card(name_or_path: str | os.PathLike[str]) -> Card:
    """Return a card by its name, or the one card of a TOML file.

    Parameters
    ----------
    name_or_path
        A name as `cards` lists it, in capitals or not, or a path ending with ``.toml``.

    Raises
    ------
    SettingError
        If there is no such card, listing those there are, or its file is not accepted.
    """
    text = os.fspath(name_or_path)
    if text.lower().endswith(".toml"):
        found = read_cards(Path(text))
        if len(found) != 1:
            raise SettingError(f"{text}: holds {len(found)} cards ({', '.join(found)}); accepted is one")
        return next(iter(found.values()))
    known = {name.casefold(): entry for name, entry in _catalogue().items()}
    if text.casefold() in known:
        return known[text.casefold()]
    close = difflib.get_close_matches(text.casefold(), known, n=1, cutoff=0.5)
    hint = f" Did you mean {known[close[0]].name}?" if close else ""
    names = ", ".join(_catalogue())
    raise SettingError(
        f"there is no card {text!r}.{hint} Accepted: {names}, or the path of a card's .toml file"
    )


def read_cards(path: Path) -> dict[str, Card]:
    """Return the cards of a TOML file by name, in its order.

    Raises
    ------
    SettingError
        Naming file, card and field: if the file cannot be read, a key, unit or source is not accepted, or a
        number is beyond the bounds of its setting.
    """
    tables = _read_toml(path)
    if not tables:
        raise SettingError(f"{path}: holds no card; accepted is one table for each card, [NAME]")
    return {name: _card(f"{path}, {name}", name, table) for name, table in tables.items()}


def card_in_force(sensors: SensorSuite) -> str | None:
    """Return the name of the card of the catalogue the settings are those of; None if they are of none."""
    groups = {name: group.to_dict() for name, group in sensors.groups().items()}
    for name, settings in _catalogue_settings().items():
        if all(
            groups[group][term] == value
            for group, terms in settings.items()
            for term, value in terms.items()
            if value is not None
        ):
            return name
    return None


@functools.cache
def _catalogue() -> Mapping[str, Card]:
    found = read_cards(CATALOGUE)
    return dict(sorted(found.items(), key=lambda item: GRADES.index(item[1].grade)))


@functools.cache
def _catalogue_settings() -> Mapping[str, dict[str, dict[str, Any]]]:
    """Return the settings of every card, as settings give them back."""
    plain = {}
    for name, entry in _catalogue().items():
        wanted = entry.settings()
        groups = SensorSuite().update(wanted).to_dict()
        plain[name] = {
            group: {term: groups[group].get(term) for term in terms} for group, terms in wanted.items()
        }
    return plain


def _off(group: Settings) -> dict[str, Any]:
    """Return the settings of a triad without any errors."""
    names = [name for _, _, name in group.leaves() if name not in _OF_THE_VEHICLE]
    off: dict[str, Any] = {name: group.param[name].default for name in names}
    for name in ("noise_density", "bias_sigma"):
        off[name] = 0.0
    off["range"] = group.param["range"].bounds[1]
    return {name: _plain(value) for name, value in off.items()}


def _in_setting_unit(datum: Datum, unit: str) -> Any:
    if datum.unit == unit:
        return _plain(datum.value)
    # Rounded: a conversion there and back should not show in the last digits.
    converted = np.asarray(datum.value) * (TO_SI[datum.unit] / TO_SI[unit])
    return [float(f"{number:.12g}") for number in converted] if converted.ndim else float(f"{converted:.12g}")


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        if path.is_file() and path.stat().st_size > MAX_BYTES:
            raise SettingError(f"{path}: is larger than {MAX_BYTES // 2**20} MB; accepted is a card's file")
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        if isinstance(error, SettingError):
            raise
        if isinstance(error, OSError):
            raise SettingError(f"{path}: cannot be read: {error.strerror or error}") from error
        raise SettingError(f"{path}: is not TOML: {error}") from error


def _card(where: str, name: str, table: Any) -> Card:
    if not isinstance(table, Mapping):
        raise SettingError(f"{where}: is not a table; accepted is [{name}] with {', '.join(_KEYS)}")
    _check_keys(where, table, _KEYS)
    texts = {key: table.get(key, "") for key in _TEXTS}
    for key, text in texts.items():
        if not isinstance(text, str):
            raise SettingError(f"{where}, {key}: {text!r} is not text")
    if texts["grade"] not in GRADES:
        raise SettingError(f"{where}, grade: {texts['grade']!r}; accepted is one of {', '.join(GRADES)}")
    sources = table.get("sources", {})
    if not isinstance(sources, Mapping) or not all(isinstance(text, str) for text in sources.values()):
        raise SettingError(f"{where}, sources: accepted is a table of documents, such as sheet = 'Rev. C'")
    terms = {
        group: _terms(f"{where}, {group}", group, table[group], sources) for group in GROUPS if group in table
    }
    if not any(terms.values()):
        raise SettingError(f"{where}: has no numbers; accepted are tables {', '.join(GROUPS)}")
    return Card(name=name, terms=terms, **texts)


def _terms(where: str, group: str, table: Any, sources: Mapping[str, str]) -> dict[str, Datum]:
    declared = SensorSuite().groups()[group]
    accepted = [
        name
        for _, _, name in declared.leaves()
        if hasattr(declared.param[name], "unit") and name not in _OF_THE_VEHICLE
    ]
    if not isinstance(table, Mapping):
        raise SettingError(f"{where}: is not a table; accepted are {', '.join(accepted)}")
    _check_keys(where, table, accepted)
    terms = {}
    for name, entry in table.items():
        terms[name] = datum = _datum(f"{where}, {name}", entry, declared.param[name], sources)
        try:
            declared.set(name, _in_setting_unit(datum, declared.param[name].unit))
        except SettingError as error:
            raise SettingError(f"{where}, {error}") from error
    return terms


def _datum(where: str, entry: Any, parameter: Any, sources: Mapping[str, str]) -> Datum:
    if not isinstance(entry, Mapping):
        raise SettingError(f"{where}: {entry!r}; accepted is {{ value = ..., unit = ..., source = ... }}")
    _check_keys(where, entry, ("value", "unit", "source"))
    lacking = [key for key in ("value", "unit", "source") if key not in entry]
    if lacking:
        raise SettingError(f"{where}: {lacking[0]} is missing; accepted are value, unit and source")
    units = next((kind for kind in _ALIKE if parameter.unit in kind), (parameter.unit,))
    if entry["unit"] not in units:
        raise SettingError(f"{where}, unit: {entry['unit']!r}; accepted is {' or '.join(units)}")
    if entry["source"] not in sources:
        known = ", ".join(sources) or "none yet"
        raise SettingError(
            f"{where}, source: {entry['source']!r} is not in the table sources; accepted: {known}"
        )
    return Datum(_value(where, entry["value"], parameter), entry["unit"], sources[entry["source"]])


def _value(where: str, value: Any, parameter: Any) -> float | tuple[float, ...]:
    axes = parameter.axes if isinstance(parameter, AxisQuantity) else ()
    numbers = value if isinstance(value, list) else [value]
    real = all(isinstance(number, int | float) and not isinstance(number, bool) for number in numbers)
    if not real or (isinstance(value, list) and len(value) != len(axes)):
        many = f", or {len(axes)} ({', '.join(axes)})" if axes else ""
        raise SettingError(f"{where}, value: {value!r}; accepted is one number{many}")
    return tuple(float(number) for number in value) if isinstance(value, list) else float(value)


def _check_keys(where: str, table: Mapping[str, Any], accepted: Any) -> None:
    for key in table:
        if key not in accepted:
            close = difflib.get_close_matches(key, accepted, n=1)
            hint = f" Did you mean {close[0]}?" if close else ""
            raise SettingError(f"{where}: there is no {key!r}.{hint} Accepted: {', '.join(accepted)}")


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value
