"""Server: what Bokeh, Panel and viser keep private and the laboratory needs on the server."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial, wraps
from typing import Any
from weakref import WeakSet

import viser
from bokeh.core.has_props import HasProps
from bokeh.core.property.bases import Property, validation_on
from bokeh.core.property.descriptors import PropertyDescriptor
from bokeh.core.property.singletons import Undefined
from bokeh.core.property.wrappers import PropertyValueContainer
from bokeh.core.types import ID
from bokeh.document import Document
from bokeh.document.callbacks import DocumentCallbackManager
from bokeh.model import Model, util
from bokeh.protocol.message import Message
from bokeh.protocol.receiver import Receiver
from bokeh.server.callbacks import SessionCallback
from bokeh.server.connection import ServerConnection as PageConnection
from bokeh.server.contexts import ApplicationContext
from bokeh.server.server import Server
from bokeh.server.session import ServerSession
from bokeh.server.views.ws import WSHandler
from bokeh.settings import settings
from bokeh.util import callback_manager
from bokeh.util.tornado import _CallbackGroup
from panel.io.server import DocHandler
from panel.links import Callback
from panel.reactive import Syncable
from panel.viewable import Viewable
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop
from tornado.web import Application, OutputTransform
from tornado.websocket import WebSocketHandler
from viser.infra import WebsockClientConnection, WebsockServer
from websockets.asyncio.server import ServerConnection

from dashboards.upstream.components import begin_components_faster
from dashboards.upstream.patch_messages import speed_up_patches
from dashboards.upstream.remembered_defaults import CONSTANT, RememberedDefaults, themed

GOING_AWAY = 1001
"""Code with which a browser closes the websocket of a page that it leaves (RFC 6455, 7.4.1)."""
MOST_VALUES = 64
"""Most accepted values that are remembered of a property; those of most are one to ten."""


def speed_up() -> None:
    """Make Bokeh and Panel cache, and skip the checks that only help authors of pages.

    These are the checks of whole documents and of the arguments of each callback. Events are made to wait for
    their document, too.
    """
    _lock_events()
    speed_up_patches()
    if PropertyDescriptor.instance_default.__module__ != RememberedDefaults.__module__:
        RememberedDefaults().install()
        cut_cycles()
        _look_at_values_that_are_set()
        begin_components_faster()
        _remember_accepted()
        _remember_arguments()
        # What is set is not looked up in the environment, several hundred times a page.
        settings.serialize_include_defaults = settings.serialize_include_defaults()
        settings.simple_ids = settings.simple_ids()
    settings.perform_document_validation = False
    settings.perform_error_diagnostics = False


def _look_at_values_that_are_set() -> None:
    """Make Bokeh search for models, and for values to send, only among values that are no constants."""
    visit_any = util.visit_immediate_value_references
    visit_inside = util.visit_value_and_its_immediate_references
    query_any = HasProps.query_properties_with_values

    def visit(value: Any, visitor: Callable[[Model], None]) -> None:
        if not isinstance(value, HasProps):
            visit_any(value, visitor)
            return
        own = _own_values(value)
        for name in value.properties_with_refs():
            if name in own and type(own[name]) not in CONSTANT:
                inside(own[name], visitor)

    def inside(obj: Any, visitor: Callable[[Model], None]) -> None:
        kind = type(obj)
        if kind in CONSTANT:
            return
        if issubclass(kind, Model):
            visitor(obj)
        elif issubclass(kind, list | tuple):
            for item in obj:
                inside(item, visitor)
        elif issubclass(kind, dict):
            for key, item in obj.items():
                inside(key, visitor)
                inside(item, visitor)
        else:
            visit_inside(obj, visitor)

    def query(
        model: HasProps,
        query: Callable[[PropertyDescriptor[Any]], bool],
        *,
        include_defaults: bool = True,
        include_undefined: bool = False,
    ) -> dict[str, Any]:
        if include_defaults or include_undefined:
            return query_any(
                model, query, include_defaults=include_defaults, include_undefined=include_undefined
            )
        return {name: value for name, value in _changed(model) if query(model.lookup(name))}

    util.visit_immediate_value_references = visit
    util.visit_value_and_its_immediate_references = inside
    HasProps.query_properties_with_values = query  # type: ignore[method-assign, assignment]


def _own_values(model: HasProps) -> dict[str, Any]:
    """Return the values of a model that its class does not share."""
    return {**model._unstable_default_values, **model._unstable_themed_values, **model._property_values}


def _changed(model: HasProps) -> Iterator[tuple[str, Any]]:
    """Yield the properties of a model that must be sent to a browser, in Bokeh's order."""
    own, theme = _own_values(model), themed(model) or {}
    for name in model.properties(_with_props=True):
        if name in own or name in theme:
            value = model.lookup(name).get_value(model)
            is_empty = isinstance(value, PropertyValueContainer) and name in model._unstable_default_values
            if name in theme or not is_empty:
                yield name, value


