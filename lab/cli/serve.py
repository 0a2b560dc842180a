"""``ins-lab serve``: the dashboard, on a port that is free."""

from __future__ import annotations

import errno
import os
import socket
import sys
from typing import Annotated

import typer

from lab.cli.app import CommandError
from lab.cli.options import AlgorithmFiles, algorithms

EXAMPLES = """\b
Examples:
  ins-lab serve --port 8000
  ins-lab serve --algorithm my_filter.py:MyFilter
Everything stays on this computer unless you name another address.
Whoever opens the page may add, change and delete your own missions.
The page Models compares your algorithm."""

_NO_ADDRESS = "--address {}: is not an address of this computer, such as 127.0.0.1 or localhost"


def serve(
    port: Annotated[
        int, typer.Option("--port", min=1, max=65535, metavar="PORT", help="Port of the page.")
    ] = 5006,
    address: Annotated[
        str, typer.Option("--address", metavar="ADDRESS", help="Address to listen on; 0.0.0.0 is all.")
    ] = "127.0.0.1",
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Do not open the page.")] = False,
    own: AlgorithmFiles = None,
) -> None:
    """Serve the dashboard and open it where there is a screen."""
    _check_port(address, port)
    algorithms(own)  # what cannot be loaded is said now, not to visitors
    from dashboards import serve as serve_dashboard  # noqa: PLC0415 - takes a second

    serve_dashboard(port=port, address=address, show=not no_browser and _has_screen(), algorithms=own or ())


def _check_port(address: str, port: int) -> None:
    try:
        family, kind, _, _, where = socket.getaddrinfo(address, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind) as probe:
            if os.name == "posix":
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(where)
    except socket.gaierror as error:
        raise CommandError(_NO_ADDRESS.format(address)) from error
    except OSError as error:
        if error.errno == errno.EADDRNOTAVAIL:
            raise CommandError(_NO_ADDRESS.format(address)) from error
        reason = (error.strerror or str(error)).lower()
        raise CommandError(
            f"--port {port}: {reason} at {address}; name another, such as --port {free_port()}"
        ) from error


def free_port() -> int:
    """Return a port nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _has_screen() -> bool:
    return sys.platform in {"darwin", "win32"} or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )
