"""Limits: how much one phone may send, and at what pace."""

from __future__ import annotations

from typing import Final

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
