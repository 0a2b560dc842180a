"""DataFlash text: ArduPilot logs as ground stations save them, one line per message.

A line has the name of a message and its fields, separated by commas; ``FMT`` lines describe the fields of
the others. Numbers are written in their own unit and not scaled. Lines with another number of fields are
left out.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray

_DESCRIPTION = re.compile(
    rb"^FMT, ?\d{1,3}, ?\d{1,3}, ?([A-Za-z0-9_]{1,4}), ?([A-Za-z]{1,16}), ?([\w, ]{1,200}?) ?\r?$",
    re.MULTILINE,
)
_TEXT = "nNZ"
_MAX_FIELDS = 40
"""Most fields of a message: the format has room for the letters of 16."""
_HEAD = 4096
"""Bytes at the start of a text that have no zero in them."""


def is_text(head: bytes) -> bool:
    """Return whether a file begins like a log as text: with lines that describe messages."""
    return b"\0" not in head[:_HEAD] and bool(_DESCRIPTION.search(head))


class DataFlashText:
    """The content of a log saved as text.

    Parameters
    ----------
    data
        All bytes.
    wanted
        Names of the messages that are wanted.

    Attributes
    ----------
    lost_bytes : int
        Bytes of lines of wanted messages that could not be used.
    """

    def __init__(self, data: bytes, wanted: Collection[str]) -> None:
        self.lost_bytes = 0
        self._data = data
        self._fields: dict[str, list[tuple[str, str]]] = {}
        for name, letters, columns in _DESCRIPTION.findall(data):
            fields = [field.strip() for field in columns.decode("ascii", "replace").split(",")]
            key = name.decode("ascii", "replace")
            if key in wanted and len(fields) == len(set(fields)) == len(letters) <= _MAX_FIELDS:
                self._fields.setdefault(key, list(zip(fields, letters.decode(), strict=True)))
        self._lines: dict[str, tuple[NDArray[np.int64], list[bytes]]] = {}
        for name in self._fields:
            self._find(name)

    @property
    def names(self) -> list[str]:
        """The wanted messages there are."""
        return sorted(name for name, (_, lines) in self._lines.items() if lines)

    def numbers(self, name: str) -> dict[str, FloatArray] | None:
        """Return the fields of messages that are numbers, NaN where they are none; None without any."""
        import pandas as pd  # noqa: PLC0415 - slow to import, and only reading needs it

        _, lines = self._lines.get(name, (None, []))
        if not lines:
            return None
        used = [place for place, (_, letter) in enumerate(self._fields[name], 1) if letter not in _TEXT]
        frame = pd.read_csv(
            io.BytesIO(b"\n".join(lines) + b"\n"), header=None, index_col=False, usecols=used, dtype=object,
            na_filter=False, quoting=csv.QUOTE_NONE, skipinitialspace=True, engine="c", encoding="latin-1",
            low_memory=False, names=range(len(self._fields[name]) + 1),
        )  # fmt: skip
        return {
            self._fields[name][place - 1][0]: np.asarray(
                pd.to_numeric(frame[place], errors="coerce"), dtype=np.float64
            )
            for place in used
        }

    def places(self, name: str) -> NDArray[np.int64]:
        """Return where in the file the messages stand that `numbers` returns [bytes from its start]."""
        return self._lines[name][0] if name in self._lines else np.empty(0, np.int64)

    def texts(self, name: str, key: str) -> list[str]:
        """Return a field of messages that is text."""
        fields = [field for field, _ in self._fields.get(name, [])]
        if key not in fields:
            return []
        place = fields.index(key) + 1
        _, lines = self._lines[name]
        return [line.decode("utf-8", "replace").split(",")[place].strip() for line in lines]

    def _find(self, name: str) -> None:
        """Find the lines of a message that have as many fields as it should."""
        commas = len(self._fields[name])
        last_is_text = self._fields[name][-1][1] in _TEXT
        places, lines = [], []
        for found in re.finditer(rb"^" + name.encode() + rb",[^\r\n]{0,1000}", self._data, re.MULTILINE):
            line = found[0]
            # A text may have commas in it.
            if line.count(b",") == commas or (last_is_text and line.count(b",") > commas):
                places.append(found.start())
                lines.append(line)
            else:
                self.lost_bytes += len(line)
        self._lines[name] = np.array(places, dtype=np.int64), lines
