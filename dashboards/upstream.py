"""Upstream: the private parts of Bokeh, Panel and viser that the laboratory replaces or reads on the server.

`upstream.js` replaces those in the browser.

Each part is tested against the installed version, which `pyproject.toml` pins
(`tests/dashboards/test_upstream.py`). These upstream changes would make parts unnecessary:

- Lazily computed defaults, and one description of properties for each class: Bokeh 4, issue `bokeh#15354
  <https://github.com/bokeh/bokeh/issues/15354>`_, and for 3.10 pull request ``bokeh#15322``.
- An ended document without reference cycles: ``bokeh#11523``, open since 2021. Collections that block all
  sessions: ``panel#3259``.
- Events without the lock of their document: no upstream issue is known. They carry the mark of
  `panel.io.with_lock`.
- Panel's repeated copies, lookups and searches for each component, and access control in viser: no upstream
  issue is known.

A page consists of 600 models. Bokeh reads the default of each of their properties several times, and copies
and checks it each time, which takes half of the time to open a page. A default that is a number, a text, a
Boolean or None is shared by all models of a class. An empty default is created on first use, without checks:
it refers to its model, which would otherwise outlive its page until a garbage collection.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import lru_cache, wraps
from typing import Any
from weakref import WeakSet

import param
import viser
from bokeh.core.has_props import HasProps
from bokeh.core.property.bases import Property, validation_on
from bokeh.core.property.descriptors import PropertyDescriptor
from bokeh.core.property.singletons import Intrinsic, Undefined
from bokeh.core.property.wrappers import (
    PropertyValueContainer,
    PropertyValueDict,
    PropertyValueList,
    PropertyValueSet,
)
from bokeh.document import Document
from bokeh.document.callbacks import DocumentCallbackManager
from bokeh.model import Model, util
from bokeh.server.callbacks import SessionCallback
from bokeh.server.contexts import ApplicationContext
from bokeh.settings import settings
from panel.config import config
from panel.custom import ReactiveESM
from panel.io import resources
from panel.io.server import DocHandler
from panel.links import Callback
from panel.pane import Bokeh
from panel.reactive import Reactive, Syncable
from panel.util import classproperty
from panel.viewable import Viewable, is_viewable_param
from panel.widgets.base import WidgetBase
from panel_material_ui.base import MaterialComponent
from panel_material_ui.theme import MaterialDesign
from tornado.web import Application, OutputTransform
from viser.infra import WebsockClientConnection, WebsockServer
from websockets.asyncio.server import ServerConnection

from dashboards.patch_messages import speed_up_patches

MOST_PATHS = 1024
"""Most pairs of file and folder whose relation is cached; a page needs 60."""
MOST_VALUES = 64
"""Most accepted values that are remembered of a property; those of most are one to ten."""


CONSTANT = frozenset((type(None), bool, int, float, str, type(Undefined)))
"""Types of cached defaults: immutable ones, which refer to no model."""
CONTAINERS = (PropertyValueDict, PropertyValueList, PropertyValueSet)
"""Types of defaults that are cached as empty."""

_FOLLOWED = (WidgetBase, param.Parameter)
"""Types of values that a component follows, in Panel's code."""

_Key = tuple[PropertyDescriptor[Any], type[HasProps]]


