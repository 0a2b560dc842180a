"""Notebook progress: a bar in a notebook while long work goes on."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape

Progress = Callable[[str, float], None]

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
    from IPython.display import HTML, display  # noqa: PLC0415 - only a notebook shows a bar

    begun, handles = time.monotonic(), []

    def tell(words: str, fraction: float) -> None:
        bar = HTML(f'<progress value="{fraction:.3f}" style="width:20em"></progress> {escape(words)}')
        if handles:
            handles[0].update(bar)
        elif time.monotonic() - begun > QUIET and fraction < 1:
            handles.append(display(bar, display_id=True))  # type: ignore[no-untyped-call]

    try:
        yield tell
    finally:
        for handle in handles:
            handle.update(HTML(""))


def _in_notebook() -> bool:
    """Return whether the code runs in a kernel of Jupyter, which displays HTML; a terminal does not."""
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    return shell is not None and hasattr(shell, "kernel")
