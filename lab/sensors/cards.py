"""Cards: the datasheet numbers of real inertial sensors, each with its unit and its source, ready to load.

The catalogue is ``cards.toml`` in this folder; a card of your own has the same form. A given number of a card
has a source. Numbers without a source are assumed to be typical of the grade (``assumed.toml``, every number
with its unit and its source) and kept separate: an error that a sheet omits is present all the same, and
without it the sensor with the shortest sheet would navigate best. Without the assumed numbers, such a term is
off. In-run bias stability or instability of datasheets is read as the coefficient B of the Allan deviation,
the setting ``flicker``.
"""

from __future__ import annotations

import difflib
import functools
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from lab.base.notebook_card import NotebookCard
from lab.base.parameters.setting_error import SettingError
from lab.base.parameters.settings import Settings
from lab.base.parameters.toml_file import TomlError, read_toml, toml_text
from lab.sensors.datum import (
    OF_THE_VEHICLE,
    Datum,
    check_keys,
    find_setting,
    read_price,
    read_sources,
    read_terms,
)
from lab.sensors.imu_errors import AccelerometerErrors, GyroErrors
from lab.sensors.suite import TRIADS, SensorSuite

ASSUMED = Path(__file__).with_name("assumed.toml")
"""The table of typical values."""
_DECLARED: dict[str, type[Settings]] = {"gyro": GyroErrors, "accelerometer": AccelerometerErrors}
"""The triads, and the classes that declare their settings."""
CATALOGUE = Path(__file__).with_name("cards.toml")
"""The cards that ship with the lab."""
GRADES = ("consumer", "industrial", "tactical", "navigation", "own")
"""Grades of sensors, from the least to the most accurate; the user's own ones come last."""
GROUPS = (*TRIADS, "gps")
"""Groups of the settings of the sensors that a card may describe."""
CLASSIC = "MEMSense AccelRate3D"
"""The card of the default settings."""
ALIGNMENT = 30.0
"""Rest before the flight that goes with a card [s]: autopilots take 10 to 60 s. The classic card has none."""
KEY_TERMS = (
    ("gyro", "noise_density", "gyro noise"),
    ("gyro", "flicker", "gyro bias"),
    ("accelerometer", "noise_density", "accel. noise"),
    ("accelerometer", "flicker", "accel. bias"),
)
"""The terms by which cards are told apart, with their titles in tables."""
EXPECTED = (
    "noise_density",
    "flicker",
    "bias_sigma",
    "scale_factor_sigma",
    "misalignment",
    "g_sensitivity",
    "range",
    "bandwidth",
)
"""Terms that a card of a triad should have; `Card.missing` names the missing ones."""
NO_ERRORS = ("range", "bandwidth")
"""Terms of these whose absence makes no error of a sensor zero."""

_TEXTS = ("maker", "grade", "note")
_KEYS = (*_TEXTS, "price", "sources", *GROUPS, "assumed")

Terms = Mapping[str, Mapping[str, Datum]]


