"""Followers: a class over websockets: a teacher's page that acts, and pages that follow and draw nothing."""

from __future__ import annotations

import asyncio
import json
import re
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager
from itertools import cycle
from typing import Any, NamedTuple
from urllib.parse import urlsplit

import numpy as np

from dashboards.page_tabs import TABS
from dashboards.teaching.teacher import COOKIE
from tests.benchmarks.visitor import PLOTS, Visitor
from tests.security.conftest import Served

MISSING = 10.0
"""Longest wait for a step [s]; one that has not come by then is an error."""
TITLES = list(TABS)
FLIGHT = "?mission=los_angeles&trajectory.imu_rate=50"
"""Settings with which the teacher begins: a short flight."""
KINDS = ("settings", "time", "settings", "another tab", "time", "first tab")
"""Steps of a teacher, in a row."""
CODE = re.compile(r"\?class=([a-z2-9]{6})")


class Page(Visitor):
    """A page of a class, which reads all messages."""

    def __init__(self, address: str, query: str = "", cookie: str = "") -> None:
        super().__init__(address, query, cookie)
        self._seen, self._left = "", False
        self._news = asyncio.Event()
        self._reading: asyncio.Task[None] | None = None

    async def _receive(self, kind: str = "") -> None:
        before = len(self._text)
        await super()._receive(kind)
        self.note(self._text[before:])

    def note(self, texts: list[str]) -> None:
        """Note the texts of messages that have arrived."""
        self._seen += "".join(texts)
        self._news.set()

    async def open(self) -> None:
        """Open the page, and read all messages from then on."""
        await super().open()
        self._reading = asyncio.create_task(self._read())

    async def _read(self) -> None:
        while not self._left:
            try:
                await self._receive()
            except AssertionError:  # the connection is closed
                if not self._left:
                    raise
            self._text.clear()

    async def until(self, arrived: Callable[[Page], bool]) -> float:
        """Return when a condition holds [s, monotonic]; infinity if it does not within `MISSING`."""
        assert self._reading is not None
        until = time.monotonic() + MISSING
        while not arrived(self):
            if self._reading.done():
                self._reading.result()
            self._news.clear()
            try:
                await asyncio.wait_for(self._news.wait(), until - time.monotonic())
            except TimeoutError:
                return np.inf
        return time.monotonic()

    def forget(self) -> None:
        """Forget what has arrived so far."""
        self._seen, self._bytes = "", 0

    def has(self, text: str) -> bool:
        """Return whether a text has arrived."""
        return text in self._seen

    @property
    def has_curves(self) -> bool:
        """Whether the numbers of the plots have arrived."""
        return self._bytes >= PLOTS

    def close(self) -> None:
        """Leave."""
        self._left = True
        super().close()


class Acting(Page):
    """A page whose models are known, so that they can be clicked and set."""

    def __init__(self, address: str, query: str = "", cookie: str = "") -> None:
        super().__init__(address, query, cookie)
        self._contents: list[Any] = []

    def note(self, texts: list[str]) -> None:
        """Note messages, and the models in them."""
        super().note(texts)
        self._contents += [json.loads(text) for text in texts]

    async def click(self, label: str) -> None:
        """Click a button."""
        button = next(model for model in self._models() if _data(model).get("label") == label)
        values = [["model", {"id": button["id"]}], ["node", "click"], ["data", {"type": "map"}]]
        click = {"type": "event", "name": "dom_event", "values": {"type": "map", "entries": values}}
        await self._report({"kind": "MessageSent", "msg_type": "bokeh_event", "msg_data": click})

    async def turn_to(self, title: str) -> None:
        """Open a tab."""
        tabs = next(model for model in self._models() if _values(model).get("_names") == TITLES)
        await self._set(tabs, "active", TITLES.index(title))

    async def set_noise(self, value: float) -> None:
        """Move the slider of the gyros' noise."""
        await self._set({"id": self._slider}, "value", value)

    async def _set(self, model: dict[str, Any], attribute: str, value: Any) -> None:
        await self._report(
            {"kind": "ModelChanged", "model": {"id": model["id"]}, "attr": attribute, "new": value}
        )

    async def _report(self, event: dict[str, Any]) -> None:
        await self._send("PATCH-DOC", {"events": [event]})

    def _models(self) -> Iterator[dict[str, Any]]:
        waiting: list[Any] = list(self._contents)
        while waiting:
            found = waiting.pop()
            if isinstance(found, dict):
                if found.get("type") == "object":
                    yield found
                waiting.extend(found.values())
            elif isinstance(found, list):
                waiting.extend(found)


