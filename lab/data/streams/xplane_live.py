"""X-Plane live: a flight recorded over the network while X-Plane flies it."""

from __future__ import annotations

import math
import socket
import threading
import time
from array import array
from typing import Self

from lab.base.files.bounds import MIN_SAMPLES
from lab.base.files.mission_error import MissionError
from lab.base.parameters.counted import counted, were
from lab.data.protocols import xplane_packets
from lab.data.rebuild.raw_flight import RawFlight

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
BUFFER = 2**20
"""Size of the system's buffer for packets [bytes]: seconds of X-Plane's data."""
MAX_PACKET = 2**16
"""Largest packet taken [bytes]: the largest of UDP."""


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
        self._where = f"X-Plane at {host}:{port}"
        try:
            found = socket.getaddrinfo(host, port, socket.AF_INET, socket.SOCK_DGRAM)
        except (OSError, UnicodeError) as error:
            raise MissionError(f"{self._where}: there is no computer of that name or address") from error
        self._address = (str(found[0][4][0]), port)
        self._rate = rate
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._ended = threading.Event()
        self._failure = ""
        self._clear()

    def _clear(self) -> None:
        self._positions = bytearray()
        self._arrivals = array("d")
        self._clocks = array("d")
        self._clock_arrivals = array("d")
        self._foreign = 0
        self._malformed = 0
        self._heard = time.monotonic()

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
        return len(self._arrivals)

    @property
    def seconds(self) -> float:
        """Time from the first sample to the last [s]."""
        with self._lock:
            return self._arrivals[-1] - self._arrivals[0] if self._arrivals else 0.0

    @property
    def problem(self) -> str:
        """The problem to solve, as a sentence; empty while samples arrive."""
        if self._failure or not self.running:
            return self._failure
        silent = time.monotonic() - self._heard
        if silent < SILENCE:
            return ""
        if self.samples:
            return f"{self._where} has sent nothing for {silent:.0f} s: is it paused, loading or closed?"
        foreign = f" {counted(self._foreign, 'packet')} came from elsewhere." if self._foreign else ""
        return (
            f"{self._where} has not answered for {silent:.0f} s: is X-Plane running with a flight loaded, "
            "are host and port those of its Settings, Network, are incoming connections accepted there, and "
            f"does no firewall stand between?{foreign}"
        )

    def start(self) -> None:
        """Begin to record.

        Raises
        ------
        MissionError
            If a recording is running, or the network cannot be used.
        """
        if self.running:
            raise MissionError(f"{self._where}: a recording is running; stop it first")
        self.close()
        udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            udp.settimeout(_WAKE)
            udp.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
            udp.bind(("", 0))
            self._ask(udp, self._rate)
        except OSError as error:
            udp.close()
            raise MissionError(f"{self._where}: the network cannot be used: {error}") from error
        self._clear()
        self._failure = ""
        self._ended.clear()
        self._thread = threading.Thread(target=self._receive, args=(udp,), name="X-Plane", daemon=True)
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
                f"{self._where}: {counted(self.samples, 'sample')} {were(self.samples)} received; accepted "
                f"are at least {MIN_SAMPLES}"
                f"{f'. {problem}' if problem else ''}"
            )
        remarks = []
        if self._foreign or self._malformed:
            remarks.append(
                f"{counted(self._foreign, 'packet')} from elsewhere and {self._malformed} of other "
                "kinds were ignored."
            )
        return xplane_packets.flight(
            bytes(self._positions), self._arrivals, self._clocks, self._clock_arrivals, remarks
        )

    def close(self) -> None:
        """End the recording, if one is running; the received data are kept until the next one begins."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def _ask(self, udp: socket.socket, rate: float) -> None:
        """Ask X-Plane for packets at a rate; a rate of zero ends them."""
        for packet in xplane_packets.requests(rate):
            udp.sendto(packet, self._address)

    def _receive(self, udp: socket.socket) -> None:
        values = [math.nan] * len(xplane_packets.REFERENCES)
        asked = time.monotonic()
        with udp:
            while not self._ended.is_set() and self.samples < MAX_SAMPLES:
                try:
                    packet, sender = udp.recvfrom(MAX_PACKET)
                    self._accept(packet, sender[0], values)
                except TimeoutError:
                    pass
                except OSError as error:
                    # On Windows the next call fails after an unreachable port.
                    if not isinstance(error, ConnectionError):
                        self._failure = f"{self._where}: the network failed: {error}"
                        return
                now = time.monotonic()
                if now - max(self._heard, asked) > SILENCE / 2:
                    # X-Plane drops its subscribers when it restarts.
                    self._ask_again(udp)
                    asked = now
            self._ask_again(udp, 0.0)
        if self.samples >= MAX_SAMPLES:
            self._failure = f"{self._where}: recorded to the limit of {MAX_SAMPLES} samples; stop and keep it"

    def _ask_again(self, udp: socket.socket, rate: float | None = None) -> None:
        try:
            self._ask(udp, self._rate if rate is None else rate)
        except OSError as error:
            self._failure = self._failure or f"{self._where}: the network failed: {error}"

    def _accept(self, packet: bytes, sender: str, values: list[float]) -> None:
        now = time.monotonic()
        if sender != self._address[0]:
            self._foreign += 1
        elif (record := xplane_packets.position(packet)) is not None:
            self._heard = now
            with self._lock:
                self._positions += record
                self._arrivals.append(now)
        elif (references := xplane_packets.references(packet)) is not None:
            for index, value in references.items():
                values[index] = value
            if 0 in references:
                self._clocks.extend(values)
                self._clock_arrivals.append(now)
        else:
            self._malformed += 1
