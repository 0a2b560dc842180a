"""Phone server: gives phones their page and takes their samples, in a thread of its own."""

from __future__ import annotations

import asyncio
import ssl
import threading
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self, cast

from tornado.httpserver import HTTPServer
from tornado.iostream import IOStream
from tornado.netutil import bind_sockets
from tornado.web import Application

from lab.base.qr_code import qr_code
from lab.data.streams.transport import TransportError
from lab.live.phone.certificate import certificate_file
from lab.live.phone.handlers import NothingHandler, PageHandler, PushHandler, SamplesHandler
from lab.live.phone.hub import PhoneHub, Ticket
from lab.live.phone.invitation import LOOPBACK, Invitation, in_address, is_any, is_loopback, own_addresses
from lab.live.phone.limits import MOST, Connections

IDLE: Final = 30.0
"""Time after which a connection without a request is closed [s]; the next one costs a phone 0.1 s."""
SLOW: Final = 10.0
"""Longest time for the body of a request [s]; a phone tries again."""
MISSING: Final = "phones need cryptography, which is not installed: pip install 'ins-lab[live]'"
_HEAD: Final = 2**14
"""Most bytes of the head of a request."""
_DRAINED: Final = 2**24
"""Most bytes of a body that is too large and is read to be refused; above it, the connection is closed."""
_WAIT: Final = 10.0
"""Longest time to start and to stop [s]."""


class PhoneServer:
    """Serves phones over HTTPS; a context manager.

    Parameters
    ----------
    hub
        Knows the phones.
    host
        Address to listen on: by default this computer only; ``0.0.0.0`` for all networks.
    port
        Port to listen on; 0 for any free one.
    push_port
        Port for the app Sensor Logger without encryption, because apps refuse certificates that nobody
        vouches for; None for no such port. It takes nothing but readings with a token.
    folder
        Where the certificate is kept; by default in the user's data folder.
    """

    def __init__(
        self,
        hub: PhoneHub,
        host: str = "127.0.0.1",
        port: int = 0,
        push_port: int | None = None,
        folder: Path | None = None,
    ) -> None:
        self.hub = hub
        self.host = host
        self.port = port
        self.push_port = push_port
        self._folder = folder
        self._thread: threading.Thread | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._servers: list[HTTPServer] = []

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def names(self) -> list[str]:
        """Addresses by which phones reach the server, the best one first."""
        if is_any(self.host):
            return [*own_addresses(), "localhost", "127.0.0.1"]
        return [self.host] if not is_loopback(self.host) else list(dict.fromkeys((self.host, "localhost")))

    def open(self) -> None:
        """Listen.

        Raises
        ------
        OSError
            If the port is taken, the address is not one of this computer, or the certificate cannot be kept.
        TransportError
            If a library is missing.
        """
        if self._thread is not None:
            return
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        try:
            context.load_cert_chain(certificate_file(self.names, self._folder))
        except ImportError as error:
            raise TransportError(MISSING) from error
        ports = [(self.port, context), *([] if self.push_port is None else [(self.push_port, None)])]
        bound: list[tuple[list[Any], ssl.SSLContext | None]] = []
        try:
            for port, how in ports:
                bound.append((bind_sockets(port, self.host, backlog=MOST), how))
        except BaseException:
            for sockets, _ in bound:
                for socket in sockets:
                    socket.close()
            raise
        self.port, *others = [sockets[0].getsockname()[1] for sockets, _ in bound]
        if others:
            self.push_port = others[0]
        started = threading.Event()
        self._thread = threading.Thread(
            target=self._run, args=(bound, started), name="phone server", daemon=True
        )
        self._thread.start()
        started.wait(_WAIT)

    def close(self) -> None:
        """Close all connections and the port; the thread has ended afterwards. May be called repeatedly."""
        thread, loop = self._thread, self._loop
        if thread is None or loop is None:
            return
        loop.call_soon_threadsafe(loop.stop)
        thread.join(_WAIT)
        self._thread = self._loop = None

    def invitation(self, ticket: Ticket) -> Invitation:
        """Return what to show to the owner of a phone.

        Parameters
        ----------
        ticket
            From `PhoneHub.invite`.
        """
        host = self.names[0]
        address = f"https://{in_address(host, self.port)}/phone/{ticket.token}"
        push = f"https://{in_address(host, self.port)}"
        if self.push_port is not None:
            push = f"http://{in_address(host, self.push_port)}"
        left = next((state.left for state in self.hub.phones() if state.key == ticket.key), 0.0)
        problem = LOOPBACK if is_loopback(host) else ""
        push_address = f"{push}/push/{ticket.token}"
        return Invitation(ticket.key, address, push_address, qr_code(address), problem=problem, left=left)

    def _run(self, bound: list[tuple[list[Any], ssl.SSLContext | None]], started: threading.Event) -> None:
        self._loop = loop = asyncio.new_event_loop()
        asyncio.set_event_loop(loop)
        connections = Connections()
        try:
            for sockets, context in bound:
                server = _BoundedServer(
                    _application(self.hub, connections, context is None),
                    connections=connections,
                    ssl_options=context,
                    idle_connection_timeout=IDLE,
                    body_timeout=SLOW,
                    max_header_size=_HEAD,
                    max_body_size=_DRAINED,
                )
                server.add_sockets(sockets)
                self._servers.append(server)
            loop.call_soon(started.set)
            loop.run_forever()
            loop.run_until_complete(self._stop())
        finally:
            started.set()
            asyncio.set_event_loop(None)
            loop.close()

    async def _stop(self) -> None:
        for server in self._servers:
            server.stop()
            await server.close_all_connections()
        self._servers.clear()
        others = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)


class _BoundedServer(HTTPServer):
    """A server with a bounded number of connections, which closes slow ones."""

    def initialize(self, *args: Any, **kwargs: Any) -> None:
        self._bounds: Connections = kwargs.pop("connections")
        super().initialize(*args, **kwargs)

    def handle_stream(self, stream: IOStream, address: tuple[Any, ...]) -> None:
        """Take a connection, or close it if there are too many."""
        if self._bounds.admit(stream, str(address[0])):
            super().handle_stream(stream, address)
        else:
            stream.close()

    def on_close(self, server_conn: object) -> None:
        """Count a connection that was closed no more."""
        super().on_close(server_conn)
        self._bounds.forget(cast(Any, server_conn).stream)


def _application(hub: PhoneHub, connections: Connections, push_only: bool) -> Application:
    given = {"hub": hub, "connections": connections}
    routes: list[Any] = [(r"/push/([^/]{1,100})", PushHandler, given)]
    if not push_only:
        routes += [
            (r"/phone/([^/]{1,100})", PageHandler, given),
            (r"/phone/([^/]{1,100})/samples", SamplesHandler, given),
        ]
    return Application(
        routes,
        default_handler_class=NothingHandler,
        default_handler_args=given,
        log_function=lambda _: None,  # addresses hold tokens
    )
