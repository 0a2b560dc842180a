"""Phone: one phone of a hub, from its invitation to its last sample."""

from __future__ import annotations

import hmac
import threading
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from lab.data.protocols.phone_line import PhoneLine
from lab.data.streams.transport import Chunk
from lab.live.phone.app_request import AppRequest
from lab.live.phone.limits import QUEUE, REQUEST_BURST, REQUESTS, SAMPLE_BURST, SAMPLES, Pace
from lab.live.phone.page_request import PageRequest

INVITED: Final = "invited"
CONNECTED: Final = "connected"
STREAMING: Final = "streaming"
SILENT: Final = "silent"
ENDED: Final = "ended"
STATES: Final = (INVITED, CONNECTED, STREAMING, SILENT, ENDED)
"""Nobody used the invitation; the page is open, and nobody reads its samples; they are read; nothing came for
`SILENCE`; the invitation has expired or was withdrawn."""
SILENCE: Final = 3.0
"""Time without a request after which a phone is silent [s]: the page sends ten requests a second."""
_RATE_OVER: Final = 5.0
"""Time over which the rate of samples is measured [s]."""

OK: Final = 200
"""Status of HTTP: the batch was taken, or had been taken before."""
BAD: Final = 400
"""It is no batch."""
FOREIGN: Final = 403
"""The address is not this phone's."""
ELSEWHERE: Final = 409
"""The page is open in another tab."""
TOO_FAST: Final = 429
"""More than a phone may send."""
FULL: Final = 503
"""The laboratory is behind."""


class Answer(NamedTuple):
    """The answer to a request.

    Attributes
    ----------
    status : int
        Of HTTP.
    received : int
        Number of the last batch that was received in order; -1 for none.
    read : bool
        Whether somebody reads the samples.
    reason : str
        Why it was refused; empty if it was not.
    """

    status: int
    received: int = -1
    read: bool = False
    reason: str = ""


class PhoneState(NamedTuple):
    """The state of a phone.

    Attributes
    ----------
    key : int
        Its number in the hub.
    name : str
        What its owner typed: plain text, never to be taken for HTML.
    state : str
        One of `STATES`.
    source : str
        What sends: ``page`` or ``Sensor Logger``; empty before anything came.
    samples, fixes : int
        Number received since the invitation.
    rate : float
        Samples per second in the last 5 s.
    waiting : int
        Batches that waited on the phone when it last sent.
    lost : int
        Batches that the phone dropped, because the network was gone for more than a minute.
    silence : float
        Time since it last sent [s]; infinite if it never did.
    left : float
        Time until the invitation expires [s].
    """

    key: int
    name: str
    state: str
    source: str
    samples: int
    fixes: int
    rate: float
    waiting: int
    lost: int
    silence: float
    left: float


