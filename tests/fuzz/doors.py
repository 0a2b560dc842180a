"""Doors: what a stranger can send to a served laboratory, and what must hold whatever comes.

There are four: requests, settings files, messages of a session, and handshakes of websockets. The server
lives on, keeps nobody else waiting for more than a second, and takes neither memory nor descriptors nor log
without bound.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
import time
from collections import Counter, deque
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Any
from urllib.parse import urlencode

import numpy as np
from addresses import MODULES
from mutations import WORDS, mutated
from websockets.exceptions import WebSocketException

from dashboards.log_limit import AT_ONCE, LONGEST, PER_SECOND
from lab.experiment.experiment import Experiment
from tests.security.conftest import Served, Visitor
from tests.security.watch import WAIT, as_map, say, watched

ANSWER = 60.0
"""Time in which an attack itself is answered [s]: a page that opens compiles nothing, but computes."""
MEMORY = 900 * 2**20
"""Memory that the attacks may take in all [bytes]: the cache of results is 256 MB, two runs at a time may
take as much each without asking, and sessions that were left live on for half a minute."""
GROWTH = 200 * 2**20
"""By how much the most of the second half of the attacks may be above the most of the first [bytes]: the last
of several runs at a time comes when it comes. Half of the longest attack fills all caches."""
FEW = 500
"""Attacks below which a growth is that of caches that fill."""
DESCRIPTORS = 40
"""Descriptors that may be open beside those of before: a session has about ten for its 3-D view."""
SILENCE = 0.3
"""How long to wait for more of an answer that may never come [s]."""
ATTACKS_OF_A_SESSION = 100
"""After so many a new session is attacked: damaged ones take less and less."""

VIEW_PATH = re.compile(r"viser/\d+\.[\w-]{32}/")

Attack = Callable[["Attacker"], Awaitable[None]]
Broken = Callable[[str, Iterable[tuple[str, bytes]]], None]

NUMBERS = (0, -1, 1, 0.5, 1e308, -1e-320, 2**31, 2**63, 10**40)
TEXTS = (
    "",
    "x",
    "nan",
    "\0",
    "<img src=x onerror=alert(1)>",
    "../../etc/passwd",
    "9" * 5000,
    "[" * 5000,
    "é" * 60_000,
)
MOVED = frozenset(
    {"value", "value_input", "value_throttled", "active", "start", "end", "clicks", "selected", "open"}
)
"""Properties that change as a person uses a page."""
EVENTS = (
    "button_click", "data_event", "esm_event", "dom_event", "document_ready", "tap", "pan", "reset",
    "rangesupdate", "selectiongeometry", "value_submit", "menu_item_click", "connection_lost",
    "lodstart", "no_such_event",
)  # fmt: skip
PATHS = (
    "/", "/metadata", "/autoload.js", "/ws", "/static/js/bokeh.min.js", "/static/../../../etc/passwd",
    "/favicon.ico", "/login", "/viser/", "/viser/x/", "/static/extensions/panel/", "/components/", "/%00",
    "/..%2f..%2f", *(f"/components/{module}/x/__css__/y/z" for module in MODULES),
)  # fmt: skip
METHODS = ("GET", "GET", "GET", "HEAD", "POST", "PUT", "DELETE", "OPTIONS", "TRACE", "\0")


class Attacker:
    """One stranger, with a session of the laboratory.

    Parameters
    ----------
    served
        The laboratory.
    rng
        Says what is sent.

    Attributes
    ----------
    sent : deque of (str, bytes)
        The last attacks, each with its door.
    view : str
        Path of the session's 3-D view.
    """

    def __init__(self, served: Served, rng: np.random.Generator) -> None:
        self.served, self.rng = served, rng
        self.sent: deque[tuple[str, bytes]] = deque(maxlen=30)
        self._visit = AsyncExitStack()
        self._visitor: Visitor | None = None
        self._left = 0
        self.view = ""

    def one_of(self, some: Any) -> Any:
        """Return one of several."""
        return some[int(self.rng.integers(len(some)))]

    def chance(self, part: float) -> bool:
        """Return True so often."""
        return bool(self.rng.random() < part)

    async def visitor(self) -> Visitor:
        """Return a session whose websocket is open: the one of before, where it still is."""
        if self._visitor is not None and (self._left <= 0 or self._visitor.way.close_code is not None):
            await self.leave()
        if self._visitor is None:
            self._left = ATTACKS_OF_A_SESSION
            self._visitor = await self._visit.enter_async_context(self.served.visitor("/?tab=3-D"))
            await say(self._visitor, "document_ready")
            await self._show_view(self._visitor)
        self._left -= 1
        return self._visitor

    async def _show_view(self, visitor: Visitor) -> None:
        """Wait until the 3-D view is there."""
        async with asyncio.timeout(ANSWER):
            while (found := VIEW_PATH.search(json.dumps(visitor.document))) is None:
                await visitor.pull()
        self.view = f"/{found[0]}"

    async def leave(self) -> None:
        """Leave the session."""
        self._visitor = None
        await self._visit.aclose()

    def value(self, depth: int = 0) -> Any:
        """Return a value as a message may hold it, or may not."""
        if depth == 3 or self.chance(0.6):
            return self.one_of((*NUMBERS, *TEXTS, None, True, False, float(self.rng.normal())))
        inner = [self.value(depth + 1) for _ in range(int(self.rng.integers(4)))]
        return self.one_of(
            (
                inner,
                as_map(**{self.one_of(TEXTS[:4]): inner}),
                {"id": self.model()["id"]},
                {"type": "number", "value": self.one_of(("nan", "-inf", "1"))},
                {"type": "object", "name": "Div", "id": "made", "attributes": {}},
                {"type": "ndarray", "array": [0], "dtype": "U99999999", "shape": [1], "order": "little"},
                {"type": "set", "entries": inner},
                {"type": "bytes", "data": {"id": "0"}},
            )
        )

    def model(self) -> dict[str, Any]:
        """Return a model of the session's document; half of the time one that a person changes."""
        assert self._visitor is not None
        found = [one for one in self._visitor.models() if "id" in one]
        moved = [one for one in found if MOVED & one["attributes"].keys()]
        return dict(self.one_of(moved if moved and self.chance(0.5) else found))


