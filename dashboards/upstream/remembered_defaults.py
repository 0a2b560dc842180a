"""Remembered defaults: the defaults of Bokeh's properties, computed once for each class of models.

A page consists of 600 models. Bokeh reads the default of each of their properties several times, and copies
and checks it each time, which takes half of the time to open a page. A default that is a number, a text, a
Boolean or None is shared by all models of a class. An empty default is created on first use, without checks:
it refers to its model, which would otherwise outlive its page until a garbage collection.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from bokeh.core.has_props import HasProps
from bokeh.core.property.descriptors import PropertyDescriptor
from bokeh.core.property.singletons import Intrinsic, Undefined
from bokeh.core.property.wrappers import PropertyValueDict, PropertyValueList, PropertyValueSet

CONSTANT = frozenset((type(None), bool, int, float, str, type(Undefined)))
"""Types of cached defaults: immutable ones, which refer to no model."""
CONTAINERS = (PropertyValueDict, PropertyValueList, PropertyValueSet)
"""Types of defaults that are cached as empty."""


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
            if value is not Undefined and value is not Intrinsic and not self._is_given(model, name, value):
                setattr(model, name, value)
        for name, descriptor in self._own_defaults(model):
            if name not in properties and (descriptor, model.__class__) not in self._empty:
                descriptor._get(model)  # creates the default
        model._initialized = True

    def _is_given(self, model: HasProps, name: str, value: Any) -> bool:
        """Give a new model a constant, which concerns no other model and no callback; False for others."""
        descriptor = model.lookup(name, raises=False)
        if descriptor is None or type(descriptor) is not PropertyDescriptor or type(value) not in CONSTANT:
            return False
        default = self.default(descriptor, model)
        prepared = descriptor.property.prepare_value(model, name, value)
        if type(default) not in CONSTANT or type(prepared) not in CONSTANT:
            return False
        if not prepared == default:  # noqa: SIM201 - as Bokeh compares, of which NaN is no default
            model._property_values[name] = prepared
        return True

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
