"""Framed scene: the flight of a result in three dimensions, as a page in a frame that needs no server."""

from __future__ import annotations

from contextlib import redirect_stdout
from io import StringIO
from typing import TYPE_CHECKING

import viser

from lab.html_frame import HtmlFrame
from lab.views.scene import Scene

if TYPE_CHECKING:
    from lab.result import Result


def view3d(result: Result, *, dark: bool = True, height: int = 500) -> HtmlFrame:
    """Return the scene of a result; see `Result.view3d`."""
    with redirect_stdout(StringIO()):  # viser prints its address, at which nobody needs to look
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        try:
            page = Scene(server, result, dark=dark).as_html(dark=dark)
        finally:
            server.stop()
    return HtmlFrame(page, f"{result.mission.title or result.mission.name} in three dimensions", height)