def _remember_accepted() -> None:
    """Make Bokeh check a number, a text or a Boolean once for a property, not for each model that has it.

    A page sets 6,000 properties, to few different values. Only values that Bokeh accepts as they are count,
    and only those with which a model begins: what a slider or a title takes later is another value each time,
    and a single one keeps 1 MB of its surroundings from the system.
    """
    prepare_any = Property.prepare_value
    accepted: dict[int, tuple[Property[Any], set[tuple[type, Any]]]] = {}

    @wraps(prepare_any)
    def prepare(declared: Property[Any], owner: Any, name: str, value: Any, *, hint: Any = None) -> Any:
        plain = type(value) in CONSTANT and value is not Undefined
        if not plain or hint is not None or declared.assertions:
            return prepare_any(declared, owner, name, value, hint=hint)
        # The declaration is kept, so that no other gets its number.
        known = accepted.setdefault(id(declared), (declared, set()))[1]
        # With the type, since True, 1 and 1.0 are equal.
        key = type(value), value
        if key in known:
            return value
        prepared = prepare_any(declared, owner, name, value, hint=hint)
        is_new = not getattr(owner, "_initialized", True)
        if is_new and prepared is value and len(known) < MOST_VALUES and validation_on():
            known.add(key)
        return prepared

    Property.prepare_value = prepare  # type: ignore[method-assign, assignment]


def _remember_arguments() -> None:
    """Make Bokeh count the arguments of a method once, not for each component that registers it."""
    count_any = callback_manager._nargs
    known: dict[tuple[Any, int], int] = {}

    def count(fn: Callable[..., Any]) -> int:
        method, given = (fn.func, len(fn.args)) if isinstance(fn, partial) and not fn.keywords else (fn, 0)
        # A bound method is another object each time it is looked up; its function is not.
        function = getattr(method, "__func__", None)
        if function is None:
            return count_any(fn)
        if (function, given) not in known:
            known[function, given] = count_any(fn)
        return known[function, given]

    callback_manager._nargs = count


def _lock_events() -> None:
    """Make Panel hold the lock of a document for all events of its browser.

    Panel takes the lock except for an event that comes just after a changed value, such as a click after
    typing. Bokeh then refuses to send what the click has changed.
    """
    for coroutine in (Syncable._event_coroutine, Syncable._change_coroutine):
        vars(coroutine)["lock"] = True


def leave_out_hooks(page: Viewable) -> None:
    """Make Panel search a page for its own links only, if there are any, not for those of other libraries.

    Panel searches all components after each change of a layout.
    """

    def process(*changed: Any, **options: Any) -> None:
        if Callback.registry:
            Callback._process_callbacks(*changed, **options)

    page.__dict__["_preprocessing_hooks"] = [process]


def cut_cycles() -> None:
    """Make Bokeh release callbacks after their call, and the data of models of ended pages.

    All of these refer to themselves and to the page, and nothing refers to them. A collection from the page
    would not find them, and the page would stay in memory.
    """
    remove, destroy = DocumentCallbackManager.remove_session_callback, Model.destroy

    def remove_and_forget(callbacks: DocumentCallbackManager, callback: SessionCallback) -> None:
        remove(callbacks, callback)
        vars(callback)["_callback"] = None

    def add_and_forget(group: _CallbackGroup, callback: Callable[[], Any], callback_id: ID) -> ID:
        # The loop keeps `run` until its turn: a removal empties the list, which lets go of the page.
        waiting = [callback]

        def run() -> Any:
            if not waiting:  # it was removed
                return None
            (called,) = waiting
            group.remove_next_tick_callback(callback_id)
            return called()

        group._assign_remover(callback, callback_id, group._next_tick_callback_removers, waiting.clear)
        group._loop.add_callback(run)
        return callback_id

    def destroy_and_forget(model: Model) -> None:
        destroy(model)
        model._unstable_default_values.clear()
        model._callbacks.clear()
        model._event_callbacks.clear()

    DocumentCallbackManager.remove_session_callback = remove_and_forget  # type: ignore[method-assign, assignment]
    Model.destroy = destroy_and_forget  # type: ignore[method-assign, assignment]
    _CallbackGroup.add_next_tick_callback = add_and_forget  # type: ignore[method-assign, assignment]


