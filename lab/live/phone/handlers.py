"""Handlers: what the phone server answers to each request."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from functools import cache
from pathlib import Path
from typing import Any, Final

from tornado.web import HTTPError, RequestHandler, stream_request_body

from lab.live.phone.app_request import parse_app_request
from lab.live.phone.hub import PhoneHub
from lab.live.phone.limits import BODY, Connections
from lab.live.phone.page_request import parse_page_request
from lab.live.phone.phone import BAD, FOREIGN, Answer, Phone

PAGE: Final = Path(__file__).with_name("page.html")
_INLINE: Final = re.compile(r"<(script|style)>(.*?)</\1>", re.DOTALL)
_TOO_LARGE: Final = 413  # of HTTP: content too large
_TOO_MANY: Final = 429  # of HTTP: too many requests; the server's own errors are above it
_WRONG_TYPE: Final = 415  # of HTTP: unsupported media type
_BACK_OFF: Final = "1"
"""Seconds after which a refused phone may try again."""
_REASONS: Final = {
    FOREIGN: "This address has expired or belongs to another phone. Ask for a new QR code.",
    404: "There is nothing here.",
    405: "This cannot be done here.",
    _TOO_LARGE: "Too much at once.",
    _WRONG_TYPE: "Only JSON is accepted here.",
}
"""What a person is told, by the status of HTTP."""


@cache
def page() -> tuple[bytes, str]:
    """Return the page for phones and its content security policy: only its own script and style may run."""
    text = PAGE.read_text(encoding="utf-8")
    hashes: dict[str, str] = {}
    for kind, content in _INLINE.findall(text):
        hashes[kind] = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
    policy = (
        f"default-src 'none'; script-src 'sha256-{hashes['script']}'; style-src 'sha256-{hashes['style']}'; "
        "connect-src 'self'; img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    return text.encode(), policy


class PhoneHandler(RequestHandler):
    """Answers in plain text, says nothing of the server, and allows no other site anything."""

    def initialize(self, hub: PhoneHub, connections: Connections) -> None:
        """Take the hub and the open connections."""
        self.hub = hub
        self.connections = connections

    def phone_of(self, token: str) -> Phone | None:
        """Return the phone of a token, whose connection this is from now on; None if it is not valid."""
        phone = self.hub.phone_of(token)
        if phone is not None:
            self.connections.used_by(getattr(self.request.connection, "stream", None), phone.key)
        return phone

    def set_default_headers(self) -> None:
        """Set the headers of all answers."""
        self.clear_header("Server")
        for name, value in {
            "Cache-Control": "no-store",
            "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
            "Content-Type": "text/plain; charset=utf-8",
            "Cross-Origin-Opener-Policy": "same-origin",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Permissions-Policy": "accelerometer=(self), gyroscope=(self), magnetometer=(self), "
            "geolocation=(self), screen-wake-lock=(self), camera=(), microphone=()",
            "Referrer-Policy": "no-referrer",  # addresses hold the token
            "X-Content-Type-Options": "nosniff",
        }.items():
            self.set_header(name, value)

    def compute_etag(self) -> None:
        """Make no tags of answers."""

    def write_error(self, status_code: int, **kwargs: Any) -> None:
        """Write a reason for people."""
        self.finish(f"{_REASONS.get(status_code, 'This did not work.')}\n")

    def log_exception(self, *_: Any) -> None:
        """Write nothing: whoever is refused shall not fill the log, and addresses hold tokens."""


class NothingHandler(PhoneHandler):
    """Answers 404 to all that is not served."""

    def prepare(self) -> None:
        """Refuse."""
        raise HTTPError(404)


class PageHandler(PhoneHandler):
    """The page, for everyone with a token that is valid; opening it claims nothing."""

    def get(self, token: str) -> None:
        """Give the page."""
        if self.phone_of(token) is None:
            raise HTTPError(FOREIGN)
        text, policy = page()
        self.set_header("Content-Type", "text/html; charset=utf-8")
        self.set_header("Content-Security-Policy", policy)
        self.finish(text)


@stream_request_body
class BodyHandler(PhoneHandler):
    """A request with a body, which is kept only if the token is valid and the body is not too large.

    What is refused is still read, and thrown away: a browser that sends while the connection is closed never
    sees the answer.
    """

    def prepare(self) -> None:
        """Decide by the head of the request."""
        self._kept: list[bytes] = []
        self._size = 0
        self._phone = self.phone_of(self.path_args[0])
        kind = self.request.headers.get("Content-Type", "").partition(";")[0].strip()
        self._refusal = 0
        if self._phone is None or not self._is_own_origin():
            self._refusal = FOREIGN
        elif kind != "application/json":  # others may be sent by any site, without being asked
            self._refusal = _WRONG_TYPE

    def data_received(self, chunk: bytes) -> None:
        """Take a piece of the body."""
        self._size += len(chunk)
        if self._size > BODY and not self._refusal:
            self._refusal = _TOO_LARGE
        if self._refusal:
            self._kept.clear()
        else:
            self._kept.append(chunk)

    def accepted(self) -> tuple[Phone, bytes]:
        """Return the phone and the whole body, or refuse."""
        if self._refusal or self._phone is None:
            raise HTTPError(self._refusal)
        return self._phone, b"".join(self._kept)

    def answer(self, phone: Phone, given: Answer) -> None:
        """Write an answer as JSON."""
        self.set_status(given.status)
        if given.status >= _TOO_MANY:
            self.set_header("Retry-After", _BACK_OFF)
        self.set_header("Content-Type", "application/json")
        said = {"received": given.received, "read": given.read, "name": phone.name}
        self.finish(json.dumps({**said, "reason": given.reason}))

    def _is_own_origin(self) -> bool:
        origin = self.request.headers.get("Origin")
        return origin is None or origin.partition("://")[2] == self.request.host


class SamplesHandler(BodyHandler):
    """Batches of the page."""

    def post(self, _token: str) -> None:
        """Take them."""
        phone, body = self.accepted()
        posted = parse_page_request(body)
        if posted is None:
            self.answer(phone, Answer(BAD, reason="this is no batch of samples"))
        elif not self.hub.claim(phone, posted.device, posted.name):
            raise HTTPError(FOREIGN)
        else:
            self.answer(phone, phone.take_page_request(posted))


class PushHandler(BodyHandler):
    """Readings of the app Sensor Logger."""

    def post(self, _token: str) -> None:
        """Take them."""
        phone, body = self.accepted()
        pushed = parse_app_request(body)
        if pushed is None:
            self.answer(phone, Answer(BAD, reason="these are no readings of Sensor Logger"))
        elif not self.hub.claim(phone, pushed.device, ""):
            raise HTTPError(FOREIGN)
        else:
            self.answer(phone, phone.take_app_request(pushed))