@dataclass(frozen=True, repr=False)
class Card(NotebookCard):
    """The numbers of a sensor with their sources.

    Attributes
    ----------
    name : str
        Name of the sensor.
    maker, grade, note : str
        Manufacturer, one of `GRADES`, and further remarks.
    terms : mapping of mappings of Datum
        The given numbers, by group of the settings (``gyro``, ``accelerometer``, ``gps``) and name of the
        setting.
    assumed : mapping of mappings of Datum
        Assumed numbers for terms that are not given, in the same form.
    price : Datum or None
        What one sensor costs, in a currency, where that is cited.
    """

    CARD: ClassVar[str] = "sensor card"

    name: str
    maker: str
    grade: str
    note: str
    terms: Terms
    assumed: Terms = field(default_factory=dict)
    price: Datum | None = None

    def __repr__(self) -> str:
        given, assumed = (sum(map(len, terms.values())) for terms in (self.terms, self.assumed))
        kind = ", ".join(part for part in (f"{self.grade} grade" if self.grade else "", self.maker) if part)
        zero = 0 if self._receiver_alone() else len(self._lacking())
        lacking = f", {zero} lacking and zero" if zero else ""
        return f"<Card {self.name}: {kind}; {given} numbers with their source, {assumed} assumed{lacking}>"

    def without_assumed(self) -> Card:
        """Return the card with the given numbers only."""
        return replace(self, assumed={})

    def settings(self) -> dict[str, Any]:
        """Return the settings of the sensors, for ``experiment.update({"sensors": card.settings()})``.

        A triad is set as a whole: a term that is neither given nor assumed is off, and without a range
        nothing saturates. For the receiver, only the terms of the card are set. The setting ``assumed`` lists
        the assumed terms, and ``lacking`` those that are zero because the card has no number; of the classic
        experiment, whose sensors have no other errors, it lists none.
        """
        suite = SensorSuite().groups()
        triads = () if self._receiver_alone() else TRIADS
        out: dict[str, Any] = {triad: _errors_off(suite[triad]) for triad in triads}
        marks = []
        for terms in (self.terms, self.assumed):
            for group, data in terms.items():
                into = out.setdefault(group, {})
                for name, datum in data.items():
                    into[name] = datum.in_unit(suite[group].param[name].unit)
                    if terms is self.assumed:
                        marks.append(f"{group}.{name}={_mark(into[name])}")
        lacking = [] if self.name == CLASSIC else self._lacking()
        return out | ({"assumed": ", ".join(marks), "lacking": ", ".join(lacking)} if triads else {})

    def load(self, experiment: Settings) -> None:
        """Give an experiment the sensors of the card, a filter that suits them, and an alignment.

        The filter gets states for the errors that the card has: scale factors, misalignments and
        g-sensitivity. It begins with a rest of `ALIGNMENT` before the flight, as every autopilot needs it: a
        linear filter cannot start with turn-on biases of some °/s. A filter with a given P0 stays as it is.

        Parameters
        ----------
        experiment : Experiment
            Experiment to change.
        """
        settings: dict[str, Any] = {"sensors": self.settings()}
        if not self._receiver_alone() and experiment.get("navigator.p0") is None:
            settings["navigator"] = {
                "states": 21 if self._has("scale_factor", "scale_factor_sigma") else 15,
                "estimate_misalignments": self._has("misalignment"),
                "estimate_g_sensitivity": self._has("g_sensitivity"),
                "alignment": 0.0 if self.name == CLASSIC else ALIGNMENT,
            }
        experiment.update(settings)

    def _has(self, *names: str) -> bool:
        """Return whether a triad has one of some errors."""
        values = (self.value(triad, name) for triad in TRIADS for name in names if self.datum(triad, name))
        return any(np.any(value) for value in values)

    def _lacking(self) -> list[str]:
        """Return the errors, as ``gyro.flicker``, that are neither given nor assumed."""
        return [
            f"{group}.{name}"
            for group, names in self._absent().items()
            for name in names
            if name not in NO_ERRORS
        ]

    def _absent(self) -> dict[str, list[str]]:
        """Return, by group, the expected terms that are neither given nor assumed."""
        suite = SensorSuite().groups()
        return {
            group: [
                name for name in EXPECTED if name in suite[group].param and self.datum(group, name) is None
            ]
            for group in TRIADS
        }

    def missing(self) -> dict[str, list[str]]:
        """Return, by group, the labels of the expected terms that are neither given nor assumed."""
        suite = SensorSuite().groups()
        return {
            group: [suite[group].param[name].label for name in names]
            for group, names in self._absent().items()
        }

    def datum(self, group: str, term: str) -> Datum | None:
        """Return a datum of the card, given or assumed; None if the card does not have it."""
        return self.terms.get(group, {}).get(term) or self.assumed.get(group, {}).get(term)

    def value(self, group: str, term: str) -> Any:
        """Return a number of the card in the unit of its setting; None if the card does not have it."""
        datum = self.datum(group, term)
        return datum and datum.in_unit(SensorSuite().groups()[group].param[term].unit)

    def is_assumed(self, group: str, term: str) -> bool:
        """Return whether a number of the card is assumed."""
        return term in self.assumed.get(group, {})

    def to_dict(self) -> dict[str, Any]:
        """Return the card in the form of its TOML file, with assumed numbers in a separate table."""
        both = (self.terms, self.assumed)
        data = [datum for terms in both for group in terms.values() for datum in group.values()]
        data += [self.price] if self.price else []
        sources = sorted({datum.source for datum in data})
        keys = {source: f"source{number}" for number, source in enumerate(sources, 1)}
        card: dict[str, Any] = {"maker": self.maker, "grade": self.grade, "note": self.note}
        if self.price:
            card["price"] = self.price.entry(keys[self.price.source])
        card["sources"] = {key: source for source, key in keys.items()}
        card |= _entries(self.terms, keys)
        # An empty table means that nothing is assumed, although the grade has typical values.
        if self.assumed or typical_terms(self.grade):
            card["assumed"] = _entries(self.assumed, keys)
        return {self.name: card}

    def _receiver_alone(self) -> bool:
        return set(self.terms) == {"gps"}

    def to_toml(self) -> str:
        """Return the card as the text of a TOML file."""
        return toml_text(self.to_dict())


def cards() -> dict[str, Card]:
    """Return the cards of the catalogue by name, grade by grade."""
    return dict(_catalogue())


def card(name_or_path: str | os.PathLike[str], *, assumed: bool = True) -> Card:
    """Return a card by its name, or the one card of a TOML file.

    Parameters
    ----------
    name_or_path
        A name as `cards` lists it, in capitals or not, or a path ending with ``.toml``.
    assumed
        False omits the assumed numbers: terms without a source are then off.

    Raises
    ------
    SettingError
        If there is no such card, listing those there are, or its file is not accepted.
    """
    found = _find(os.fspath(name_or_path))
    return found if assumed else found.without_assumed()


