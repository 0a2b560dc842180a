"""Attacks by phones: requests of the page and of Sensor Logger, messages of SensorServer, and HTTP.

Whatever comes, nothing is raised, a line that is kept can be read again, and the next phone is answered.
"""

from __future__ import annotations

import copy
import http.client
import json
import math
import socket
import sys
import threading
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from fuzz.mutations import mutated
from fuzz.streams import attack_decoder
from played_phone import Played, batch, request, untrusting

from lab.data.protocols.catalogue import make_decoder
from lab.data.protocols.phone_line import LONGEST
from lab.data.streams.sensor_server import KINDS, SensorServerTransport
from lab.live.phone.app_request import parse_app_request
from lab.live.phone.hub import PhoneHub
from lab.live.phone.page_request import parse_page_request
from lab.live.phone.phone import Phone
from lab.live.phone.server import PhoneServer

START = 1698501144401773000  # ns since 1970
STEP = 10_000_000  # ns
VALUES = (
    None, True, 0, -1, 0.1, 1e15, -1e15, 1.1e15, 1e-300, -1.2345678901234567e-300, 2**53, 2**63, 10**400,
    math.inf, math.nan, "", "x", "é" * 100, "\0", "\ud800", [], [[]], [None] * 9, {}, {"x": 1},
)  # fmt: skip
"""What takes the place of a value of JSON."""
STATUSES = frozenset((200, 400, 403, 404, 405, 409, 411, 413, 415, 429, 501, 503))
"""What the server may answer: 500 is an exception that nobody caught, and that no log shows."""


def changed(body: bytes, rng: np.random.Generator) -> bytes:
    """Return a request, or lines of JSON, with other values, other bytes, or both."""
    if rng.random() < 0.7:
        lines = body.split(b"\n")
        at = int(rng.integers(len(lines)))
        said = json.loads(lines[at])
        for _ in range(int(rng.geometric(0.5))):
            _change(said, rng)
        lines[at] = json.dumps(said).encode()
        body = b"\n".join(lines)
    return mutated(body, rng) if rng.random() < 0.5 else body


def _change(said: Any, rng: np.random.Generator) -> None:
    """Change one value, at any depth; half of the time all of a list."""
    value = copy.deepcopy(VALUES[int(rng.integers(len(VALUES)))])
    while True:
        keys = list(said) if isinstance(said, dict) else list(range(len(said)))
        if not keys:
            return
        key = keys[int(rng.integers(len(keys)))]
        inner = said[key]
        if isinstance(inner, list) and inner and rng.random() < 0.1:
            said[key] = copy.deepcopy(inner * int(rng.integers(2, 60)))
            return
        if not isinstance(inner, dict | list) or not inner or rng.random() < 0.1:
            break
        said = inner
    if isinstance(said, list) and rng.random() < 0.5:
        said[:] = [copy.deepcopy(value) for _ in said]
    else:
        said[key] = value


def page_seed() -> bytes:
    """Return a request of the page."""
    fix = [1050.0, 1.7e12, 51.5, -0.1, 60.0, 6.0, 3.0, 2.0, 90.0]
    return request([batch(0), batch(1, fix=[fix]), batch(2)])


def logger_seed() -> bytes:
    """Return a request of Sensor Logger."""
    kinds = ("gyroscope", "totalacceleration", "accelerometer", "gravity", "magnetometer")
    payload: list[dict[str, Any]] = [
        {"name": name, "time": START + STEP * one, "values": {"x": 0.1, "y": 0.2, "z": 9.7}}
        for one in range(8)
        for name in kinds
    ]
    place = {
        "latitude": 51.5, "longitude": -0.1, "altitude": 60.0, "horizontalAccuracy": 6.0,
        "verticalAccuracy": 3.0, "speed": 2.0, "bearing": 90.0, "speedAccuracy": 0.5,
    }  # fmt: skip
    payload.append({"name": "location", "time": START + STEP, "values": place})
    said = {"messageId": 0, "sessionId": "identifier", "deviceId": "an-identifier", "payload": payload}
    return json.dumps(said).encode()


def server_seed() -> bytes:
    """Return messages of SensorServer, one a line."""
    return b"\n".join(
        json.dumps({"type": kind, "timestamp": START + STEP * one, "values": [0.1, 0.2, 9.7]}).encode()
        for one in range(4)
        for kind in KINDS
    )


def attack_page(body: bytes) -> bool:
    """Give a request of the page to a hub; return whether it was taken."""
    posted = parse_page_request(body)
    if posted is None:
        return False
    return _is_taken(posted.device, posted.name, lambda phone: phone.take_page_request(posted).status)


def attack_logger(body: bytes) -> bool:
    """Give a request of Sensor Logger to a hub; return whether it was taken."""
    pushed = parse_app_request(body)
    if pushed is None:
        return False
    return _is_taken(pushed.device, "", lambda phone: phone.take_app_request(pushed).status)