class Phone:
    """One phone; all methods may be called from any thread.

    Parameters
    ----------
    key
        Its number in the hub.
    digest
        Hash of the token that it is known by.
    until
        When the invitation expires if nobody uses it, and when it expires in any case [s of the clock].
    clock
        Gives the time, monotonic [s].
    """

    def __init__(
        self, key: int, digest: bytes, until: tuple[float, float], clock: Callable[[], float]
    ) -> None:
        now = clock()
        self.key = key
        self.name = f"Phone {key}"
        self._digest = digest
        self._until = until
        self._clock = clock
        self._changed = threading.Condition()
        self._requests = Pace(REQUESTS, REQUEST_BURST, now)
        self._rows = Pace(SAMPLES, SAMPLE_BURST, now)
        self._device = ""
        self._source = ""
        self._run = -1
        self._next = 0
        self._session, self._message = "", -1
        self._queue: deque[Chunk] = deque()
        self._queued = 0
        self._readers = 0
        self._last = -float("inf")
        self._recent: deque[tuple[float, int]] = deque(maxlen=500)
        self._samples = self._fixes = self._waiting = self._lost = 0
        self._withdrawn = False

    def is_known_by(self, digest: bytes) -> bool:
        """Return whether a token has this hash; it takes the same time for all of them."""
        return hmac.compare_digest(self._digest, digest)

    @property
    def expired(self) -> bool:
        """Whether the invitation is over."""
        return self._withdrawn or self._time_left() <= 0

    def state(self) -> PhoneState:
        """Return what is known now."""
        with self._changed:
            now = self._clock()
            silence = now - self._last
            if self.expired:
                state = ENDED
            elif not self._device:
                state = INVITED
            elif silence > SILENCE:
                state = SILENT
            else:
                state = STREAMING if self._readers else CONNECTED
            rate = sum(count for time, count in self._recent if time > now - _RATE_OVER) / _RATE_OVER
            return PhoneState(
                self.key, self.name, state, self._source, self._samples, self._fixes, rate, self._waiting,
                self._lost, silence, max(self._time_left(), 0.0),
            )  # fmt: skip

    def claim(self, device: str, name: Callable[[], str]) -> bool:
        """Let a device use the invitation; return whether it may: the first one may, and no other.

        Parameters
        ----------
        device
            Name that the device made up for itself.
        name
            Gives the name to show; called for the first device only.
        """
        with self._changed:
            if self.expired:
                return False
            if not self._device:
                self._device, self.name = device, name()
            return hmac.compare_digest(self._device.encode(), device.encode())

    def take_page_request(self, posted: PageRequest) -> Answer:
        """Take the batches of the page that follow those received; of a phone that has claimed."""
        with self._changed:
            now = self._clock()
            if not self._requests.allows(1, now):
                return self._answer(TOO_FAST, "too many requests")
            if posted.run < self._run:
                return self._answer(ELSEWHERE, "the page is open in another tab")
            if posted.run > self._run:
                self._run, self._next = posted.run, posted.oldest
            # The phone drops its oldest batches first: those between were dropped before they were sent.
            self._lost += max(posted.oldest - self._next, 0)
            self._next = max(posted.oldest, self._next)
            lines = []
            following = self._next
            for line in posted.batches:
                if line.number == following:
                    lines.append(line)
                    following += 1
            refused = self._queue_lines(lines, "page", now)
            if refused is not None:
                return refused
            # Only now: what was refused is sent again, and must count as new then.
            self._next, self._waiting = following, posted.waiting
            return self._answer(OK)

    def take_app_request(self, pushed: AppRequest) -> Answer:
        """Take the readings of the app, unless it sent them before; of a phone that has claimed."""
        with self._changed:
            now = self._clock()
            if not self._requests.allows(1, now):
                return self._answer(TOO_FAST, "too many requests")
            # The app repeats a message of which the answer was lost.
            if pushed.session == self._session and pushed.message == self._message >= 0:
                return self._answer(OK)
            for number, line in enumerate(pushed.lines, self._next):
                line.number = number
            refused = self._queue_lines(pushed.lines, "Sensor Logger", now)
            if refused is not None:
                return refused
            self._session, self._message = pushed.session, pushed.message
            self._next += len(pushed.lines)
            return self._answer(OK)

    def withdraw(self) -> None:
        """End the invitation; what was received can still be read."""
        with self._changed:
            self._withdrawn = True
            self._changed.notify_all()

    def start_reading(self) -> None:
        """From now on, keep what comes until it is read."""
        with self._changed:
            if self._readers:
                raise OSError(f"{self.name} is already being recorded")
            self._readers += 1

    def stop_reading(self) -> None:
        """Keep nothing any more, and end a reading that waits."""
        with self._changed:
            self._readers = 0
            self._queue.clear()
            self._queued = 0
            self._changed.notify_all()

    def read(self, longest: float, goes_on: Callable[[], bool]) -> Chunk | None:
        """Return what came next; None if nothing did in a time [s], or if it shall not go on.

        Raises
        ------
        EOFError
            If the invitation is over and all is read.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._queue or self.expired or not goes_on(), longest)
            if self._queue and goes_on():
                chunk = self._queue.popleft()
                self._queued -= len(chunk.data)
                return chunk
            if self.expired:
                raise EOFError(f"{self.name} may not send any more: its invitation is over")
            return None

    def _time_left(self) -> float:
        return self._until[bool(self._device)] - self._clock()

    def _answer(self, status: int, reason: str = "") -> Answer:
        return Answer(status, self._next - 1, self._readers > 0, reason)

    def _queue_lines(self, lines: Sequence[PhoneLine], source: str, now: float) -> Answer | None:
        """Queue lines as a chunk, or return the answer that refuses them all."""
        self._last = now
        rows = sum(len(line.imu) + len(line.rate) + len(line.force) + len(line.magnetic) for line in lines)
        data = b"".join(line.written() for line in lines) if self._readers else b""
        if self._queued + len(data) > QUEUE:
            return self._answer(FULL, "the laboratory is too busy to take more")
        if not self._rows.allows(rows, now):
            return self._answer(TOO_FAST, "too many samples a second")
        if data:
            self._queue.append(Chunk(now, data))
            self._queued += len(data)
            self._changed.notify_all()
        samples = sum(line.samples for line in lines)
        self._source = source
        self._samples += samples
        self._fixes += sum(len(line.fix) for line in lines)
        self._recent.append((now, samples))
        return None
