"""A phone that a test plays."""

from __future__ import annotations

import http.client
import json
import ssl
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from lab.live.phone.hub import Ticket
from lab.live.phone.server import PhoneServer

JSON = {"Content-Type": "application/json"}


class Reply(NamedTuple):
    """An answer of the server."""

    status: int
    headers: dict[str, str]
    body: bytes

    @property
    def said(self) -> dict[str, Any]:
        """The JSON in it."""
        return json.loads(self.body)


def untrusting() -> ssl.SSLContext:
    """Return a context that takes any certificate, as a browser after its warning."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    return context


def ask(
    address: str, body: bytes | None = None, headers: dict[str, str] | None = None, method: str = ""
) -> Reply:
    """Return the answer to a request: POST if it has a body, else GET."""
    at = urlsplit(address)
    connect = http.client.HTTPSConnection if at.scheme == "https" else http.client.HTTPConnection
    options: dict[str, Any] = {"context": untrusting()} if at.scheme == "https" else {}
    connection = connect(str(at.hostname), at.port, timeout=20, **options)
    try:
        connection.request(method or ("GET" if body is None else "POST"), at.path, body, headers or {})
        answer = connection.getresponse()
        return Reply(answer.status, {key.lower(): value for key, value in answer.getheaders()}, answer.read())
    finally:
        connection.close()


def batch(number: int, samples: int = 6, **others: Any) -> dict[str, Any]:
    """Return a batch of a phone at rest, face up, with 60 samples a second."""
    first = samples * number
    rows = [
        [1000 + (first + one) * 1000 / 60, 0.1, -0.2, 0.3, 0.0, 0.1, 9.8] for one in range(samples)
    ]  # time, rate, acceleration
    return {"number": number, "first": first, "imu": rows, "fix": [], "up": [0, 0, 1], **others}


def request(batches: list[dict[str, Any]], **others: Any) -> bytes:
    """Return the body of a request of the page."""
    said = {
        "device": "a-phone-of-a-test", "run": 1, "name": "Anna", "apple": False, "origin": 1.7e12,
        "oldest": 0, "waiting": len(batches), "batches": batches,
    }  # fmt: skip
    return json.dumps({**said, **others}).encode()


class Played:
    """A phone that was invited; what it sends, and what a reader gets."""

    def __init__(self, server: PhoneServer) -> None:
        self.hub = server.hub
        self.ticket: Ticket = server.hub.invite()
        invitation = server.invitation(self.ticket)
        self.page = invitation.address
        self.push = invitation.push_address

    def post(self, *batches: dict[str, Any], **others: Any) -> Reply:
        """Send batches as the page does."""
        return ask(f"{self.page}/samples", request(list(batches), **others), JSON)