def models_version(document: Document) -> tuple[int, int]:
    """Return numbers that change, all but always, when a document gets or loses a model.

    Bokeh makes a new table of the models then. Going through the models of thirty pages takes 14 ms.
    """
    table = document.models._models
    return id(table), len(table)


def serving_application(document: Document) -> Application | None:
    """Return the Tornado application that serves a document; None where no browser is connected to it."""
    application = getattr(page_socket(document), "application", None)
    return application if isinstance(application, Application) else None


def page_socket(document: Document) -> WebSocketHandler | None:
    """Return the websocket of the browser that shows a document; None where none is connected to it."""
    session = getattr(document.session_context, "session", None)
    sockets = (connection._socket for connection in getattr(session, "_subscribed_connections", ()))
    return next((one for one in sockets if isinstance(one, WebSocketHandler)), None)


class TransformedPages:
    """Applies a transform of Tornado to the pages of some applications, whichever server they are on.

    An application is not asked when its server is made, so it cannot add the transform there; and other
    applications of that server need other headers.
    """

    def __init__(self, transform: type[OutputTransform]) -> None:
        self._transform = transform
        self._applications: WeakSet[ApplicationContext] = WeakSet()

    def add(self, document: Document) -> None:
        """Apply it to the answer with a document, which is being made, and to all later ones alike."""
        server = getattr(document.session_context, "server_context", None)
        context = getattr(server, "application_context", None)
        if context is None or context in self._applications:
            return
        if not self._applications:
            self._install()
        self._applications.add(context)

    def _install(self) -> None:
        write, transform, applications = DocHandler.write, self._transform, self._applications

        def write_transformed(handler: DocHandler, chunk: Any) -> None:
            # An answer is written in several calls, and gets the transform once.
            known = handler._transforms
            if handler.application_context in applications and not any(
                isinstance(one, transform) for one in known
            ):
                known.append(transform(handler.request))
            write(handler, chunk)

        DocHandler.write = write_transformed  # type: ignore[method-assign, assignment]


def begun_message(receiver: Receiver) -> Message[Any] | None:
    """Return the message of which a receiver has got its first parts; None if it waits for a new one."""
    return receiver._partial


def has_session(connection: PageConnection) -> bool:
    """Return whether a connection still has its session; a ping that finds the page gone takes it away."""
    return connection._session is not None


def viser_sockets(server: viser.ViserServer) -> WebsockServer:
    """Return the part of a viser server to which browsers connect."""
    return server._websock_server


def viser_connection(sockets: WebsockServer, client: WebsockClientConnection) -> ServerConnection:
    """Return the websocket of a browser that is connected to a viser server."""
    return sockets._live_connections[client.client_id]


def end_left_pages(after: float, waits: Callable[[Document], bool]) -> None:
    """Make Bokeh's next check end a page whose browser has left, from some time after it left.

    A browser that closes or reloads a page says so, and never asks for its session again. Without a word, it
    has lost its connection, and the session lasts as long as the server says.

    Parameters
    ----------
    after
        The time [s].
    waits
        Whether the page of a document must still stay, because the one that is loaded again goes on with what
        it holds; it then stays for another such time.
    """
    on_close = WSHandler.on_close
    if on_close.__module__ == __name__:
        return

    def end(session: ServerSession) -> None:
        if session.destroyed:
            return
        if waits(session.document):
            IOLoop.current().call_later(after, end, session)
        else:
            session.request_expiration()

    def close(handler: WSHandler) -> None:
        session = None if handler.connection is None else handler.connection._session
        on_close(handler)
        if session is not None and handler.close_code == GOING_AWAY:
            IOLoop.current().call_later(after, end, session)

    WSHandler.on_close = close  # type: ignore[assignment, method-assign]


async def end_socket(document: Document, code: int, reason: str) -> None:
    """Close the websocket of a page once all that was sent before is on its way.

    Parameters
    ----------
    document
        Document of the page.
    code, reason
        What the browser is told: a code of RFC 6455, and at most 123 bytes.
    """
    socket = page_socket(document)
    if socket is not None:
        with await socket.write_lock.acquire():  # type: ignore[attr-defined]  # of Bokeh's handler
            socket.close(code, reason)


def web_server(server: Server) -> HTTPServer:
    """Return the web server of a server of Bokeh, which takes connections."""
    return server._http
