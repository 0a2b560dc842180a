"""Simulated link: where a simulated device writes: a pseudo-terminal, a TCP port, or datagrams."""

from __future__ import annotations

import contextlib
import os
import socket
from importlib.util import find_spec
from typing import Protocol

from lab.data.streams.address import LAST_PORT
from lab.data.streams.transport import TransportError

_BACKLOG = 4
"""Clients that may wait to take the place of the one that reads: a few that connect again."""
_LARGEST_DATAGRAM = 1400
"""Largest datagram that goes through an Ethernet in one piece [bytes]."""


class Link(Protocol):
    """One end of a line, to write to."""

    @property
    def address(self) -> str:
        """The address that opens the other end."""

    @property
    def has_reader(self) -> bool:
        """Whether somebody may read what is written, as far as is known."""

    def plug(self) -> None:
        """Make the line, again after `unplug`; raises `OSError`."""

    def write(self, data: bytes) -> int:
        """Write, without waiting; return how many bytes found room."""

    def unplug(self) -> None:
        """Break the line; may be repeated."""


class PseudoTerminal:
    """A serial port that is a program; on Linux and macOS.

    Each time it is plugged, the port has another name, as that of a real device may.
    """

    def __init__(self) -> None:
        self._ours = self._theirs = -1
        self._name = ""

    @property
    def address(self) -> str:
        """The address that opens the other end."""
        return f"serial:{self._name}"

    @property
    def has_reader(self) -> bool:
        """Whether somebody may read: always, since nobody knows who opened its other side."""
        return True

    def plug(self) -> None:
        """Make the port."""
        import pty  # noqa: PLC0415 - not on Windows
        import tty  # noqa: PLC0415 - not on Windows

        # Our own descriptor of their side keeps what is written until it is opened.
        self._ours, self._theirs = pty.openpty()
        tty.setraw(self._theirs)
        os.set_blocking(self._ours, False)
        self._name = os.ttyname(self._theirs)

    def write(self, data: bytes) -> int:
        """Write what finds room."""
        try:
            return os.write(self._ours, data)
        except BlockingIOError:
            return 0

    def discard(self) -> None:
        """Throw away what the reader wrote: its writes must not wait for room."""
        with contextlib.suppress(BlockingIOError):
            os.read(self._ours, 4096)

    def unplug(self) -> None:
        """Close both sides: who reads gets an error."""
        ours, theirs, self._ours, self._theirs = self._ours, self._theirs, -1, -1
        for descriptor in (ours, theirs):
            if descriptor >= 0:
                os.close(descriptor)


class TcpServer:
    """A TCP port that one client at a time may read.

    Parameters
    ----------
    host, port
        Where it listens; port 0 for any that is free, which it keeps.
    """

    def __init__(self, host: str = "127.0.0.1", port: int = 0) -> None:
        self._host, self._port = host, port
        self._server: socket.socket | None = None
        self._client: socket.socket | None = None

    @property
    def address(self) -> str:
        """The address that opens the other end."""
        return f"tcp:{self._host}:{self._port}"

    @property
    def has_reader(self) -> bool:
        """Whether somebody may read: whether a client is connected."""
        return self._client is not None

    def plug(self) -> None:
        """Listen."""
        self._server = socket.create_server((self._host, self._port), backlog=_BACKLOG)
        self._server.setblocking(False)
        self._port = self._server.getsockname()[1]

    def write(self, data: bytes) -> int:
        """Write what finds room; without a client, as on a line that nobody reads, it is gone."""
        if self._server is not None:
            with contextlib.suppress(BlockingIOError):
                client, _ = self._server.accept()
                client.setblocking(False)
                self._end(self._client)
                self._client = client
        if self._client is None:
            return 0
        try:
            return self._client.send(data)
        except BlockingIOError:
            return 0
        except OSError:
            self._end(self._client)
            self._client = None
            return 0

    def unplug(self) -> None:
        """End the connection and stop listening."""
        client, server, self._client, self._server = self._client, self._server, None, None
        self._end(client)
        self._end(server)

    @staticmethod
    def _end(one: socket.socket | None) -> None:
        if one is not None:
            one.close()


class UdpSender:
    """Datagrams to a port.

    Parameters
    ----------
    host, port
        Where they go.
    """

    def __init__(self, host: str, port: int) -> None:
        self._place = host, port
        self._socket: socket.socket | None = None

    @property
    def address(self) -> str:
        """The address that opens the other end."""
        return f"udp:{self._place[1]}"

    @property
    def has_reader(self) -> bool:
        """Whether somebody may read: always."""
        return True

    def plug(self) -> None:
        """Begin."""
        family = socket.getaddrinfo(*self._place, type=socket.SOCK_DGRAM)[0][0]
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def write(self, data: bytes) -> int:
        """Send in pieces that datagrams hold; nobody need listen."""
        assert self._socket is not None
        for begin in range(0, len(data), _LARGEST_DATAGRAM):
            try:
                self._socket.sendto(data[begin : begin + _LARGEST_DATAGRAM], self._place)
            except BlockingIOError:
                return begin
            except OSError:  # nobody listened to an earlier one, or the network is gone
                continue
        return len(data)

    def unplug(self) -> None:
        """End."""
        found, self._socket = self._socket, None
        if found is not None:
            found.close()


def local_link() -> Link:
    """Return the best link within this computer: a pseudo-terminal, which is read like a serial port."""
    if os.name == "posix" and find_spec("serial") is not None:
        return PseudoTerminal()
    return TcpServer()


def make_link(text: str) -> Link:
    """Return the link that a person named: ``pty``, ``tcp:PORT``, ``tcp:ADDRESS:PORT``, ``udp:ADDRESS:PORT``.

    Raises
    ------
    TransportError
        If it is none of them.
    """
    kind, _, place = text.partition(":")
    host, _, port = place.rpartition(":")
    if kind == "pty" and not place and os.name == "posix":
        return PseudoTerminal()
    if kind in ("tcp", "udp") and port.isascii() and port.isdigit() and 0 <= int(port) <= LAST_PORT:
        if kind == "tcp":
            return TcpServer(host or "127.0.0.1", int(port))
        if int(port):
            return UdpSender(host or "127.0.0.1", int(port))
    raise TransportError(
        f"{text!r} is no place to send to; accepted are pty, tcp:5555 and udp:127.0.0.1:5555"
    )
