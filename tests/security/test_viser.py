"""The way to a viser server: for the pages accepted, while its session lasts, and not past the proxy."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
import viser
from tornado.httpserver import HTTPServer
from tornado.testing import bind_unused_port
from tornado.web import Application
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.typing import Origin, Subprotocol

from dashboards import viser_proxy
from dashboards.viser_proxy import KEY_HEADER, ServedScene, View, guarded_server, registered_views

VERSION = Subprotocol(f"viser-v{viser.__version__}")


@contextlib.contextmanager
def counted_listener() -> Iterator[tuple[int, list[socket.socket]]]:
    """Listen like another program that got the port; give it, and who was let in."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.setblocking(False)
        came: list[socket.socket] = []

        def accept() -> None:
            with contextlib.suppress(BlockingIOError):
                while True:
                    came.append(listener.accept()[0])

        yield listener.getsockname()[1], came
        accept()
        for one in came:
            one.close()


@contextlib.asynccontextmanager
async def proxied(application: Application):
    """Serve a web application; give its port."""
    listening, port = bind_unused_port()
    server = HTTPServer(application)
    server.add_socket(listening)
    yield port
    server.stop()
    await server.close_all_connections()


async def status(address: str, origin: str, **where: Any) -> int | None:
    """Return the status a websocket is refused with; None if it opens."""
    try:
        async with connect(address, origin=Origin(origin), subprotocols=[VERSION], proxy=None, **where):
            return None
    except InvalidStatus as error:
        return error.response.status_code


async def half_a_handshake(port: int) -> bytes:
    """Ask for a websocket without its key, from no page at all."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(
        b"GET /viser/token/ HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        b"Sec-WebSocket-Version: 13\r\n\r\n"
    )
    line = await reader.readline()
    writer.close()
    return line


def test_a_refused_handshake_reaches_no_viser_server(run) -> None:
    async def ask(upstream: int) -> tuple[int | None, bytes]:
        application = Application()
        registered_views(application)["token"] = View(upstream, "key")
        async with proxied(application) as port:
            # A stranger's name that leads here: the browser takes its page and this server for one origin.
            host = f"evil.example:{port}"
            refused = await status(f"ws://{host}/viser/token/", f"http://{host}", host="127.0.0.1", port=port)
            return refused, await half_a_handshake(port)

    with counted_listener() as (upstream, came):
        refused, answer = run(ask(upstream))
    assert refused == 403
    assert b" 400 " in answer
    assert came == []


@pytest.fixture
def served_scene(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[ServedScene, Application]]:
    """Return a scene that is served through a web application."""
    application = Application()
    monkeypatch.setattr(viser_proxy, "web_application", lambda _document: application)
    made = ServedScene(SimpleNamespace())  # type: ignore[arg-type]  # only its application is asked for
    yield made, application
    made.end()


def test_a_token_ends_with_its_session_and_leads_to_nobody_else(run, served_scene) -> None:
    scene, application = served_scene

    async def ask() -> list[int | None]:
        async with proxied(application) as port:
            address, origin = f"ws://127.0.0.1:{port}/{scene.address}", f"http://127.0.0.1:{port}"
            open_now = await status(address, origin)
            with pytest.raises(InvalidStatus):
                async with connect(address.replace("/viser/", "/viser/x"), origin=Origin(origin), proxy=None):
                    pass
            scene.end()
            await asyncio.to_thread(scene.server._websock_server._server_thread.join)
            with socket.create_server(("127.0.0.1", scene.server.get_port())) as reused:
                reused.setblocking(False)
                ended = await status(address, origin)
                with pytest.raises(BlockingIOError):
                    reused.accept()
            return [open_now, ended]

    assert run(ask()) == [None, 403]


def test_viser_itself_sends_nothing_to_whoever_has_no_key(run) -> None:
    server, view = guarded_server()

    async def received(**headers: str) -> bool:
        async with connect(
            f"ws://127.0.0.1:{view.port}/",
            origin=Origin("http://evil.example"),
            subprotocols=[VERSION],
            additional_headers=headers,
            proxy=None,
        ) as way:
            try:
                return bool(await way.recv())
            except ConnectionClosed as error:
                assert error.rcvd is not None
                assert error.rcvd.code == 1008
                return False

    try:
        server.scene.add_frame("/secret")
        assert not run(received())
        assert not run(received(**{KEY_HEADER: "another"}))
        assert run(received(**{KEY_HEADER: view.key}))
    finally:
        server.stop()
