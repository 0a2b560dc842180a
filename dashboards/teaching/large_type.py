"""Large type: letters of plots and texts for a projector."""

from __future__ import annotations

from functools import partial
from typing import Any
from weakref import WeakKeyDictionary, ref

import panel as pn
import panel_material_ui as pmui
from bokeh.model import Model
from bokeh.models.annotations import Legend, Title
from bokeh.models.axes import Axis

FACTOR = 1.5
"""Letters of a page on a projector by those on a screen: 8 mm high on a wall of 2 m, they are read from 4 m,
and with this factor from 6 m, the last row of a seminar room."""
SIZES = {
    Axis: ("axis_label_text_font_size", "major_label_text_font_size"),
    Legend: ("label_text_font_size",),
    Title: ("text_font_size",),
}
"""Sizes of letters in plots, which are painted and follow no style of the page."""


class LargeType:
    """Enlarges the letters of pages, and makes them small again.

    Attributes
    ----------
    on : bool
        Whether pages that are dressed from now on have large letters.
    """

    def __init__(self) -> None:
        self.on = False
        self._sizes: WeakKeyDictionary[Model, dict[str, str]] = WeakKeyDictionary()
        self._zoomed: WeakKeyDictionary[Any, dict[str, Any]] = WeakKeyDictionary()

    def dress(self, view: pn.viewable.Viewable) -> None:
        """Give the plots and the texts of a page large letters, or their own if it is off."""
        if not self.on and not self._sizes and not self._zoomed:
            return
        for pane in view.select(pn.pane.Bokeh):
            self._dress_plot(pane.object)
        for kind in (pn.pane.HTML, pmui.RadioBoxGroup):  # texts, and the answers to choose from
            for text in view.select(kind):
                self._dress_text(text)

    def _dress_plot(self, plot: Model) -> None:
        for kind, names in SIZES.items():
            for model in plot.select({"type": kind}):
                if model not in self._sizes:
                    self._sizes[model] = {name: str(getattr(model, name)) for name in names}
                    for name in names:
                        model.on_change(name, partial(self._changed, ref(model)))
                own = self._sizes[model]
                model.update(**{name: _large(size) if self.on else size for name, size in own.items()})

    def _changed(self, changed: ref[Model], name: str, _old: object, new: object) -> None:
        """Enlarge letters again that a browser has made smaller, as it does when the theme changes."""
        model = changed()
        if self.on and model is not None:
            large = _large(self._sizes[model][name])
            if new != large:
                model.update(**{name: large})

    def _dress_text(self, text: Any) -> None:
        own = self._zoomed.setdefault(text, dict(text.styles))
        wanted = {**own, "zoom": str(FACTOR)} if self.on else own
        if text.styles != wanted:
            text.styles = wanted


def _large(size: str) -> str:
    """Return a size of letters, such as ``13px``, enlarged."""
    number = size.rstrip("pxemt")
    return f"{round(FACTOR * float(number), 2):g}{size[len(number) :]}"
