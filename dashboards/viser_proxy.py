"""Viser proxy: the 3-D view through the port of the page, so that a browser needs only one port.

Each session has its own viser server, which listens on this computer only. It requires a key, since any page
in a browser on this computer could connect to it. The session's page shows the scene in a frame at
``viser/TOKEN/`` beside itself. The handler here serves viser's client there and carries its websocket. A
token is random. It is valid only while its scene is served, and never gives access to a later user of the
port.
"""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from threading import Thread
from typing import Any

import viser
from bokeh.document import Document
from tornado.web import Application, HTTPError
from tornado.websocket import WebSocketClosedError, WebSocketHandler
from viser.infra import WebsockClientConnection
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidMessage
from websockets.typing import Subprotocol

from dashboards.headers import policy, sockets
from dashboards.origins import is_from_accepted
from dashboards.process_place import number
from dashboards.upstream.server import serving_application, viser_connection, viser_sockets

VIEWS = "ins_lab_3d_views"
"""Key of the registered views, by token, in the settings of the web application."""

KEY_HEADER = "X-INS-Lab-Key"
"""Header in which the handler sends the key to a viser server."""

MAX_MESSAGE = 64 * 2**20
"""Largest message carried to a browser [bytes]."""


@dataclass(frozen=True)
class View:
    """Port of a viser server on this computer, and its key."""

    port: int
    key: str


class ServedScene:
    """A viser server of one session, and its route in the web application that serves the page.

    Parameters
    ----------
    document
        Document of a session whose browser is connected.

    Raises
    ------
    RuntimeError
        If no browser is connected to the session.

    Attributes
    ----------
    server : viser.ViserServer
        The viser server.
    address : str
        Address of viser's client, relative to the page.
    """

    def __init__(self, document: Document) -> None:
        self._views = registered_views(web_application(document))
        # The number is that of this process, to which `dashboards.front` sends the frame.
        self._token = f"{number()}.{secrets.token_urlsafe(24)}"
        self.address = f"viser/{self._token}/"
        self.server, self._views[self._token] = guarded_server()

    def end(self) -> None:
        """Remove the route, and stop the server in a thread, since that takes a moment."""
        self._views.pop(self._token, None)
        Thread(target=self.server.stop, name="viser-stop", daemon=True).start()


def guarded_server() -> tuple[viser.ViserServer, View]:
    """Start a viser server on this computer that closes connections without its key."""
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    view = View(server.get_port(), secrets.token_urlsafe(24))
    sockets = viser_sockets(server)

    async def ask_for_key(client: WebsockClientConnection) -> None:
        # Called before anything is sent; viser itself does not authenticate.
        connection = viser_connection(sockets, client)
        given = connection.request.headers.get(KEY_HEADER, "") if connection.request is not None else ""
        if not hmac.compare_digest(given.encode(), view.key.encode()):
            await connection.close(1008, "this view belongs to a page")

    sockets.on_client_connect(ask_for_key)
    sockets.disconnect_all_clients()  # connections from before the check
    return server, view


def registered_views(application: Application) -> dict[str, View]:
    """Return the views of a web application by token; the first call adds their handler."""
    if VIEWS not in application.settings:
        application.settings[VIEWS] = {}
        application.add_handlers(r".*", [(r".*/viser/([\w.-]+)/?", ViserHandler)])
    views: dict[str, View] = application.settings[VIEWS]
    return views


def web_application(document: Document) -> Application:
    """Return the Tornado application that serves a document, found through the socket of its browser."""
    application = serving_application(document)
    if application is not None:
        return application
    raise RuntimeError("the 3-D view needs a page that is open in a browser")


CLEAR = b"""<style>@media (max-width: 600px) {
.mantine-Notifications-root, .mantine-Paper-root:has(.mantine-ScrollArea-root) { display: none !important; }
}</style>"""
"""Keeps viser's own panel and its remarks off the scene on a phone, where they cover all of it."""


@cache
def client_page() -> tuple[bytes, str]:
    """Return viser's client, which is a single file, and its entity tag."""
    page = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_bytes()
    page = page.replace(b"</head>", CLEAR + b"</head>", 1)
    return page, f'"{hashlib.sha256(page).hexdigest()[:24]}"'


class ViserHandler(WebSocketHandler):
    """Serves viser's client, and carries the messages between it and the session's viser server."""

    _view: View
    _upstream: ClientConnection | None = None
    _pump: asyncio.Task[None] | None = None
    _ended = False

    async def get(self, *args: Any, **kwargs: Any) -> None:
        """Send the client, or open the websocket."""
        view = self.application.settings[VIEWS].get(args[0])
        if view is None:
            raise HTTPError(403, reason="this address is not valid, or no longer valid")
        if self.request.headers.get("Upgrade", "").lower() != "websocket":
            self._send_client()
            return
        if not is_from_accepted(self.request, self.application):
            raise HTTPError(403)
        self._view = view
        await super().get(*args, **kwargs)

    def check_origin(self, origin: str) -> bool:
        """Accept every origin, because the origin was checked before."""
        return True

    def select_subprotocol(self, subprotocols: list[str]) -> str | None:
        """Choose the client's protocol version; a viser server of another version closes the connection."""
        return subprotocols[0] if subprotocols else None

    async def open(self, *_args: str, **_kwargs: str) -> None:
        """Connect to the viser server, now that the browser is connected, and forward its messages."""
        offered = [self.selected_subprotocol] if self.selected_subprotocol else []
        try:
            upstream = await connect(
                f"ws://127.0.0.1:{self._view.port}/",
                subprotocols=[Subprotocol(name) for name in offered],
                additional_headers={KEY_HEADER: self._view.key},
                max_size=MAX_MESSAGE,
                compression=None,
                proxy=None,
            )
        except (OSError, InvalidHandshake, InvalidMessage):
            self.close(1001, "this 3-D view has ended")
            return
        if self._ended:
            await upstream.close()
            return
        self._upstream = upstream
        self._pump = asyncio.ensure_future(self._downstream())

    async def on_message(self, message: str | bytes) -> None:
        """Forward a message to the viser server."""
        try:
            if self._upstream is not None:
                await self._upstream.send(message)
        except ConnectionClosed:
            self.close()

    def on_close(self) -> None:
        """Close the other half of the connection."""
        self._ended = True
        if self._pump is not None:
            self._pump.cancel()
        if self._upstream is not None:
            # Kept, because the loop itself does not keep its tasks.
            self._closing = asyncio.ensure_future(self._upstream.close())

    def get_compression_options(self) -> Mapping[str, Any] | None:  # type: ignore[override]
        """Do not compress: viser's messages are already compressed."""
        return None

    async def _downstream(self) -> None:
        assert self._upstream is not None
        try:
            async for message in self._upstream:
                # Waiting for each write slows the server down to the speed of the browser.
                await self.write_message(message, binary=isinstance(message, bytes))
        except (ConnectionClosed, WebSocketClosedError):
            return
        finally:
            self.close()

    def _send_client(self) -> None:
        page, tag = client_page()
        self.set_header("Content-Type", "text/html; charset=utf-8")
        self.set_header("Cache-Control", "private, max-age=0, must-revalidate")
        self.set_header("Etag", tag)
        # The client unpacks itself into an inline script; it never contains text from outside.
        self.set_header("Content-Security-Policy", policy("'unsafe-inline'", sockets(self.request)))
        if self.check_etag_header():
            self.set_status(304)
            self.finish()
        else:
            self.finish(page)
