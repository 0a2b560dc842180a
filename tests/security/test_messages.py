"""Messages made by hand take no memory, no time of others and no log, and change only what a page changes."""

from __future__ import annotations

import asyncio
import base64
import gzip
import json
import logging
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from bokeh.core.serialization import Deserializer
from bokeh.events import DocumentReady
from bokeh.models import Range1d
from bokeh.protocol import Protocol
from bokeh.protocol.exceptions import ProtocolError
from bokeh.protocol.message import Message
from bokeh.server.connection import ServerConnection
from hypothesis import given, settings
from hypothesis import strategies as st
from tornado.websocket import WebSocketClosedError
from websockets.exceptions import ConnectionClosed

from dashboards.log_limit import AT_ONCE, LONGEST, PER_SECOND, LogLimit
from dashboards.messages import (
    CHUNK,
    MAX_EVENTS,
    MAX_MESSAGE,
    MAX_REASON,
    MAX_TEXT,
    BoundedHandler,
    BoundedReceiver,
    is_refusal,
)
from dashboards.origins import PageSocket
from tests.security.conftest import Served, Visitor
from tests.security.watch import say

MEMORY = 200 * 2**20
"""Most memory one attack may take [bytes]."""
WAIT = 1.0
"""Longest time it may take of anybody else [s]."""


def squeezed(size: int) -> str:
    """Return zeros as Bokeh writes bytes into a text."""
    return base64.b64encode(gzip.compress(bytes(size), 9)).decode()


def change(value: Any, kind: str = "ModelChanged") -> dict[str, Any]:
    """Return the content of a message in which a property changes."""
    return {"events": [{"kind": kind, "model": {"id": "p1"}, "attr": "name", "new": value}]}


def received(*fragments: str | bytes) -> Message[Any] | None:
    """Return the message that a server makes of fragments."""

    async def consume() -> Message[Any] | None:
        receiver, message = BoundedReceiver(Protocol()), None
        for fragment in fragments:
            message = await receiver.consume(fragment)
        return message

    # In a thread of its own: a browser of other tests may leave a loop running in this one.
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(lambda: asyncio.run(consume())).result()


def patch(content: Any, **header: Any) -> tuple[str, str, str]:
    """Return the fragments of a patch."""
    text = content if isinstance(content, str) else json.dumps(content)
    return json.dumps({"msgid": "1", "msgtype": "PATCH-DOC"} | header), "{}", text


ZEROS = {"type": "bytes", "data": {"id": "0"}}


@pytest.mark.parametrize(
    "content",
    [
        change(ZEROS | {"data": squeezed(1000)}),
        change({"type": "ndarray", "array": [0], "dtype": "U100000000", "shape": [1], "order": "little"}),
        change({"type": "value", "value": 1}),
        change({"type": ["list"]}),
        change(1, "ColumnsStreamed"),
        change(1, "RootAdded"),
        change([ZEROS, {"type": "typed_array", "array": ZEROS, "order": "little", "dtype": "uint8"}]),
        {"events": change(1)["events"] * (MAX_EVENTS + 1)},
        {"events": {"kind": "ModelChanged"}},
        [],
        "[" * 20_000,
        "9" * 5_000,
        " " * (MAX_TEXT + 1),
    ],
)
def test_what_a_page_does_not_send_is_refused_undecoded(content: Any) -> None:
    with pytest.raises(ProtocolError) as refusal:
        received(*patch(content))
    assert len(str(refusal.value).encode()) <= MAX_REASON


@pytest.mark.parametrize("parts", [10**9, -1, "1", None, 0.5])
def test_a_message_has_few_binary_parts(parts: Any) -> None:
    with pytest.raises(ProtocolError):
        received(*patch(change(1), num_buffers=parts))


