"""Shortcuts: the keys of the page, and the list of them behind the question mark."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import panel_material_ui as pmui

from dashboards.address import HistoryBar
from dashboards.style import header_icon, wide_html

KEYS = (
    ("1 to 7", "open a tab"),
    ("Space", "play, or stop"),
    ("← →", "go to the fix before, or to the next one"),
    ("H", "hold this result"),
    ("/", "find a setting"),
    ("V", "show or hide all values at the cursor"),
    ("Ctrl+Z, Ctrl+Shift+Z", "undo, redo"),
    ("Esc", "close the missions, the lessons, this list"),
    ("?", "this list"),
)
"""What each key does."""
PLOTS = (
    ("Click", "move the time cursor"),
    ("Drag", "zoom into a stretch of time"),
    ("Ctrl+wheel", "zoom at the mouse"),
    ("Shift+wheel", "move along the time"),
    ("Double click", "show the whole flight"),
    ("Two fingers", "zoom; then one finger moves along the time"),
)
"""What the mouse does over a plot."""
_STYLE = """
h3 { margin: 14px 0 4px; font-size: 15px; font-weight: 500; } p { margin: 4px 0 8px; line-height: 1.45; }
table { border-collapse: collapse; } td { padding: 3px 18px 3px 0; vertical-align: top; }
kbd { font: 13px/1.4 "Roboto Mono", monospace; white-space: nowrap; }
"""
_ABOUT = (
    "<p>A flight is simulated or recorded. Sensors with errors measure it, and a navigator estimates "
    "position, velocity and attitude from them. The plots show how wrong it "
    "is, and how wrong it believes to be.</p>"
    "<p>The coloured label above says in words whether the filter is right, and what to change.</p>"
)


class Shortcuts:
    """Hears the keys of the page, and lists them.

    Parameters
    ----------
    keys
        What hears the keys in the browser.
    acts
        What each wish does; a number is given to those that have one.

    Attributes
    ----------
    button : viewable
        The question mark, for the header.
    list : viewable
        The list, for the page.
    """

    def __init__(self, keys: HistoryBar, acts: Mapping[str, Callable[[int], None]]) -> None:
        self._acts: dict[str, Callable[[int], None]] = {**acts, "help": lambda _number: self._open()}
        keys.hear(self._do)
        self.button = header_icon("help_outline", "What keys and mouse do (?)")
        self.button.on_click(lambda _event: self._open())
        self._words = wide_html(stylesheets=[_STYLE])
        self.list = pmui.Dialog(
            self._words, title="INS Lab", close_on_click=True, show_close_button=True, width_option="sm"
        )

    def _open(self) -> None:
        """Show the list; its words are sent when it is first shown."""
        if not self._words.object:
            self._words.object = _ABOUT + _table("Keys", KEYS) + _table("Over a plot", PLOTS)
        self.list.open = True

    def _do(self, what: str, number: int) -> None:
        if what in self._acts:
            self._acts[what](number)


def _table(title: str, rows: tuple[tuple[str, str], ...]) -> str:
    cells = "".join(f"<tr><td><kbd>{key}</kbd></td><td>{does}</td></tr>" for key, does in rows)
    return f"<h3>{title}</h3><table>{cells}</table>"
