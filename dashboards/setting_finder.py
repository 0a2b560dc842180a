"""Setting finder: the settings whose names have the words that a person types, and those that are changed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import panel as pn
import panel_material_ui as pmui

MOST = 12
"""Most settings that are shown at once."""
NOTHING = "<small>No setting has all these words.</small>"


class SettingFinder:
    """A box for words, a button for what is changed, and the fields that are found, in place of all groups.

    Parameters
    ----------
    names
        All names of each setting: group, label, path.
    changed
        Returns the paths of the settings that are changed.
    fields
        Makes a row for each of some settings, to change them there.
    found
        Called with whether settings are sought: then the groups are hidden.

    Attributes
    ----------
    names : mapping
        As given.
    view : viewable
        The box, the button and the fields.
    """

    def __init__(
        self,
        names: Mapping[str, str],
        changed: Callable[[], Iterable[str]],
        fields: Callable[[Iterable[str]], list[pn.viewable.Viewable]],
        found: Callable[[bool], None],
    ) -> None:
        self.names, self._changed, self._fields, self._found = names, changed, fields, found
        self._box = pmui.TextInput(
            label="Find a setting",
            size="small",
            variant="outlined",
            margin=(6, 0),
            sizing_mode="stretch_width",
        )
        self._only = pmui.Toggle(
            label="Changed",
            size="small",
            variant="outlined",
            color="default",
            margin=(6, 0, 6, 8),
            sx={"textTransform": "none", "whiteSpace": "nowrap"},
        )
        self._place = pn.Column(margin=(0, 10), sizing_mode="stretch_width", visible=False)
        self._box.param.watch(lambda _event: self._seek(), "value_input")
        self._only.param.watch(lambda _event: self._seek(), "value")
        self.view = pn.Column(
            pn.Row(self._box, self._only, margin=0, sizing_mode="stretch_width"),
            self._place,
            margin=0,
            sizing_mode="stretch_width",
        )

    def count(self) -> None:
        """Say how many settings are changed."""
        number = sum(1 for _ in self._changed())
        label = f"Changed {number}" if number else "Changed"
        if label != self._only.label:
            self._only.param.update(label=label, disabled=not number and not self._only.value)

    def _seek(self) -> None:
        """Show the fields of what is sought; nothing is sought without words."""
        words = str(self._box.value_input or "").casefold().split()
        among = self._changed() if self._only.value else self.names if words else ()
        paths = [path for path in among if all(word in self.names[path].casefold() for word in words)]
        sought = bool(words) or bool(self._only.value)
        rows = self._fields(paths[:MOST]) if sought else []
        self._place[:] = rows if rows or not sought else [pn.pane.HTML(NOTHING, margin=(8, 0))]
        self._place.visible = sought
        self._found(sought)


def mark_changed(view: pn.viewable.Viewable, before: str) -> None:
    """Mark a field as changed, with what it was before; an empty text takes the mark away."""
    marked = MARK in view.css_classes
    styles = {name: value for name, value in view.styles.items() if name != "--was"}
    if before:
        styles["--was"] = f'"{before}"'
    if styles != view.styles or marked != bool(before):
        others = [one for one in view.css_classes if one != MARK]
        view.param.update(styles=styles, css_classes=[*others, MARK] if before else others)


MARK = "changed"
"""Class of a field whose setting is changed."""
MARKED = """
:host(.changed)::after { content: var(--was); display: block; font-size: 11px; line-height: 1.2; opacity: .75;
                         text-align: right; padding-right: 22px; overflow: hidden; text-overflow: ellipsis; }
:host(.changed)::before { content: ""; position: absolute; left: -9px; top: 10px; width: 6px; height: 6px;
                          z-index: 2; border-radius: 50%; background: #e07b00; }
"""
"""A dot before the field, and what it was, below it."""
