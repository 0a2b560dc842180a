"""Class link: the address that students open, and the code of a class in the address of a page."""

from __future__ import annotations

from typing import NamedTuple
from urllib.parse import parse_qsl, quote, urlencode, urlsplit

from lab.live.phone.invitation import in_address, is_loopback, own_addresses

FIELD = "class"
"""Field of the address with the code of a class, beside those of the settings."""
MOST_FIELDS = 200
"""Most fields of an address that are read, as of the settings."""
HERE_ONLY = (
    "Students cannot reach this address. Start the server with --address 0.0.0.0, or open this page by its "
    "public name."
)

_listening: list[str] = []
"""Address that the server of this process listens on; empty if unknown."""


class ClassLink(NamedTuple):
    """The link for students.

    Attributes
    ----------
    address : str
        The link.
    problem : str
        Why students cannot reach it; empty if they can.
    """

    address: str
    problem: str


def listen_on(address: str) -> None:
    """Note the address that the server of this process listens on."""
    _listening[:] = [address]


def class_link(page: str, code: str) -> ClassLink:
    """Return the link to a class.

    Parameters
    ----------
    page
        Address of the teacher's page, as the browser has it; students use the same host and path. A host that
        only this computer reaches is replaced by its address in the network, if the server listens there.
    code
        Code of the class.
    """
    parts = urlsplit(page)
    host, problem = parts.netloc, ""
    if is_loopback(parts.hostname or ""):
        others = [] if _listening and is_loopback(_listening[0]) else own_addresses()
        if others:
            host = in_address(others[0], parts.port or 80)
        else:
            problem = HERE_ONLY
    scheme = parts.scheme if parts.scheme in {"http", "https"} else "http"
    return ClassLink(f"{scheme}://{host}{quote(parts.path or '/')}?{urlencode({FIELD: code})}", problem)


def code_of(query: str) -> str:
    """Return the code of a class in the query of an address, as it is there; empty without one."""
    try:
        fields = parse_qsl(query, max_num_fields=MOST_FIELDS)
    except ValueError:
        return ""
    return next((text for name, text in fields if name == FIELD), "")
