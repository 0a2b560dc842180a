"""Fast components: what Panel does again for each component of a page is done once for a class of them."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache, wraps
from typing import Any

import param
from bokeh.core.has_props import HasProps, MetaHasProps
from bokeh.core.serialization import Ref, Serializer
from bokeh.core.types import ID
from bokeh.document import Document
from bokeh.model import Model
from panel.config import config
from panel.custom import ReactComponent, ReactiveESM
from panel.io import resources
from panel.io.state import state
from panel.layout import Column
from panel.pane import Bokeh
from panel.reactive import Reactive, Syncable
from panel.util import classproperty
from panel.util.parameters import edit_readonly
from panel.viewable import is_viewable_param
from panel.widgets.base import WidgetBase
from panel_material_ui.base import MaterialComponent
from panel_material_ui.layout import Card
from panel_material_ui.theme import MaterialDesign
from panel_material_ui.widgets import Button, IconButton, Select, Toggle
from param.parameterized import Parameters, no_instance_params

from dashboards.upstream.remembered_defaults import CONSTANT

MOST_PATHS = 1024
"""Most pairs of file and folder whose relation is cached; a page needs 60."""

_ALIKE = (Card, Column, IconButton, Select, Toggle)
"""Components that never change their own declarations, and of which a page has most."""
_FOLLOWED = (WidgetBase, param.Parameter)
"""Types of values that a component follows, in Panel's code."""


def send_to_browser(component: ReactiveESM, content: Any) -> None:
    """Send something to the browser's part of a component; nothing of it is kept."""
    component._send_msg(content)


def material_bundle() -> str:
    """Return the address of the file with the code of all components of Material, as they name it."""
    return str(Button._render_esm(compiled=True, server=True))


def begin_components_faster() -> None:
    """Make Panel begin components faster from now on."""
    _share_declarations()
    _begin_components()
    _take_values()
    _place_figures()
    _remember_paths()
    _remember_classes()
    _share_settings()
    _describe_once()


def _describe_once() -> None:
    """Make Bokeh describe the classes of components once, not for each page: 160 of them take 10 ms."""
    describe = Serializer._encoders[MetaHasProps]
    known: dict[type[HasProps], Any] = {}

    def described(kind: type[HasProps], serializer: Serializer) -> Any:
        if kind in known:
            serializer.add_ref(kind, Ref(id=ID(kind.__qualified_model__)))
        else:
            known[kind] = describe(kind, serializer)
        return known[kind]

    Serializer._encoders[MetaHasProps] = described


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
        kind = type(component)
        if kind not in marked and issubclass(kind, _ALIKE):
            no_instance_params(kind)
        if refs is not None or kind not in marked:
            marked.add(kind)
            begin_reactive(component, refs=refs, **values)
        else:
            super(Reactive, component).__init__(**values)  # type: ignore[no-untyped-call]

    MaterialComponent.__init__ = material  # type: ignore[method-assign, assignment]
    Reactive.__init__ = reactive  # type: ignore[method-assign, assignment]


def _take_values() -> None:
    """Make Param and Panel set values without steps that change nothing.

    Param inspects each value to see whether it is a function or follows something, and Panel unlocks all
    declarations of a component to set the one that is locked.
    """
    resolve = Parameters._resolve_ref

    def resolve_ref(parameters: Parameters, declared: param.Parameter, value: Any) -> Any:
        plain = type(value) in CONSTANT
        return (None, None, value, False) if plain else resolve(parameters, declared, value)

    @contextmanager
    def unlock(owner: param.Parameterized) -> Iterator[None]:
        every = owner.param.objects("existing").values()
        locked = [(one, one.readonly, one.constant) for one in every if one.readonly or one.constant]
        for one, *_ in locked:
            one.readonly = one.constant = False
        try:
            yield
        finally:
            for one, readonly, constant in locked:
                one.readonly, one.constant = readonly, constant

    _replace(Parameters, _resolve_ref=resolve_ref)
    for module in list(sys.modules.values()):
        if getattr(module, "__dict__", {}).get("edit_readonly") is edit_readonly:
            vars(module)["edit_readonly"] = unlock


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


def _remember_classes() -> None:
    """Make Panel work out once what is the same for all components of a class."""
    linked: dict[type[MaterialComponent], tuple[str, ...]] = {}
    linked_by: Callable[[MaterialComponent], tuple[str, ...]] = vars(MaterialComponent)[
        "_linked_properties"
    ].fget

    def linked_properties(component: MaterialComponent) -> tuple[str, ...]:
        kind = type(component)
        if kind not in linked:
            linked[kind] = linked_by(component)
        return linked[kind]

    _replace(MaterialComponent, _linked_properties=property(linked_properties))
    style = vars(MaterialDesign)["_get_modifiers"].__func__
    styled: dict[tuple[Any, ...], tuple[dict[str, Any], dict[str, Any]]] = {}

    def style_of(design: type[MaterialDesign], component: Any, theme: Any, isolated: Any = None) -> Any:
        is_served = bool(state.curdoc and state.curdoc.session_context)
        key = design, type(component), type(theme), is_served
        if key not in styled:
            styled[key] = style(design, component, theme, isolated)
        own, of_children = styled[key]
        return {**own}, of_children

    _replace(MaterialDesign, _get_modifiers=classmethod(style_of))
    if config.autoreload:  # then the code may change
        return
    maps_of = vars(ReactComponent)["_process_importmap"].__func__
    maps = lru_cache(MOST_PATHS)(maps_of)

    def map_of(kind: type[ReactComponent]) -> Any:
        return maps(kind)

    _replace(ReactComponent, _process_importmap=classmethod(map_of))
    code_of = vars(MaterialComponent)["_render_esm"].__func__

    @lru_cache(MOST_PATHS)
    def code(kind: type[MaterialComponent], compiled: Any, server: bool, _path: Any, _inline: bool) -> Any:
        return code_of(kind, compiled=compiled, server=server)

    def render(kind: type[MaterialComponent], compiled: Any = True, server: bool = False) -> Any:
        return code(kind, compiled, server, state.rel_path, config.inline)

    _replace(MaterialComponent, _render_esm=classmethod(render))


def _replace(kind: type[Any], **parts: Any) -> None:
    """Replace parts of a class."""
    for name, part in parts.items():
        setattr(kind, name, part)


def _share_settings() -> None:
    """Make Panel read a setting of the whole server without asking which page is being made."""
    kind = type(config)
    get_any: Callable[[Any, str], Any] = kind.__getattribute__
    shared = frozenset(kind._globals)

    @wraps(get_any)
    def get(settings: Any, name: str) -> Any:
        return (
            param.Parameterized.__getattribute__(settings, name)
            if name in shared
            else get_any(settings, name)
        )

    _replace(kind, __getattribute__=get)
