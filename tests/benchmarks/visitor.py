"""Visitor: opens the simulator as a browser does, without drawing: page, websocket, document, changes."""

from __future__ import annotations

import asyncio
import json
import re
import time
from typing import Any

from tornado.httpclient import AsyncHTTPClient, HTTPRequest
from tornado.websocket import WebSocketClientConnection, websocket_connect

from dashboards.settings_panel import COMMON, SECTIONS
from dashboards.sigmas import sigma_of
from lab.experiment.experiment import Experiment

PLOTS = 50_000
"""Bytes of numbers in the plots of the Overview, at least: with each step of a slider, 55 kB."""
PATIENCE = 300.0
"""Longest time to wait for anything [s]."""

READY = {
    "kind": "MessageSent",
    "msg_type": "bokeh_event",
    "msg_data": {"type": "event", "name": "document_ready", "values": {"type": "map"}},
}
"""What a browser says once it has drawn the document."""


SLIDER = re.compile(r'"name":"Slider\d*","id":"(\w+)","attributes":\{"name":"White noise')
"""Finds the model that holds the value of the slider of the gyros' noise."""
LABEL = re.compile(r'"label":("(?:[^"\\]|\\.)*")')


def labels() -> set[str]:
    """Return the labels of the settings that a page shows at first, without units."""
    experiment = Experiment()
    shown = set()
    for path in COMMON:
        owner, _, name = path.rpartition(".")
        _title, is_open = SECTIONS[owner]
        if is_open:
            declaration = experiment.get(owner).param[name]
            shown.add(str((sigma_of(declaration) or declaration).label))
    return shown


class Visitor:
    """One browser with the simulator open.

    Parameters
    ----------
    address
        Address of the simulator, without a slash at its end.
    query
        Query of the address.
    cookie
        Cookie of the browser, as ``name=value``; empty without one.

    Attributes
    ----------
    framed, drawn, complete : float
        Time from the request to the document, to the numbers of the first plots, and until all settings are
        there as well [s].
    """

    def __init__(self, address: str, query: str = "", cookie: str = "") -> None:
        self._address = address
        self._query = query
        self._headers = {"Cookie": cookie} if cookie else {}
        self._text: list[str] = []
        self._slider: str | None = None
        self.framed = self.drawn = self.complete = 0.0
        self._bytes = 0
        self._socket: WebSocketClientConnection | None = None

    async def open(self) -> None:
        """Open the page and wait until it is complete."""
        begin = time.monotonic()
        answer = await AsyncHTTPClient(force_instance=True).fetch(
            self._request(f"{self._address}{self._query}")
        )
        found = re.search(r'"token":"([^"]+)"', answer.body.decode())
        assert found is not None, "the page names no session"
        address = f"{self._address.replace('http', 'ws', 1)}/ws"
        self._socket = await websocket_connect(self._request(address), subprotocols=["bokeh", found[1]])
        await self._receive("ACK")
        await self._send("PULL-DOC-REQ", {})
        await self._receive("PULL-DOC-REPLY")
        self.framed = time.monotonic() - begin
        await self._send("PATCH-DOC", {"events": [READY]})
        missing = labels()
        while not (self.drawn and self.complete):
            if not self.drawn and self._bytes >= PLOTS:
                self.drawn = time.monotonic() - begin
            seen = "".join(self._text)
            missing -= {json.loads(label).partition(" [")[0] for label in LABEL.findall(seen)}
            self._text.clear()
            slider = SLIDER.search(seen)
            self._slider = slider[1] if slider else self._slider
            if self.drawn and not missing:
                self.complete = time.monotonic() - begin
            else:
                await self._receive()

    async def move(self, value: float) -> float:
        """Move the slider of the gyros' noise; return the time until the new curves arrive [s]."""
        assert self._slider is not None, "the page has no slider"
        self._bytes = 0
        begin = time.monotonic()
        change = {"kind": "ModelChanged", "model": {"id": self._slider}, "attr": "value", "new": value}
        await self._send("PATCH-DOC", {"events": [change]})
        while self._bytes < PLOTS:
            await self._receive()
        return time.monotonic() - begin

    def close(self) -> None:
        """Leave, as a browser does that closes a page."""
        if self._socket is not None:
            self._socket.close(1001)

    async def _send(self, kind: str, content: dict[str, Any]) -> None:
        assert self._socket is not None
        header = {"msgid": str(time.monotonic_ns()), "msgtype": kind}
        for part in (header, {}, content):
            await self._socket.write_message(json.dumps(part))

    async def _receive(self, kind: str = "") -> None:
        """Receive one message, or all until one of a kind has come."""
        while True:
            header = json.loads(await self._fragment())
            await self._fragment()
            self._text.append(str(await self._fragment()))
            for _ in range(header.get("num_buffers", 0)):
                await self._fragment()
                self._bytes += len(await self._fragment())
            if not kind or header["msgtype"] == kind:
                return

    async def _fragment(self) -> str | bytes:
        assert self._socket is not None
        fragment = await asyncio.wait_for(self._socket.read_message(), PATIENCE)
        assert fragment is not None, "the server has closed the connection"
        return fragment

    def _request(self, address: str) -> HTTPRequest:
        # Certificates of tests are made by the tests.
        return HTTPRequest(
            address,
            connect_timeout=PATIENCE,
            request_timeout=PATIENCE,
            headers=self._headers,
            validate_cert=False,
        )
