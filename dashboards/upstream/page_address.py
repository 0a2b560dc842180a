"""Page address: the address of a page, as its browser sends it, in the parts that a browser's scripts have.

Panel divides an address at each colon and each question mark, and fails where there is one more: with an IPv6
address, and with a question mark in a setting. It also computes the value of each setting, though no
component follows one, and fails at a number of more than 4,300 digits. No upstream issue is known.
"""

from __future__ import annotations

import re
from typing import Any

from panel.io import location
from panel.io.location import Location
from param.parameterized import Event

_HOST = re.compile(r"(\[[^\]]*\]|[^:]*)(?::(\d*))?", re.ASCII)


def read_any_address() -> None:
    """Make Panel read the address of a page whatever is in it, and compute only what a component follows."""
    if location._get_location_params is address_parts:
        return
    location._get_location_params = address_parts
    update = Location._update_synced

    def update_followed(self: Location, event: Event | None = None) -> None:
        if self._synced:
            update(self, event)

    Location._update_synced = update_followed  # type: ignore[method-assign]


def address_parts(protocol: str | None, host: str | None, uri: str | None) -> dict[str, Any]:
    """Return the parts of an address by the names that they have in a browser.

    Parameters
    ----------
    protocol
        Scheme, such as ``http``.
    host
        Name or address of the server, with its port where it is not the usual one; of IPv6 in brackets.
    uri
        Path and query.
    """
    whole = host or ""
    found = _HOST.fullmatch(whole)
    name, port = found.groups("") if found else (whole, "")
    rest, _, fragment = (uri or "").partition("#")
    path, _, query = rest.partition("?")
    return {
        "protocol": f"{protocol}:" if protocol else "",
        "hostname": name,
        "port": port,
        "pathname": path,
        "search": f"?{query}" if query else "",
        "hash": f"#{fragment}" if fragment else "",
        "href": "".join((f"{protocol}:" if protocol else "", f"//{whole}" if whole else "", uri or "")),
    }
