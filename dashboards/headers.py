"""Headers: HTTP headers that make a browser refuse foreign scripts and frames on other sites."""

from __future__ import annotations

import re
import secrets
from http import HTTPStatus

from tornado.httputil import HTTPHeaders, HTTPServerRequest
from tornado.web import OutputTransform

from dashboards.upstream.server import TransformedPages

_HOST = re.compile(r"[\w.:-]{1,260}", re.ASCII)
"""Hosts that a policy can name; an IPv6 address is none (Content Security Policy Level 3, 2.3.1)."""
_SCRIPT = re.compile(rb"<script(?=[\s>])", re.IGNORECASE)


class SecurityHeaders(OutputTransform):
    """Adds the headers to a response, and allows the scripts that the server itself wrote.

    A document consists of a few scripts with the state of the page. Each gets a random nonce for this
    response. A browser runs no other inline script, and no script in an attribute of a tag. The document
    contains no tags from outside: texts arrive later, as data.
    """

    def __init__(self, request: HTTPServerRequest) -> None:
        self._sockets = sockets(request)

    def transform_first_chunk(
        self, status_code: int, headers: HTTPHeaders, chunk: bytes, finishing: bool
    ) -> tuple[int, HTTPHeaders, bytes]:
        """Add the headers and the nonces."""
        headers.setdefault("X-Content-Type-Options", "nosniff")
        headers.setdefault("Referrer-Policy", "same-origin")
        if "Content-Security-Policy" not in headers:
            number = secrets.token_urlsafe(16)
            headers["Content-Security-Policy"] = policy(f"'nonce-{number}'", self._sockets)
            if finishing and headers.get("Content-Type", "").startswith("text/html"):
                chunk = _SCRIPT.sub(f'<script nonce="{number}"'.encode(), chunk)
                if "Content-Length" in headers:
                    headers["Content-Length"] = str(len(chunk))
        return status_code, headers, chunk


class OneRequest(OutputTransform):
    """Has the next request come over another connection, which may lead to another process."""

    def __init__(self, request: HTTPServerRequest) -> None:
        pass

    def transform_first_chunk(
        self, status_code: int, headers: HTTPHeaders, chunk: bytes, finishing: bool
    ) -> tuple[int, HTTPHeaders, bytes]:
        """Announce the end of the connection, unless it becomes a websocket."""
        if status_code != HTTPStatus.SWITCHING_PROTOCOLS:
            headers["Connection"] = "close"
        return status_code, headers, chunk


PROTECTED = TransformedPages(SecurityHeaders)
"""Pages that have the headers on any server, such as that of ``panel serve``."""


def sockets(request: HTTPServerRequest) -> str:
    """Return the websocket addresses of a page: not every browser counts them as 'self'."""
    host = request.host if _HOST.fullmatch(request.host) else ""
    return f"ws://{host} wss://{host}" if host else ""


def policy(scripts: str, sockets: str = "") -> str:
    """Return a content security policy.

    Parameters
    ----------
    scripts
        Inline scripts that may run, besides the files of the server.
    sockets
        Addresses of websockets that are allowed besides 'self'.
    """
    return "; ".join(
        (
            "default-src 'self'",
            # Bokeh compiles the text of its CustomJS to functions, and Panel that of its components to
            # modules.
            f"script-src 'self' blob: 'unsafe-eval' {scripts}",
            "style-src 'self' 'unsafe-inline'",  # components set inline styles when drawn
            "img-src 'self' data: blob:",
            "font-src 'self' data:",
            f"connect-src 'self' data: blob: {sockets}".rstrip(),
            "worker-src 'self' blob:",
            "object-src 'none'",
            "base-uri 'self'",
            "form-action 'self'",
            "frame-ancestors 'self'",
        )
    )
