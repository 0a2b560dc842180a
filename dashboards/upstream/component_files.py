"""Component files: the route ``components/`` gives the files of loaded components, and imports nothing.

Panel imports the module that an address names, whatever it is, and asks for no password. A module that is
imported runs: that of a command ends the server. No upstream issue is known.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from bokeh.server.views.auth_request_handler import AuthRequestHandler
from panel.io.resources import ResourceComponent
from panel.io.server import ComponentResourceHandler
from panel.theme import Theme
from panel.viewable import ServableMixin
from tornado.web import HTTPError

PACKAGES = frozenset({"dashboards", "panel", "panel_material_ui"})
"""Packages whose components a page of the laboratory has."""
_COMPONENTS = (ServableMixin, ResourceComponent, Theme)
"""What declares files: components and templates, designs, themes."""


def give_files_of_loaded_components(packages: frozenset[str] | None = None) -> None:
    """Make Panel's route give files of loaded components alone, and only to whoever the server admits.

    Servers that run do so, too.

    Parameters
    ----------
    packages
        Packages of these components; None for all, or for those named before.
    """
    kind: Any = ComponentResourceHandler
    if kind.prepare is not _admit:
        kind.prepare, kind.get_current_user = _admit, AuthRequestHandler.get_current_user
        kind.parse_url_path = _only_loaded(kind.parse_url_path)
    kind.packages = packages or getattr(kind, "packages", None)


def _only_loaded(parse: Callable[..., str]) -> Callable[..., str]:
    """Return what finds the file of an address, if its component is loaded."""

    def find(handler: Any, path: str) -> str:
        module, name, *_ = (*path.split("/"), "", "")
        found = getattr(sys.modules.get(module), "__dict__", {}).get(name)
        is_component = isinstance(found, type) and issubclass(found, _COMPONENTS)
        is_ours = handler.packages is None or module.partition(".")[0] in handler.packages
        if not is_ours or not is_component or found.__module__ != module:
            raise HTTPError(404)
        try:
            return parse(handler, path)
        except (AttributeError, TypeError, ValueError) as error:  # what it declares there is no list of files
            raise HTTPError(404) from error

    return find


async def _admit(handler: Any) -> None:
    """Refuse whoever the server does not admit; a server of Jupyter asks by itself."""
    if hasattr(handler.application, "auth_provider"):
        await AuthRequestHandler.prepare(handler)
        if not handler.current_user:
            raise HTTPError(403)
