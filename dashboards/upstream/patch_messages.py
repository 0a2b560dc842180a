"""Patch messages: the changes of a page as one message, sent at once, which costs as much as what it says.

Bokeh makes a message for each changed property, and looks at all models of the page for each message. Panel
takes a property that was held back for one that the browser has changed, and processes it a second time. In
a class of thirty pages this takes half of a teacher's step. For each colour or width of a figure, Bokeh
builds the type anew by which it distinguishes a value from the name of a column. It gives each of the dozen
parts of a message to the system alone, and waits for each. No upstream issue is known.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Awaitable, Callable, Coroutine, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any
from weakref import WeakKeyDictionary

from bokeh.core.has_props import HasProps
from bokeh.core.property.bases import Property
from bokeh.core.property.dataspec import DataSpec
from bokeh.core.property.nothing import Nothing
from bokeh.core.property.primitive import String
from bokeh.core.property.vectorization import Field, Value
from bokeh.core.serialization import Ref, Serializer
from bokeh.document import Document
from bokeh.document.events import DocumentPatchedEvent
from bokeh.document.json import PatchJson
from bokeh.document.models import DocumentModelManager
from bokeh.model import Model
from bokeh.protocol.message import Message
from bokeh.protocol.messages.patch_doc import patch_doc
from bokeh.server.session import ServerSession
from bokeh.server.views.ws import WSHandler
from panel.reactive import Syncable
from tornado.escape import utf8
from tornado.iostream import StreamClosedError
from tornado.websocket import WebSocketProtocol13

log = logging.getLogger(__name__)

TEXT, BINARY = 1, 2
"""Kinds of websocket frames (RFC 6455, 5.2)."""

_released: WeakKeyDictionary[Document, list[DocumentPatchedEvent]] = WeakKeyDictionary()
"""Documents whose held changes are being released, and the changes to send."""


class PageSerializer(Serializer):
    """Serialises changes of a page, and knows a model of the page when it meets it.

    Parameters
    ----------
    models
        The models of the page.
    """

    def __init__(self, models: DocumentModelManager) -> None:
        super().__init__()
        self._models = models._models
        self._new = models._new_models

    def get_ref(self, obj: Any) -> Ref | None:
        """Return the reference to a model that the browser has from here on; None for anything else."""
        found = self._references.get(id(obj))
        if found is None and isinstance(obj, Model) and self._models.get(obj.id) is obj:
            # The browser has not got a new model yet, so it is written whole.
            return None if obj in self._new else obj.ref
        return found


def speed_up_patches() -> None:
    """Make Bokeh and Panel send the changes of a page as this file says, from now on."""
    if patch_doc.create.__func__ is _create.__func__:  # type: ignore[attr-defined]
        return
    patch_doc.create = _create  # type: ignore[method-assign, assignment]
    patched, changed = ServerSession._document_patched, Syncable._server_change

    @wraps(patched)
    def gather(session: ServerSession, event: DocumentPatchedEvent) -> None:
        waiting = _released.get(session.document)
        if waiting is None:
            patched(session, event)
        else:
            waiting.append(event)

    @wraps(changed)
    def process(component: Syncable, doc: Document, *change: Any) -> None:
        if doc not in _released:
            changed(component, doc, *change)

    WSHandler.send_message = _send_at_once(WSHandler.send_message)  # type: ignore[method-assign, assignment]
    DataSpec.to_serializable = _values_or_columns()  # type: ignore[method-assign, assignment]
    ServerSession._document_patched = gather  # type: ignore[method-assign, assignment]
    Syncable._server_change = process  # type: ignore[method-assign, assignment]


def _send_at_once(
    send_by_parts: Callable[[WSHandler, Message[Any]], Awaitable[None]],
) -> Callable[[WSHandler, Message[Any]], Coroutine[Any, Any, None]]:
    """Return what sends a message to a browser, all its parts by one call of the system."""

    async def send(handler: WSHandler, message: Message[Any]) -> None:
        protocol = handler.ws_connection
        if not isinstance(protocol, WebSocketProtocol13) or protocol._compressor is not None:
            await send_by_parts(handler, message)
            return
        parts: list[str | bytes] = [message.header_json, message.metadata_json, message.content_json]
        for buffer in message.buffers:
            parts += json.dumps(buffer.ref), buffer.to_bytes()
        try:
            with await handler.write_lock.acquire():
                await protocol.stream.write(_frames(protocol, parts))
        except StreamClosedError:
            log.info("a browser left before a message was sent")

    return send


def _frames(protocol: WebSocketProtocol13, parts: list[str | bytes]) -> bytes:
    """Return texts and binary parts as the frames that Tornado would send."""
    frames: list[bytes] = []
    stream = vars(protocol.stream)
    stream["write"] = frames.append  # in place of the method, for the calls in between
    try:
        for part in parts:
            is_text = isinstance(part, str)
            protocol._write_frame(True, TEXT if is_text else BINARY, utf8(part))
    finally:
        del stream["write"]
    return b"".join(frames)


def _values_or_columns() -> Callable[[DataSpec, HasProps, str, Any], Any]:
    """Return Bokeh's way to say whether a property is a value or a column, which keeps the type it needs."""
    types: dict[int, tuple[DataSpec, Property[Any]]] = {}

    def to_serializable(spec: DataSpec, _model: HasProps, _name: str, given: Any) -> Any:
        if id(spec) not in types:  # the declaration is kept, so that no other gets its number
            types[id(spec)] = spec, spec.value_type.replace(String, Nothing())
        try:
            types[id(spec)][1].validate(given, False)
        except ValueError:
            return Field(given) if isinstance(given, str) else given
        return Value(given)

    return to_serializable


@contextmanager
def one_message(document: Document) -> Iterator[None]:
    """Send the changes that a document releases inside as one message, if it is served.

    They were made here: a component knows them already.
    """
    session = getattr(document.session_context, "session", None)
    waiting = _released[document] = []
    try:
        yield
    finally:
        del _released[document]
        if waiting:
            assert session is not None  # nobody else gathers
            _send(session, waiting)


def _send(session: ServerSession, events: list[DocumentPatchedEvent]) -> None:
    """Send changes to each browser, but to none those that it has made itself."""
    if session._pending_writes is None:
        raise RuntimeError("a document was changed without its lock")
    for connection in session._subscribed_connections:
        its_own = session if connection is session._current_patch_connection else None
        sent = [event for event in events if its_own is None or event.setter is not its_own]
        if sent:
            message = connection.protocol.create("PATCH-DOC", sent)
            session._pending_writes.append(connection._socket.send_message(message))


@classmethod  # type: ignore[misc]
def _create(cls: type[patch_doc], events: list[DocumentPatchedEvent], **metadata: Any) -> patch_doc:
    """Return a message with changes, as Bokeh makes it."""
    documents = {event.document for event in events}
    if len(documents) != 1:
        raise ValueError("a message needs changes of one document")
    models = documents.pop().models
    serializer = PageSerializer(models)
    content = PatchJson(events=serializer.encode(events))
    models.flush_synced(lambda model: not serializer.has_ref(model))
    message = cls(cls.create_header(), metadata, content)
    message.add_buffers(*serializer.buffers)
    return message
