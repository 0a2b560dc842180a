"""Other form: a box below a setting that shows and accepts its value in another form."""

from __future__ import annotations

from typing import Any

import panel_material_ui as pmui
import param

from dashboards.field_text import field_label, per_axis
from dashboards.widgets import Change, Field


class OtherFormField(Field):
    """A number in a box, or one for each axis."""

    def __init__(self, declaration: param.Parameter, change: Change) -> None:
        super().__init__(declaration, change)
        self._axes: tuple[str, ...] = getattr(declaration, "axes", ())
        self.view = self._box = pmui.TextInput(
            label=field_label(declaration),
            size="small",
            variant="standard",
            margin=(0, 0, 8, 12),
            sizing_mode="stretch_width",
            description=declaration.doc,
        )
        self._box.param.watch(self._accept_typed, "value")
        self.parts = {"box": self._box}
        self.show(declaration.default)

    def complain(self, sentence: str) -> None:
        """Show a sentence below the box."""
        self._box.param.update(helper_text=sentence, error_state=bool(sentence))

    def _render(self, value: Any) -> None:
        self._box.value = self.in_words(value)

    def _relabel(self) -> None:
        self._box.param.update(label=field_label(self.said), description=self.said.doc)

    def _accept_typed(self, event: param.parameterized.Event) -> None:
        if not self._showing and event.new != self.in_words(self._value):
            self._ask(self._as_set(per_axis(event.new, self._axes)))
