"""Overview head: what the page shows in two sentences, what to try first, and six figures of the run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import param
from panel.custom import JSComponent

_STYLE = Path(__file__).with_name("overview_head.css").read_text("utf-8")


class OverviewHead(JSComponent):
    """Two sentences with buttons, which a person closes for ever, and figures that are buttons too.

    The browser remembers that the sentences were closed; one that refuses to remember it closes them for this
    opening of the page.

    Parameters
    ----------
    act
        Called with the key of a button that was pressed.
    """

    content: dict[str, Any] = param.Dict(
        {"sentences": "", "actions": [], "numbers": []},
        doc="The sentences; key and label of each button; key, value, label and next step of each figure.",
    )
    asked: dict[str, Any] = param.Dict({}, doc="The key of the last button that was pressed, and a count.")

    _esm = Path(__file__).with_name("overview_head.js")
    _stylesheets = [_STYLE]  # noqa: RUF012 - Panel's own

    def __init__(self, act: Callable[[str], None], **params: Any) -> None:
        super().__init__(**params)  # type: ignore[no-untyped-call]
        self._act = act
        self.param.watch(lambda event: self._act(str(event.new.get("key"))), "asked")

    def fill(self, sentences: str, actions: list[tuple[str, str]], numbers: list[tuple[str, ...]]) -> None:
        """Fill in sentences, buttons and figures."""
        content = {"sentences": sentences, "actions": actions, "numbers": numbers}
        if content != self.content:
            self.content = content


class TrackSwitch(JSComponent):
    """Two buttons in the place of the track: the track from above, or the flight in three dimensions."""

    is_3d: bool = param.Boolean(False, doc="Whether the flight is shown in three dimensions.")

    _esm = """
export function render({model}) {
  const group = document.createElement("div")
  group.setAttribute("role", "group")
  group.setAttribute("aria-label", "Track or 3-D")
  const buttons = [["Track", false], ["3-D", true]].map(([label, is_3d]) => {
    const button = document.createElement("button")
    button.type = "button"
    button.textContent = label
    button.addEventListener("click", () => { model.is_3d = is_3d })
    const show = () => button.setAttribute("aria-pressed", model.is_3d === is_3d)
    model.on("is_3d", show)
    show()
    return button
  })
  group.append(...buttons)
  return group
}
"""
    _stylesheets = [  # noqa: RUF012 - Panel's own
        """
button { font: 12px/1 Roboto, sans-serif; color: inherit; background: none; cursor: pointer; padding: 5px 9px;
         border: 1px solid rgba(128, 128, 128, .4); }
button:first-child { border-radius: 6px 0 0 6px; }
button:last-child { border-radius: 0 6px 6px 0; border-left: 0; }
button[aria-pressed=true] { background: rgba(59, 142, 234, .2); }
@media (forced-colors: active) { button[aria-pressed=true] { background: Highlight; color: HighlightText; } }
button:focus-visible { outline: 2px solid #3b8eea; outline-offset: 1px; }
@media print { :host { display: none; } }
"""
    ]
