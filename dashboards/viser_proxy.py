"""Viser proxy: the 3-D view through the port of the page, so that one port is all a browser needs to reach.

Each session has a viser server of its own that listens on this computer only. The page shows it in a frame
at ``viser/TOKEN/`` beside itself; the handler here serves viser's client there and carries its websocket. The
token is signed and holds the port, so nobody can make the handler connect to anything else, or guess it.
"""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import secrets
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import viser
from bokeh.document import Document
from bokeh.server.util import check_allowlist
from bokeh.settings import settings as bokeh_settings
from tornado.web import Application, HTTPError
from tornado.websocket import WebSocketClosedError, WebSocketHandler
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.typing import Subprotocol

from dashboards.headers import policy, sockets

SECRET = "viser_proxy_secret"
"""Key of the signing secret in the settings of the web application; there once the handler is mounted."""

MAX_MESSAGE = 64 * 2**20
"""Largest message carried [bytes]."""


def mount(document: Document) -> bytes:
    """Make the web application that serves a document serve viser too, once; return its signing secret.

    Parameters
    ----------
    document
        Document of a session whose browser is connected.

    Raises
    ------
    RuntimeError
        If no browser is connected to the session.
    """
    application = web_application(document)
    if SECRET not in application.settings:
        # Several server processes understand each other's tokens if they were given a common secret.
        application.settings[SECRET] = bokeh_settings.secret_key_bytes() or secrets.token_bytes(32)
        application.add_handlers(r".*", [(r".*/viser/([\w.-]+)/?", ViserHandler)])
    secret: bytes = application.settings[SECRET]
    return secret


def web_application(document: Document) -> Application:
    """Return the Tornado application that serves a document, found through the socket of its browser."""
    session = getattr(document.session_context, "session", None)
    for connection in getattr(session, "_subscribed_connections", ()):
        application = connection._socket.application
        if isinstance(application, Application):
            return application
    raise RuntimeError("the 3-D view needs a page that is open in a browser")


def sign(port: int, secret: bytes) -> str:
    """Return a token that opens the way to a port of this computer."""
    text = f"{port}.{secrets.token_hex(8)}"
    return f"{text}.{_signature(text, secret)}"


def port_of(token: str, secret: bytes) -> int | None:
    """Return the port a token opens the way to, or None if it was not signed here."""
    text, _, signature = token.rpartition(".")
    if not hmac.compare_digest(signature.encode(), _signature(text, secret).encode()):
        return None
    return int(text.partition(".")[0])


def _signature(text: str, secret: bytes) -> str:
    return hmac.new(secret, f"viser {text}".encode(), hashlib.sha256).hexdigest()[:32]


@cache
def client_page() -> tuple[bytes, str]:
    """Return viser's client, which is a single file, and its entity tag."""
    page = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_bytes()
    return page, f'"{hashlib.sha256(page).hexdigest()[:24]}"'


class ViserHandler(WebSocketHandler):
    """Serves viser's client, and carries the messages between it and the session's viser server."""

    _upstream: ClientConnection | None = None
    _pump: asyncio.Task[None] | None = None

    async def get(self, *args: Any, **kwargs: Any) -> None:
        """Answer with the client, or open the websocket."""
        port = port_of(str(args[0]), self.application.settings[SECRET])
        if port is None:
            raise HTTPError(403, reason="this address is not valid, or no longer")
        if self.request.headers.get("Upgrade", "").lower() != "websocket":
            self._send_client()
            return
        try:
            self._upstream = await connect(
                f"ws://127.0.0.1:{port}/",
                subprotocols=[Subprotocol(name) for name in self._offered()],
                max_size=MAX_MESSAGE,
                compression=None,
                proxy=None,
            )
        except (OSError, InvalidHandshake) as error:
            raise HTTPError(410, reason="this 3-D view has ended") from error
        await super().get(*args, **kwargs)

    def check_origin(self, origin: str) -> bool:
        """Accept the page's own origin, and those the server was told to accept."""
        allowed = list(getattr(self.application, "websocket_origins", ()))
        host = origin.partition("://")[2].lower()
        return super().check_origin(origin) or check_allowlist(host, allowed)

    def select_subprotocol(self, subprotocols: list[str]) -> str | None:
        """Choose what the viser server chose."""
        return self._upstream.subprotocol if self._upstream is not None else None

    def open(self, *_args: str, **_kwargs: str) -> None:
        """Begin to carry what the viser server sends."""
        self._pump = asyncio.ensure_future(self._downstream())

    async def on_message(self, message: str | bytes) -> None:
        """Carry a message to the viser server."""
        try:
            if self._upstream is not None:
                await self._upstream.send(message)
        except ConnectionClosed:
            self.close()

    def on_close(self) -> None:
        """End the other half of the connection."""
        if self._pump is not None:
            self._pump.cancel()
        if self._upstream is not None:
            self._closing = asyncio.ensure_future(self._upstream.close())

    def get_compression_options(self) -> Mapping[str, Any] | None:  # type: ignore[override]
        """Compress nothing: viser's messages are compressed already."""
        return None

    async def _downstream(self) -> None:
        assert self._upstream is not None
        try:
            async for message in self._upstream:
                # Waiting for each write is what slows the server down for a slow browser.
                await self.write_message(message, binary=isinstance(message, bytes))
        except (ConnectionClosed, WebSocketClosedError):
            return
        finally:
            self.close()

    def _offered(self) -> list[str]:
        header = self.request.headers.get("Sec-WebSocket-Protocol", "")
        return [name.strip() for name in header.split(",") if name.strip()]

    def _send_client(self) -> None:
        page, tag = client_page()
        self.set_header("Content-Type", "text/html; charset=utf-8")
        self.set_header("Cache-Control", "private, max-age=0, must-revalidate")
        self.set_header("Etag", tag)
        # It unpacks itself into a script of its own making; no text from outside is ever in it.
        self.set_header("Content-Security-Policy", policy("'unsafe-inline'", sockets(self.request)))
        if self.check_etag_header():
            self.set_status(304)
            self.finish()
        else:
            self.finish(page)
