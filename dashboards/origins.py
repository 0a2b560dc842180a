"""Origins: the pages that may connect to the server: its own, under its host names and addresses.

Pages of other sites get nothing that costs a session: no document but one that a person opens, and no script
with a page in it.
"""

from __future__ import annotations

import ipaddress
import logging
import socket
import time
from collections.abc import Iterable
from typing import Any
from urllib.parse import urlsplit

from bokeh.server.urls import per_app_patterns
from bokeh.server.util import check_allowlist
from bokeh.util.token import check_token_signature, get_token_payload
from panel.io.server import AutoloadJsHandler, DocHandler, WSHandler
from tornado.httputil import HTTPServerRequest
from tornado.web import Application, HTTPError

from dashboards.upstream.server import has_session

log = logging.getLogger(__name__)

SETTING = "ins_lab_origins"
"""Key of the accepted hosts, each with its port, in the settings of the web application."""

WEB_PORT = 80
"""Port of an origin without a port; as in Bokeh, for https too."""


class OriginError(ValueError):
    """The given text is not an origin."""


def accepted_hosts(address: str, port: int, more: Iterable[str] = ()) -> frozenset[str]:
    """Return the hosts, each with a port, whose pages may connect to a server.

    Addresses of this computer need not be among them: see `is_accepted`.

    Parameters
    ----------
    address
        Name or address that the server listens on.
    port
        Port it listens on.
    more
        Further hosts, as ``lab.example.org`` or ``lab.example.org:8443``; one without a port is accepted with
        the server's port and with the usual port of the web.

    Raises
    ------
    OriginError
        If one of the origins is not a host.
    """
    names = {"localhost", "127.0.0.1", "::1", address.lower()} - {"", "0.0.0.0", "::"}
    if not is_loopback(address):
        name = socket.gethostname().lower()
        names |= {name, name.partition(".")[0], f"{name.partition('.')[0]}.local"}
    hosts = {_with_port(name, port) for name in names}
    for origin in more:
        host, own_port = _parse_origin(origin)
        hosts |= {_with_port(host, one) for one in ((port, WEB_PORT) if own_port is None else (own_port,))}
    return frozenset(hosts)


def is_loopback(address: str) -> bool:
    """Return whether only this computer can reach a server that listens on an address."""
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return address.lower() == "localhost"


def is_from_accepted(request: HTTPServerRequest, application: Application) -> bool:
    """Return whether a request comes from an accepted page, or from no page at all.

    Tornado's own check accepts any request whose origin equals its host. If a foreign host name resolves to
    this computer, the requests of the foreign page satisfy that check (DNS rebinding).
    """
    origin = request.headers.get("Origin")
    return origin is None or is_accepted(origin, request, application)


def is_accepted(origin: str, request: HTTPServerRequest, application: Application) -> bool:
    """Return whether a page of an origin may connect to the server.

    It may if its host was configured, or if its host is the local address at which the request arrived. No
    name is looked up, because a foreign name may resolve to this computer.
    """
    try:
        host, port = _parse_origin(origin)
    except OriginError:
        return False
    if urlsplit(origin).scheme not in {"http", "https"}:
        return False
    port = WEB_PORT if port is None else port
    told = {*application.settings.get(SETTING, ()), *getattr(application, "websocket_origins", ())}
    return check_allowlist(_with_port(host, port), sorted(told)) or (host, port) == _reached_address(request)


def _reached_address(request: HTTPServerRequest) -> tuple[str, int] | None:
    """Return the local address and port at which a request arrived."""
    stream: Any = getattr(request.connection, "stream", None)
    try:
        address, port, *_ = stream.socket.getsockname()
        return _canonical_host(address), int(port)
    except (AttributeError, OSError, ValueError):  # closed meanwhile, or not an internet socket
        return None


def _parse_origin(origin: str) -> tuple[str, int | None]:
    """Return the host and the port of an origin, with or without its scheme."""
    refusal = OriginError(
        f"{origin!r} is not a host of a page; accepted are such as lab.example.org and 192.0.2.7:8443"
    )
    try:
        parts = urlsplit(origin if "://" in origin else f"//{origin}")
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise refusal from error
    more = parts.path.strip("/") or parts.query or parts.fragment or parts.username is not None
    if not host or more or not all(sign.isalnum() or sign in "-._:" for sign in host):
        raise refusal
    return _canonical_host(host), port


def _canonical_host(host: str) -> str:
    """Return a host in canonical form; an IPv4-mapped IPv6 address becomes the IPv4 address."""
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return host.lower()
    return str(getattr(address, "ipv4_mapped", None) or address)


def _with_port(host: str, port: int) -> str:
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


class PageSocket(WSHandler):
    """The websocket of a page; it opens only for accepted origins, and for the token of a page."""

    async def get(self, *args: Any, **kwargs: Any) -> None:
        """Open the websocket if the origin and the token are accepted."""
        if not is_from_accepted(self.request, self.application):
            origin = self.request.headers["Origin"]
            log.warning("a page of %.200r was refused; `--origin HOST` accepts one more", origin)
            raise HTTPError(403)
        if self.request.headers.get("Upgrade", "").lower() == "websocket" and not self._has_token():
            raise HTTPError(403, "a websocket without a token of this server, or with one that has expired")
        await super().get(*args, **kwargs)

    def _has_token(self) -> bool:
        """Return whether the request has the signed token of a page that was opened a short time ago."""
        offered = self.request.headers.get("Sec-WebSocket-Protocol", "").split(",")
        protocol, token = (*map(str.strip, offered), "", "")[:2]
        served: Any = self.application
        try:
            is_signed = check_token_signature(token, served.secret_key, served.sign_sessions)
            expires = get_token_payload(token)["session_expiry"] if is_signed else 0
            return protocol == "bokeh" and time.time() < expires
        except (KeyError, TypeError, ValueError):
            return False

    def check_origin(self, origin: str) -> bool:
        """Accept every origin, because the origin was checked before."""
        return True

    def on_close(self) -> None:
        """End the connection, unless a ping did, which found the page gone before its socket was closed."""
        if self.connection is not None and has_session(self.connection):
            super().on_close()

    def _protocol_error(self, message: str) -> None:
        """Close with a valid close code; with Bokeh's invalid one, browsers wait for another."""
        log.warning("the websocket of a page is closed: %s", message)
        self.close(1008, message)

    _internal_error = _protocol_error


class PageDocument(DocHandler):
    """The document of a page; no part of a page of another site is answered with it."""

    async def prepare(self) -> None:
        """Refuse what a page of another site loads by itself: a picture, a script, a frame.

        Browsers say so on encrypted connections and to this computer (Fetch Metadata Request Headers).
        """
        headers = self.request.headers
        is_own = headers.get("Sec-Fetch-Site", "none") in {"none", "same-origin"}
        if not is_own and headers.get("Sec-Fetch-Dest") != "document":
            raise HTTPError(403)
        await super().prepare()  # type: ignore[no-untyped-call]


def check_origins_of_pages() -> None:
    """Make servers created from now on check origins here; Bokeh's own check compares names only.

    They have no script with a page in it either, by which other sites show pages as their own.
    """
    own: dict[type[Any], type[Any]] = {WSHandler: PageSocket, DocHandler: PageDocument}
    per_app_patterns[:] = [
        (pattern, own.get(kind, kind))
        for pattern, kind, *_ in per_app_patterns
        if not issubclass(kind, AutoloadJsHandler)
    ]