def test_a_message_of_many_parts_is_no_larger_than_one() -> None:
    part = bytes(MAX_MESSAGE // 3)
    fragments = [fragment for number in range(4) for fragment in (json.dumps({"id": f"{number}"}), part)]
    with pytest.raises(ProtocolError, match="too large"):
        received(*patch(change(1), num_buffers=4), *fragments)


def test_a_piece_of_an_upload_is_received() -> None:
    message = received(*patch(change(ZEROS), num_buffers=1), '{"id": "0"}', bytes(CHUNK))
    assert message is not None
    assert message.buffers[0].data == bytes(CHUNK)


JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=8) | st.sampled_from(["bytes", "map", "set"]),
    lambda some: (
        st.lists(some, max_size=3)
        | st.dictionaries(
            st.sampled_from(["type", "id", "data", "events", "kind", "new"]) | st.text(max_size=3), some
        )
    ),
    max_leaves=8,
)


@settings(max_examples=200)
@given(fragments=st.lists(JSON.map(json.dumps) | st.text(max_size=20) | st.binary(max_size=20), max_size=8))
def test_nonsense_is_refused_with_a_reason_that_fits_a_closing_frame(fragments: list[str | bytes]) -> None:
    try:
        received(*fragments)
    except ProtocolError as error:
        assert len(str(error).encode()) <= MAX_REASON


def memory(served: Served) -> int:
    """Return the memory a server has taken at most [bytes]."""
    status = Path(f"/proc/{served.process.pid}/status").read_text(encoding="utf-8").splitlines()
    return 1024 * next(int(line.split()[1]) for line in status if line.startswith("VmHWM"))


@pytest.mark.proof
@pytest.mark.skipif(sys.platform != "linux", reason="Linux tells the most memory taken")
def test_an_attack_takes_little_memory_and_time_and_log(served: Served, run) -> None:
    """Two hundred megabytes in a text of 271 kB, and then as many refused messages as can be sent."""
    bomb = change(ZEROS | {"data": squeezed(2**28)})
    token, origin = served.token(), f"http://127.0.0.1:{served.port}"

    async def attack() -> None:
        for contents in (
            [bomb],
            [change("x" * 50_000) | {"more": "y" * 10_000}] * 100,
        ):
            async with served.socket(token, origin) as way:
                attacker = Visitor(way)
                with pytest.raises(ConnectionClosed):
                    for content in contents:
                        await attacker.send("PATCH-DOC", content)
                    await attacker.send("PUSH-DOC", {"doc": {"roots": []}})
                    while True:
                        await way.recv()

    async def watch() -> float:
        """Return the longest time a visitor waited for an answer during the attack [s]."""
        async with served.visitor() as victim:
            waits = [WAIT]
            while max(waits[-20:]) > WAIT / 10:  # both sessions compute their first result
                waits.append(await victim.wait())
            before, logged = memory(served), served.log.stat().st_size
            attacking, longest = asyncio.create_task(attack()), 0.0
            while not attacking.done():
                longest = max(longest, await victim.wait())
            await attacking
            assert memory(served) - before < MEMORY
            assert served.log.stat().st_size - logged < 2 * AT_ONCE * LONGEST
            return longest

    assert run(watch()) < WAIT


def test_no_model_is_made_where_others_change(served: Served, run) -> None:
    model = {"type": "object", "name": "CustomJS", "id": "mine", "attributes": {"code": "alert(1)"}}

    async def ask() -> list[str]:
        async with served.visitor() as visitor:
            root = visitor.document["roots"][0]["id"]
            answers = [await visitor.change(root, tags=[value]) for value in (model, "a tag")]
            return [answer["msgtype"] for answer in answers]

    assert run(ask()) == ["ERROR", "OK"]


HAND_MADE = ("no such mission", "", -1, 1e308, None, [1], True, {"type": "map", "entries": []})
"""Values that no choice and no tab of a page has."""


