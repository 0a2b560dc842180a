"""X-Plane live: the link to a running X-Plane, and a flight recorded while X-Plane flies it."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from array import array
from collections.abc import Sequence
from typing import Self

import numpy as np

from lab.base.arrays import Flags, FloatArray
from lab.base.files.bounds import MIN_SAMPLES
from lab.base.files.mission_error import MissionError
from lab.base.parameters.counted import count_noun, was_or_were
from lab.data.files.fields import NAMED, SEA_LEVEL
from lab.data.protocols import xplane
from lab.data.protocols.xplane import FIELDS, REFERENCES, Position, XPlanePackets
from lab.data.rebuild.raw_flight import ColumnUnit, Dropped, RawFlight

NAME = "X-Plane live"
PORT = 49000
"""X-Plane's default port."""
LAST_PORT = 65_535
"""Largest number of a port: UDP has 16 bits for it."""
RATES = (1.0, 1000.0)
"""Rates accepted [Hz]; X-Plane sends at most once in a frame."""
MAX_SAMPLES = 4_000_000
"""Most samples kept: more than a day at 40 Hz."""
SILENCE = 3.0
"""Time without a sample after which a problem is reported [s]."""

_WAKE = 0.1
"""Longest wait for a packet [s]: within it a recording that is ended ends."""
_BUFFER = 2**20
"""Size of the system's buffer for packets [bytes]: seconds of X-Plane's data."""
_MAX_PACKET = 2**16
"""Largest packet taken [bytes]: the largest of UDP."""


class XPlaneLink:
    """Asks an X-Plane for its motion, again after a silence, and takes its packets and no others.

    Parameters
    ----------
    host, port
        Where X-Plane listens.
    rate
        Positions to ask for [Hz]; X-Plane sends at most one in a frame.

    Attributes
    ----------
    where : str
        X-Plane and its place, for messages.
    peer : tuple
        Its address and port, once `find` or `open` has found it.
    foreign : int
        Packets that came from elsewhere.
    """

    def __init__(self, host: str, port: int, rate: float) -> None:
        self.where = f"X-Plane at {host}:{port}"
        self.peer = ("", 0)
        self.foreign = 0
        self._place, self._rate = (host, port), rate
        self._udp: socket.socket | None = None
        self._opened = self._asked = self._heard = 0.0

    def find(self) -> None:
        """Look the computer up.

        Raises
        ------
        OSError
            If there is none of this name or address.
        """
        try:
            found = socket.getaddrinfo(*self._place, socket.AF_INET, socket.SOCK_DGRAM)
        except UnicodeError as error:
            raise OSError("no computer can have this name") from error
        self.peer = str(found[0][4][0]), self._place[1]

    def open(self) -> None:
        """Ask for the motion.

        Raises
        ------
        OSError
            If there is no such computer, or the network cannot be used.
        """
        self.find()
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._udp.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
            self._udp.bind(("", 0))
            self._opened = self._heard = time.monotonic()
            self._ask(self._rate)
        except OSError:
            self.close()
            raise
        self.foreign = 0

    def packet(self, longest: float) -> bytes | None:
        """Return the next packet of X-Plane; None if none comes in time.

        Parameters
        ----------
        longest
            Longest waiting time [s].

        Raises
        ------
        OSError
            If the network failed.
        """
        assert self._udp is not None
        deadline = time.monotonic() + longest
        while True:
            now = time.monotonic()
            if now - max(self._heard, self._asked) > SILENCE / 2:
                self._ask(self._rate)  # X-Plane drops its subscribers when it restarts
            self._udp.settimeout(max(deadline - now, 0.0))
            try:
                packet, sender = self._udp.recvfrom(_MAX_PACKET)
            except (TimeoutError, BlockingIOError):
                return None
            except ConnectionError:  # on Windows, after an unreachable port
                return None
            if sender[0] == self.peer[0]:
                self._heard = time.monotonic()
                return packet
            self.foreign += 1
            if time.monotonic() > deadline:  # however many come from elsewhere
                return None

    @property
    def silence(self) -> str:
        """What to look after if nothing comes, as a sentence; empty while packets come."""
        silent = time.monotonic() - self._heard
        if self._udp is None or silent < SILENCE:
            return ""
        if self._heard > self._opened:
            return f"{self.where} has sent nothing for {silent:.0f} s: is it paused, loading or closed?"
        return (
            f"{self.where} has not answered for {silent:.0f} s: is X-Plane running with a flight loaded, "
            "are host and port those of its Settings, Network, are incoming connections accepted there, and "
            "does no firewall stand between?"
        )

    def _ask(self, rate: float) -> None:
        """Ask for packets at a rate [Hz]; a rate of zero ends them."""
        assert self._udp is not None
        self._asked = time.monotonic()
        for packet in xplane.requests(rate):
            self._udp.sendto(packet, self.peer)

    def close(self) -> None:
        """End the packets, and free the port; may be repeated."""
        if self._udp is not None:
            with contextlib.suppress(OSError):
                self._ask(0.0)
            self._udp.close()
            self._udp = None