async def request(attacker: Attacker) -> None:
    """Ask for something by an address, or by what is none."""
    names = [path for path, _, _ in Experiment().leaves()] + [
        "mission",
        "card",
        "bokeh-session-id",
        "next",
        "x",
    ]
    fields = {
        attacker.one_of(names): attacker.one_of((*TEXTS, *map(str, NUMBERS), "[[1,2]]", "montreal"))
        for _ in range(int(attacker.rng.integers(6)))
    }
    path = "/" if attacker.chance(0.2) else attacker.one_of(PATHS)
    query = mutated(urlencode(fields).encode(), attacker.rng)
    head = f"{attacker.one_of(METHODS)} {path}?".encode() + query + b" HTTP/1.1\r\n"
    lines = f"Host: 127.0.0.1:{attacker.served.port}\r\nAccept-Encoding: gzip\r\nConnection: close\r\n"
    if attacker.chance(0.3):
        lines += f"Content-Length: {attacker.one_of((0, 5, -1, 10**30))}\r\n"
    whole = head + lines.encode() + b"\r\nbody="
    await _by_socket(attacker, mutated(whole, attacker.rng) if attacker.chance(0.4) else whole)


async def handshake(attacker: Attacker) -> None:
    """Ask for a websocket of a page or of a 3-D view, and send what is no frame of it."""
    token = await asyncio.to_thread(attacker.served.token) if attacker.chance(0.1) else "token"
    await attacker.visitor()
    path = attacker.one_of(("/ws", *[attacker.view] * 3, f"/viser/{'x' * 32}/"))
    lines = [f"GET {path} HTTP/1.1", f"Host: 127.0.0.1:{attacker.served.port}", "Upgrade: websocket"]
    lines += [
        "Connection: Upgrade",
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
        "Sec-WebSocket-Version: 13",
    ]
    own = f"http://127.0.0.1:{attacker.served.port}"
    lines += [f"Origin: {attacker.one_of((own, own, own, 'http://evil.example', 'null', '::', 'http://['))}"]
    lines += [f"Sec-WebSocket-Protocol: {attacker.one_of(('bokeh', 'viser-v1.0.0', 'x'))}, {token}"]
    whole = "\r\n".join([*lines, "", ""]).encode()
    if attacker.chance(0.5):
        whole = mutated(whole, attacker.rng)
    frames = b"".join(
        bytes([attacker.one_of((0x81, 0x82, 0x01, 0x88, 0x89, 0xF1)), 0x80 | len(text)]) + bytes(4) + text
        for text in (mutated(attacker.one_of(WORDS)[:100] * 2, attacker.rng)[:100] for _ in range(3))
    )
    await _by_socket(attacker, whole + frames)