def test_a_value_that_no_page_sends_is_dropped_with_one_line(served: Served, run) -> None:
    async def send() -> bool:
        # The log, which an attack before has filled, takes so many records again after this time.
        await asyncio.sleep(3 * len(HAND_MADE) / PER_SECOND)
        async with served.visitor() as visitor:
            await say(visitor, "document_ready")
            while not (choices := list(visitor.models(label="Mission"))):
                await visitor.pull()  # settings come after the plots
            (choice,) = choices
            tabs = visitor.tabs()
            for value in HAND_MADE:
                await visitor.change(choice["id"], value=value)
                await visitor.change(tabs, active=value)
            await visitor.change(tabs, no_such=1)
            await visitor.change("p0", value=1)
            await visitor.change(tabs, active=2)
            await visitor.pull()
            return any(visitor.models(active=2))

    before = len(served.log.read_text())
    assert run(send())  # the page works on
    said = served.log.read_text()[before:]
    assert "Traceback" not in said
    assert said.count("is refused") >= len(HAND_MADE)
    assert len(said.splitlines()) <= 3 * len(HAND_MADE) + 5


def test_a_fault_of_a_callback_is_no_refusal() -> None:
    """Though the error is the same: what is read here is read by Bokeh, without the frame of this test."""
    one, other = Range1d(), Range1d()
    one.on_change("end", lambda attr, old, new: setattr(other, attr, "x"))
    for name, value, refused in (("start", "x", True), ("end", 2.0, False)):
        with pytest.raises(ValueError, match="failed to validate") as caught:
            setattr(one, name, value)
        assert is_refusal(caught.value.with_traceback(caught.tb.tb_next)) is refused
    with pytest.raises(TypeError) as event:
        DocumentReady.from_serializable({"name": "document_ready", "values": {"x": 1}}, Deserializer())
    assert is_refusal(event.value.with_traceback(event.tb.tb_next))


@pytest.fixture
def written() -> tuple[logging.Logger, list[str]]:
    """Return a logger with a limit, and the lines it has written."""
    lines: list[str] = []

    class Lines(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            lines.append(logging.Formatter().format(record))

    logger = logging.Logger("limited")
    handler = Lines()
    handler.addFilter(LogLimit())
    logger.addHandler(handler)
    return logger, lines


def test_a_page_that_a_ping_has_found_gone_closes_and_sends_its_last_without_a_line(
    run, caplog: pytest.LogCaptureFixture
) -> None:
    socket = PageSocket.__new__(PageSocket)
    connection = socket.connection = ServerConnection.__new__(ServerConnection)
    connection._session, connection._protocol = None, Protocol()
    last = Protocol().create("PULL-DOC-REQ")
    answer = run(BoundedHandler().handle(last, connection))
    socket.on_close()
    assert answer.msgtype == "ERROR"
    assert not caplog.records


def test_a_log_takes_so_many_lines_and_says_how_many_it_left_out(
    written, monkeypatch: pytest.MonkeyPatch
) -> None:
    logger, lines = written
    for number in range(10 * AT_ONCE):
        logger.warning("line %d", number)
    assert AT_ONCE <= len(lines) <= AT_ONCE + 5
    later = time.monotonic() + 60
    monkeypatch.setattr(time, "monotonic", lambda: later)
    logger.warning("the next")
    assert lines[-1].startswith("the next (")
    assert f"({10 * AT_ONCE - len(lines) + 1} records" in lines[-1]


def test_long_lines_and_tracebacks_are_shortened(written) -> None:
    logger, lines = written
    try:
        int("x" * 10**6)
    except ValueError:
        logger.exception("%r", "y" * 10**6)
    (line,) = lines
    assert len(line) < 2 * LONGEST + 200
    assert "characters left out" in line


def test_a_browser_that_left_during_a_message_is_no_line(written) -> None:
    logger, lines = written
    error = WebSocketClosedError()
    logger.error("Task exception was never retrieved", exc_info=(type(error), error, None))
    logger.error("another")
    assert lines == ["another"]
