"""DataFlash file: the self-describing log of ArduPilot, its messages as arrays.

Each message begins with two marks and its type. Messages of type 128 (``FMT``) describe the others:
length, name, and a letter for each field. After bytes that cannot be decoded the reader looks for the next
message; a message counts only if another one, or the end of the file, follows it.

References
----------
ArduPilot, *Logs: adding a new log message*,
https://ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html
"""

from __future__ import annotations

from array import array
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray

MARKS = b"\xa3\x95"
"""What every message begins with."""
FORMAT_TYPE = 128
"""Type of the messages that describe the others."""
MAGIC = MARKS + bytes((FORMAT_TYPE,))
"""First bytes of every file."""

_HEADER = 3
"""Bytes before the content of a message: two marks and its type."""
_FORMAT = np.dtype([("type", "u1"), ("length", "u1"), ("name", "S4"), ("format", "S16"), ("columns", "S64")])
_TEXT = "nNZ"
_TYPES = {
    "a": "<i2", "b": "i1", "B": "u1", "g": "<f2", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "f": "<f4",
    "d": "<f8", "n": "S4", "N": "S16", "Z": "S64", "c": "<i2", "C": "<u2", "e": "<i4", "E": "<u4",
    "L": "<i4", "M": "u1", "q": "<i8", "Q": "<u8",
}  # fmt: skip
_SCALES = {"c": 1e-2, "C": 1e-2, "e": 1e-2, "E": 1e-2, "L": 1e-7}
"""Unit of the whole numbers of a letter: hundredths, and ten millionths of a degree (of the format)."""
_SHAPES = {"a": (32,)}
"""Shape of a letter that is an array (of the format)."""
_MAX_KINDS = 1000
"""Most descriptions of wanted messages that are kept: a damaged file must not fill the memory with them."""


class Log(Protocol):
    """What a log gives, in bytes or as text.

    Attributes
    ----------
    lost_bytes : int
        Bytes that could not be decoded.
    """

    lost_bytes: int

    @property
    def names(self) -> list[str]:
        """The wanted messages there are."""

    def numbers(self, name: str) -> dict[str, FloatArray] | None:
        """Return the fields of messages that are numbers; None without any."""

    def places(self, name: str) -> NDArray[np.int64]:
        """Return where in the file the messages stand that `numbers` returns."""

    def texts(self, name: str, key: str) -> list[str]:
        """Return a field of messages that is text."""


@dataclass(eq=False)
class Kind:
    """How the messages of a type are made, and where they are.

    Attributes
    ----------
    name : str
        As the log calls them.
    length : int
        Of a message with its header [bytes].
    letters : dict
        The letter of each field.
    layout : dtype or None
        The fields of a message; None if they do not fill it.
    places : array of int
        Where the content of each message begins.
    """

    name: str
    length: int
    letters: dict[str, str]
    layout: np.dtype[np.void] | None
    places: array[int] = field(default_factory=lambda: array("q"))


