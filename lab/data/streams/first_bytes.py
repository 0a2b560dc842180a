"""First bytes: those of a stream before a sample or fix came, for a recording that begins later.

A replay finds protocol, rate and clock from the first bytes, as the source did. Without them, a recording
that began within the first second had other times than the stream.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

from lab.data.streams.transport import Chunk

MOST = 2**18
"""Most bytes that are kept: a rate is found within 2 s, at most 0.1 MB/s each."""


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
