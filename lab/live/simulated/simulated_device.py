"""Simulated device: sends a simulated flight as a real device would, and misbehaves when told to."""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from lab.base.aid_table import SENT
from lab.data.protocols.catalogue import ENCODERS
from lab.data.protocols.decoder import Encoder
from lab.data.streams.transport import TransportError
from lab.live.simulated.simulated_flight import SimulatedFlight
from lab.live.simulated.simulated_link import Link

TICK = 1e-3
"""Shortest time between two sendings [s]: one sample of a device with 1 kHz."""
_LOOKS = 4
"""Looks at the clock in a step of the flight: a sample is late by a quarter of a step at most."""
LONGEST_SLEEP = 0.1
"""Longest time between two looks at the line [s]: a line that was unplugged is plugged again no later."""
PATIENCE = 10.0
"""Time without room on the line after which nobody reads it [s]: a busy computer delays a reader for less."""
FIX_DELAY = 0.1
"""Time from the validity of a fix to its sending [s], as of receivers that send 10 fixes a second."""


@dataclass
class Misbehaviour:
    """What is wrong with a device.

    Attributes
    ----------
    corruption : float
        Part of the bytes that have another value.
    jitter : float
        Mean delay of a sending, beside the time that it takes [s].
    drift : float
        How much too fast the clock of the device runs, as a part of 1.
    """

    corruption: float = 0.0
    jitter: float = 0.0
    drift: float = 0.0


def make_encoder(device: str) -> Encoder:
    """Return a new encoder of a device.

    Raises
    ------
    TransportError
        If there is no such device, or a library for it is not installed.
    """
    if device not in ENCODERS:
        raise TransportError(f"{device!r} is no device; accepted are {', '.join(ENCODERS)}")
    try:
        return ENCODERS[device]()
    except ImportError as error:
        raise TransportError(str(error)) from error


def unsent_readings(device: str, reading: NDArray[np.void]) -> str:
    """Return which readings a device does not send, and which devices do, in sentences; empty if it does.

    Parameters
    ----------
    device
        A key of `ENCODERS`.
    reading : (k,) array of `lab.data.protocols.samples.READING`
        Headings and speeds.
    """
    sentences = []
    for name in (aid.live for aid in SENT):
        rows = reading[np.isfinite(reading[name])][:1]
        if len(rows) and not _sends_reading(device, rows):
            able = ", ".join(one for one in ENCODERS if _sends_reading(one, rows))
            sentences.append(f"This device sends no {name.replace('_', ' ')}s; accepted for them are {able}.")
    return " ".join(sentences)


def _sends_reading(device: str, reading: NDArray[np.void]) -> bool:
    try:
        write = getattr(ENCODERS[device](), "encode_readings", None)
    except ImportError:  # of a library that is not installed
        return False
    return write is not None and bool(write(reading))


