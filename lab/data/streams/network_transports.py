"""Network transports: bytes of a computer that listens (TCP), or of one that sends datagrams (UDP)."""

from __future__ import annotations

import socket
import time

from lab.base.parameters.counted import count_noun
from lab.data.streams.address import Address, computer_and_port
from lab.data.streams.transport import Chunk

_PATIENCE = 3.0
"""Longest time to connect [s]: three attempts of TCP in a local network."""
_AT_ONCE = 2**16
"""Most bytes read at once."""
HERE = "127.0.0.1"
"""Address listened at if none is given: datagrams of this computer only."""

_BUFFER = 2**20
"""Size of the system's buffer for datagrams [bytes]: 10 s of a device with 100 kB/s."""
_LARGEST = 2**16
"""Size of the largest datagram [bytes]."""
_MOST = 256
"""Most datagrams read at once, before others get their turn."""


class UdpListener:
    """Datagrams of one sender; a `Transport` with remarks.

    The first sender is listened to, until it is silent for `SILENCE`: two streams in one would be none.

    Parameters
    ----------
    address
        Such as ``udp:5555``, or ``udp:0.0.0.0:5555`` for senders on other computers.

    Raises
    ------
    TransportError
        If there is no port in it.
    """

    reconnects = True
    SILENCE = 2.0
    """Silence after which another sender is listened to [s]."""

    def __init__(self, address: Address) -> None:
        address.check(())
        self.address = str(address)
        self._place = computer_and_port(address, HERE)
        self._socket: socket.socket | None = None
        self._sender: tuple[object, ...] | None = None
        self._heard = -float("inf")
        self.foreign = 0

    @property
    def remark(self) -> str:
        """What is not listened to, in a sentence."""
        if not self.foreign:
            return ""
        return f"Another sender sends here too: {count_noun(self.foreign, 'datagram')} of it not used."

    def open(self) -> None:
        """Listen.

        Raises
        ------
        OSError
            If the port is in use or the address is none of this computer.
        """
        family, _, _, _, place = socket.getaddrinfo(
            *self._place, type=socket.SOCK_DGRAM, flags=socket.AI_PASSIVE
        )[0]
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
            self._socket.bind(place)
        except OSError:
            self.close()
            raise

    def read(self, longest: float) -> Chunk:
        """Wait for a datagram, and return all that are there."""
        assert self._socket is not None
        parts: list[bytes] = []
        try:
            self._socket.settimeout(longest)
            self._accept(parts)
            self._socket.settimeout(0.0)
            while len(parts) < _MOST:
                self._accept(parts)
        except (TimeoutError, BlockingIOError):
            pass
        return Chunk(time.monotonic(), b"".join(parts))

    def _accept(self, parts: list[bytes]) -> None:
        assert self._socket is not None
        data, sender = self._socket.recvfrom(_LARGEST)
        now = time.monotonic()
        if sender != self._sender and now - self._heard < self.SILENCE:
            self.foreign += 1
            return
        self._sender, self._heard = sender, now
        parts.append(data)

    def close(self) -> None:
        """Free the port."""
        found, self._socket = self._socket, None
        if found is not None:
            found.close()


class TcpConnection:
    """Bytes of a computer that listens; a `Transport`.

    Parameters
    ----------
    address
        Such as ``tcp:127.0.0.1:5555``.

    Raises
    ------
    TransportError
        If there is no computer and port in it.
    """

    reconnects = True

    def __init__(self, address: Address) -> None:
        address.check(())
        self.address = str(address)
        self._place = computer_and_port(address)
        self._socket: socket.socket | None = None

    def open(self) -> None:
        """Connect.

        Raises
        ------
        OSError
            If there is no such computer, or it does not accept.
        """
        self._socket = socket.create_connection(self._place, _PATIENCE)
        # A cable that is pulled out closes nothing: the system asks now and then.
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)

    def read(self, longest: float) -> Chunk:
        """Wait for bytes.

        Raises
        ------
        OSError
            If the other side ended the connection.
        """
        assert self._socket is not None
        self._socket.settimeout(longest)
        try:
            data = self._socket.recv(_AT_ONCE)
        except TimeoutError:
            return Chunk(time.monotonic(), b"")
        if not data:
            raise ConnectionError("the other side ended the connection")
        return Chunk(time.monotonic(), data)

    def close(self) -> None:
        """End the connection."""
        found, self._socket = self._socket, None
        if found is not None:
            found.close()
