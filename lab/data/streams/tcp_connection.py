"""TCP connection: bytes of a device or a program that listens on a port."""

from __future__ import annotations

import socket
import time

from lab.data.streams.address import Address, computer_and_port
from lab.data.streams.transport import Chunk

_PATIENCE = 3.0
"""Longest time to connect [s]: three attempts of TCP in a local network."""
_AT_ONCE = 2**16
"""Most bytes read at once."""


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