class SimulatedDevice:
    """Sends a flight once, in real time; as a context manager, it ends its thread and its line.

    What finds no room on the line waits, and is sent late and in order: only a misbehaviour loses samples.

    Attributes
    ----------
    misbehaviour : Misbehaviour
        What is wrong with it; may be changed at any time, but for the drift.
    sent : int
        Samples that were due so far, whoever read them.
    refused : int
        Bytes that nobody read, or that were on a line that broke.
    latest : float
        Longest time by which bytes came late, without its being told to [s].
    plugged : bool
        Whether the line is there.
    begun : float
        The host's monotonic clock at the start of the flight [s]; NaN before it.

    Parameters
    ----------
    flight
        What it sends.
    encoder
        A key of `ENCODERS`, or an encoder.
    link
        The line.
    misbehaviour
        What is wrong with it.
    endless
        Whether the flight begins again when it is over, while time goes on: for one that stands still.

    Raises
    ------
    TransportError
        If there is no such encoder.
    """

    def __init__(
        self,
        flight: SimulatedFlight,
        encoder: str | Encoder,
        link: Link,
        misbehaviour: Misbehaviour | None = None,
        endless: bool = False,
    ) -> None:
        self.flight = flight
        self.misbehaviour = misbehaviour or Misbehaviour()
        self.sent = 0
        self.refused = 0
        self.latest = 0.0
        self._waiting: deque[tuple[float, bytes]] = deque()  # due times of the flight [s], and what was due
        self._moved = 0.0  # time of the flight when the line last took bytes, or none waited [s]
        self._encoder = make_encoder(encoder) if isinstance(encoder, str) else encoder
        self._endless = endless
        self._link = link
        self.plugged = False
        self._back = np.inf  # when it is plugged in again, by the host's clock [s]
        self._lock = threading.Lock()  # of the line, and of what waits
        self._ending = threading.Event()
        self._rng = np.random.default_rng(1)
        self._imu = flight.imu.copy()
        self._fix = flight.fix.copy()
        self._imu["time"] *= 1 + self.misbehaviour.drift
        self._fix["time"] *= 1 + self.misbehaviour.drift
        self._due_fix = flight.fix["time"] + FIX_DELAY
        self._reading = flight.reading.copy()
        self._reading["time"] *= 1 + self.misbehaviour.drift
        self._due_reading = flight.reading["time"] + FIX_DELAY
        self.begun = float("nan")
        self._thread = threading.Thread(target=self._run, name="simulated device", daemon=True)

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def address(self) -> str:
        """The address that opens its line, as long as it is plugged."""
        return self._link.address

    @property
    def finished(self) -> bool:
        """Whether the flight is over, and all that can be delivered is."""
        return not self._endless and self.sent >= len(self._imu) and not self._waiting

    @property
    def late(self) -> float:
        """How long the oldest bytes that found no room have waited [s]; 0 if none wait."""
        waiting = self._waiting
        try:
            return max(0.0, self.time - waiting[0][0])
        except IndexError:  # also if they were sent just now
            return 0.0

    @property
    def time(self) -> float:
        """Time of the flight [s]."""
        return max(0.0, time.monotonic() - self.begun) if np.isfinite(self.begun) else 0.0

    def start(self) -> None:
        """Plug in, and begin to send."""
        self.plug()
        self._thread.start()

    def plug(self) -> None:
        """Make the line, again after `unplug`; the flight has gone on."""
        with self._lock:
            if not self.plugged:
                self._link.plug()
                self.plugged, self._back = True, np.inf

    def unplug(self, seconds: float = np.inf) -> None:
        """Break the line for a time [s], as when the plug is pulled; the flight goes on."""
        with self._lock:
            if self.plugged:
                self._link.unplug()
                self.plugged, self._back = False, time.monotonic() + seconds
                self._forget()

    def close(self) -> None:
        """End; may be repeated."""
        self._ending.set()
        if self._thread.ident is not None:
            self._thread.join()
        self.unplug()

    def _run(self) -> None:
        # The line needs a reader before the first sample, or the sample would be lost.
        self.begun = time.monotonic()
        step = max(1 / self.flight.rate, TICK)
        before = 0  # samples of the rounds before
        sent_fixes, sent_readings, held = 0, 0, 0.0
        while not self._ending.is_set() and not self.finished:
            if time.monotonic() >= self._back:
                with contextlib.suppress(OSError):  # the port may be taken: it is tried again
                    self.plug()
            now = time.monotonic() - self.begun
            with self._lock:
                if now >= held:
                    if self._endless and self.sent - before == len(self._imu):
                        # What is due a moment later is sent now, before the flight is put behind itself.
                        self._queue(now, self._imu[:0], self._fix[sent_fixes:], self._reading[sent_readings:])
                        before, sent_fixes, sent_readings = self.sent, 0, 0
                        self._begin_again()
                    due = min(int(now * self.flight.rate + 1e-9), before + len(self._imu))
                    fixes = int(np.searchsorted(self._due_fix, now))
                    readings = int(np.searchsorted(self._due_reading, now))
                    if due > self.sent or fixes > sent_fixes or readings > sent_readings:
                        first = max((self.sent + 1) / self.flight.rate, held) if due > self.sent else now
                        self._queue(
                            first,
                            self._imu[self.sent - before : due - before],
                            self._fix[sent_fixes:fixes],
                            self._reading[sent_readings:readings],
                        )
                        self.sent, sent_fixes, sent_readings = due, fixes, readings
                        jitter = self.misbehaviour.jitter
                        held = now + self._rng.exponential(jitter) if jitter else 0.0
                self._deliver(now)
            ahead = max((self.sent + 1) / self.flight.rate, held, now + step / _LOOKS) - now
            if self._waiting:
                ahead = min(ahead, TICK)
            self._ending.wait(min(max(ahead, 0.0), LONGEST_SLEEP))

    def _begin_again(self) -> None:
        """Put the flight behind itself."""
        longer = len(self._imu) / self.flight.rate
        for rows in (self._imu, self._fix, self._reading):
            rows["time"] += longer * (1 + self.misbehaviour.drift)
        for rows in (self._fix, self._reading):
            rows["week_time"] += longer
            rows["utc"] += longer
        self._due_fix += longer
        self._due_reading += longer

    def _queue(self, due: float, imu: np.ndarray, fix: np.ndarray, reading: np.ndarray) -> None:
        """Put what is due at a time of the flight [s] behind what waits for room."""
        data = self._encoder.encode(imu, fix[:0]) + (self._encoder.encode(imu[:0], fix) if len(fix) else b"")
        if len(reading) and (write := getattr(self._encoder, "encode_readings", None)) is not None:
            data += write(reading)
        part = self.misbehaviour.corruption
        if part:
            stream = np.frombuffer(data, np.uint8).copy()
            places = np.flatnonzero(self._rng.random(len(stream)) < part)
            stream[places] ^= self._rng.integers(1, 256, len(places), dtype=np.uint8)
            data = stream.tobytes()
        if self.plugged:
            self._waiting.append((due, data))

    def _deliver(self, now: float) -> None:
        """Write what waits as far as there is room, at a time of the flight [s]; the lock is held."""
        if not self.plugged:
            return
        while self._waiting:
            due, data = self._waiting.popleft()
            written = self._link.write(data)
            if written:
                self._moved = now
                self.latest = max(self.latest, now - due)
            if written < len(data):
                self._waiting.appendleft((due, data[written:]))
                break
        if not self._waiting:
            self._moved = now
        elif not self._link.has_reader or now - self._moved > PATIENCE:
            self._forget()

    def _forget(self) -> None:
        """Count what waits as refused."""
        self.refused += sum(len(data) for _, data in self._waiting)
        self._waiting.clear()