class XPlaneRecorder:
    """Records a flight from a running X-Plane; as a context manager, it ends a running recording.

    Parameters
    ----------
    host : str
        Name or address of the computer X-Plane runs on.
    port : int
        X-Plane's port.
    rate : float
        Samples to ask for [Hz]; X-Plane sends at most one in a frame.

    Raises
    ------
    MissionError
        If a port or rate is not accepted, or there is no such computer.
    """

    def __init__(self, host: str = "127.0.0.1", port: int = PORT, rate: float = 50.0) -> None:
        if not 1 <= port <= LAST_PORT:
            raise MissionError(
                f"X-Plane at {host}: port {port} is not accepted; accepted are 1 to {LAST_PORT}"
            )
        if not RATES[0] <= rate <= RATES[1]:
            raise MissionError(
                f"X-Plane at {host}:{port}: a rate of {rate:g} Hz is not accepted; accepted are "
                f"{RATES[0]:g} to {RATES[1]:g} Hz"
            )
        self._link = XPlaneLink(host, port, rate)
        try:
            self._link.find()
        except OSError as error:
            raise MissionError(f"{self._link.where}: there is no computer of that name or address") from error
        self._thread: threading.Thread | None = None
        self._ended = threading.Event()
        self._clear()

    def _clear(self) -> None:
        self._failure = ""
        self._packets = XPlanePackets()
        self._records = bytearray()
        self._values = array("d")
        self._arrivals = array("d")
        self._received = 0
        self._earliest = self._latest = 0.0  # arrivals of the first and the last sample [s]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def running(self) -> bool:
        """Whether a recording is running."""
        return self._thread is not None and self._thread.is_alive()

    @property
    def samples(self) -> int:
        """Samples received so far."""
        return self._received

    @property
    def seconds(self) -> float:
        """Time from the first sample to the last [s]."""
        return self._latest - self._earliest

    @property
    def problem(self) -> str:
        """The problem to solve, as a sentence; empty while samples arrive."""
        if self._failure or not self.running:
            return self._failure
        silence = self._link.silence
        if silence and self._link.foreign:
            return f"{silence} {count_noun(self._link.foreign, 'packet')} came from elsewhere."
        return silence

    def start(self) -> None:
        """Begin to record.

        Raises
        ------
        MissionError
            If a recording is running, or the network cannot be used.
        """
        if self.running:
            raise MissionError(f"{self._link.where}: a recording is running; stop it first")
        self.close()
        try:
            self._link.open()
        except OSError as error:
            raise MissionError(f"{self._link.where}: the network cannot be used: {error}") from error
        self._clear()
        self._ended.clear()
        self._thread = threading.Thread(target=self._receive, name="X-Plane", daemon=True)
        self._thread.start()

    def stop(self) -> RawFlight:
        """End the recording and return the received flight.

        Raises
        ------
        MissionError
            If there are too few samples for a flight, naming the problem.
        """
        problem = self.problem
        self.close()
        if self.samples < MIN_SAMPLES:
            raise MissionError(
                f"{self._link.where}: {count_noun(self.samples, 'sample')} {was_or_were(self.samples)} "
                "received; "
                f"accepted are at least {MIN_SAMPLES}"
                f"{f'. {problem}' if problem else ''}"
            )
        self._keep(self._packets.finish())
        remarks = []
        if self._link.foreign or self._packets.ignored:
            remarks.append(
                f"{count_noun(self._link.foreign, 'packet')} from elsewhere and {self._packets.ignored} of "
                "other kinds were ignored."
            )
        return flight(bytes(self._records), self._arrivals, self._values, remarks)

    def close(self) -> None:
        """End the recording, if one is running; the received data are kept until the next one begins."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def _receive(self) -> None:
        while not self._ended.is_set() and self._received < MAX_SAMPLES:
            try:
                packet = self._link.packet(_WAKE)
            except OSError as error:
                self._failure = f"{self._link.where}: the network failed: {error}"
                self._ended.wait(_WAKE)  # it may come back
                continue
            if packet is not None:
                self._failure = ""
                now = time.monotonic()
                if xplane.position(packet) is not None:
                    self._earliest, self._latest = self._earliest if self._received else now, now
                    self._received += 1
                self._keep(self._packets.accept(packet, now))
        self._link.close()
        if self._received >= MAX_SAMPLES:
            self._failure = (
                f"{self._link.where}: recorded to the limit of {MAX_SAMPLES} samples; stop and keep it"
            )

    def _keep(self, found: Sequence[Position]) -> None:
        for one in found:
            self._records += one.record
            self._values.extend(one.references)
            self._arrivals.append(one.arrival)


def flight(
    records: bytes, arrivals: Sequence[float], values: Sequence[float], remarks: Sequence[str] = ()
) -> RawFlight:
    """Return the flight made of positions.

    Parameters
    ----------
    records
        The records of n positions.
    arrivals
        When they arrived [s].
    values
        Their references, position by position.
    remarks
        Further remarks.

    Raises
    ------
    MissionError
        If there are too few samples that can be used.
    """
    known, remarks = xplane.columns(records, values), [SEA_LEVEL, *remarks]
    timed = np.isfinite(known["time"])
    trusted = 2 * timed.sum() > len(timed)
    units = {name: unit for name, _, unit in FIELDS}
    for name, *_, unit in REFERENCES:
        if trusted and 2 * np.isfinite(known[name]).sum() > len(timed):
            units[name] = unit
        else:
            del known[name]
    if not trusted:
        timed[:] = True
        known["time"], units["time"] = np.array(arrivals) - np.array(arrivals[:1]), "s"
        remarks.append(
            "X-Plane did not send its own clock: time is that of arrival at this computer, which jitters."
        )
    kept, dropped = _mask_believable(known, timed)
    known = {name: column[kept] for name, column in known.items()}
    return RawFlight(
        format=NAME,
        time=known["time"],
        latitude=known["latitude"],
        longitude=known["longitude"],
        height=known["height"],
        velocity_n=xplane.velocity_n(known),
        euler=xplane.matrix(known, "roll", "pitch", "heading"),
        body_rate=xplane.matrix(known, "p", "q", "r"),
        airspeed=known.get("airspeed"),
        alpha=known.get("alpha"),
        beta=known.get("beta"),
        rows_read=len(timed),
        dropped=dropped,
        units=tuple(ColumnUnit(name, unit, NAMED) for name, unit in units.items()),
        remarks=tuple(remarks),
        vehicle="aircraft",
    )


def _mask_believable(known: dict[str, FloatArray], timed: Flags) -> tuple[Flags, tuple[Dropped, ...]]:
    """Return which samples have a clock and possible numbers, and the report on the others."""
    believed = timed & xplane.mask_possible(known)
    unclocked = Dropped.of("without the simulator's clock", ~timed)
    if believed.sum() < MIN_SAMPLES:
        raise MissionError(
            f"X-Plane sent {len(timed)} samples, of which {believed.sum()} can be used; accepted are at "
            f"least {MIN_SAMPLES}"
        )
    return believed, (*unclocked, *Dropped.of("with numbers no flight has", timed & ~believed))
