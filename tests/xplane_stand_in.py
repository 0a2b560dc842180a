"""What stand-ins for X-Plane share: a port on the loopback, a thread, and who asked for what."""

from __future__ import annotations

import socket
import struct
import threading
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Self

Place = tuple[str, int]
"""Address and port of someone who asks."""


@dataclass
class Subscriber:
    """Who asked for what: the rate of positions [Hz], and the names of references by their numbers."""

    rate: int = 0
    references: dict[int, str] = field(default_factory=dict)

    def ask(self, packet: bytes) -> None:
        """Take a request."""
        if packet.startswith(b"RPOS\0"):
            self.rate = int(packet[5:].split(b"\0")[0])
        elif packet.startswith(b"RREF\0"):
            rate, index, name = struct.unpack("<5xii400s", packet)
            self.references[index] = name.split(b"\0")[0].decode()
            if not rate:
                self.references.pop(index)

    def answer(self, values: Mapping[str, float]) -> bytes:
        """Return the packet with the references that were asked for."""
        rows = (struct.pack("<if", index, values[name]) for index, name in self.references.items())
        return b"RREF," + b"".join(rows)


class XPlaneStandIn(ABC):
    """Listens at a port of its own from a thread, as a context manager.

    Parameters
    ----------
    port : int
        Where to listen; zero for any free port.

    Attributes
    ----------
    requests : list of bytes
        What was asked.
    subscribers : dict
        Who has asked and not ended it, by address.
    """

    def __init__(self, port: int = 0) -> None:
        self.requests: list[bytes] = []
        self.subscribers: dict[Place, Subscriber] = {}
        self._stop = threading.Event()
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._udp.bind(("127.0.0.1", port))
        self.port: int = self._udp.getsockname()[1]
        self._thread = threading.Thread(target=self._run, name="simulated X-Plane", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._udp.close()

    @abstractmethod
    def _run(self) -> None:
        """Send, until `_stop` is set."""

    def _listen(self, longest: float = 0.0) -> bool:
        """Take the next request within a time [s]; return whether one came."""
        self._udp.settimeout(longest)
        try:
            packet, place = self._udp.recvfrom(2048)
        except (TimeoutError, BlockingIOError, ConnectionError):
            return False
        self.requests.append(packet)
        who = self.subscribers.setdefault(place, Subscriber())
        who.ask(packet)
        if not who.rate and not who.references:
            del self.subscribers[place]
        return True
