"""The changes of a page go to its browsers as one message, in Bokeh's own words."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import panel_material_ui as pmui
import pytest
from bokeh.core.serialization import Serializer
from bokeh.document import Document
from bokeh.document.events import DocumentPatchedEvent
from bokeh.models import ColumnDataSource, Row
from bokeh.protocol import Protocol
from bokeh.server.session import ServerSession
from bokeh.server.views.ws import WSHandler
from panel.io.state import set_curdoc
from tornado.iostream import StreamClosedError
from tornado.locks import Lock
from tornado.websocket import WebSocketProtocol13

from dashboards.sending import together
from dashboards.upstream.server import speed_up
from lab.views.figures import TimeAxis, time_figure


@pytest.fixture(autouse=True)
def fast() -> None:
    speed_up()


class Browser:
    """A connection that keeps what is sent."""

    protocol = Protocol()

    def __init__(self) -> None:
        self.messages: list[Any] = []
        self._socket = SimpleNamespace(send_message=self.messages.append)

    def send_patch_document(self, event: DocumentPatchedEvent) -> None:
        """Take one change, as Bokeh sends it."""
        self.messages.append(self.protocol.create("PATCH-DOC", [event]))


class Served:
    """A document with browsers that show it, and its lock held."""

    def __init__(self, browsers: int = 1) -> None:
        self.document = Document()
        self.figure: Any = time_figure("a", TimeAxis())
        self.row: Any = Row(children=[self.figure])
        self.document.add_root(self.row)
        self.document.models.flush_synced()
        loop: Any = SimpleNamespace(add_callback=lambda *_: None, call_later=lambda *_: None)
        self.session = ServerSession("a" * 44, self.document, loop)  # type: ignore[arg-type]
        request = SimpleNamespace(arguments={}, headers={}, cookies={})
        context = SimpleNamespace(session=self.session, server_context=None, request=request)
        self.document._session_context = lambda: context  # type: ignore[assignment]
        self.session._pending_writes = []
        self.browsers = [Browser() for _ in range(browsers)]
        for browser in self.browsers:
            self.session.subscribe(browser)  # type: ignore[arg-type]

    def change(self) -> None:
        """Change three properties, one of them twice, and show another figure."""
        self.figure.title.text = "b"
        self.row.spacing = 3
        self.row.spacing = 4
        self.row.children = [self.figure, time_figure("c", TimeAxis(name="other"))]


def contents(message: Any) -> list[Any]:
    return list(message.content["events"])


def test_all_changes_are_one_message() -> None:
    served = Served(browsers=2)
    with together(served.document):
        served.change()
    for browser in served.browsers:
        assert len(browser.messages) == 1
        events = contents(browser.messages[0])
        assert [(one["attr"], one["new"]) for one in events[:2]] == [("text", "b"), ("spacing", 4)]
        assert events[2]["attr"] == "children"


def test_the_message_says_what_bokeh_would_say() -> None:
    served = Served()
    document = served.document
    seen: list[DocumentPatchedEvent] = []
    document.on_change(lambda event: seen.append(event) if isinstance(event, DocumentPatchedEvent) else None)
    served.change()
    known = document.models.synced_references
    assert len(known) > 20
    document.models._new_models |= served.row.children[1].references()
    plain = Serializer(references=document.models.synced_references)
    expected = plain.encode(seen)
    message = Protocol().create("PATCH-DOC", seen)
    assert message.content["events"] == expected
    assert '"Figure"' in str(expected).replace("'", '"')
    assert not document.models._new_models  # from now on, the browser has them
    again: list[Any] = contents(Protocol().create("PATCH-DOC", seen))
    assert again[-1]["new"] == [one.ref for one in served.row.children]


def test_numbers_go_as_buffers_of_the_message() -> None:
    served = Served()
    source = ColumnDataSource({"x": [0.0]})
    served.figure.line("x", "x", source=source)
    served.browsers[0].messages.clear()
    served.document.models.flush_synced()
    with together(served.document):
        source.data = {"x": np.arange(5.0)}
        served.row.spacing = 9
    [message] = served.browsers[0].messages
    assert [event["kind"] for event in contents(message)] == ["ColumnDataChanged", "ModelChanged"]
    [numbers] = message.buffers
    assert np.frombuffer(numbers.to_bytes()).tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_a_browser_is_not_sent_what_it_changed_itself() -> None:
    served = Served(browsers=2)
    served.session._current_patch_connection = served.browsers[0]  # type: ignore[assignment]
    with together(served.document):
        served.row.set_from_json("spacing", 7, setter=served.session)
        served.figure.title.text = "b"
    own, other = ([event["attr"] for event in contents(browser.messages[0])] for browser in served.browsers)
    assert (own, other) == (["text"], ["spacing", "text"])


def test_a_document_without_its_lock_is_not_changed_silently() -> None:
    served = Served()
    served.session._pending_writes = None
    with pytest.raises(RuntimeError, match="lock"), together(served.document):
        served.row.spacing = 5


def test_a_component_does_not_take_what_was_held_back_for_a_change_of_the_browser() -> None:
    served = Served()
    box = pmui.TextInput(value="before")
    with set_curdoc(served.document):
        model: Any = box.get_root(served.document)
        served.document.add_root(model)
    before = len(served.document.session_callbacks)
    with together(served.document):
        model.data.value = "after"
    assert len(served.browsers[0].messages) == 2  # the new root, and its value
    assert len(served.document.session_callbacks) == before
    box._server_change(served.document, "box", None, "value", "after", "typed")
    assert len(served.document.session_callbacks) == before + 1


def completed(work: Coroutine[Any, Any, Any]) -> Any:
    """Run a coroutine to its end, and return what it returns."""
    # In a thread of its own: a browser of other tests may leave a loop running in this one.
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(asyncio.run, work).result(30)


class Wire:
    """A websocket to a browser, which keeps what is written to its stream, call by call."""

    def __init__(self) -> None:
        self.written: list[bytes] = []
        parameters: Any = SimpleNamespace(max_message_size=0, compression_options=None)
        self.ws_connection = WebSocketProtocol13(Mock(), mask_outgoing=False, params=parameters)
        self.ws_connection.stream = SimpleNamespace(write=self._write)
        self.write_lock = Lock()

    def _write(self, data: bytes) -> asyncio.Future[None]:
        self.written.append(data)
        done: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        done.set_result(None)
        return done

    async def write_message(self, message: str | bytes, binary: bool = False, locked: bool = True) -> None:
        """Send one part, as Bokeh does."""
        assert not locked
        await self.ws_connection.write_message(message, binary)


@pytest.mark.parametrize("length", [1, 125, 126, 65535, 65536])
def test_a_message_leaves_in_one_piece_and_in_bokehs_own_frames(length: int) -> None:
    served = Served()
    source = ColumnDataSource({"a": np.arange(float(length)), "b": np.zeros(length)})
    with together(served.document):
        served.row.children = [served.figure, Row(tags=["ø" * length]), Row(tags=[source])]
    (message,) = served.browsers[0].messages

    async def send(sender: Any, wire: Wire) -> bytes:
        await sender(wire)
        return b"".join(wire.written)

    parts, once = Wire(), Wire()
    expected = completed(send(message.send, parts))
    assert completed(send(lambda wire: WSHandler.send_message(wire, message), once)) == expected
    assert len(parts.written) >= 5
    assert len(once.written) == 1


def test_a_browser_that_has_left_takes_no_message(caplog: pytest.LogCaptureFixture) -> None:
    served, wire = Served(), Wire()
    with together(served.document):
        served.figure.height = 99
    (message,) = served.browsers[0].messages
    wire.ws_connection.stream = SimpleNamespace(write=Mock(side_effect=StreamClosedError()))
    completed(WSHandler.send_message(wire, message))  # type: ignore[arg-type]
    assert not [record for record in caplog.records if record.levelname in ("ERROR", "WARNING")]