def _is_taken(device: str, name: str, take: Callable[[Phone], int]) -> bool:
    """Return whether the phone of a new hub takes a request, and check that what it keeps is read again."""
    hub = PhoneHub()
    ticket = hub.invite()
    phone = hub._phones[ticket.key]
    phone.start_reading()
    assert hub.claim(phone, device, name)
    return _is_read_again(hub, ticket.key, take(phone))


def _is_read_again(hub: PhoneHub, key: int, status: int) -> bool:
    phone = hub._phones[key]
    chunk = phone.read(0.0, lambda: True)
    hub.phones()
    if chunk is not None:
        _read_again(chunk.data)
    return status == 200


def _read_again(data: bytes) -> None:
    """Decode what is kept of a phone: no line of it is refused."""
    lines = data.splitlines(keepends=True)
    assert all(len(line) <= LONGEST for line in lines), f"a line of {max(map(len, lines))} bytes"
    attack_decoder("phone", data, max(len(data), 1))
    decoder = make_decoder("phone")
    decoder.feed(data)
    decoder.finish()
    seen = decoder.statistics
    assert (seen.frames, seen.failed, seen.skipped) == (len(lines), 0, 0)


def attack_server(messages: bytes) -> bool:
    """Let a hostile SensorServer send; return whether a line came of it."""

    class Sender:
        def __init__(self) -> None:
            self.left = messages.split(b"\n")

        def recv(self, timeout: float) -> bytes | str:
            if not self.left:
                raise TimeoutError
            one = self.left.pop(0)
            return one if len(self.left) % 2 else one.decode(errors="replace")

        def close(self) -> None:
            pass

    transport = SensorServerTransport("sensorserver:127.0.0.1:8080")
    transport._socket = Sender()
    taken = False
    while data := transport.read(0.0).data:
        _read_again(data)
        taken = True
    return taken


PUSHES: dict[str, tuple[Callable[[], bytes], Callable[[bytes], bool]]] = {
    "phone page": (page_seed, attack_page),
    "Sensor Logger": (logger_seed, attack_logger),
    "SensorServer": (server_seed, attack_server),
}
"""What sends: a good request, and the attack with another one."""
PHONE_SERVER = "phone server"


def besiege_phones(
    folder: Path,
    rng: np.random.Generator,
    enough: Callable[[int], bool],
    broken: Callable[[str, bytes], None],
) -> Counter[int]:
    """Attack a server for phones by HTTP until it is enough; return how often it answered what.

    Parameters
    ----------
    folder
        Where its certificate is kept.
    rng
        Says what is sent.
    enough
        Says after a number of attacks whether it is enough.
    broken
        Told what did not hold, and the request.
    """
    answers: Counter[int] = Counter()
    with PhoneServer(PhoneHub(), folder=folder, push_port=0) as server:
        threads = threading.active_count()
        played = Played(server)
        while not enough(answers.total()):
            if answers.total() % 40 == 39:  # the pace of one phone is bounded
                server.hub.forget(played.ticket.key)
                played = Played(server)
            sent, status = _ask_anything(played, rng)
            answers[status] += 1
            if status and status not in STATUSES:
                broken(f"the server answered {status}", sent)
        other = Played(server)
        answer = other.post(batch(0))
        if answer.status != 200 or answer.said["received"] != 0:
            broken(f"the next phone was answered {answer.status}", b"")
        if threading.active_count() > threads:
            broken("threads are left", b"")
    return answers


def _ask_anything(played: Played, rng: np.random.Generator) -> tuple[bytes, int]:
    """Send a request, or what is none; return it, and the status of the answer: 0 for none."""
    page = rng.random() < 0.5
    address = f"{played.page}/samples" if page else played.push
    at = urlsplit(address)
    body = changed(page_seed() if page else logger_seed(), rng)
    if rng.random() < 0.05:
        body *= int(rng.integers(2, 400))
    path = at.path.encode()
    if rng.random() < 0.2:
        path = path[:30] + mutated(path[30:], rng)
    kind = b"application/json" if rng.random() < 0.9 else b"text/plain"
    size = len(body) if rng.random() < 0.9 else int(rng.choice((0, 1, 5, 2**20, 2**40)))
    head = b"POST " + path + b" HTTP/1.1\r\nHost: " + at.netloc.encode() + b"\r\nConnection: close\r\n"
    head += b"Content-Type: " + kind + b"\r\nContent-Length: " + str(size).encode() + b"\r\n\r\n"
    if rng.random() < 0.2:
        head = mutated(head, rng)
    return head + body, _answered(at.scheme == "https", int(at.port or 0), head + body)


def _answered(secure: bool, port: int, sent: bytes) -> int:
    """Return the status of the answer to some bytes; 0 if the connection was closed without one."""
    with socket.create_connection(("127.0.0.1", port), timeout=20) as plain:
        way = untrusting().wrap_socket(plain, server_hostname="localhost") if secure else plain
        try:
            way.sendall(sent)
            if not secure:
                way.shutdown(socket.SHUT_WR)
            else:
                way.settimeout(1)  # a request that is announced longer than it is never ends
            answer = http.client.HTTPResponse(way)
            answer.begin()
        except (OSError, http.client.HTTPException):
            return 0
        else:
            return answer.status
        finally:
            way.close()
