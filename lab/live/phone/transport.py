"""Transport of a phone: the batches that the server received, as bytes."""

from __future__ import annotations

import time

from lab.data.streams.transport import Chunk
from lab.live.phone.phone import Phone


class PhoneTransport:
    """Reads what a phone sends, as lines for the decoder ``phone``; a `lab.data.streams.transport.Transport`.

    What came before it was opened is not kept. Each chunk is what one request brought.

    Parameters
    ----------
    phone
        A phone of a hub; its address is ``phone:NAME`` with the name that its owner typed.
    """

    def __init__(self, phone: Phone) -> None:
        self.address = f"phone:{phone.name}"
        self.reconnects = False
        self._phone = phone
        self._open = False

    def open(self) -> None:
        """Begin to keep what comes.

        Raises
        ------
        OSError
            If another transport reads this phone.
        """
        if not self._open:
            self._phone.start_reading()
            self._open = True

    def read(self, longest: float) -> Chunk:
        """Wait for a request of the phone.

        Parameters
        ----------
        longest
            Longest waiting time [s]; then the chunk is empty.

        Raises
        ------
        OSError
            If the transport is not open.
        EOFError
            If the phone may not send any more, and all is read.
        """
        if not self._open:
            raise OSError(f"{self.address} is not open")
        chunk = self._phone.read(longest, lambda: self._open)
        if chunk is None and not self._open:
            raise OSError(f"{self.address} was closed")
        return chunk or Chunk(time.monotonic(), b"")

    def close(self) -> None:
        """Stop; what comes from now on is not kept."""
        if self._open:
            self._open = False
            self._phone.stop_reading()
