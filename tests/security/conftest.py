"""A laboratory served as its users serve it, and visitors who are no browsers and send what they like."""

from __future__ import annotations

import asyncio
import json
import os
import re
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any, TypeVar
from urllib.request import Request, urlopen

import psutil
import pytest
from websockets.asyncio.client import ClientConnection, connect
from websockets.typing import Origin, Subprotocol

from lab.missions import add_mission, mission

ROOT = Path(__file__).parents[2]
START = 120.0
"""What a start may take [s] on a machine that does other work."""

T = TypeVar("T")


class Served:
    """A laboratory that is served.

    Attributes
    ----------
    port : int
        Where it listens.
    process : psutil.Process
        Its process.
    log : Path
        What it wrote.
    """

    def __init__(self, port: int, process: subprocess.Popen[bytes], log: Path) -> None:
        self.port, self.popen, self.log = port, process, log
        self.process = psutil.Process(process.pid)

    def page(self, host: str = "127.0.0.1", path: str = "/", **headers: str) -> str:
        """Return the page that a browser is given first."""
        request = Request(f"http://{host}:{self.port}{path}", headers=headers)
        with urlopen(request, timeout=START) as answer:
            return str(answer.read().decode())

    def token(self, host: str = "127.0.0.1", path: str = "/", **headers: str) -> str:
        """Return the token of a new session."""
        found = re.search(r'"token":\s*"([^"]+)"', self.page(host, path, **headers))
        assert found is not None
        return found[1]

    def status(self, path: str, **headers: str) -> int:
        """Return the status a request is answered with."""
        request = Request(f"http://127.0.0.1:{self.port}{path}", headers=headers)
        with urlopen(request, timeout=START) as answer:
            return int(answer.status)

    def socket(self, token: str, origin: str | None, host: str = "127.0.0.1", named: str = "") -> connect:
        """Return the websocket of a session, as a page of an origin opens it, by a name of the host."""
        return connect(
            f"ws://{named or host}:{self.port}/ws",
            host=host,
            port=self.port,
            origin=None if origin is None else Origin(origin),
            subprotocols=[Subprotocol("bokeh"), Subprotocol(token)],
            max_size=2**26,
            ping_interval=None,  # how long an answer takes is for the test to say
            proxy=None,
        )

    @asynccontextmanager
    async def visitor(self, path: str = "/", **headers: str) -> AsyncIterator[Visitor]:
        """Open a session as a browser does, and pull its document."""
        token = await asyncio.to_thread(self.token, path=path, **headers)
        async with self.socket(token, f"http://127.0.0.1:{self.port}") as way:
            visitor = Visitor(way)
            await visitor.answer()  # its acknowledgement
            await visitor.pull()
            yield visitor


class Visitor:
    """One websocket of a session, whose messages are made by hand."""

    def __init__(self, way: ClientConnection) -> None:
        self.way = way
        self.document: dict[str, Any] = {}

    async def send(self, kind: str, content: Any, *parts: bytes, **header: Any) -> None:
        """Send a message with its binary parts, numbered from 0."""
        head = {"msgid": "1", "msgtype": kind} | ({"num_buffers": len(parts)} if parts else {}) | header
        text = content if isinstance(content, str) else json.dumps(content)
        for fragment in (json.dumps(head), "{}", text):
            await self.way.send(fragment)
        for number, part in enumerate(parts):
            await self.way.send(json.dumps({"id": str(number)}))
            await self.way.send(part)

    async def answer(self) -> dict[str, Any]:
        """Return the header of the next message; of a document, keep it."""
        header: dict[str, Any] = json.loads(await self.way.recv())
        await self.way.recv()
        content = json.loads(await self.way.recv())
        for _ in range(2 * header.get("num_buffers", 0)):
            await self.way.recv()
        if header["msgtype"] == "PULL-DOC-REPLY":
            self.document = content["doc"]
        return header | {"content": content}

    async def reply(self, *kinds: str) -> dict[str, Any]:
        """Return the next message of one of these kinds."""
        while True:
            message = await self.answer()
            if message["msgtype"] in kinds:
                return message

    async def pull(self) -> None:
        """Ask for the document as it is now."""
        await self.send("PULL-DOC-REQ", {})
        await self.reply("PULL-DOC-REPLY")

    def tabs(self) -> str:
        """Return the name of the model of the tabs."""
        (tabs,) = self.models(name="page tabs")
        return str(tabs["id"])

    async def wait(self) -> float:
        """Ask for next to nothing, and return how long the answer took [s]."""
        asked = time.monotonic()
        await self.send("SERVER-INFO-REQ", {})
        await self.reply("SERVER-INFO-REPLY")
        return time.monotonic() - asked

    async def change(self, model: str, **values: Any) -> dict[str, Any]:
        """Change properties of a model, and return what is answered."""
        events = [
            {"kind": "ModelChanged", "model": {"id": model}, "attr": name, "new": value}
            for name, value in values.items()
        ]
        await self.send("PATCH-DOC", {"events": events})
        return await self.reply("OK", "ERROR")

    def models(self, **values: Any) -> Iterator[dict[str, Any]]:
        """Yield the models of the document whose attributes have these values."""
        waiting: list[Any] = [self.document]
        while waiting:
            found = waiting.pop()
            if isinstance(found, dict):
                attributes = found.get("attributes")
                if isinstance(attributes, dict) and values.items() <= _plain(attributes).items():
                    yield found
                waiting.extend(found.values())
            elif isinstance(found, list):
                waiting.extend(found)


