"""Listener: a port of TCP, or a WebSocket, from which programs read rows."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
from collections import deque
from collections.abc import Awaitable, Callable, Sequence
from typing import Any, Final

from lab.data.protocols.foxglove import SUBPROTOCOLS, Conversation, make_messages, time_stamp
from lab.data.protocols.sent_solution import SentSolution
from lab.live.outlets.destination import Destination
from lab.live.phone.invitation import in_address

WAITING: Final = 25
"""Rows that wait for a reader, beside those that its line holds: half a second at 50 Hz."""
MOST_READERS: Final = 16
"""Readers of a listener at a time."""
BUFFER: Final = 2**15
"""Buffer of the system for a reader of TCP [bytes]: a larger one would hold rows of many seconds."""
LARGEST_MESSAGE: Final = 2**16
"""Largest message of a reader of a WebSocket [bytes]: Foxglove asks for channels in some hundred."""
LONGEST_CLOSE: Final = 0.5
"""Longest time for which the end waits for readers [s]."""
_SILENT: Final = logging.Logger("outlets", logging.CRITICAL)
"""Logger of handshakes: one that fails is an error to `websockets`."""

Row = list[bytes]
"""The messages of one solution, which are sent together or not at all."""


class Reader:
    """Rows that wait to be sent to one reader; all in the thread of one event loop.

    Attributes
    ----------
    sent, lost : int
        Rows that were sent, and those that gave way to newer ones.
    """

    def __init__(self) -> None:
        self.sent = self.lost = 0
        self._rows: deque[Row] = deque()
        self._more = asyncio.Event()
        self._idle = asyncio.Event()
        self._idle.set()

    def put(self, row: Row) -> None:
        """Take a row; the oldest one that waits gives way if there are too many."""
        if len(self._rows) >= WAITING:
            self._rows.popleft()
            self.lost += 1
        self._rows.append(row)
        self._idle.clear()
        self._more.set()

    async def send(self, write: Callable[[Row], Awaitable[None]]) -> None:
        """Send rows one after the other, until this is cancelled or `write` raises."""
        while True:
            while self._rows:
                try:
                    await write(self._rows.popleft())
                except BaseException:  # it left, or the end came
                    self.lost += 1
                    raise
                self.sent += 1
            self._idle.set()
            self._more.clear()
            await self._more.wait()

    async def wait_until_empty(self) -> None:
        """Wait until nothing waits."""
        await self._idle.wait()

    def end(self) -> None:
        """Count what waits as lost: it will not be sent."""
        self.lost += len(self._rows)
        self._rows.clear()
        self._idle.set()


class Listener:
    """A port of TCP; each reader gets the rows from its coming on."""

    refused: Sequence[str] = ()

    def __init__(self, destination: Destination, write: Callable[[SentSolution], bytes]) -> None:
        self._destination, self._write = destination, write
        self._server: Any = None
        self._readers: set[Reader] = set()
        self._sent = self._lost = self._came = 0  # of those that left, and all that came
        self.place = ""
        """Where it listens."""

    @property
    def counts(self) -> tuple[int, int, int]:
        """As of `Outlet`."""
        sent, lost = (
            sum(getattr(reader, name) for reader in tuple(self._readers)) for name in ("sent", "lost")
        )
        return self._sent + sent, self._lost + lost, self._came

    async def open(self) -> None:
        """Listen."""
        place = self._destination
        self._server = await asyncio.start_server(self._serve, place.host, place.port, limit=LARGEST_MESSAGE)
        self._open_socket()

    def send(self, solution: SentSolution) -> None:
        """Give the row to all readers."""
        data = self._write(solution)  # without readers too: some protocols count their messages
        if data:
            for reader in self._readers:
                reader.put([data])

    async def close(self) -> None:
        """Wait a moment for the readers, and end."""
        waiting = [reader.wait_until_empty() for reader in self._readers]
        if waiting:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(asyncio.gather(*waiting), LONGEST_CLOSE)
        if self._server is not None:
            self._server.close()

    def _open_socket(self) -> None:
        host, port = self._server.sockets[0].getsockname()[:2]
        self.place = f"{self._destination.kind}://{in_address(host, port)}"

    async def _while_heard(
        self, reader: Reader, write: Callable[[Row], Awaitable[None]], gone: Awaitable[None]
    ) -> None:
        """Send rows to a reader until it is gone."""
        self._readers.add(reader)
        self._came += 1
        # Who reads nothing more is noticed by `gone` only, and a write that fails by `send` only.
        tasks = [asyncio.ensure_future(reader.send(write)), asyncio.ensure_future(gone)]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            # Awaited, or the loop would complain of an exception that nobody has looked at.
            await asyncio.gather(*tasks, return_exceptions=True)
            reader.end()
            self._readers.discard(reader)
            self._sent, self._lost = self._sent + reader.sent, self._lost + reader.lost

    async def _serve(self, stream: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if len(self._readers) >= MOST_READERS:
            writer.close()
            return
        writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER)
        # No row waits in the transport: a slow reader loses whole rows here, where they are counted, and
        # never half of one.
        writer.transport.set_write_buffer_limits(0)

        async def write(row: Row) -> None:
            writer.writelines(row)
            await writer.drain()

        async def gone() -> None:
            while await stream.read(LARGEST_MESSAGE):  # what it sends is not looked at
                pass
            await writer.wait_closed()  # who has nothing to say may read on

        try:
            await self._while_heard(Reader(), write, gone())
        finally:
            # Not `close`: that would wait for a reader that takes nothing.
            writer.transport.abort()


class WebSocket(Listener):
    """A WebSocket: rows as messages, and for Foxglove the channels that it asks for."""

    def __init__(self, destination: Destination, write: Callable[[SentSolution], bytes]) -> None:
        super().__init__(destination, write)
        self.refused: list[str] = []
        self._conversations: dict[Reader, Conversation] = {}

    async def open(self) -> None:
        """Listen."""
        from websockets.asyncio.server import serve  # noqa: PLC0415 - needed with this destination only
        from websockets.typing import Subprotocol  # noqa: PLC0415

        self._server = await serve(
            self._greet_client,
            self._destination.host,
            self._destination.port,
            process_request=self._check,
            select_subprotocol=lambda connection, offered: next(
                (Subprotocol(name) for name in SUBPROTOCOLS if name in offered), None
            ),
            compression=None,
            logger=_SILENT,  # a handshake that fails is no matter of whoever navigates
            max_size=LARGEST_MESSAGE,
            write_limit=1,
            close_timeout=LONGEST_CLOSE,
        )
        self._open_socket()

    def send(self, solution: SentSolution) -> None:
        """Give the row to all readers, to each as it wants it."""
        data = self._write(solution)
        messages = make_messages(solution) if self._conversations else {}
        for reader in self._readers:
            conversation = self._conversations.get(reader)
            row = [data] if conversation is None else conversation.written(time_stamp(solution), messages)
            if row and row[0]:
                reader.put(row)

    async def close(self) -> None:
        """Wait a moment for the readers, and take leave."""
        await super().close()
        if self._server is not None:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._server.wait_closed(), LONGEST_CLOSE)

    def _check(self, connection: Any, request: Any) -> Any:
        """Refuse a page of a browser whose origin nobody named: programs send none."""
        for origin in request.headers.get_all("Origin"):
            if origin.lower() not in self._destination.origins:
                shown = origin[:100] if origin.isprintable() else "an unprintable origin"
                if shown not in self.refused and len(self.refused) < MOST_READERS:
                    self.refused.append(shown)
                return connection.respond(403, "The origin of this page was not named at the start.\n")
        if len(self._readers) >= MOST_READERS:
            return connection.respond(503, "There are too many readers.\n")
        return None

    async def _greet_client(self, connection: Any) -> None:
        transport = connection.transport
        transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER)
        reader, is_text = Reader(), self._destination.protocol != "mavlink"
        conversation = Conversation() if connection.subprotocol else None
        if conversation is not None:
            # Before the greeting: a row that comes while it is sent must not go out as plain text.
            self._conversations[reader] = conversation
            for greeting in conversation.greetings():
                await connection.send(greeting)

        async def write(row: Row) -> None:
            for message in row:
                as_text = is_text and conversation is None
                await connection.send(message.decode().rstrip("\n") if as_text else message)

        async def gone() -> None:
            async for message in connection:
                if conversation is not None:
                    conversation.accept(message)

        try:
            await self._while_heard(reader, write, gone())
        finally:
            self._conversations.pop(reader, None)
