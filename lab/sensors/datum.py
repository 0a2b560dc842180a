"""Datum: a number of a data sheet with unit, convention and source, and its conversion to a setting.

White noise has two conventions. The setting ``noise_density`` is the coefficient N of IEEE Std 952: the mean
over an interval Δt has the variance N² / Δt, the Allan deviation is N / √τ, and N² is the *two-sided*
spectral density. Angle and velocity random walk (°/√h, m/s/√h) are N. The noise density of data sheets
(°/s/√Hz, µg/√Hz) comes from a spectrum analyser, which folds negative frequencies onto the positive ones:
its square is the *one-sided* density 2 N², so that noise density times the root of a bandwidth is the rms in
that band. A datum in such a unit says which of the two it is; `Datum.in_unit` is the one place that converts.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lab.base.parameters.setting_error import SettingError
from lab.base.parameters.setting_kinds import AxisQuantity
from lab.base.parameters.settings import Settings
from lab.base.parameters.toml_file import read_toml
from lab.base.parameters.units import TO_SI

ONE_SIDED, TWO_SIDED = "one-sided", "two-sided"
"""Conventions of the density of white noise."""
DENSITY = "noise_density"
"""The setting that is a density of white noise."""
OF_THE_VEHICLE = frozenset({"vibration_density"})
"""Settings of a triad that do not describe the sensor."""
ALIKE = (
    ("°/s/√Hz", "°/h/√Hz", "°/√h"),
    ("µg/√Hz", "mg/√Hz", "m/s/√h", "ft/s/√h"),
    ("°/s", "°/h"),
    ("°/s/g", "°/h/g"),
    ("°", "mrad"),
    ("g", "mg", "µg"),
    ("%", "ppm"),
)
"""Units of the same kind; each is accepted in place of the others."""

WORDS = {
    word: name
    for name, words in read_toml(Path(__file__).with_name("data_sheet_words.toml")).items()
    for word in words.split()
}
"""Words of data sheets for the settings of a triad. Nonlinearity is a scale factor that changes with the
signal: the lab has a constant one of the same size for it."""

_KEYS = ("value", "unit", "source", "density")


@dataclass(frozen=True)
class Datum:
    """A number of a card.

    Attributes
    ----------
    value : float or tuple of float
        The number, or one for each axis.
    unit : str
        Unit in the source.
    source : str
        Source: document and revision.
    density : str
        Convention of white noise in a unit per √Hz: `ONE_SIDED` or `TWO_SIDED`; empty if not stated, which is
        read as two-sided.
    """

    value: float | tuple[float, ...]
    unit: str
    source: str
    density: str = ""

    @property
    def convention(self) -> str:
        """Convention of a density in a unit per √Hz, as text; empty for any other number."""
        stated = self.density or not self.unit.endswith("/√Hz")
        return self.density if stated else f"not stated, taken as {TWO_SIDED}"

    def in_unit(self, unit: str) -> Any:
        """Return the number, or one for each axis as a list, in the unit of its setting."""
        # A one-sided density has the power of both sides at positive frequencies: twice as much.
        fold = math.sqrt(2) if self.density == ONE_SIDED else 1.0
        if self.unit == unit and fold == 1.0:
            return list(self.value) if isinstance(self.value, tuple) else self.value
        # Rounded, so that a conversion and its inverse do not change the last digits.
        converted = np.asarray(self.value) * (TO_SI[self.unit] / TO_SI[unit] / fold)
        if converted.ndim:
            return [float(f"{number:.12g}") for number in converted]
        return float(f"{converted:.12g}")

    def entry(self, source: str) -> dict[str, Any]:
        """Return the datum in the form of a TOML file.

        Parameters
        ----------
        source
            Key of its source in the file.
        """
        value = list(self.value) if isinstance(self.value, tuple) else self.value
        plain = {"value": value, "unit": self.unit, "source": source}
        return plain | ({"density": self.density} if self.density else {})


def read_terms(where: str, declared: Settings, table: Any, sources: Mapping[str, str]) -> dict[str, Datum]:
    """Return the data of a group of settings by name.

    Parameters
    ----------
    where
        Name of the table in messages.
    declared
        A group of settings, which declares units and bounds; its values are overwritten.
    table
        Content of the group in a TOML file; its keys are settings or `WORDS` of data sheets.
    sources
        Documents by key.

    Raises
    ------
    SettingError
        Naming the field: if a name, unit, convention or source is not accepted, or a number is beyond the
        bounds of its setting.
    """
    accepted = [
        name
        for _, _, name in declared.leaves()
        if hasattr(declared.param[name], "unit") and name not in OF_THE_VEHICLE
    ]
    if not isinstance(table, Mapping):
        raise SettingError(f"{where}: is not a table; accepted are {', '.join(accepted)}")
    terms: dict[str, Datum] = {}
    for word, entry in table.items():
        name = find_setting(word)
        if name not in accepted:
            check_keys(where, (word,), accepted)
        if name in terms:
            raise SettingError(
                f"{where}, {word}: is {name}, which is given already; accepted is one of the two"
            )
        terms[name] = datum = _datum(f"{where}, {word}", entry, declared.param[name], sources)
        try:
            declared.set(name, datum.in_unit(declared.param[name].unit))
        except SettingError as error:
            raise SettingError(f"{where}, {error}") from error
    return terms


def read_price(where: str, entry: Any, sources: Mapping[str, str]) -> Datum:
    """Return the price of a card, whose unit is its currency.

    Raises
    ------
    SettingError
        If it has no source, is not above zero, or its currency is not named by three letters.
    """
    _check_datum(where, entry, _KEYS[:3], sources)
    value, unit = entry["value"], entry["unit"]
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < math.inf:
        raise SettingError(f"{where}, value: {value!r}; accepted is a number above zero")
    if not (isinstance(unit, str) and re.fullmatch("[A-Z]{3}", unit)):
        raise SettingError(f"{where}, unit: {unit!r}; accepted are three capital letters, as USD")
    return Datum(float(value), unit, sources[entry["source"]])


def find_setting(word: str) -> str:
    """Return the setting that a word of data sheets means, in capitals or not; any other word as it is."""
    plain = re.sub(r"[\s-]+", "_", word.casefold())
    return WORDS.get(plain, word)


def read_sources(where: str, table: Mapping[str, Any]) -> Mapping[str, str]:
    """Return the documents of a card by their keys.

    Raises
    ------
    SettingError
        If one is not text.
    """
    sources = table.get("sources", {})
    if not isinstance(sources, Mapping) or not all(isinstance(text, str) for text in sources.values()):
        raise SettingError(f"{where}, sources: accepted is a table of documents, such as sheet = 'Rev. C'")
    return sources


def check_keys(where: str, table: Iterable[str], accepted: Iterable[str]) -> None:
    """Raise `SettingError` for a key that is not accepted.

    Raises
    ------
    SettingError
        With the key and the accepted ones.
    """
    accepted = tuple(accepted)
    for key in table:
        if key not in accepted:
            close = difflib.get_close_matches(key, accepted, n=1)
            hint = f" Did you mean {close[0]}?" if close else ""
            raise SettingError(f"{where}: there is no {key!r}.{hint} Accepted: {', '.join(accepted)}")


def _check_datum(where: str, entry: Any, accepted: Iterable[str], sources: Mapping[str, str]) -> None:
    """Raise `SettingError` unless a datum has its keys, and one of the sources."""
    if not isinstance(entry, Mapping):
        raise SettingError(f"{where}: {entry!r}; accepted is {{ value = ..., unit = ..., source = ... }}")
    check_keys(where, entry, accepted)
    lacking = [key for key in _KEYS[:3] if key not in entry]
    if lacking:
        raise SettingError(f"{where}: {lacking[0]} is missing; accepted are value, unit and source")
    if not isinstance(entry["source"], str) or entry["source"] not in sources:
        known = ", ".join(sources) or "none yet"
        raise SettingError(
            f"{where}, source: {entry['source']!r} is not in the table sources; accepted: {known}"
        )


def _datum(where: str, entry: Any, parameter: Any, sources: Mapping[str, str]) -> Datum:
    _check_datum(where, entry, _KEYS if parameter.name == DENSITY else _KEYS[:3], sources)
    units = next((kind for kind in ALIKE if parameter.unit in kind), (parameter.unit,))
    if entry["unit"] not in units:
        raise SettingError(f"{where}, unit: {entry['unit']!r}; accepted is {' or '.join(units)}")
    density = entry.get("density", "")
    accepted = (TWO_SIDED,) if _is_random_walk(entry["unit"]) else (ONE_SIDED, TWO_SIDED)
    if "density" in entry and density not in accepted:
        raise SettingError(
            f"{where}, density: {density!r}; accepted in {entry['unit']} is {' or '.join(accepted)}"
        )
    return Datum(_value(where, entry["value"], parameter), entry["unit"], sources[entry["source"]], density)


def _value(where: str, value: Any, parameter: Any) -> float | tuple[float, ...]:
    axes = parameter.axes if isinstance(parameter, AxisQuantity) else ()
    numbers = value if isinstance(value, list) else [value]
    real = all(isinstance(number, int | float) and not isinstance(number, bool) for number in numbers)
    if not real or (isinstance(value, list) and len(value) != len(axes)):
        many = f", or {len(axes)} ({', '.join(axes)})" if axes else ""
        raise SettingError(f"{where}, value: {value!r}; accepted is one number{many}")
    try:
        return tuple(float(number) for number in value) if isinstance(value, list) else float(value)
    except OverflowError as error:
        raise SettingError(f"{where}, value: is too large a number") from error


def _is_random_walk(unit: str) -> bool:
    """Return whether a unit is that of an angle or velocity random walk, which is N by definition."""
    return "√h" in unit
