"""Outlet: one destination, open: datagrams, a listener, a WebSocket, a pseudo-terminal or a file."""

from __future__ import annotations

import asyncio
import errno
import os
import socket
from collections.abc import Callable, Sequence
from typing import Any, Protocol

from lab.data.protocols.foxglove import make_messages, time_stamp
from lab.data.protocols.mavlink_encoder import MavlinkSolution
from lab.data.protocols.nmea_encoder import encode_sentences
from lab.data.protocols.sent_solution import SentSolution, json_line
from lab.live.outlets.destination import Destination
from lab.live.outlets.listener import Listener, WebSocket
from lab.live.outlets.mcap_file import McapFile
from lab.live.simulated.simulated_link import PseudoTerminal


class Outlet(Protocol):
    """A destination that is open; used in the thread of one event loop."""

    @property
    def place(self) -> str:
        """Where readers find it, in words."""

    @property
    def counts(self) -> tuple[int, int, int]:
        """Rows sent and lost, over all readers, and readers so far."""

    @property
    def refused(self) -> Sequence[str]:
        """Origins of pages that were refused."""

    async def open(self) -> None:
        """Open; raises `OSError` or `ImportError`."""

    def send(self, solution: SentSolution) -> None:
        """Send a solution, without waiting."""

    async def close(self) -> None:
        """Send what waits, at most for `lab.live.outlets.listener.LONGEST_CLOSE`, and close."""


def choose_writer(destination: Destination) -> Callable[[SentSolution], bytes]:
    """Return what writes a solution in the protocol of a destination.

    Raises
    ------
    ImportError
        If a library for it is not installed.
    """
    if destination.protocol == "nmea":
        return lambda solution: encode_sentences(solution, destination.talker)
    return MavlinkSolution().written if destination.protocol == "mavlink" else json_line


def make_outlet(destination: Destination) -> Outlet:
    """Return the outlet of a destination; raises `ImportError` as `choose_writer`."""
    if destination.kind == "mcap":
        return FileOutlet(destination)
    write = choose_writer(destination)
    if destination.kind == "udp":
        return Datagrams(destination, write)
    if destination.kind == "pty":
        return TerminalOutlet(write)
    return (Listener if destination.kind == "tcp" else WebSocket)(destination, write)


class _Counting:
    """Counts rows; how many programs read them is not known."""

    refused: Sequence[str] = ()
    _sent = _lost = 0

    @property
    def counts(self) -> tuple[int, int, int]:
        """As of `Outlet`."""
        return self._sent, self._lost, 0


class Datagrams(_Counting):
    """A datagram for each row; nobody need listen."""

    def __init__(self, destination: Destination, write: Callable[[SentSolution], bytes]) -> None:
        self._destination, self._write = destination, write
        self._socket: socket.socket | None = None
        self._to: Any = None

    @property
    def place(self) -> str:
        """Where the datagrams go."""
        return f"datagrams to {self._to[0]}, port {self._to[1]}"

    async def open(self) -> None:
        """Find the computer."""
        loop, place = asyncio.get_running_loop(), self._destination
        family, kind, proto, _, self._to = (
            await loop.getaddrinfo(place.host, place.port, type=socket.SOCK_DGRAM)
        )[0]
        self._socket = socket.socket(family, kind, proto)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)  # whoever starts it may name all

    def send(self, solution: SentSolution) -> None:
        """Send a datagram; one that finds no room or no network is lost."""
        data = self._write(solution)
        if not data or self._socket is None:
            return
        try:
            self._socket.sendto(data, self._to)
            self._sent += 1
        except OSError:
            self._lost += 1

    async def close(self) -> None:
        """End."""
        if self._socket is not None:
            self._socket.close()


class TerminalOutlet(_Counting):
    """A pseudo-terminal, which is read like a serial port."""

    def __init__(self, write: Callable[[SentSolution], bytes]) -> None:
        self._write, self._line = write, PseudoTerminal()
        self._rest = b""  # of a row that was written in part

    @property
    def place(self) -> str:
        """The name of the port."""
        return f"the serial port {self._line.address.removeprefix('serial:')}"

    async def open(self) -> None:
        """Make the port."""
        self._line.plug()

    def send(self, solution: SentSolution) -> None:
        """Write a row behind the rest of the last one; while that finds no room, rows are lost."""
        self._line.discard()
        data = self._write(solution)
        self._rest = self._rest[self._line.write(self._rest) :] if self._rest else b""
        if not data:
            return
        if self._rest:
            self._lost += 1
            return
        written = self._line.write(data)
        # Nothing of a row that found no room at all need follow.
        self._rest = data[written:] if written else b""
        self._sent, self._lost = self._sent + bool(written), self._lost + (not written)

    async def close(self) -> None:
        """Close the port."""
        self._line.unplug()


class FileOutlet(_Counting):
    """An MCAP file."""

    def __init__(self, destination: Destination) -> None:
        self._path = destination.path
        self._file: McapFile | None = None
        self._failure = ""

    @property
    def place(self) -> str:
        """The file."""
        return f"the file {self._path}{self._failure}"

    async def open(self) -> None:
        """Make the file."""
        self._file = McapFile(self._path)

    def send(self, solution: SentSolution) -> None:
        """Append the messages of a solution; a full disk ends the file, and rows are lost."""
        if self._file is None:
            self._lost += 1
            return
        try:
            self._file.write(time_stamp(solution), make_messages(solution))
            self._sent += 1
        except OSError as error:
            self._fail(error)

    async def close(self) -> None:
        """Write the summary and the end."""
        try:
            if self._file is not None:
                self._file.close()
        except OSError as error:
            self._fail(error)

    def _fail(self, error: OSError) -> None:
        self._lost += 1
        self._failure = f" (it ended early: {os.strerror(error.errno or errno.EIO)})"
        self._file = None
