"""Speed: what Bokeh would work out again for each model, worked out once for each class of models.

A page consists of 600 models. Bokeh asks for the default of each of their properties several times, and each
time it copies and checks the default: half of the time to open a page. A default that is a number, a text, a
truth value or nothing is the same for all models of a class, so it is remembered.
"""

from __future__ import annotations

from typing import Any

from bokeh.core.has_props import HasProps
from bokeh.core.property.descriptors import PropertyDescriptor
from bokeh.settings import settings

CONSTANT = (type(None), bool, int, float, str)
"""Types of the defaults that are remembered: what nobody can change in place."""

_Key = tuple[PropertyDescriptor[Any], type[HasProps]]


class RememberedDefaults:
    """The defaults of Bokeh's properties, each worked out once for a class of models.

    A theme may set another default for single models, so what a theme names is always asked of Bokeh.
    """

    def __init__(self) -> None:
        self._default = PropertyDescriptor.instance_default
        self._is_unstable = PropertyDescriptor.has_unstable_default
        self._defaults: dict[_Key, Any] = {}
        self._unstable: dict[_Key, bool] = {}

    def install(self) -> None:
        """Answer in place of Bokeh from now on."""
        remembered = self

        def instance_default(descriptor: PropertyDescriptor[Any], model: HasProps) -> Any:
            return remembered.default(descriptor, model)

        def has_unstable_default(descriptor: PropertyDescriptor[Any], model: HasProps) -> bool:
            return remembered.is_unstable(descriptor, model)

        HasProps.themed_values = _themed  # type: ignore[method-assign, assignment]
        PropertyDescriptor.instance_default = instance_default  # type: ignore[method-assign, assignment]
        PropertyDescriptor.has_unstable_default = has_unstable_default  # type: ignore[method-assign, assignment]

    def default(self, descriptor: PropertyDescriptor[Any], model: HasProps) -> Any:
        """Return the default of a property of a model."""
        themed = _themed(model)
        if themed is not None and descriptor.name in themed:
            return self._default(descriptor, model)
        key = (descriptor, model.__class__)
        if key in self._defaults:
            return self._defaults[key]
        default = self._default(descriptor, model)
        if type(default) in CONSTANT and not self.is_unstable(descriptor, model):
            self._defaults[key] = default
        return default

    def is_unstable(self, descriptor: PropertyDescriptor[Any], model: HasProps) -> bool:
        """Return whether each model has a default of its own, such as an empty list."""
        key = (descriptor, model.__class__)
        if key not in self._unstable:
            self._unstable[key] = self._is_unstable(descriptor, model)
        return self._unstable[key]


def _themed(model: HasProps) -> dict[str, Any] | None:
    """Return what a theme sets on a model; Bokeh's own way asks all properties where there is nothing."""
    return model.__dict__.get("__themed_values__")


def speed_up() -> None:
    """Have Bokeh remember defaults and leave out the checks that serve those who write pages.

    The checks are those of whole documents and of the arguments of each callback.
    """
    if PropertyDescriptor.instance_default.__module__ != __name__:
        RememberedDefaults().install()
    settings.perform_document_validation = False
    settings.perform_error_diagnostics = False
