"""The way to a viser server is open to the page's own origin and those the server was told to accept."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager

import pytest
from bokeh.document import Document
from bokeh.events import DocumentReady
from panel.io.state import set_curdoc
from tornado.httpserver import HTTPServer
from tornado.testing import bind_unused_port
from tornado.web import Application
from websockets.asyncio.client import connect
from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import InvalidStatus
from websockets.typing import Origin, Subprotocol

from dashboards.pages.view_3d import View3D
from dashboards.viser_proxy import View, registered_views
from lab.experiment.experiment import Experiment
from lab.views.figures import TimeAxis

PROTOCOL = Subprotocol("viser-test")


@asynccontextmanager
async def proxy(*accepted: str) -> AsyncIterator[tuple[int, str]]:
    """Serve the proxy in front of a server that echoes; give its port and a valid path."""

    async def echo(connection: ServerConnection) -> None:
        async for message in connection:
            await connection.send(message)

    application = Application()
    views = registered_views(application)
    application.websocket_origins = set(accepted)  # type: ignore[attr-defined]  # as Bokeh's application has
    socket, port = bind_unused_port()
    server = HTTPServer(application)
    server.add_socket(socket)
    async with serve(echo, "127.0.0.1", 0, subprotocols=[PROTOCOL]) as upstream:
        (listening,) = upstream.sockets
        views["token"] = View(listening.getsockname()[1], "key")
        yield port, "/viser/token/"
        server.stop()
        await server.close_all_connections()


def answer(origin: Callable[[int], str], *accepted: str) -> str | int:
    """Return what a browser of an origin gets: its own words back, or the status of a refusal."""

    async def ask() -> str | int:
        async with proxy(*accepted) as (port, path):
            try:
                address, allowed = f"ws://127.0.0.1:{port}{path}", Origin(origin(port))
                async with connect(address, origin=allowed, subprotocols=[PROTOCOL], proxy=None) as way:
                    await way.send("hello")
                    return str(await way.recv())
            except InvalidStatus as error:
                return error.response.status_code

    # In a thread of its own: a browser of other tests may leave a loop running in this one.
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(lambda: asyncio.run(asyncio.wait_for(ask(), 30))).result()


@pytest.mark.parametrize(
    ("origin", "accepted"),
    [
        (lambda port: f"http://127.0.0.1:{port}", ()),
        (lambda _port: "https://lab.example.org", ("lab.example.org:80",)),
        (lambda _port: "https://LAB.example.org:8443", ("lab.example.org:8443",)),
    ],
)
def test_the_page_itself_and_named_hosts_get_through(origin: Callable[[int], str], accepted: tuple) -> None:
    assert answer(origin, *accepted) == "hello"


@pytest.mark.parametrize(
    ("origin", "accepted"),
    [
        (lambda _port: "http://evil.example", ()),
        (lambda port: f"http://localhost.evil.example:{port}", ()),
        (lambda _port: "http://evil.example", ("lab.example.org:80",)),
        (lambda port: f"http://127.0.0.1:{port + 1}", ()),
    ],
)
def test_pages_of_others_are_refused(origin: Callable[[int], str], accepted: tuple) -> None:
    """A page of somebody else in the same browser, with a token it came to know."""
    assert answer(origin, *accepted) == 403


def test_a_link_to_the_view_waits_for_its_browser() -> None:
    """The page is made before the browser is connected; nothing failed, and it is drawn once it is there."""
    document = Document()
    with set_curdoc(document):
        page = View3D(TimeAxis())
    drawn: list[bool] = []
    page.draw_again = lambda: drawn.append(True)
    page.draw(Experiment().run())
    document.callbacks.trigger_event(DocumentReady())
    assert drawn == [True]
    page.close()
