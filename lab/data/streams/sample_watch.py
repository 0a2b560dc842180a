"""Sample watch: the bytes of a stream that give no sample: why they give none, and those before the first.

A replay finds protocol, rate and clock from the first bytes, as the source did. Without them, a recording
that began within the first second had other times than the stream.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

from lab.base.parameters.counted import count_noun
from lab.data.streams.reception import Reception
from lab.data.streams.transport import Chunk

MOST = 2**18
"""Most bytes that are kept: a rate is found within 2 s, at most 0.1 MB/s each."""
FRUITLESS = 2.0
"""Time with bytes and without a sample after which a source is stale [s]: it holds two fixes of a receiver,
and the time in which a protocol is looked for twice."""


class SampleWatch:
    """When bytes last gave a frame, and when a sample or a fix; of one connection.

    Parameters
    ----------
    now
        When it began [s].
    """

    def __init__(self, now: float) -> None:
        self._framed = self._sampled = now
        self._frames = 0

    def sampled(self, now: float) -> None:
        """Note that a sample or a fix came."""
        self._framed = self._sampled = now

    def without(self, now: float, frames: int) -> None:
        """Note that bytes came without one; there are so many frames in all."""
        if frames != self._frames:
            self._frames, self._framed = frames, now

    def missing_reason(self, now: float, reception: Reception, *, is_serial: bool) -> str:
        """Return what is wrong with bytes that give no sample; empty while nothing is.

        Parameters
        ----------
        now
            The time [s].
        reception
            What reads the bytes.
        is_serial
            Whether they come through a line that has a speed.
        """
        if now - self._sampled <= FRUITLESS or not reception.detector.statistics.bytes:
            return ""
        if now - self._framed > FRUITLESS:
            return f"{_describe_unread(now - self._framed, reception)} {_question(is_serial)}"
        seen, loss = reception.detector.statistics, reception.loss
        counts = {
            "repeated": loss.repeated, "backwards": loss.backwards, "outside the limits": seen.refused,
            "without samples": seen.unknown,
        }  # fmt: skip
        why = ", ".join(f"{count} {name}" for name, count in counts.items() if count)
        return (
            f"Frames come, but no new sample or position for {now - self._sampled:.0f} s"
            f"{f' ({why})' if why else ''}. A receiver may still look for satellites."
        )


def _describe_unread(seconds: float, reception: Reception) -> str:
    """Return a sentence about bytes that are no frames."""
    if not reception.detector.protocol:
        return reception.detector.evidence or "Bytes come; their protocol is looked for."
    detector = reception.detector
    seen = count_noun(detector.statistics.skipped, "byte")
    return (
        f"Bytes come, but no frame of {detector.protocol} has passed its check for {seconds:.0f} s; "
        f"{seen} belong to none."
    )


def _question(is_serial: bool) -> str:
    return "Are the speed of the line and the protocol right?" if is_serial else "Is the protocol right?"


class FirstBytes:
    """The bytes from the beginning of a stream to its first sample."""

    def __init__(self) -> None:
        self._chunks: deque[Chunk] = deque()
        self._bytes = 0
        self._ended = False

    def __iter__(self) -> Iterator[Chunk]:
        return iter(self._chunks)

    def add(self, chunk: Chunk) -> None:
        """Keep bytes that gave no sample; of too many, the latest."""
        if self._ended or not chunk.data:
            return
        self._chunks.append(chunk)
        self._bytes += len(chunk.data)
        while self._bytes > MOST:
            self._bytes -= len(self._chunks.popleft().data)

    def end(self) -> None:
        """Forget the bytes, since a sample came."""
        self._chunks.clear()
        self._ended = True
