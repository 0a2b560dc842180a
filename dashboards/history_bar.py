"""History bar: the buttons Undo and Redo, and the tie between a page's history and that of its browser."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import param
from panel.custom import JSComponent

_STYLE = """
div { display: flex; }
button { width: 36px; height: 36px; padding: 6px; border: 0; border-radius: 50%;
         background: none; color: #ffffff; cursor: pointer; }
button:hover { background: rgba(255, 255, 255, .12); }
button:focus-visible { outline: 2px solid #ffffff; outline-offset: -2px; }
button:disabled { opacity: .4; background: none; cursor: default; }
svg { display: block; width: 24px; height: 24px; fill: currentColor; }
"""


class HistoryBar(JSComponent):
    """Two buttons and their keys; the history of the browser follows what is shown.

    Parameters
    ----------
    act
        Called with what a person asks for ("undo", "redo", or "visit" for an entry of the browser's history),
        and with the number of the entry.
    """

    shown: dict[str, Any] = param.Dict(
        {"pushed": [], "position": 0, "search": "", "oldest": 0, "undone": "", "redone": "", "count": 0},
        doc="Number and query of new entries, number and query of the present one, number of the oldest one, "
        "names of what undo and redo change, and a count.",
    )
    asked: dict[str, Any] = param.Dict({}, doc="The last wish: what, the number of an entry, and a count.")

    _esm = Path(__file__).with_name("history_bar.js")
    _stylesheets = [_STYLE]  # noqa: RUF012 - Panel's own

    def __init__(self, act: Callable[[str, int], None], **params: Any) -> None:
        super().__init__(**params)  # type: ignore[no-untyped-call]
        self._act = act
        self.param.watch(self._asked, "asked")

    def _asked(self, event: param.parameterized.Event) -> None:
        what, position = event.new.get("what"), event.new.get("position")
        if isinstance(what, str) and isinstance(position, int):
            self._act(what, position)