def _plain(attributes: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in attributes.items() if isinstance(value, str | int | float | bool)}


def free_port() -> int:
    """Return a port nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def serving(folder: Path, *flags: str, port: int = 0, **environment: str) -> Iterator[Served]:
    """Serve the laboratory with these flags; what it writes goes to a file of the folder.

    The port is a free one unless it is named. What a server leaves for the next one is in the folder too.
    """
    port, log = port or free_port(), folder / "server.log"
    command = [
        sys.executable,
        "-m",
        "dashboards",
        "serve",
        "--no-browser",
        "--no-warm",
        "--port",
        str(port),
        *flags,
    ]
    with (
        log.open("wb") as sink,
        subprocess.Popen(
            command,
            cwd=ROOT,
            stdout=sink,
            stderr=sink,
            env={**os.environ, "TMPDIR": str(folder), "XDG_DATA_HOME": str(folder), **environment},
        ) as process,
    ):
        try:
            _wait_for(port, process, log)
            yield Served(port, process, log)
        finally:
            process.kill()


def _wait_for(port: int, process: subprocess.Popen[bytes], log: Path) -> None:
    """Wait until the server says where it is, and somebody listens there."""
    until = time.monotonic() + START
    while True:
        with socket.socket() as probe:
            listens = probe.connect_ex(("127.0.0.1", port)) == 0
        if listens and "INS Lab is at http" in log.read_text():
            return
        assert process.poll() is None, log.read_text()
        assert time.monotonic() < until, log.read_text()
        time.sleep(0.05)


@pytest.fixture(scope="session")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """Return a laboratory for all who reach this computer, with a further name."""
    with serving(
        tmp_path_factory.mktemp("served"), "--address", "0.0.0.0", "--origin", "lab.example.org"
    ) as found:
        yield found


@pytest.fixture(scope="session")
def locked(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """Return a laboratory with a password."""
    folder = tmp_path_factory.mktemp("locked")
    (folder / "password").write_text("open sesame\n")
    with serving(folder, "--password-file", str(folder / "password")) as found:
        yield found


@pytest.fixture(scope="session")
def run() -> Iterator[Callable[[Awaitable[Any]], Any]]:
    """Return a function that runs a coroutine; in a thread, since other tests may leave a loop here."""
    with ThreadPoolExecutor(1) as thread:

        def run_it(work: Awaitable[T]) -> T:
            async def bounded() -> T:
                return await asyncio.wait_for(work, START)

            return thread.submit(lambda: asyncio.run(bounded())).result()

        yield run_it


@pytest.fixture
def mine(own_missions: Path) -> Iterator[Path]:
    """Return the folder of the user's own missions, with one called mine in it."""
    add_mission(mission("los_angeles").recording, "mine", title="My flight", overwrite=True)
    yield own_missions
    for path in own_missions.iterdir():  # a process that another test stopped may have left a folder
        shutil.rmtree(path) if path.is_dir() else path.unlink()


def own_addresses() -> Sequence[str]:
    """Return addresses of this computer other than loopback, where it has one."""
    found = {
        one.address
        for addresses in psutil.net_if_addrs().values()
        for one in addresses
        if one.family == socket.AF_INET and not one.address.startswith("127.")
    }
    return sorted(found)
