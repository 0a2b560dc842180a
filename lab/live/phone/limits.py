"""Limits: how much one phone may send and at what pace, and how many connections a server holds open.

Nobody keeps the others out. A class behind one router has one address, so an address tells nobody apart. A
request with a valid token tells whose its connection is. Until then a connection is a stranger's: where there
are too many, the oldest makes room, because a phone sends its first request as soon as it is connected.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from tornado.iostream import IOStream

MOST: Final = 256
"""Most connections at once: four for each of the 60 phones, and some for those that come."""
STRANGERS: Final = 64
"""Most connections of strangers from one address at once: a class of 40 that scans its codes together."""
EACH: Final = 4
"""Most connections of one phone at once: a browser uses one or two, and more while it changes the network."""
BODY: Final = 2**18
"""Most bytes of a request: ten seconds of a page at 100 Hz have 70 kB."""
REQUESTS: Final = 30.0
"""Most requests a second of one phone in the long run: the page sends 10."""
REQUEST_BURST: Final = 60.0
"""Requests that may come at once."""
SAMPLES: Final = 1000.0
"""Most rows a second of one phone in the long run: browsers give 60 to 100 samples, apps up to 500 readings
of two sensors."""
SAMPLE_BURST: Final = 60 * SAMPLES
"""Rows that may come at once: those of a minute without network."""
QUEUE: Final = 2**22
"""Most bytes that wait to be read: ten minutes of a page, or 50 s of an app at 500 Hz."""


class Pace:
    """Lets through so many a second in the long run, and a burst now and then (a token bucket).

    Parameters
    ----------
    rate
        Per second.
    burst
        At once.
    now
        Time [s].
    """

    def __init__(self, rate: float, burst: float, now: float) -> None:
        self._rate = rate
        self._burst = burst
        self._left = burst
        self._last = now

    def allows(self, count: float, now: float) -> bool:
        """Return whether so many more may come at a time [s]; if so, they count."""
        self._left = min(self._burst, self._left + self._rate * (now - self._last))
        self._last = now
        if count > self._left:
            return False
        self._left -= count
        return True


class Connections:
    """The open connections of all ports of a server, in the order of their last use."""

    def __init__(self) -> None:
        self._open: dict[IOStream, tuple[str, int | None]] = {}

    def admit(self, stream: IOStream, host: str) -> bool:
        """Count a new connection; return False if there is no room for it.

        Parameters
        ----------
        stream
            The connection.
        host
            Address from which it comes.
        """
        strangers = [one for one, (_, phone) in self._open.items() if phone is None]
        from_here = [one for one in strangers if self._open[one][0] == host]
        if len(from_here) >= STRANGERS:
            # The oldest stranger from there gives way: one host that opens many cannot keep others out.
            self._close(from_here[0])
        elif len(self._open) >= MOST:
            # Connections of known phones are never closed for a stranger.
            if not strangers:
                return False
            self._close(strangers[0])
        self._open[stream] = host, None
        return True

    def used_by(self, stream: IOStream | None, phone: int) -> None:
        """Note that a phone has sent a request; close its connection of the longest ago if it has too many.

        Parameters
        ----------
        stream
            The connection of the request; None if it is closed by now.
        phone
            Key of the phone.
        """
        if stream is None or stream not in self._open:
            return
        # Taken out and put in again below: the order of the table is that of the last use.
        host, _ = self._open.pop(stream)
        others = list(self._streams_of_phone(phone))
        if len(others) >= EACH:
            self._close(others[0])
        self._open[stream] = host, phone

    def forget(self, stream: IOStream) -> None:
        """Count a closed connection no more."""
        self._open.pop(stream, None)

    def _streams_of_phone(self, phone: int) -> Iterator[IOStream]:
        return (stream for stream, (_, owner) in self._open.items() if owner == phone)

    def _close(self, stream: IOStream) -> None:
        self.forget(stream)
        stream.close()