class RememberedDefaults:
    """The defaults of Bokeh's properties, each computed once for a class of models.

    A theme may set other defaults for single models, so properties in a theme always go to Bokeh.
    """

    def __init__(self) -> None:
        self._default = PropertyDescriptor.instance_default
        self._is_unstable = PropertyDescriptor.has_unstable_default
        self._defaults: dict[_Key, Any] = {}
        self._empty: dict[_Key, Callable[[], Any]] = {}
        self._unstable: dict[_Key, bool] = {}
        self._own: dict[type[HasProps], list[tuple[str, PropertyDescriptor[Any]]]] = {}

    def install(self) -> None:
        """Replace Bokeh's functions from now on."""
        remembered = self

        def begin(model: HasProps, **properties: Any) -> None:
            remembered.begin(model, properties)

        def instance_default(descriptor: PropertyDescriptor[Any], model: HasProps) -> Any:
            return remembered.default(descriptor, model)

        def has_unstable_default(descriptor: PropertyDescriptor[Any], model: HasProps) -> bool:
            return remembered.is_unstable(descriptor, model)

        apply_theme = HasProps.apply_theme

        def apply(model: HasProps, property_values: dict[str, Any]) -> None:
            if property_values != (themed(model) or {}):  # Panel and Bokeh apply copies of the same theme
                apply_theme(model, property_values)

        HasProps.apply_theme = apply  # type: ignore[method-assign, assignment]
        HasProps.__init__ = begin  # type: ignore[method-assign, assignment]
        HasProps.themed_values = themed  # type: ignore[method-assign, assignment]
        PropertyDescriptor.instance_default = instance_default  # type: ignore[method-assign, assignment]
        PropertyDescriptor.has_unstable_default = has_unstable_default  # type: ignore[method-assign, assignment]

    def begin(self, model: HasProps, properties: dict[str, Any]) -> None:
        """Initialise a model as Bokeh does, with the given properties and its own defaults."""
        super(HasProps, model).__init__()
        model._property_values = {}
        model._unstable_default_values = {}
        model._unstable_themed_values = {}
        for name, value in properties.items():
            if value is not Undefined and value is not Intrinsic:
                setattr(model, name, value)
        for name, descriptor in self._own_defaults(model):
            if name not in properties and (descriptor, model.__class__) not in self._empty:
                descriptor._get(model)  # creates the default
        model._initialized = True

    def default(self, descriptor: PropertyDescriptor[Any], model: HasProps) -> Any:
        """Return the default of a property of a model."""
        overrides = themed(model)
        if overrides is not None and descriptor.name in overrides:
            return self._default(descriptor, model)
        key = (descriptor, model.__class__)
        if key in self._defaults:
            return self._defaults[key]
        if key in self._empty:
            return self._empty[key]()
        default = self._default(descriptor, model)
        if self.is_unstable(descriptor, model):
            if type(default) in CONTAINERS and not default:
                self._empty[key] = type(default)
        elif type(default) in CONSTANT:
            self._defaults[key] = default
        return default

    def is_unstable(self, descriptor: PropertyDescriptor[Any], model: HasProps) -> bool:
        """Return whether each model has its own default, such as an empty list."""
        key = (descriptor, model.__class__)
        if key not in self._unstable:
            self._unstable[key] = self._is_unstable(descriptor, model)
        return self._unstable[key]

    def _own_defaults(self, model: HasProps) -> list[tuple[str, PropertyDescriptor[Any]]]:
        """Return the properties for which each model has its own default, in Bokeh's order."""
        kind = model.__class__
        if kind not in self._own:
            every = [(name, model.lookup(name)) for name in model.properties(_with_props=True)]
            self._own[kind] = [(name, one) for name, one in every if one.has_unstable_default(model)]
        return self._own[kind]


def themed(model: HasProps) -> dict[str, Any] | None:
    """Return the values that a theme sets on a model; Bokeh's own code visits all properties."""
    return model.__dict__.get("__themed_values__")


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
        _share_declarations()
        _begin_components()
        _place_figures()
        _remember_paths()
        _remember_accepted()
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


def _share_declarations() -> None:
    """Make Panel read the declarations of a component's class instead of copying each for the component.

    The copies, 2,700 for a page, serve only components that change their own declarations.
    """
    get_properties = ReactiveESM._get_properties
    holders: dict[type[ReactiveESM], list[str]] = {}

    @wraps(get_properties)
    def properties(component: ReactiveESM, document: Any) -> dict[str, Any]:
        private = type(component)._param__private
        before, private.disable_instance_params = private.disable_instance_params, True
        try:
            return get_properties(component, document)
        finally:
            private.disable_instance_params = before

    def children(
        component: ReactiveESM, _data: Any, document: Any, root: Any, parent: Any, comm: Any
    ) -> tuple[dict[str, Any], list[Any]]:
        kind = type(component)
        if kind not in holders:
            mapping, declarations = kind._property_mapping, component.param.objects(instance=False)
            viewable = [name for name, one in declarations.items() if is_viewable_param(one)]
            holders[kind] = [name for name in viewable if mapping.get(name, "") is not None]
        models, old = dict[str, Any](), list[Any]()
        for name in holders[kind]:
            child = getattr(component, name)
            models[name], before = component._get_child_model(child, document, root, parent, comm)
            old += before
        return models, old

    def init_params(component: Syncable) -> dict[str, Any]:
        synced = component._synced_params  # read once, not for each of them
        return {name: value for name in synced if (value := getattr(component, name)) is not None}

    ReactiveESM._get_properties = properties  # type: ignore[method-assign, assignment]
    ReactiveESM._get_children = children  # type: ignore[method-assign, assignment]
    Syncable._init_params = init_params  # type: ignore[method-assign, assignment]