@dataclass(eq=False)
class DataFlashFile:
    """The content of a log.

    Attributes
    ----------
    lost_bytes : int
        Bytes that could not be decoded.
    """

    lost_bytes: int = 0
    _data: bytes = b""
    _kinds: list[Kind] = field(default_factory=list)

    @classmethod
    def of(cls, data: bytes, wanted: Collection[str]) -> DataFlashFile:
        """Return the content of the bytes of a file.

        Parameters
        ----------
        data
            All bytes.
        wanted
            Names of the messages that are wanted.
        """
        log = cls(_data=data)
        log._walk(wanted)
        return log

    @property
    def names(self) -> list[str]:
        """The wanted messages there are."""
        return sorted({kind.name for kind in self._kinds if kind.places})

    def numbers(self, name: str) -> dict[str, FloatArray] | None:
        """Return the fields of messages that are numbers, in the unit they are meant in; None without any.

        Parameters
        ----------
        name
            Of the messages.
        """
        found = self._messages(name)
        if found is None:
            return None
        kind, messages = found
        with np.errstate(invalid="ignore"):  # damaged numbers are no numbers without a warning
            return {
                key: np.asarray(messages[key], dtype=np.float64) * _SCALES.get(letter, 1.0)
                for key, letter in kind.letters.items()
                if letter not in _TEXT and letter not in _SHAPES
            }

    def places(self, name: str) -> NDArray[np.int64]:
        """Return where in the file the messages stand that `numbers` returns [bytes from its start]."""
        found = self._kind(name)
        return np.empty(0, np.int64) if found is None else np.frombuffer(found.places, dtype=np.int64)

    def texts(self, name: str, key: str) -> list[str]:
        """Return a field of messages that is text."""
        found = self._messages(name)
        if found is None or found[0].letters.get(key, "?") not in _TEXT:
            return []
        return [text.decode("utf-8", "replace") for text in found[1][key].tolist()]

    def _kind(self, name: str) -> Kind | None:
        kinds = [kind for kind in self._kinds if kind.name == name and kind.places]
        # A type that is described again has changed its meaning; the longer part is used.
        kind = max(kinds, key=lambda one: len(one.places), default=None)
        return None if kind is None or kind.layout is None else kind

    def _messages(self, name: str) -> tuple[Kind, NDArray[np.void]] | None:
        kind = self._kind(name)
        if kind is None or kind.layout is None:
            return None
        content = np.frombuffer(self._data, dtype=np.uint8)
        windows = np.lib.stride_tricks.sliding_window_view(content, kind.layout.itemsize)
        rows = np.ascontiguousarray(windows[np.frombuffer(kind.places, dtype=np.int64)])
        return kind, rows.view(kind.layout)[:, 0]

    def _walk(self, wanted: Collection[str]) -> None:
        data, end, at = self._data, len(self._data), 0
        first, second = MARKS
        lengths = [0] * 256
        lengths[FORMAT_TYPE] = _HEADER + _FORMAT.itemsize
        kinds: list[Kind | None] = [None] * 256
        while at + _HEADER <= end:
            number = data[at + 2]
            following = at + lengths[number]
            # A type that was not described yet has length 0, and is passed over.
            sound = data[at] == first and data[at + 1] == second and following > at and following <= end
            # Marks may be in damaged bytes too: it counts where the next message begins right behind.
            if sound and (following + 2 > end or data.startswith(MARKS, following)):
                kind = kinds[number]
                if number == FORMAT_TYPE:
                    self._describe(data[at + _HEADER : following], wanted, lengths, kinds)
                elif kind is not None:
                    kind.places.append(at + _HEADER)
                at = following
                continue
            sense = data.find(MARKS, at + 1)
            sense = end if sense < 0 else sense
            self.lost_bytes += sense - at
            at = sense

    def _describe(
        self, message: bytes, wanted: Collection[str], lengths: list[int], kinds: list[Kind | None]
    ) -> None:
        description = np.frombuffer(message, dtype=_FORMAT)[0]
        number, length = int(description["type"]), int(description["length"])
        if number == FORMAT_TYPE or length <= _HEADER:
            return
        lengths[number], name = length, description["name"].decode("ascii", "replace")
        old = kinds[number]
        if name not in wanted:
            kinds[number] = None
            return
        letters, layout = _layout(
            description["format"].decode("ascii", "replace"),
            description["columns"].decode("ascii", "replace"),
            length,
        )
        if old is None or (old.name, old.letters, old.length) != (name, letters, length):
            kind = kinds[number] = Kind(name, length, letters, layout)
            if len(self._kinds) < _MAX_KINDS:
                self._kinds.append(kind)


def parameters_of(log: Log) -> dict[str, float]:
    """Return the parameters of the autopilot; 0 for those that are no number."""
    names = [name.rstrip("\0") for name in log.texts("PARM", "Name")]
    values = (log.numbers("PARM") or {}).get("Value", np.empty(0))
    return dict(zip(names, np.nan_to_num(values).tolist(), strict=False))


def _layout(form: str, columns: str, length: int) -> tuple[dict[str, str], np.dtype[np.void] | None]:
    """Return the letter of each field, and the layout of a message; None if it contradicts the length."""
    names = columns.split(",")
    fits = len(names) == len(form) == len(set(names)) and all(names) and set(form) <= set(_TYPES)
    if not fits:
        return {}, None
    letters = dict(zip(names, form, strict=True))
    layout = np.dtype([(name, _TYPES[one], _SHAPES.get(one, ())) for name, one in letters.items()])
    return letters, layout if layout.itemsize == length - _HEADER else None
