"""Browser: which pages belong to one browser, and which of them is that of the person who serves.

A random cookie is what the pages of a browser have in common. It identifies nobody, and gives no right but to
what its browser opened. A browser that takes no cookies has a page for a visitor, and the limits of its
computer.
"""

from __future__ import annotations

import re
import secrets
from typing import NamedTuple
from urllib.parse import urlsplit

from bokeh.document import Document
from tornado.httputil import HTTPHeaders, HTTPServerRequest
from tornado.web import OutputTransform
from tornado.websocket import WebSocketHandler

from dashboards.forwarded import computer, is_encrypted
from dashboards.origins import is_loopback
from dashboards.upstream.server import TransformedPages, page_socket
from lab.live.owner import Visitor

COOKIE = "ins_lab_browser"
"""Name of the cookie, before the port: browsers give the cookies of a host to all its ports."""
_RANDOM = re.compile(r"[\w-]{43}", re.ASCII)
"""What `secrets.token_urlsafe` makes of 32 bytes."""
_OF_PROXIES = ("forwarded", "via", "x-real-ip")
"""Headers of a proxy, beside those that begin with ``x-forwarded``."""


class BrowserCookie(OutputTransform):
    """Gives a page's browser its cookie, unless it has one."""

    def __init__(self, request: HTTPServerRequest) -> None:
        self._name = _name(getattr(request.connection, "stream", None))
        self._has_one = _cookie(request, self._name) != ""
        self._is_secure = is_encrypted(request)

    def transform_first_chunk(
        self, status_code: int, headers: HTTPHeaders, chunk: bytes, finishing: bool
    ) -> tuple[int, HTTPHeaders, bytes]:
        """Add the cookie, which ends with the browser."""
        if not self._has_one:
            secure = "; Secure" if self._is_secure else ""
            value = secrets.token_urlsafe(32)
            headers.add("Set-Cookie", f"{self._name}={value}; HttpOnly; Path=/; SameSite=Lax{secure}")
        return status_code, headers, chunk


REMEMBERED = TransformedPages(BrowserCookie)
"""Pages whose browsers are known again."""


class _Known(NamedTuple):
    identity: str
    counted: str


class Browser:
    """The browser of one page.

    Parameters
    ----------
    document
        Document of the page.
    """

    def __init__(self, document: Document) -> None:
        self._document = document
        self._alone = f"page {secrets.token_urlsafe(16)}"
        self._known: _Known | None = None

    def visitor(self, school_class: str, *, teaches: bool) -> Visitor:
        """Return who uses the page.

        Parameters
        ----------
        school_class
            Code of the class that the page attends or leads; empty outside of a class.
        teaches
            Whether it is the page of a teacher, who has no limit.
        """
        known = self._known or self._look()
        return Visitor(known.identity, school_class, teaches, "" if teaches else known.counted)

    def _look(self) -> _Known:
        """Return what the websocket of the page says, which the browser opened with its new cookie."""
        if self._document.session_context is None:  # without a server
            return _Known(self._alone, "")
        socket = page_socket(self._document)
        if socket is None:
            return _Known(self._alone, self._alone)
        self._known = known_by(socket, self._alone)
        return self._known


def known_by(socket: WebSocketHandler, alone: str) -> _Known:
    """Return by what the browser behind a websocket is known, and whose places it takes.

    Parameters
    ----------
    socket
        The websocket.
    alone
        Identity of a page whose browser has no cookie.
    """
    request: HTTPServerRequest = socket.request
    cookie = _cookie(request, _name(getattr(socket.ws_connection, "stream", None)))
    if is_of_server(request):
        counted = ""
    else:
        counted = f"browser {cookie}" if cookie else f"computer {computer(request)}"
    return _Known(f"browser {cookie}" if cookie else alone, counted)


def is_of_server(request: HTTPServerRequest) -> bool:
    """Return whether a request comes from the computer of the server, and not through a proxy.

    Some proxies add no header. Then the names by which the browser knows the page are those of the proxy.
    """
    names = [name.lower() for name in request.headers]
    if any(name in _OF_PROXIES or name.startswith("x-forwarded") for name in names):
        return False
    hosts = [request.headers.get("Host", ""), request.headers.get("Origin", "")]
    return is_loopback(str(request.remote_ip)) and all(_is_here(host) for host in hosts if host)


def _is_here(place: str) -> bool:
    """Return whether a host, or an origin, is this computer for itself only."""
    try:
        host = urlsplit(place if "://" in place else f"//{place}").hostname
    except ValueError:
        return False
    return is_loopback(host or "")


def _cookie(request: HTTPServerRequest, name: str) -> str:
    """Return the cookie of a browser; empty if it has none that a server made."""
    found = request.cookies.get(name)
    return found.value if found is not None and _RANDOM.fullmatch(found.value) else ""


def _name(stream: object) -> str:
    """Return the name of the cookie for a connection of the server."""
    socket = getattr(stream, "socket", None)
    try:
        _, port, *_ = socket.getsockname()  # type: ignore[union-attr]
    except (AttributeError, OSError, ValueError):  # closed meanwhile, or not an internet socket
        return COOKIE
    return f"{COOKIE}_{port}"