class Teacher(Acting):
    """The page of the teacher."""

    def __init__(self, address: str, token: str, port: int = 0) -> None:
        cookie = f"{COOKIE}_{port or urlsplit(address).port}={token}"
        super().__init__(address, FLIGHT, cookie)

    async def start(self) -> str:
        """Start a class, and return its code."""
        await self.click("Start a class")
        await self.until(lambda page: CODE.search(page._seen) is not None)
        found = CODE.search(self._seen)
        assert found is not None
        return found[1]

    async def look_at(self, seconds: float) -> None:
        """Move the time cursor."""
        cursor = next(model for model in self._models() if _values(model).get("name") == "time cursor")
        await self._set(cursor, "location", seconds)


class Step(NamedTuple):
    """One step of the teacher, and how long it took to each follower.

    Attributes
    ----------
    kind : str
        Kind of the step.
    delays : list of float
        Time from the teacher's message until its effect was with a follower [s].
    """

    kind: str
    delays: list[float]


@asynccontextmanager
async def class_of(served: Served, number: int) -> AsyncIterator[tuple[Teacher, list[Page]]]:
    """Open the page of a teacher who starts a class, and pages that follow it, all at once."""
    address = f"http://127.0.0.1:{served.port}"
    found = re.search(r"/teach\?key=([\w-]+)", served.log.read_text())
    assert found is not None, "no link for teachers was printed"
    teacher = Teacher(address, found[1])
    await teacher.open()
    query = f"?class={await teacher.start()}"
    followers = [Page(address, query) for _ in range(number)]
    try:
        await asyncio.gather(*(follower.open() for follower in followers))
        yield teacher, followers
    finally:
        for page in (teacher, *followers):
            page.close()


async def steps(teacher: Teacher, followers: list[Page], seconds: float) -> AsyncIterator[Step]:
    """Have the teacher change a setting, the time, the tab and back, in a row for some time, but all once."""
    until = time.monotonic() + seconds
    for number, kind in enumerate(cycle(KINDS), start=1):
        if time.monotonic() >= until and number > len(KINDS):
            return
        for page in followers:
            page.forget()
        begin = time.monotonic()
        arrived = await _act(teacher, kind, number)
        ends = await asyncio.gather(*(page.until(arrived) for page in followers))
        yield Step(kind, [end - begin for end in ends])


async def _act(teacher: Teacher, kind: str, number: int) -> Callable[[Page], bool]:
    """Take a step, and return the condition that it is with a follower."""
    if kind == "settings":
        await teacher.set_noise(0.03 + 1e-3 * (number % 60))
        return lambda page: page.has_curves
    if kind == "time":
        seconds = 1.0 + number % 100 + 0.25
        await teacher.look_at(seconds)
        return lambda page: page.has(f'"attr":"location","new":{seconds}')
    title = "Flight" if kind == "another tab" else "Errors"
    await teacher.turn_to(title)
    return lambda page: page.has(f'"attr":"active","new":{TITLES.index(title)}') and page.has('"Figure"')


def _values(model: dict[str, Any]) -> dict[str, Any]:
    return dict(model.get("attributes", {}))


def _data(model: dict[str, Any]) -> dict[str, Any]:
    data = _values(model).get("data")
    return _values(data) if isinstance(data, dict) else {}