def _find(text: str) -> Card:
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
    """Return the name of the catalogue card that the settings equal; None if there is none.

    With or without the assumed numbers.
    """
    groups = {name: group.to_dict() for name, group in sensors.groups().items()}
    for name, variants in _catalogue_settings().items():
        for settings in variants:
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
def _catalogue_settings() -> Mapping[str, list[dict[str, dict[str, Any]]]]:
    """Return the settings of every card, with and without assumed numbers, as the settings return them."""
    plain: dict[str, list[dict[str, dict[str, Any]]]] = {}
    for name, entry in _catalogue().items():
        for variant in (entry, entry.without_assumed()):
            wanted = variant.settings()
            groups = SensorSuite().update(wanted).to_dict()
            found = {
                group: {term: groups[group].get(term) for term in terms}
                for group, terms in wanted.items()
                if isinstance(terms, Mapping)
            }
            plain.setdefault(name, []).append(found)
    return plain


def _errors_off(group: Settings) -> dict[str, Any]:
    """Return the settings of a triad without any errors."""
    names = [name for _, _, name in group.leaves() if name not in OF_THE_VEHICLE]
    off: dict[str, Any] = {name: group.param[name].default for name in names}
    for name in ("noise_density", "bias_sigma"):
        off[name] = 0.0
    off["range"] = group.param["range"].bounds[1]
    return {name: _to_plain(value) for name, value in off.items()}


def _entries(terms: Terms, keys: Mapping[str, str]) -> dict[str, Any]:
    """Return data in the form of a TOML file."""
    return {
        group: {name: datum.entry(keys[datum.source]) for name, datum in data.items()}
        for group, data in terms.items()
    }


def _mark(value: Any) -> str:
    """Return a value of a setting in the form of the setting ``assumed``."""
    return "|".join(f"{number:.12g}" for number in (value if isinstance(value, list) else [value]))


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return read_toml(path)
    except TomlError as error:
        raise SettingError(f"{path}: {error}") from error


def _card(where: str, name: str, table: Any) -> Card:
    if not isinstance(table, Mapping):
        raise SettingError(f"{where}: is not a table; accepted is [{name}] with {', '.join(_KEYS)}")
    check_keys(where, table, _KEYS)
    texts = {key: table.get(key, "") for key in _TEXTS}
    for key, text in texts.items():
        if not isinstance(text, str):
            raise SettingError(f"{where}, {key}: {text!r} is not text")
    if texts["grade"] not in GRADES:
        raise SettingError(f"{where}, grade: {texts['grade']!r}; accepted is one of {', '.join(GRADES)}")
    sources = read_sources(where, table)
    suite = SensorSuite().groups()
    terms = {
        group: read_terms(f"{where}, {group}", suite[group], table[group], sources)
        for group in GROUPS
        if group in table
    }
    if not any(terms.values()):
        raise SettingError(f"{where}: has no numbers; accepted are tables {', '.join(GROUPS)}")
    price = read_price(f"{where}, price", table["price"], sources) if "price" in table else None
    assumed = _assumed_terms(where, table, terms, sources)
    return Card(name=name, terms=terms, assumed=assumed, price=price, **texts)


def _assumed_terms(where: str, table: Mapping[str, Any], terms: Terms, sources: Mapping[str, str]) -> Terms:
    """Return the assumed numbers: those of the file, otherwise those typical of the grade."""
    own = table.get("assumed")
    if own is None:
        return gaps_filled(terms, table["grade"])
    if not isinstance(own, Mapping):
        raise SettingError(f"{where}, assumed: is not a table; accepted are tables {', '.join(TRIADS)}")
    check_keys(f"{where}, assumed", own, TRIADS)
    suite = SensorSuite().groups()
    for triad, data in own.items():
        words = data if isinstance(data, Mapping) else ()
        twice = [word for word in words if find_setting(word) in terms.get(triad, {})]
        if twice:
            raise SettingError(
                f"{where}, assumed.{triad}: {twice[0]} is given already; accepted is one of the two"
            )
    return {
        triad: read_terms(f"{where}, assumed.{triad}", suite[triad], data, sources)
        for triad, data in own.items()
    }


def gaps_filled(terms: Terms, grade: str) -> Terms:
    """Return what is typical of a grade for the terms that are not given; a receiver alone has no gaps."""
    filling = {} if set(terms) == {"gps"} else typical_terms(grade)
    rest = {
        triad: {name: datum for name, datum in data.items() if name not in terms.get(triad, {})}
        for triad, data in filling.items()
    }
    return {triad: data for triad, data in rest.items() if data}


def _to_plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


@functools.cache
def grades() -> Mapping[str, Terms]:
    """Return the typical values by grade, triad and name of the setting.

    Raises
    ------
    SettingError
        If the table is not accepted.
    """
    tables = read_toml(ASSUMED)
    return {grade: _terms(f"{ASSUMED}, {grade}", table) for grade, table in tables.items()}


def typical_terms(grade: str) -> Terms:
    """Return the typical values of a grade; none for grades that the table lacks, such as own sensors."""
    return grades().get(grade, {})


def _terms(where: str, table: Mapping[str, Mapping[str, object]]) -> Terms:
    sources = read_sources(where, table)
    return {
        triad: read_terms(f"{where}, {triad}", declared(), table.get(triad, {}), sources)
        for triad, declared in _DECLARED.items()
    }
