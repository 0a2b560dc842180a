"""Notebook display: the theme of plots in a notebook, and the progress of a run.

Python does not know the theme of the page. JupyterLab notes it on the page's body, where the figure looks as
soon as it has a size. Panel takes the colour of texts and labels of widgets from a variable that only the
package ipywidgets defines: without it they are black, also in the dark. The figure defines it.
"""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from pathlib import Path
from typing import Any

from bokeh.models import CustomJS
from bokeh.plotting import figure

from lab.base.progress import Progress

FOLLOW = Path(__file__).with_name("notebook_display.js").read_text("utf-8")
"""Turns the lightness of a figure and keeps its hues; white becomes the dark grey of JupyterLab's cells."""
_EVENT = "change:inner_width"


def follow_theme(drawn: figure) -> None:
    """Have a figure turn dark where JupyterLab is dark; elsewhere nothing changes.

    Parameters
    ----------
    drawn
        The figure, which no page shows yet.
    """
    if _EVENT not in drawn.js_property_callbacks:
        drawn.js_on_change("inner_width", CustomJS(code=FOLLOW))


def theme_hook(plot: Any, element: Any) -> None:
    """Do the same with a plot of HoloViews, as one of its ``hooks``."""
    follow_theme(plot.state)


QUIET = 0.5
"""Work that takes no longer than this shows no bar [s]."""


@contextmanager
def shown(progress: Progress | None) -> Iterator[Progress | None]:
    """Yield a function that takes progress: the given one; in a notebook, by default, one that shows a bar.

    Outside of a notebook, without a given function, yield None. The bar disappears at the end.
    """
    if progress is not None or not _in_notebook():
        yield progress
        return
    display = importlib.import_module("IPython.display").display  # only a notebook shows a bar
    begun, handles = time.monotonic(), list[Any]()

    def tell(words: str, fraction: float) -> None:
        bar = f'<progress value="{fraction:.3f}" style="width:20em"></progress> {escape(words)}'
        if handles:
            handles[0].update({"text/html": bar}, raw=True)
        elif time.monotonic() - begun > QUIET and fraction < 1:
            handles.append(display({"text/html": bar}, raw=True, display_id=True))

    try:
        yield tell
    finally:
        for handle in handles:
            handle.update({"text/html": ""}, raw=True)


def _in_notebook() -> bool:
    """Return whether the code runs in a kernel of Jupyter, which displays HTML; a terminal does not."""
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    return shell is not None and hasattr(shell, "kernel")
