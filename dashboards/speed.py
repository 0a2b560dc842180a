"""Speed: what Bokeh and Panel would work out again for each of the 600 models of a page, worked out once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import lru_cache, wraps
from typing import Any

from bokeh.core.has_props import HasProps
from bokeh.core.property.descriptors import PropertyDescriptor
from bokeh.core.property.wrappers import PropertyValueContainer
from bokeh.model import Model, util
from bokeh.settings import settings
from panel.custom import ReactiveESM
from panel.io import resources
from panel.reactive import Syncable
from panel.viewable import is_viewable_param

from dashboards.defaults import CONSTANT, RememberedDefaults, themed
from dashboards.garbage import cut_cycles

MOST_PATHS = 1024
"""Most files and folders of which it is remembered whether one is in the other; a page asks for 60."""


def speed_up() -> None:
    """Have Bokeh and Panel remember, and leave out the checks that serve those who write pages.

    The checks are those of whole documents and of the arguments of each callback.
    """
    if PropertyDescriptor.instance_default.__module__ != RememberedDefaults.__module__:
        RememberedDefaults().install()
        cut_cycles()
        _look_at_values_that_are_set()
        _share_declarations()
        _remember_paths()
    settings.perform_document_validation = False
    settings.perform_error_diagnostics = False


def _look_at_values_that_are_set() -> None:
    """Have Bokeh look for models, and for what it sends, only among values that are no constant defaults."""
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
                visit_inside(own[name], visitor)

    def query(
        model: HasProps,
        query: Callable[[PropertyDescriptor[Any]], bool],
        *,
        include_defaults: bool = True,
        include_undefined: bool = False,
    ) -> dict[str, Any]:
        if include_defaults or include_undefined or themed(model):
            return query_any(
                model, query, include_defaults=include_defaults, include_undefined=include_undefined
            )
        return {name: value for name, value in _changed(model) if query(model.lookup(name))}

    util.visit_immediate_value_references = visit
    HasProps.query_properties_with_values = query  # type: ignore[method-assign, assignment]


def _own_values(model: HasProps) -> dict[str, Any]:
    """Return the values of a model that are not those of all models of its class."""
    return {**model._unstable_default_values, **model._unstable_themed_values, **model._property_values}


def _changed(model: HasProps) -> Iterator[tuple[str, Any]]:
    """Yield the properties of a model that a browser cannot know, in Bokeh's order."""
    own = _own_values(model)
    for name in model.properties(_with_props=True):
        if name in own:
            value = model.lookup(name).get_value(model)
            if not (isinstance(value, PropertyValueContainer) and name in model._unstable_default_values):
                yield name, value


def _share_declarations() -> None:
    """Have Panel read the declarations of a component's class, and not copy each of them for the component.

    The copies, 2,700 for a page, are for components that change their own declarations.
    """
    get_properties = ReactiveESM._get_properties

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
        models, old, mapping = dict[str, Any](), list[Any](), type(component)._property_mapping
        for name, declaration in component.param.objects(instance=False).items():
            if is_viewable_param(declaration) and mapping.get(name, "") is not None:
                models[name], before = component._get_child_model(
                    getattr(component, name), document, root, parent, comm
                )
                old += before
        return models, old

    def init_params(component: Syncable) -> dict[str, Any]:
        synced = component._synced_params  # asked once, not for each of them
        return {name: value for name in synced if (value := getattr(component, name)) is not None}

    ReactiveESM._get_properties = properties  # type: ignore[method-assign, assignment]
    ReactiveESM._get_children = children  # type: ignore[method-assign, assignment]
    Syncable._init_params = init_params  # type: ignore[method-assign, assignment]


def _remember_paths() -> None:
    """Have Panel look once whether a file of a component is in a folder it serves: 700 times for a page."""
    vars(resources)["_is_subpath"] = lru_cache(MOST_PATHS)(resources._is_subpath)
