"""Notebook progress: a bar in a notebook while long work goes on."""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from typing import Any

from lab.base.progress import Progress

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
