"""Messages: bounds on the kind and the amount of data that a browser may send over a page's websocket.

Bokeh's own reader accepts everything its protocol can express: compressed bytes of any size, arrays of any
type and shape, new models, other documents. It logs unreadable messages in full. A page sends only a small
part of that. All other messages are refused here before they are decoded, and the connection is closed.
"""

from __future__ import annotations

import logging
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

from bokeh.protocol.exceptions import ProtocolError
from bokeh.protocol.message import Message
from bokeh.protocol.receiver import Receiver
from bokeh.server.connection import ServerConnection
from bokeh.server.protocol_handler import ProtocolHandler
from bokeh.server.session import ServerSession
from bokeh.server.views import ws

from dashboards.upstream.server import begun_message, has_session

log = logging.getLogger(__name__)

MAX_TEXT = 64 * 2**10
"""Longest text of a message [characters]; in a walk over all pages, the longest has 4,000."""
CHUNK = 2**20
"""Size of the pieces in which files are uploaded [bytes]; a message must have room for one."""
MAX_MESSAGE = CHUNK + 2 * MAX_TEXT
"""Largest message with all its parts [bytes]."""
MAX_BUFFERS = 4
"""Most binary parts of a message; a piece of an upload has one."""
MAX_EVENTS = 100
"""Most events of a message; in a walk over all pages, the largest number is 14."""
MAX_REASON = 100
"""Longest reason for a refusal [characters]; the last frame of a websocket holds 123 bytes of it."""

KINDS = frozenset({"ModelChanged", "MessageSent"})
"""Accepted kinds of events: a property of a model changes, or a widget sends an event."""
TYPES = frozenset({"array", "bytes", "event", "map", "number", "object", "set", "typed_array"})
"""Accepted encodings of a value; an object must already exist in the page."""

_READERS = sys.stdlib_module_names | {"bokeh", "numpy"}
"""Packages whose code reads a message, beside what is here and upstream."""


class BoundedReceiver(Receiver):
    """Assembles messages, up to the largest accepted size."""

    _size = 0

    async def consume(self, fragment: str | bytes) -> Message[Any] | None:
        """Take the next part of a message; return the message once it is complete.

        Raises
        ------
        ProtocolError
            If it is not an acceptable message of a page.
        """
        self._size += len(fragment)
        if self._size > MAX_MESSAGE or (isinstance(fragment, str) and len(fragment) > MAX_TEXT):
            raise ProtocolError(f"a message is too large; accepted are {MAX_TEXT} characters of text")
        try:
            message = await super().consume(fragment)
            if (begun := begun_message(self)) is not None:
                _check_header(begun.header)
            if message is not None:
                self._size = 0
                _check_content(message)
        except ProtocolError as error:
            raise ProtocolError(ascii(str(error))[1 : 1 + MAX_REASON].removesuffix("'")) from None
        except Exception as error:  # malformed input can raise any exception in Bokeh's reader
            raise ProtocolError(f"a message cannot be read: {type(error).__name__}") from None
        return message


async def _tell_version(message: Message[Any], connection: ServerConnection) -> Message[Any]:
    """Return the answer to a page that asks for the version of Bokeh."""
    return connection.protocol.create("SERVER-INFO-REPLY", message.header["msgid"])


HANDLERS: dict[str, Callable[[Any, ServerConnection], Any]] = {
    "PULL-DOC-REQ": ServerSession.pull,
    "PATCH-DOC": ServerSession.patch,
    "SERVER-INFO-REQ": _tell_version,
}
"""Accepted types of messages, and the coroutine for each; Bokeh declares its own without `async`."""


class BoundedHandler(ProtocolHandler):
    """Carries out messages, except those for other documents; a refusal is logged in one line."""

    async def handle(self, message: Message[Any], connection: ServerConnection) -> Any:
        """Return the answer to a message."""
        if message.msgtype not in HANDLERS:
            raise ProtocolError(f"messages of type {message.msgtype} are not accepted")
        if not has_session(connection):
            return connection.error(message, "the page has left")
        try:
            _check_objects(message, connection)
            return await HANDLERS[message.msgtype](message, connection)
        except Exception as error:
            if is_refusal(error):
                log.warning("a message of a page is refused: %s", ascii(str(error))[:MAX_REASON])
            else:
                log.exception("a message of a page failed")
            return connection.error(message, f"{type(error).__name__}: {error}"[:MAX_REASON])


def is_refusal(error: Exception) -> bool:
    """Return whether a message could not be read; in a callback that it causes, the same error is a fault."""
    modules = [frame.f_globals["__name__"] for frame, _ in traceback.walk_tb(error.__traceback__)]
    return all(
        module.partition(".")[0] in _READERS or module.startswith(("dashboards.upstream.", __name__))
        for module in modules
    )


def _check_header(header: Any) -> None:
    if not isinstance(header, dict) or not isinstance(header.get("msgid"), str):
        raise ProtocolError("a message has no identity")
    parts = header.get("num_buffers", 0)
    if not isinstance(parts, int) or not 0 <= parts <= MAX_BUFFERS:
        raise ProtocolError(f"a message has too many binary parts; accepted are {MAX_BUFFERS}")


def _check_content(message: Message[Any]) -> None:
    """Refuse content that would grow when decoded, and content that pages do not send."""
    content = message.content
    events = content.get("events", []) if isinstance(content, dict) else None
    if not isinstance(events, list) or len(events) > MAX_EVENTS:
        raise ProtocolError(f"a message is not a list of events; accepted are up to {MAX_EVENTS}")
    if not all(isinstance(event, dict) and event.get("kind") in KINDS for event in events):
        raise ProtocolError(f"an event is of an unknown kind; accepted are {', '.join(sorted(KINDS))}")
    used: Counter[str] = Counter()
    for value in _iterate_encoded(content):
        if value["type"] not in TYPES:
            raise ProtocolError(f"a value is of a type that pages do not send: {value['type']}")
        if value["type"] == "bytes":
            data = value.get("data")
            if not isinstance(data, dict):
                raise ProtocolError("bytes are written as text; accepted are binary parts of the message")
            used[str(data.get("id"))] += 1
    if used and max(used.values()) > 1:
        raise ProtocolError("a binary part is used more than once")


def _check_objects(message: Message[Any], connection: ServerConnection) -> None:
    """Refuse models that the page does not have: browsers create no models here."""
    models = connection.session.document.models
    for value in _iterate_encoded(message.content):
        if value["type"] == "object" and not (isinstance(value.get("id"), str) and value["id"] in models):
            raise ValueError("a message names a model that the page does not have")


def _iterate_encoded(content: Any) -> Iterator[dict[str, Any]]:
    """Yield the values in a content that name their type."""
    waiting = [content]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict):
            if "type" in value:
                yield value
            waiting.extend(value.values())
        elif isinstance(value, list):
            waiting.extend(value)


def bound_messages() -> None:
    """Make Bokeh's server apply these bounds to all messages from now on."""
    vars(ws).update(Receiver=BoundedReceiver, ProtocolHandler=BoundedHandler)
