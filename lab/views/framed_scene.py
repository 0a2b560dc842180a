"""Framed scene: the flight of a result in three dimensions, as a page in a frame that needs no server."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import rich
import viser

from lab.base.notebook_card import HtmlFrame
from lab.views.scene import Scene

if TYPE_CHECKING:
    from lab.experiment.result import Result


def view3d(result: Result, *, dark: bool = True, height: int = 500) -> HtmlFrame:
    """Return the scene of a result; see `Result.view3d`."""
    with _silence():
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        try:
            page = Scene(server, result, dark=dark).as_html(dark=dark)
        finally:
            server.stop()
    return HtmlFrame(page, f"{result.mission.title or result.mission.name} in three dimensions", height)


@contextmanager
def _silence() -> Iterator[None]:
    """Keep viser from printing its address: nobody needs to look there."""
    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before