async def message(attacker: Attacker) -> None:
    """Change what a session holds, by messages that a page would not send."""
    visitor = await attacker.visitor()
    if attacker.chance(0.05):
        await visitor.pull()  # other pages have other models
    model = attacker.model()
    known = list(model["attributes"])
    names = [name for name in known if name in MOVED] if attacker.chance(0.7) else known
    if attacker.chance(0.3):
        content = {"type": "event", "name": attacker.one_of(EVENTS)}
        values = [["model", {"id": model["id"]}], ["data", attacker.value()], ["x", attacker.value()]]
        content["values"] = {"type": "map", "entries": values[: int(attacker.rng.integers(4))]}
        events = [{"kind": "MessageSent", "msg_type": "bokeh_event", "msg_data": content}]
    else:
        events = [
            {
                "kind": "ModelChanged",
                "model": {"id": model["id"]},
                "attr": attacker.one_of(names or ["value"]),
                "new": attacker.value(),
            }
            for _ in range(int(attacker.rng.integers(1, 4)))
        ]
    text = json.dumps({"events": events})
    if attacker.chance(0.1):
        text = mutated(text.encode(), attacker.rng).decode(errors="replace")
    attacker.sent.append(("message", text.encode()))
    parts = [b"part"] if '"bytes"' in text else []
    await visitor.send("PATCH-DOC", text, *parts)
    await visitor.reply("OK", "ERROR")


async def settings_file(attacker: Attacker) -> None:
    """Upload a damaged settings file."""
    visitor = await attacker.visitor()
    data = mutated(_settings(attacker), attacker.rng)
    attacker.sent.append(("settings file", data))
    button = next((one["id"] for one in visitor.models() if _accepts(one) == ".toml"), attacker.model()["id"])
    at = int(attacker.rng.integers(1 + len(data)))
    for number, piece in enumerate((data[:at], data[at:]), 1):
        told = {
            "status": "upload_event",
            "name": "a.toml",
            "chunk": number,
            "total_chunks": 2,
            "mime_type": "",
        }
        content = {"type": "bytes", "data": {"id": "0"}}
        await say(visitor, "data_event", piece, model={"id": button}, data=as_map(**told, data=content))
    await say(visitor, "data_event", model={"id": button}, data=as_map(status="finished"))


DOORS: dict[str, Attack] = {
    "requests": request,
    "settings files": settings_file,
    "messages": message,
    "handshakes": handshake,
}


