"""Rest routes: what Panel loads as it makes a server, before the first request.

With ``panel serve``, a page is loaded when somebody opens it. Until then, this extension of Panel's routes,
named in ``pyproject.toml``, is the only code of the laboratory in the server.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from dashboards.upstream.component_files import give_files_of_loaded_components


def no_routes(_files: Sequence[str], _endpoint: str) -> list[Any]:
    """Return no further routes: what counts is that Panel has loaded this file."""
    return []


give_files_of_loaded_components()
