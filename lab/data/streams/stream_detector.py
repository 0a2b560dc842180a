"""Stream detector: bytes are kept until their protocol is found in them, and then decoded."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import astuple
from operator import add

import numpy as np

from lab.base.parameters.counted import count_noun
from lab.data.protocols.catalogue import make_decoder
from lab.data.protocols.column_map import ColumnMap
from lab.data.protocols.decoder import Decoder, Statistics
from lab.data.protocols.recognition import recognise, sound_frames
from lab.data.protocols.samples import Samples
from lab.data.protocols.text_cells import last_whole_lines
from lab.data.protocols.text_lines import TextLines
from lab.data.streams.transport import Chunk

RECOGNISED = 1.0
"""Time of bytes in which a protocol is looked for, and until it is looked for again [s]: 20 samples of a slow
device, a fix of a receiver."""
ENOUGH = 4096
"""Bytes that are enough to look for the first time, however soon they come: 40 frames of 100 bytes."""
MOST = 2**14
"""Bytes in which it is looked for again: to look in them takes 0.1 s."""
_LOOKED_AT = 8192
"""Last bytes in which lines are looked for, to be shown."""


class StreamDetector:
    """Finds the decoder of one stream, and decodes with it.

    Attributes
    ----------
    protocol, evidence : str
        The protocol, empty while it is unknown; and what speaks for it, or why nothing is recognised.
    decoder : Decoder or None
        The decoder; None while the protocol is unknown.
    found_out : bool
        Whether the protocol is found out: after the device was lost, that of another one is.

    Parameters
    ----------
    protocol
        A key of `DECODERS`, or ``FILE.py:Name``; empty to find out.
    columns
        Of text: what they are; None to find out.
    said, units
        As of `TextLines`.
    """

    def __init__(
        self, protocol: str, columns: ColumnMap | None, said: Mapping[str, str], units: Mapping[str, str]
    ) -> None:
        self.protocol = protocol
        self.evidence = ""
        self._columns, self._said, self._units = columns, dict(said), dict(units)
        self._before = Statistics()
        self.found_out = not protocol
        self.decoder: Decoder | None = self._made() if protocol else None
        self._first: deque[Chunk] = deque()
        self._held = 0  # bytes in them
        self._tried: float | None = None  # when a protocol was last looked for
        self._again = False  # whether the device was lost, and another one may come

    def _made(self) -> Decoder:
        if self.protocol == TextLines.name:
            made = TextLines(self._columns, self._said, self._units)
            made.follows_headers |= self.found_out
            return made
        return make_decoder(self.protocol)

    @property
    def statistics(self) -> Statistics:
        """What the decoders have seen, since the beginning."""
        now = self.decoder.statistics if self.decoder else Statistics(self._held)
        return Statistics(*map(add, astuple(self._before), astuple(now)))

    @property
    def described(self) -> str:
        """What speaks for the protocol, and what the decoder found out about the device, in sentences."""
        return " ".join(text for text in (self.evidence, getattr(self.decoder, "evidence", "")) if text)

    @property
    def columns(self) -> ColumnMap | None:
        """The columns of text lines, once they are known."""
        return self.decoder.columns if isinstance(self.decoder, TextLines) else self._columns

    @property
    def last_lines(self) -> tuple[str, ...]:
        """The last lines of text in which no columns are recognised; empty for anything else."""
        if isinstance(self.decoder, TextLines):
            return tuple(self.decoder.last) if self.decoder.is_unrecognised else ()
        if self.decoder is not None or self._tried is None:
            return ()
        return last_whole_lines(b"".join(one.data for one in self._first)[-_LOOKED_AT:])

    @property
    def wrap_period(self) -> float:
        """Time after which the device's clock starts again [s]."""
        return self.decoder.wrap_period if self.decoder else np.inf

    def accept(self, chunk: Chunk) -> list[tuple[Samples, float]]:
        """Return the samples in bytes that arrived, with the times of their arrival [s]."""
        if self.decoder is not None and not self._again:
            return [(self.decoder.feed(chunk.data), chunk.arrival)]
        if self.decoder is not None:
            return self._decode_as_before(self.decoder, chunk)
        self._first.append(chunk)
        self._held += len(chunk.data)
        if not self._found(chunk.arrival):
            return []
        return self._decode_kept()

    def name_columns(self, said: Mapping[str, str]) -> list[tuple[Samples, float]]:
        """Read text with columns that a person names; return the samples in bytes that were kept.

        Parameters
        ----------
        said
            As of `TextLines`.
        """
        self._before = self.statistics
        # The bytes that were kept are fed again below, and must not count twice.
        self._before.bytes -= self._held
        self.protocol, self.evidence, self._columns, self._said = TextLines.name, "", None, dict(said)
        self.found_out = False
        return self._decode_kept()

    def find_out(self) -> None:
        """Go on as if the protocol had been found out, as a recording says that it was."""
        self.found_out = True
        if isinstance(self.decoder, TextLines):
            self.decoder.follows_headers = True

    def _decode_as_before(self, decoder: Decoder, chunk: Chunk) -> list[tuple[Samples, float]]:
        """Decode what comes after a loss, unless it is of another device."""
        self._first.append(chunk)
        self._held += len(chunk.data)
        found = decoder.feed(chunk.data)
        # One frame with a sound check: it is the same device again.
        if decoder.statistics.frames:
            self._again, self._held = False, 0
            self._first.clear()
            return [(found, chunk.arrival)]
        said = self.evidence
        if self._found(chunk.arrival):
            self._again, self._columns = False, None
            return self._decode_kept()
        # Looking for a protocol has written that nothing is recognised, which is no news of this device.
        self.evidence = said
        return [(found, chunk.arrival)]

    def _decode_kept(self) -> list[tuple[Samples, float]]:
        decoder = self.decoder = self._made()
        found = [(decoder.feed(one.data), one.arrival) for one in self._first]
        self._first.clear()
        self._held = 0
        return found

    def answer(self, unit: str) -> float:
        """Read rates in another unit from now on; return the factor for those that were read.

        Raises
        ------
        ColumnMapError
            If it is no unit of a rate.
        """
        self._units["rate"] = unit
        if self._columns is not None:
            self._columns = self._columns.in_unit("rate", unit)
        return self.decoder.answer(unit) if isinstance(self.decoder, TextLines) else 1.0

    def finish(self) -> Samples | None:
        """Return the samples that were held back when the device was lost; None without a decoder."""
        rest = None
        if self.decoder is not None:
            rest = self.decoder.finish()
            self._before = self.statistics
            if self._columns is None and isinstance(self.decoder, TextLines):
                self._columns = self.decoder.columns
            self.decoder = self._made()
            self._again = self.found_out
        self._first.clear()
        self._held, self._tried = 0, None
        return rest

    def _found(self, arrival: float) -> bool:
        """Look for a protocol in the bytes that are kept, if it is time to; return whether there is one."""
        first = self._first
        # Enough bytes are looked at once; from then on, at most as often as `RECOGNISED` says.
        begin = first[0].arrival if self._tried is None else self._tried
        if (self._held < ENOUGH or self._tried is not None) and arrival - begin < RECOGNISED:
            return False
        self._tried = arrival
        # The oldest go first: what speaks for a protocol is what the device sends now.
        while self._held > MOST and len(first) > 1:
            gone = len(first.popleft().data)
            self._held -= gone
            self._before.bytes += gone
            self._before.skipped += gone
        data = b"".join(one.data for one in first)
        found = recognise(data)
        if not found:
            seen = count_noun(self.statistics.bytes, "byte")
            self.evidence = sound_frames(data) or f"Nothing is recognised in {seen}."
            return False
        self.protocol, self.evidence = found[0].name, found[0].evidence
        return True
