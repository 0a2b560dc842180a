"""Worker: one of several processes of a server; `dashboards.front` hands it connections."""

from __future__ import annotations

import os
import signal
import socket
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from dashboards.process_place import take_place
from dashboards.server import Laboratory, Start, serve_part

if TYPE_CHECKING:
    from bokeh.server.server import Server

READY = b"r"
"""What a process says once it takes connections."""


@dataclass(frozen=True)
class Part:
    """What one process serves.

    Attributes
    ----------
    number : int
        Its number, from 0; classes and streams live in the first.
    laboratory : Laboratory
        What is served.
    start : Start
        What the server begins with.
    devices : sequence of str
        Sources that the page Live may open.
    phones : tuple or None
        Address and port at which phones are taken; None without phones.
    scheduler : str or None
        Address of a Dask scheduler; None for threads.
    """

    number: int
    laboratory: Laboratory
    start: Start
    devices: Sequence[str] = ()
    phones: tuple[str, int] | None = None
    scheduler: str | None = None


def work(part: Part, key: bytes, channel: socket.socket) -> None:
    """Serve a part until the front ends, or asks for the end.

    Parameters
    ----------
    part
        What is served.
    key
        Secret key for the tokens of its pages.
    channel
        Gives the connections.
    """
    from dashboards.devices import allow_devices  # noqa: PLC0415 - takes a second
    from dashboards.phones import take_phones  # noqa: PLC0415
    from lab.cli.options import cluster_of  # noqa: PLC0415

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes; the front ends them
    take_place(part.number)
    allow_devices(part.devices)
    if part.phones is not None and part.number == 0:
        take_phones(*part.phones)

    def connect(server: Server) -> None:
        _take_connections(server, channel)

    with cluster_of(part.scheduler) as client:
        # The port is given up before anybody can have used it; connections come from the front.
        serve_part(part.laboratory, part.start, client, connect=connect, port=0, key=key)


def _take_connections(server: Server, channel: socket.socket) -> None:
    from tornado.ioloop import IOLoop  # noqa: PLC0415 - takes a moment
    from tornado.iostream import IOStream  # noqa: PLC0415

    from dashboards.upstream.server import web_server  # noqa: PLC0415

    web = web_server(server)
    web.stop()
    channel.setblocking(False)

    def take(*_events: object) -> None:
        while True:
            try:
                said, handles, _, _ = socket.recv_fds(channel, 1, 1)
            except BlockingIOError:
                return
            except OSError:
                said, handles = b"", []
            if not said:  # the front has ended
                IOLoop.current().remove_handler(channel.fileno())
                os.kill(os.getpid(), signal.SIGTERM)
                return
            for handle in handles:
                _take(handle)

    def _take(handle: int) -> None:
        connection = socket.socket(fileno=handle)
        connection.setblocking(False)
        try:
            address = connection.getpeername()
        except OSError:  # the browser has gone
            connection.close()
            return
        web.handle_stream(IOStream(connection), address)

    def begin() -> None:
        channel.send(READY)

    loop = IOLoop.current()
    loop.add_handler(channel.fileno(), take, IOLoop.READ)
    loop.add_callback(begin)