async def besiege(
    served: Served, rng: np.random.Generator, enough: Callable[[int], bool], broken: Broken
) -> Counter[str]:
    """Attack a laboratory by its doors until it is enough; return how often by each.

    Parameters
    ----------
    served
        The laboratory.
    rng
        Says what is sent.
    enough
        Says after a number of attacks whether it is enough.
    broken
        Told what did not hold, and the last attacks, each with its door.
    """
    async with watched(served) as watch, _attacking(served, rng) as attacker:
        before, logged, began = _taken(served), served.log.stat().st_size, time.monotonic()
        count, longest, taken = Counter[str](), 0.0, list[int]()
        while not enough(count.total()):
            door = attacker.one_of(list(DOORS))
            count[door] += 1
            try:
                async with asyncio.timeout(ANSWER):
                    await attacker.visitor()
                    await DOORS[door](attacker)
            except TimeoutError:
                broken(f"{door}: an attack was not answered in {ANSWER:g} s", attacker.sent)
            except (WebSocketException, OSError, EOFError):
                pass  # the door was shut, as it should be
            if (waited := watch.longest) > WAIT:
                broken(f"{door}: somebody else waited for {waited:.1f} s", attacker.sent)
            longest = max(longest, waited)
            watch.forget()
            taken.append(_taken(served)[0])
            if served.popen.poll() is not None or waited > ANSWER:
                broken(f"{door}: the server has ended, or will never answer again", attacker.sent)
                return count
        await attacker.leave()
        memory, descriptors = _taken(served)
        print(f"{dict(count)}; somebody else waited for up to {longest:.2f} s")
        print(
            f"{before[0] / 1e6:.0f} MB became {memory / 1e6:.0f}, {before[1]} descriptors {descriptors}",
            flush=True,
        )
        most = 2 * LONGEST * (AT_ONCE + PER_SECOND * (time.monotonic() - began))
        if served.log.stat().st_size - logged > most:
            broken("the log has grown too much", attacker.sent)
        if (more := _growth(taken)) > GROWTH:
            broken(f"the second half of the attacks took {more / 1e6:.0f} MB more", attacker.sent)
        if (left := await _more_than(before, served)) is not None:
            broken(left, attacker.sent)
        return count


@asynccontextmanager
async def _attacking(served: Served, rng: np.random.Generator) -> AsyncIterator[Attacker]:
    attacker = Attacker(served, rng)
    await attacker.visitor()
    try:
        yield attacker
    finally:
        await attacker.leave()


def _taken(served: Served) -> tuple[int, int]:
    """Return the memory [bytes] and the descriptors that a server has taken."""
    return served.process.memory_info().rss, served.process.num_fds()


def _growth(taken: list[int]) -> int:
    """Return how much more memory the second half of the attacks took than the first [bytes]."""
    half = len(taken) // 2
    return max(taken[half:]) - max(taken[:half]) if len(taken) >= FEW else 0


async def _more_than(before: tuple[int, int], served: Served) -> str | None:
    """Return what a server keeps of the attacks, once its sessions have ended."""
    until = time.monotonic() + ANSWER
    while True:
        memory, descriptors = (now - then for now, then in zip(_taken(served), before, strict=True))
        if memory <= MEMORY and descriptors <= DESCRIPTORS:
            return None
        if time.monotonic() > until:
            return f"{memory / 1e6:.0f} MB and {descriptors} descriptors are not given back"
        await asyncio.sleep(1.0)


async def _by_socket(attacker: Attacker, data: bytes) -> None:
    """Send bytes, and read until nothing comes for a while."""
    attacker.sent.append(("bytes", data))
    reader, writer = await asyncio.open_connection("127.0.0.1", attacker.served.port)
    try:
        writer.write(data)
        await writer.drain()
        patience = ANSWER if data.startswith(b"GET / ") else SILENCE
        with contextlib.suppress(TimeoutError):
            while await asyncio.wait_for(reader.read(2**16), patience):
                patience = SILENCE
    finally:
        writer.close()


def _accepts(model: dict[str, Any]) -> Any:
    data = model["attributes"].get("data")
    return data.get("attributes", {}).get("accept") if isinstance(data, dict) else None


def _settings(attacker: Attacker) -> bytes:
    """Return a settings file in which some settings are not what they are by default."""
    experiment = Experiment()
    for path, _, _ in experiment.leaves():
        if attacker.chance(0.1):
            with contextlib.suppress(ValueError):
                experiment.set_text(path, attacker.one_of(("1", "0", "2.5", "true", "[1, 2, 3]", "[[3, 5]]")))
    return experiment.to_toml().encode()
