"""Setting finder: settings by words of their names, those that are changed, and the last ones used."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import panel as pn
import panel_material_ui as pmui

from dashboards.style import plain_column, plain_row

MOST = 12
"""Most settings that are shown at once."""
LAST = 3
"""How many of the settings that were changed last are at hand."""
_LAST = {
    "& button": {
        "padding": "2px 8px", "whiteSpace": "nowrap", "overflow": "hidden",
        "textOverflow": "ellipsis", "display": "block", "width": "auto", "maxWidth": "100px",
        "flexShrink": "0",
    },
}  # fmt: skip
NOTHING = "<small>No setting has all these words.</small>"


class SettingFinder:
    """A box for words, a button for what is changed, and the fields that are found, in place of all groups.

    Parameters
    ----------
    names
        All names of each setting: group, label, others.
    changed
        Returns the paths of the settings that are changed.
    fields
        Makes a row for each of some settings, to change them there.
    found
        Called with whether settings are sought: then the groups are hidden.
    others
        Stand below the box: the first beside the button, the second below it.

    Attributes
    ----------
    names : mapping
        As given.
    view : viewable
        The box, the button and the fields.
    """

    def __init__(
        self,
        names: Mapping[str, tuple[str, ...]],
        changed: Callable[[], Iterable[str]],
        fields: Callable[[Iterable[str]], list[pn.viewable.Viewable]],
        found: Callable[[bool], None],
        others: tuple[pn.viewable.Viewable, pn.viewable.Viewable],
    ) -> None:
        self.names, self._changed, self._fields, self._found = names, changed, fields, found
        self._recent: list[str] = []
        self._box = pmui.TextInput(
            label="Find a setting",
            size="small",
            variant="outlined",
            margin=(10, 0, 6, 0),
            sizing_mode="stretch_width",
        )
        self._only = pmui.Toggle(
            label="Changed",
            size="small",
            variant="outlined",
            color="default",
            margin=(6, 8, 2, 0),
            sx={"whiteSpace": "nowrap", "& button, &": {"padding": "3px 10px"}},
        )
        self._last = pmui.CheckButtonGroup(options={}, value=[], size="small", margin=(0, 0, 4, 0), sx=_LAST)
        self._strip = pn.Column(pn.pane.HTML("<small>Changed last</small>", margin=0), self._last, margin=0)
        self._place = plain_column(margin=(0, 10), visible=False)
        self._box.param.watch(lambda _event: self._seek(), "value_input")
        self._only.param.watch(lambda _event: self._seek(), "value")
        self._last.param.watch(lambda _event: self._seek(), "value")
        self.view = plain_column(self._box, plain_row(self._only, others[0]), others[1], self._place)

    def count(self) -> None:
        """Say how many settings are changed."""
        number = sum(1 for _ in self._changed())
        label = f"Changed {number}" if number else "Changed"
        if label != self._only.label:
            self._only.param.update(label=label, disabled=not number and not self._only.value)

    def used(self, path: str) -> None:
        """Have a setting at hand that was changed: its name stays among the last ones.

        Names that are there keep their places, and so do their fields: a slider may be in motion.
        """
        if path not in self.names or path in self._recent:
            return
        self._recent = [*self._recent[-LAST + 1 :], path]
        self._offer()
        if self._strip not in self.view.objects:
            self.view.insert(3, self._strip)

    def rename(self, names: Mapping[str, tuple[str, ...]]) -> None:
        """Take other names of the settings."""
        self.names = names
        self._offer()

    def _offer(self) -> None:
        """Show the names of the last settings; those that are pressed stay so."""
        kept = self._pressed()
        self._last.param.update(options={self._short(one): one for one in self._recent}, value=kept)

    def _short(self, path: str) -> str:
        """Return the label of a setting, with its group where another one at hand has the same."""
        group, label, *_ = self.names[path]
        same = sum(self.names[one][1] == label for one in self._recent)
        return f"{label} ({group})" if same > 1 else label

    def _seek(self) -> None:
        """Show the fields of what is sought, or else of the last ones that are pressed."""
        words = str(self._box.value_input or "").casefold().split()
        among = self._changed() if self._only.value else self.names if words else self._pressed()
        texts = {path: " ".join(self.names[path]).casefold() for path in among}
        paths = [path for path, text in texts.items() if all(word in text for word in words)]
        sought = bool(words) or bool(self._only.value)
        rows = self._fields(paths[:MOST])
        self._place[:] = rows if rows or not sought else [pn.pane.HTML(NOTHING, margin=(8, 0))]
        self._place.visible = sought or bool(rows)
        self._found(sought)

    def _pressed(self) -> list[str]:
        """Return the last settings whose names are pressed."""
        return [path for path in self._recent if path in self._last.value]


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
