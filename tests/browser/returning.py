"""Students over websockets who solve a step of a lesson; their pages come back as those of browsers do."""

from __future__ import annotations

import asyncio
import json
import time
from typing import Any

from tornado.httpclient import AsyncHTTPClient
from tornado.simple_httpclient import HTTPTimeoutError

from tests.benchmarks.followers import Acting
from tests.benchmarks.visitor import PATIENCE

LESSON = "Tuning R"
RIGHT = "yes"
"""Answer to the first question of that lesson."""
RESTARTS = 1012
"""Code with which a server that restarts closes a websocket, of IANA's registry."""


class Student(Acting):
    """A page that a student has opened, with what its browser stores.

    Attributes
    ----------
    search : str
        The address that the page has written last.
    kept : str
        What it has the browser store.
    """

    def __init__(self, address: str, query: str = "", cookie: str = "") -> None:
        super().__init__(address, query, cookie)
        self.search = self.kept = ""
        self._bar: dict[str, Any] = {}

    def note(self, texts: list[str]) -> None:
        """Note messages, the models in them, and what belongs to the browser."""
        for text in texts:
            content = json.loads(text)
            for event in content.get("events", ()) if isinstance(content, dict) else ():
                new = event.get("new")
                shown = dict(new["entries"]) if isinstance(new, dict) and new.get("type") == "map" else {}
                if event.get("attr") == "shown" and "search" in shown:
                    self.search, self._bar = shown["search"], event["model"]
                if event.get("attr") == "kept":
                    self.kept = new
        super().note(texts)

    async def open(self) -> None:
        """Open the page, and wait until it has written its address."""
        await super().open()
        while self._query and not self.search:
            await self.until(lambda page: bool(getattr(page, "search", "")))

    async def solve(self) -> None:
        """Open a lesson of the list, which is open, and answer its first question."""
        await self.arrives(f'"label":"{LESSON}"')
        await self.click(LESSON)
        await self.arrives('"Check the answer"')
        choices = next(one for one in self._models() if RIGHT in _values(one).get("options", ()))
        await self._set(choices, "value", RIGHT)
        await self.click("Check the answer")
        await self.arrives(r"\"solved\": [[")

    async def choose(self, noise: float) -> None:
        """Set the noise of the gyros, and wait until it is in the address."""
        before = self.search
        await self.set_noise(noise)
        while self.search == before:
            await self.until(lambda page: page.has("white_noise="))
            self.forget()

    async def ends(self) -> int:
        """Return the code with which the server closes the connection."""
        assert self._reading is not None
        assert self._socket is not None
        await asyncio.wait({self._reading}, timeout=PATIENCE)
        return int(self._socket.close_code or 0)

    async def come_back(self) -> Student:
        """Wait until a server answers, open the page again, and bring what the browser had stored."""
        client = AsyncHTTPClient(force_instance=True)
        until = time.monotonic() + PATIENCE
        while True:
            try:
                asked = self._request(f"{self._address}/health")
                answer = await client.fetch(asked, raise_error=False)
                if answer.code < 500:
                    break
            except (OSError, HTTPTimeoutError):
                pass  # nobody answers yet
            assert time.monotonic() < until, "no server came back"
            await asyncio.sleep(0.5)
        page = Student(self._address, self.search, self._headers.get("Cookie", ""))
        await page.open()
        await page._set(page._bar, "brought", json.dumps({"kept": self.kept, "is_same": True}))
        if self.kept:
            await page.arrives(r"\"solved\": [[")
        return page

    async def shows(self, search: str) -> None:
        """Wait until the page has written an address."""
        begin = time.monotonic()
        while self.search != search:
            assert time.monotonic() - begin < PATIENCE, f"{self.search} has not become {search}"
            await asyncio.sleep(0.1)

    async def arrives(self, text: str) -> None:
        """Wait until a text has arrived."""
        begin = time.monotonic()
        while not self.has(text):
            assert time.monotonic() - begin < PATIENCE, f"{text} has not arrived"
            await self.until(lambda page: page.has(text))


def _values(model: dict[str, Any]) -> dict[str, Any]:
    return dict(model.get("attributes", {}))
