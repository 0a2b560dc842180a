"""Headers: what every answer tells a browser to refuse: scripts of others, and frames elsewhere."""

from __future__ import annotations

import re
import secrets

from tornado.httputil import HTTPHeaders, HTTPServerRequest
from tornado.web import OutputTransform

_HOST = re.compile(r"[\w.:\[\]-]{1,260}", re.ASCII)
_SCRIPT = re.compile(rb"<script(?=[\s>])", re.IGNORECASE)


class SecurityHeaders(OutputTransform):
    """Adds the headers to an answer, and lets the scripts of a document run that the server itself wrote.

    A document is a few scripts with the state of the page in them. Each gets a number drawn for this answer;
    a browser runs no other script that is written in the document, nor one in an attribute of a tag. Nothing
    from outside is a tag in the document as it is sent: texts arrive later, as data.
    """

    def __init__(self, request: HTTPServerRequest) -> None:
        self._sockets = sockets(request)

    def transform_first_chunk(
        self, status_code: int, headers: HTTPHeaders, chunk: bytes, finishing: bool
    ) -> tuple[int, HTTPHeaders, bytes]:
        """Add what is missing."""
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


def sockets(request: HTTPServerRequest) -> str:
    """Return where websockets of a page lead: not every browser takes this for the server itself."""
    host = request.host if _HOST.fullmatch(request.host) else ""
    return f"ws://{host} wss://{host}" if host else ""


def policy(scripts: str, sockets: str = "") -> str:
    """Return a content security policy.

    Parameters
    ----------
    scripts
        Which scripts within a document may run, beside the files of the server.
    sockets
        Where websockets may lead, beside what a browser takes for the server itself.
    """
    return "; ".join(
        (
            "default-src 'self'",
            # Bokeh makes functions of the texts of its CustomJS, Panel modules of those of its components.
            f"script-src 'self' blob: 'unsafe-eval' {scripts}",
            "style-src 'self' 'unsafe-inline'",  # components write their styles as they are drawn
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