def _begin_components() -> None:
    """Make Panel begin a component without steps that change nothing for those of the laboratory.

    Panel marks the declarations of a class again for each component, and copies the declaration of each given
    value to see whether the component may follow a widget.
    """
    begin_material: Callable[..., None] = MaterialComponent.__init__
    begin_reactive: Callable[..., None] = Reactive.__init__
    marked = set[type[Reactive]]()

    @wraps(begin_material)
    def material(component: MaterialComponent, **values: Any) -> None:
        if "dark_theme" in values or any(isinstance(value, _FOLLOWED) for value in values.values()):
            begin_material(component, **values)
            return
        chosen = config.design
        design = chosen if isinstance(chosen, type) and issubclass(chosen, MaterialDesign) else MaterialDesign
        usual = {"dark_theme": config.theme == "dark", "design": design}
        super(MaterialComponent, component).__init__(**usual | values)  # type: ignore[no-untyped-call]

    @wraps(begin_reactive)
    def reactive(component: Reactive, refs: Any = None, **values: Any) -> None:
        if refs is not None or type(component) not in marked:
            marked.add(type(component))
            begin_reactive(component, refs=refs, **values)
        else:
            super(Reactive, component).__init__(**values)  # type: ignore[no-untyped-call]

    MaterialComponent.__init__ = material  # type: ignore[method-assign, assignment]
    Reactive.__init__ = reactive  # type: ignore[method-assign, assignment]


def _place_figures() -> None:
    """Make Panel place a figure into a served page without visiting its models.

    Panel searches them for code that names the figure by its identifier; that of the laboratory does not.
    Panel also applies the theme, which the document does again.
    """
    get_model = Bokeh._get_model

    @wraps(get_model)
    def place(
        pane: Bokeh, doc: Document, root: Model | None = None, parent: Model | None = None, comm: Any = None
    ) -> Model:
        figure: Model | None = pane.object
        themed_alone = pane.theme is not None
        if root is None or comm or figure is None or themed_alone or figure.document not in (None, doc):
            return get_model(pane, doc, root, parent, comm)
        pane._models[root.ref["id"]] = (figure, parent)
        return figure

    Bokeh._get_model = place  # type: ignore[method-assign, assignment]


def _remember_paths() -> None:
    """Make Panel look only once for the files of a component's class, not thousands of times a page."""
    vars(resources)["_is_subpath"] = lru_cache(MOST_PATHS)(resources._is_subpath)
    if config.autoreload:  # then the files may change
        return
    for kind in (ReactiveESM, MaterialComponent):
        remembered = lru_cache(MOST_PATHS)(vars(kind)["_bundle_path"].f)
        kind._bundle_path = classproperty(remembered)  # type: ignore[method-assign]
    styles_of = vars(MaterialComponent)["_bundle_css"].f

    @lru_cache(MOST_PATHS)
    def styles(kind: type[MaterialComponent], _mode: str) -> tuple[str, ...]:
        return tuple(styles_of(kind))

    found = classproperty(lambda kind: list(styles(kind, resources.RESOURCE_MODE)))
    MaterialComponent._bundle_css = found  # type: ignore[method-assign]


def _remember_accepted() -> None:
    """Make Bokeh check a number, a text or a Boolean once for a property, not for each model that has it.

    A page sets 6,000 properties, to few different values. Only values that Bokeh accepts as they are count.
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
        key = type(value), value
        if key in known:
            return value
        prepared = prepare_any(declared, owner, name, value, hint=hint)
        if prepared is value and len(known) < MOST_VALUES and validation_on():
            known.add(key)
        return prepared

    Property.prepare_value = prepare  # type: ignore[method-assign, assignment]


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

    Both refer to themselves and to the page, and nothing refers to them. A collection from the page would not
    find them, and the page would stay in memory.
    """
    remove, destroy = DocumentCallbackManager.remove_session_callback, Model.destroy

    def remove_and_forget(callbacks: DocumentCallbackManager, callback: SessionCallback) -> None:
        remove(callbacks, callback)
        vars(callback)["_callback"] = None

    def destroy_and_forget(model: Model) -> None:
        destroy(model)
        model._unstable_default_values.clear()
        model._callbacks.clear()
        model._event_callbacks.clear()

    DocumentCallbackManager.remove_session_callback = remove_and_forget  # type: ignore[method-assign, assignment]
    Model.destroy = destroy_and_forget  # type: ignore[method-assign, assignment]


def serving_application(document: Document) -> Application | None:
    """Return the Tornado application that serves a document; None where no browser is connected to it."""
    session = getattr(document.session_context, "session", None)
    for connection in getattr(session, "_subscribed_connections", ()):
        application = connection._socket.application
        if isinstance(application, Application):
            return application
    return None


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
            known = handler._transforms
            if handler.application_context in applications and not any(
                isinstance(one, transform) for one in known
            ):
                known.append(transform(handler.request))
            write(handler, chunk)

        DocHandler.write = write_transformed  # type: ignore[method-assign, assignment]


def viser_sockets(server: viser.ViserServer) -> WebsockServer:
    """Return the part of a viser server to which browsers connect."""
    return server._websock_server


def viser_connection(sockets: WebsockServer, client: WebsockClientConnection) -> ServerConnection:
    """Return the websocket of a browser that is connected to a viser server."""
    return sockets._live_connections[client.client_id]
