"""ULog file: the self-describing log of PX4, its messages as arrays.

Sixteen bytes of header, then messages: two bytes of length, one of kind, the content. Formats (``F``)
declare the fields of each topic, subscriptions (``A``) give a topic's number, data (``D``) are of such a
number. After bytes that cannot be decoded the reader looks for the next message.

References
----------
PX4 Guide, *ULog File Format*, https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

from __future__ import annotations

import re
import struct
from array import array
from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

MAGIC = b"ULog\x01\x12\x35"
"""First bytes of every file."""

SYNC = b"\x2f\x73\x13\x20\x25\x0c\xbb\x12"
"""Content of the messages after which a reader finds its way again."""
_HEADER = 16
"""Bytes of the header."""
_HEAD = 3
"""Bytes of the head of a message: its length and its kind."""
_LEAST_FLAGS = 40
"""Bytes of the message of flags (of the format)."""
_LEAST_PARAMETER = 6
"""Fewest bytes of a parameter: length of the key, one of the key, four of the value."""
_VALUE = 4
"""Bytes of the value of a parameter."""
_LEAST_SUBSCRIPTION = 4
"""Fewest bytes of a subscription: instance, number of the topic, one of its name."""
_STAMP = 8
"""Bytes of the time stamp, which every topic has."""
_KINDS = frozenset(b"BFIMPQARDLCSO")
_FLAGS, _FORMAT, _PARAMETER, _SUBSCRIPTION, _DATA, _DROPOUT = b"BFPADO"
_PADDING = 8
"""Most bytes by which a message may be longer than its fields: the alignment of its C structure."""
_TYPES = {
    "int8_t": "i1", "uint8_t": "u1", "int16_t": "<i2", "uint16_t": "<u2", "int32_t": "<i4",
    "uint32_t": "<u4", "int64_t": "<i8", "uint64_t": "<u8", "float": "<f4", "double": "<f8", "bool": "u1",
    "char": "u1",
}  # fmt: skip
_FIELD = re.compile(r"([A-Za-z_]\w*)(?:\[(\d{1,5})\])? ([A-Za-z_]\w*)")
_MAX_FIELDS = 1000
"""Most fields of a format, and formats in a log; PX4 has some hundred."""
_MAX_PARAMETERS = 10_000
"""Most parameters kept: far more than an autopilot has."""
_MAX_DEPTH = 8
"""Deepest nesting of formats; PX4 has two levels."""
_MAX_MESSAGE = 2**16
"""Largest message [bytes]: its length is written in two of them."""
_FRAMES_THAT_FIT = 3
"""Messages in a row that have to make sense for a damaged log to be read on."""


@dataclass(eq=False)
class Topic:
    """Where the messages of a topic are, and how they are made.

    Attributes
    ----------
    name : str
        Of the topic.
    instance : int
        Which of several of that name.
    layout : dtype
        The fields of a message that are numbers or arrays of numbers.
    places : array of int
        Where the content of each message begins.
    """

    name: str
    instance: int
    layout: np.dtype[np.void]
    size: int
    places: array[int] = field(default_factory=lambda: array("q"))


@dataclass(eq=False)
class ULogFile:
    """The content of a log.

    Attributes
    ----------
    parameters : dict
        Parameters of the autopilot, as they were at the start.
    lost_bytes : int
        Bytes that could not be decoded.
    dropouts : int
        How often the logger could not keep up.
    dropped_seconds : float
        How long in all [s].
    """

    parameters: dict[str, float] = field(default_factory=dict)
    lost_bytes: int = 0
    dropouts: int = 0
    dropped_seconds: float = 0.0
    _data: bytes = b""
    _formats: dict[str, str] = field(default_factory=dict)
    _topics: list[Topic] = field(default_factory=list)
    _sizes: dict[str, int] = field(default_factory=dict)
    _has_sync: bool = True

    @classmethod
    def of(cls, data: bytes, wanted: Collection[str]) -> ULogFile:
        """Return the content of the bytes of a file.

        Parameters
        ----------
        data
            All bytes.
        wanted
            The topics whose messages are wanted.

        Raises
        ------
        ValueError
            If the log cannot be read, such as one with unknown flags.
        """
        log = cls(_data=data)
        log._walk(wanted)
        return log

    @property
    def names(self) -> list[str]:
        """The wanted topics that have messages."""
        return sorted({topic.name for topic in self._topics if topic.places})

    def instances(self, name: str) -> list[int]:
        """Return the numbers of the instances of a topic that have messages."""
        return sorted({topic.instance for topic in self._topics if topic.name == name and topic.places})

    def topic(self, name: str, instance: int | None = None) -> NDArray[np.void] | None:
        """Return the messages of a topic as a structured array, by default of its lowest instance.

        None without any.
        """
        found = [topic for topic in self._topics if topic.name == name and topic.places]
        if instance is None:
            instance = min((topic.instance for topic in found), default=0)
        parts = [self._messages(topic) for topic in found if topic.instance == instance]
        # Of one topic that is subscribed twice, and changed between, the longer part.
        return max(parts, key=len) if parts else None

    def _messages(self, topic: Topic) -> NDArray[np.void]:
        content = np.frombuffer(self._data, dtype=np.uint8)
        windows = np.lib.stride_tricks.sliding_window_view(content, topic.size)
        rows = np.ascontiguousarray(windows[np.frombuffer(topic.places, dtype=np.int64)])
        return rows.view(topic.layout)[:, 0]

    def _walk(self, wanted: Collection[str]) -> None:
        data, end, at = self._data, len(self._data), _HEADER
        subscribed: dict[int, Topic | None] = {}
        resumes: list[int] = []
        while at + _HEAD <= end:
            # The size is that of the content, without the head.
            size, kind = data[at] | data[at + 1] << 8, data[at + 2]
            content, following = at + _HEAD, at + _HEAD + size
            if resumes and following > resumes[0]:
                # After a crash the log continues at an offset that the header states.
                at = max(at, resumes.pop(0))
                continue
            if kind == _DATA and following <= end and size >= 2:
                topic = subscribed.get(data[content] | data[content + 1] << 8)
                if topic is None:
                    at = following
                    continue
                # Two bytes of the content are the number of the subscription.
                if topic.size <= size - 2 <= topic.size + _PADDING:
                    topic.places.append(content + 2)
                    at = following
                    continue
            elif kind in _KINDS and following <= end:
                message = data[content:following]
                if kind == _SUBSCRIPTION:
                    self._subscribe(message, wanted, subscribed)
                elif kind == _FLAGS:
                    resumes = self._flags(message)
                else:
                    self._accept(kind, message)
                at = following
                continue
            sense = self._next(at + 1)
            self.lost_bytes += sense - at
            at = sense

    def _next(self, start: int) -> int:
        """Return where the next messages that make sense begin; the end of the file if nowhere."""
        data, end = self._data, len(self._data)
        sync = data.find(SYNC, start) if self._has_sync else -1
        if sync >= 0:
            return sync + len(SYNC)
        # None follows here, so none follows further on.
        self._has_sync = False
        for first in range(start, end - 2):
            at = first
            for _ in range(_FRAMES_THAT_FIT):
                if at + _HEAD > end or data[at + 2] not in _KINDS:
                    break
                at += _HEAD + (data[at] | data[at + 1] << 8)
            else:
                if at <= end:
                    return first
        return end

    def _flags(self, message: bytes) -> list[int]:
        """Return where the log goes on after a crash, if it does."""
        if len(message) < _LEAST_FLAGS:
            return []
        # Flags that a reader must know; bit 0 says that data were appended, at up to three offsets.
        if message[8] & ~1 or any(message[9:16]):
            raise ValueError("it is newer or encrypted, with unknown flags")
        return sorted(
            offset for offset in struct.unpack("<3Q", message[16:_LEAST_FLAGS]) if message[8] and offset
        )

    def _accept(self, kind: int, message: bytes) -> None:
        if kind == _FORMAT:
            name, colon, fields = message.decode("ascii", "replace").partition(":")
            if colon and len(self._formats) < _MAX_FIELDS:
                self._formats[name] = fields
        elif kind == _PARAMETER and len(message) >= _LEAST_PARAMETER:
            key = message[1 : 1 + message[0]].decode("ascii", "replace")
            value = message[1 + message[0] :]
            form, _, name = key.partition(" ")
            if (
                len(value) == _VALUE
                and form in {"float", "int32_t"}
                and len(self.parameters) < _MAX_PARAMETERS
            ):
                number = struct.unpack("<f" if form == "float" else "<i", value)[0]
                self.parameters.setdefault(name, float(number))
        elif kind == _DROPOUT and len(message) >= 2:
            self.dropouts += 1
            self.dropped_seconds += 1e-3 * (message[0] | message[1] << 8)

    def _subscribe(
        self, message: bytes, wanted: Collection[str], subscribed: dict[int, Topic | None]
    ) -> None:
        if len(message) < _LEAST_SUBSCRIPTION:
            return
        number, name = message[1] | message[2] << 8, message[3:].decode("ascii", "replace")
        subscribed[number] = None
        if name in wanted:
            layout = self._layout(name)
            if layout is not None:
                topic = Topic(name, message[0], *layout)
                subscribed[number] = topic
                self._topics.append(topic)

    def _layout(self, name: str) -> tuple[np.dtype[np.void], int] | None:
        """Return the fields of a topic that are numbers, and the size of a message; None without any."""
        names, forms, offsets, at = [], [], [], 0
        for kind, count, field_name in self._fields(name):
            size = self._size(kind, _MAX_DEPTH) * max(count, 1)
            if kind in _TYPES and field_name not in names and not field_name.startswith("_padding"):
                names.append(field_name)
                forms.append((_TYPES[kind], (count,)) if count else _TYPES[kind])
                offsets.append(at)
            last = field_name.startswith("_padding")
            at += size
        fields = self._fields(name)
        if fields and last:  # padding at the end is not logged
            at -= size
        if not names or not _STAMP <= at < _MAX_MESSAGE or "timestamp" not in names:
            return None
        layout = np.dtype({"names": names, "formats": forms, "offsets": offsets, "itemsize": at})
        return layout, at

    def _fields(self, name: str) -> list[tuple[str, int, str]]:
        """Return type, length of array (0 for none) and name of the fields of a format."""
        found = _FIELD.findall(self._formats.get(name, ""))
        return [(kind, int(count or 0), field_name) for kind, count, field_name in found[:_MAX_FIELDS]]

    def _size(self, kind: str, deepest: int) -> int:
        """Return the size of a type [bytes], at most `_MAX_MESSAGE`."""
        if kind in _TYPES:
            return np.dtype(_TYPES[kind]).itemsize
        if deepest == 0 or kind not in self._formats:
            return _MAX_MESSAGE
        if kind not in self._sizes:
            total = 0
            for inner, count, _ in self._fields(kind):
                total = min(total + self._size(inner, deepest - 1) * max(count, 1), _MAX_MESSAGE)
            self._sizes[kind] = total
        return self._sizes[kind]
