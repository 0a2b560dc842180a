"""Parcel: many changes of a page's models, sent to the browser as one message.

Bokeh sends each changed property by itself, and each message costs a look at all models of the page. A tick
of the page *Live* has a dozen changes.
"""

from __future__ import annotations

import json
from collections.abc import Container
from pathlib import Path
from typing import Any

import numpy as np
from bokeh.model import Model
from bokeh.models.callbacks import CustomJS
from bokeh.models.sources import ColumnDataSource

from lab.base.arrays import FloatArray

UNPACK = Path(__file__).with_name("parcel.js").read_text("utf-8")
"""Makes the changes in the browser, without sending them back, and empties the carrier as a receipt."""

DECIMALS = 6
"""Decimals of the numbers: a microsecond, a micrometre, a millionth of a degree."""


class Parcel:
    """Collects changes until `send`.

    Attributes
    ----------
    carrier : ColumnDataSource
        Brings them to the browser; it must be found from a model of the document, such as by its tags.
    """

    def __init__(self) -> None:
        self.carrier = ColumnDataSource({"what": []}, name="live parcel")
        self._models: list[Model] = []
        self._groups: list[int] = []
        self._streams: list[tuple[int, dict[str, FloatArray], int | None]] = []
        self._ages: dict[int, tuple[float, float]] = {}
        self._sets: dict[int, dict[str, Any]] = {}

    def seal(self) -> None:
        """Know all models: afterwards, changes can be sent."""
        unpack = CustomJS(args={"models": self._models}, code=UNPACK)
        self.carrier.js_on_change("data", unpack)

    def number(self, model: Model, group: int = 0) -> int:
        """Return the number of a model, which is new; `send` may hold back the changes of its group."""
        self._models.append(model)
        self._groups.append(group)
        return len(self._models) - 1

    @property
    def taken(self) -> bool:
        """Whether the browser has made the changes that were sent last."""
        return not self.carrier.data.get("what")

    def stream(self, model: int, columns: dict[str, Any], rollover: int | None) -> None:
        """Append rows of numbers to a source, or replace its data if `rollover` is None.

        Parameters
        ----------
        model
            Number of the source.
        columns
            Columns of equal length; of a source with ages, all but these.
        rollover
            Most rows that are kept.
        """
        if rollover is None:
            self._streams = [one for one in self._streams if one[0] != model]
        self._streams.append(
            (model, {name: np.asarray(values, np.float64) for name, values in columns.items()}, rollover)
        )

    def age(self, model: int, now: float, window: float) -> None:
        """Set the column ``age`` of a source to how long before now its ``time`` is.

        Parameters
        ----------
        model
            Number of the source.
        now
            The present [s].
        window
            Age beyond which rows are dropped, but for one, to which the first line begins [s].
        """
        self._ages[model] = now, window

    def set(self, model: int, **values: Any) -> None:
        """Set properties of a model; their values go through JSON."""
        self._sets.setdefault(model, {}).update(values)

    def send(self, groups: Container[int] | None = None) -> None:
        """Make the changes: in the browser as one message, or here while the models are in no document.

        Send once while a document holds back its changes: of two messages, it would send the last alone.

        Parameters
        ----------
        groups
            Groups whose changes are made now; the others wait. None for all.
        """
        due = [groups is None or group in groups for group in self._groups]
        streams = [one for one in self._streams if due[one[0]]]
        ages = {model: values for model, values in self._ages.items() if due[model]}
        sets = {model: values for model, values in self._sets.items() if due[model]}
        self._streams = [one for one in self._streams if not due[one[0]]]
        self._ages = {model: values for model, values in self._ages.items() if not due[model]}
        self._sets = {model: values for model, values in self._sets.items() if not due[model]}
        if not streams and not ages and not sets:
            return
        if self.carrier.document is None:
            self._make(streams, ages, sets)
            return
        parts = [
            (model, [(name, _numbers_for_json(values)) for name, values in columns.items()], rollover)
            for model, columns, rollover in streams
        ]
        aged = [(model, *values) for model, values in ages.items()]
        self.carrier.data = {
            "what": [json.dumps({"streams": parts, "ages": aged, "sets": list(sets.items())})]
        }

    def _make(
        self,
        streams: list[tuple[int, dict[str, FloatArray], int | None]],
        ages: dict[int, tuple[float, float]],
        sets: dict[int, dict[str, Any]],
    ) -> None:
        """Make the changes of models that no browser has yet, as `UNPACK` does.

        A browser that had them and left them makes no more of what was sent last.
        """
        self.carrier.data = {"what": []}
        changed: dict[int, dict[str, Any]] = {}
        for number, columns, rollover in streams:
            data = changed.setdefault(number, self._data(number))
            for name, values in columns.items():
                data[name] = values if rollover is None else np.append(data[name], values)[-rollover:]
        for number, (now, window) in ages.items():
            data = changed.setdefault(number, self._data(number))
            time = np.asarray(data["time"], np.float64)
            begin = max(int(np.searchsorted(time, now - window)) - 1, 0)
            data.update({name: values[begin:] for name, values in data.items() if name != "age"})
            data["age"] = now - time[begin:]
        for number, data in changed.items():
            self._models[number].update(data=data)
        for number, properties in sets.items():
            self._models[number].update(**properties)

    def _data(self, number: int) -> dict[str, Any]:
        """Return a copy of the columns of a source."""
        source = self._models[number]
        assert isinstance(source, ColumnDataSource)
        return dict(source.data)


def _numbers_for_json(values: FloatArray) -> list[float | None]:
    """Return numbers for JSON, which has no NaN."""
    rounded = np.round(values, DECIMALS).tolist()
    return [value if value == value else None for value in rounded]  # noqa: PLR0124 - NaN is not itself
