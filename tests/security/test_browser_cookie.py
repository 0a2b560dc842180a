"""The cookie that pages of one browser have in common, and who counts as whoever serves."""

from __future__ import annotations

import re
from http.client import HTTPConnection
from types import SimpleNamespace
from typing import Any, cast

import pytest
from tornado.httputil import HTTPHeaders, HTTPServerRequest, RequestStartLine
from tornado.websocket import WebSocketHandler

from dashboards.browser import COOKIE, is_of_server, known_by
from tests.security.conftest import Served

FIRST, SECOND = "a" * 43, "b" * 43


def cookies(served: Served, path: str = "/", cookie: str = "") -> list[str]:
    """Return the cookies that an answer sets."""
    way = HTTPConnection("127.0.0.1", served.port, timeout=60)
    way.request("GET", path, headers={"Cookie": cookie} if cookie else {})
    answer = way.getresponse()
    answer.read()
    return [value for name, value in answer.getheaders() if name == "Set-Cookie"]


@pytest.mark.proof
def test_a_browser_gets_a_random_cookie_once(served: Served) -> None:
    name = f"{COOKIE}_{served.port}"
    found = [cookies(served) for _ in range(2)]
    assert [len(one) for one in found] == [1, 1]
    (first,), (second,) = found
    for one in (first, second):
        assert re.fullmatch(rf"{name}=[\w-]{{43}}; HttpOnly; Path=/; SameSite=Lax", one)
    assert first != second
    own = first.partition(";")[0]
    assert cookies(served, cookie=own) == []
    for wrong in (f"{name}=", f"{name}=short", f"{name}={'x' * 500}", f"{COOKIE}_1={FIRST}", "other=1"):
        assert len(cookies(served, cookie=wrong)) == 1
    for path in ("/static/js/bokeh.min.js", "/favicon.ico", "/metadata"):
        assert cookies(served, path) == []


def request(remote: str = "192.0.2.7", cookie: str = "", **headers: str) -> HTTPServerRequest:
    """Return the request of a websocket."""
    given = HTTPHeaders({"Host": "lab.example.org:5006", **headers})
    if cookie:
        given["Cookie"] = cookie
    connection = SimpleNamespace(context=SimpleNamespace(remote_ip=remote, protocol="http"))
    line = RequestStartLine("GET", "/ws", "HTTP/1.1")
    return HTTPServerRequest(headers=given, connection=cast(Any, connection), start_line=line)


def socket(asked: HTTPServerRequest) -> WebSocketHandler:
    """Return a websocket at port 5006."""
    stream = SimpleNamespace(socket=SimpleNamespace(getsockname=lambda: ("127.0.0.1", 5006)))
    return cast(
        WebSocketHandler, SimpleNamespace(request=asked, ws_connection=SimpleNamespace(stream=stream))
    )


def test_pages_of_a_browser_are_one_visitor_and_pages_without_a_cookie_share_the_places_of_a_computer() -> (
    None
):
    tab, other_tab = (known_by(socket(request(cookie=f"{COOKIE}_5006={FIRST}")), f"page {n}") for n in (1, 2))
    assert tab == other_tab
    other = known_by(socket(request(cookie=f"{COOKIE}_5006={SECOND}")), "page 3")
    assert other.identity != tab.identity
    assert other.counted != tab.counted
    for cookie in ("", f"{COOKIE}_5007={FIRST}", f"{COOKIE}_5006=a b", f"{COOKIE}_5006={'ä' * 43}"):
        one, two = (known_by(socket(request(cookie=cookie)), f"page {n}") for n in (1, 2))
        assert (one.identity, two.identity) == ("page 1", "page 2")
        assert one.counted == two.counted == "computer 192.0.2.7"


@pytest.mark.parametrize(
    ("remote", "headers", "serves"),
    [
        ("127.0.0.1", {"Host": "127.0.0.1:5006", "Origin": "http://127.0.0.1:5006"}, True),
        ("::1", {"Host": "[::1]:5006", "Origin": "http://localhost:5006"}, True),
        ("127.0.0.1", {"Host": "localhost:5006"}, True),
        ("192.0.2.7", {"Host": "localhost:5006", "Origin": "http://localhost:5006"}, False),
        ("127.0.0.1", {"Host": "localhost:5006", "X-Forwarded-For": "127.0.0.1"}, False),
        ("127.0.0.1", {"Host": "localhost:5006", "x-forwarded-proto": "https"}, False),
        ("127.0.0.1", {"Host": "localhost:5006", "Forwarded": "for=127.0.0.1"}, False),
        ("127.0.0.1", {"Host": "localhost:5006", "X-Real-IP": "127.0.0.1"}, False),
        ("127.0.0.1", {"Host": "localhost:5006", "Via": "1.1 proxy"}, False),
        # A proxy that adds no header keeps the origin, which is its own name.
        ("127.0.0.1", {"Host": "localhost:5006", "Origin": "https://lab.example.org"}, False),
        ("127.0.0.1", {"Host": "lab.example.org"}, False),
        ("127.0.0.1", {"Host": "localhost:5006", "Origin": "null"}, False),
        ("127.0.0.1", {"Host": "localhost:5006", "Origin": "http://["}, False),
    ],
)
def test_whoever_serves_sits_at_the_server(remote: str, headers: dict[str, str], serves: bool) -> None:
    asked = request(remote, f"{COOKIE}_5006={FIRST}", **headers)
    assert is_of_server(asked) == serves
    known = known_by(socket(asked), "page 1")
    assert (known.counted == "") == serves
    assert known.identity == f"browser {FIRST}"
