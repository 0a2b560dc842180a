"""Phones: the server that takes their samples, if the operator of the server wants one."""

from __future__ import annotations

import atexit
import os
import threading

from lab.data.streams.transport import TransportError
from lab.live.phone.hub import PhoneHub
from lab.live.phone.server import PhoneServer

VARIABLE = "INS_LAB_PHONES"
"""Environment variable with ``ADDRESS:PORT`` for ``panel serve``; visitors cannot set it."""
PORT = 5008
"""Usual port of the page for phones; the app Sensor Logger sends to the next one."""
MISSING = (
    "This server takes no phones. Whoever serves it starts it with: ins-lab serve --phone. A phone needs the "
    "same network as this computer, a camera for the QR code, and a browser."
)
"""Said where phones are not taken."""

_lock = threading.Lock()
_wanted: list[tuple[str, int]] = []
"""Address and port that the server of this process wants."""
_server: list[PhoneServer] = []
"""The server, once it is needed."""


def take_phones(address: str, port: int = PORT) -> None:
    """Let visitors invite phones.

    Parameters
    ----------
    address
        Address that phones reach; ``0.0.0.0`` for all networks of this computer.
    port
        Port of their page.
    """
    _wanted[:] = [(address, port)]


def phone_server() -> PhoneServer:
    """Return the server for phones, started when first asked for.

    Raises
    ------
    TransportError
        If this laboratory takes no phones, the port is taken, or a library is missing.
    """
    with _lock:
        if _server:
            return _server[0]
        if not _wanted:
            named, _, number = os.environ.get(VARIABLE, "").rpartition(":")
            if not named or not number.isdecimal():
                raise TransportError(MISSING)
            _wanted.append((named, int(number)))
        host, port = _wanted[0]
        server = PhoneServer(PhoneHub(), host, port, push_port=port + 1 if port else 0)
        try:
            server.open()
        except OSError as error:
            raise TransportError(
                f"The server for phones cannot listen on port {port} of {host}: {error.strerror or error}"
            ) from error
        _server.append(server)
        atexit.register(close_phone_server)
        return server


def close_phone_server() -> None:
    """End the server for phones, and take no more."""
    with _lock:
        servers, _server[:] = list(_server), []
        _wanted.clear()
    for server in servers:
        server.hub.forget_all()
        server.close()
