"""Dashboards: the pages of the laboratory in a browser; layout and state of a session, no physics."""

from __future__ import annotations

TYPE_CHECKING = False  # that of typing takes 10 ms, in which Ctrl-C would print a traceback
if TYPE_CHECKING:
    from typing import Any

    from dashboards.server import serve

__all__ = ["serve"]


def __getattr__(name: str) -> Any:
    """Import `serve` at its first use: where another package is called ``lab``, it cannot be imported."""
    if name != "serve":
        raise AttributeError(f"module 'dashboards' has no attribute {name!r}")
    from dashboards.server import serve  # noqa: PLC0415 - at its first use

    return serve
