"""Only pages of the server itself may talk to it, under the names and addresses it is reached by."""

from __future__ import annotations

import json
import socket
from http.client import HTTPConnection
from types import SimpleNamespace

import pytest
from bokeh.util.token import generate_jwt_token
from tornado.web import Application
from websockets.exceptions import InvalidStatus

from dashboards.origins import SETTING, OriginError, accepted_hosts, is_accepted
from tests.security.conftest import Served, own_addresses

NAME = socket.gethostname().lower()


@pytest.fixture(scope="module")
def token(served: Served) -> str:
    return served.token()


def answer(
    served: Served, run, token: str, origin: str, host: str = "127.0.0.1", named: str = ""
) -> str | int:
    """Return the first message a page of an origin is sent, or the status it is refused with."""

    async def ask() -> str | int:
        try:
            async with served.socket(token, origin, host, named) as way:
                return str(json.loads(await way.recv())["msgtype"])
        except InvalidStatus as error:
            return error.response.status_code

    return run(ask())


@pytest.mark.parametrize(
    "origin",
    [
        "http://127.0.0.1:{}",
        "http://localhost:{}",
        "http://[::1]:{}",
        f"http://{NAME}:{{}}",
        "https://lab.example.org",
    ],
)
def test_pages_of_the_server_get_their_document(served: Served, run, token: str, origin: str) -> None:
    assert answer(served, run, token, origin.format(served.port)) == "ACK"


def test_the_address_a_browser_came_by_is_an_origin(served: Served, run, token: str) -> None:
    addresses = own_addresses()
    if not addresses:
        pytest.skip("this computer has no address but loopback")
    assert answer(served, run, token, f"http://{addresses[0]}:{served.port}", addresses[0]) == "ACK"
    assert answer(served, run, token, f"http://{addresses[0]}:{served.port}", "127.0.0.1") == 403


@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "http://evil.example:{}", "http://127.0.0.1:1", "http://192.0.2.7:{}", "null"],
)
def test_pages_of_strangers_are_refused_on_all_addresses(
    served: Served, run, token: str, origin: str
) -> None:
    assert answer(served, run, token, origin.format(served.port)) == 403


def test_a_stranger_whose_name_leads_here_is_refused(served: Served, run, token: str) -> None:
    """The browser takes the stranger's page and this server for one origin."""
    name = "evil.example"
    assert answer(served, run, token, f"http://{name}:{served.port}", named=name) == 403


def test_a_token_made_elsewhere_opens_no_websocket(served: Served) -> None:
    """Of other keys, of no session, changed, and none; by hand, because no client sends all of them."""
    others = [generate_jwt_token("mine.x", secret_key=b"k" * 32, signed=signed) for signed in (False, True)]
    own, before = served.token(), len(served.log.read_text())
    changed = [own[:-2], own.swapcase(), own.partition(".")[0]]
    offers = [f"bokeh, {token}" for token in (*others, *changed, "x", "a.b", "", "é")]
    for offer in (*offers, f"x, {own}", own, "bokeh", "", f"bokeh, {own}"):
        way = HTTPConnection("127.0.0.1", served.port, timeout=60)
        upgrade = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13"}
        named = {"Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Protocol": offer}
        way.request("GET", "/ws", headers=upgrade | named)
        assert way.getresponse().status == (101 if offer == f"bokeh, {own}" else 403), offer
        way.close()
    assert "Traceback" not in served.log.read_text()[before:]


FOREIGN = {"Sec-Fetch-Site": "cross-site"}
"""What a browser tells with a request that a page of another site makes."""
LOADED = [
    ("GET", "/", FOREIGN | {"Sec-Fetch-Dest": "image"}),
    ("GET", "/?seed=7", FOREIGN | {"Sec-Fetch-Dest": "iframe"}),
    (
        "GET",
        "/",
        {"Sec-Fetch-Site": "same-site", "Sec-Fetch-Dest": "script"},
    ),  # another port of this computer
    ("GET", "/autoload.js?bokeh-autoload-element=1", FOREIGN | {"Sec-Fetch-Dest": "script"}),
    ("GET", "/autoload.js?bokeh-autoload-element=1", {}),
    ("OPTIONS", "/autoload.js", {}),
    ("GET", "/ws", {"Origin": "http://evil.example"}),
    ("GET", "/ws", {"Origin": "http://["}),
    ("GET", "/metadata?x", {"Origin": "http://evil.example", "bokeh-session-id": "1"}),
]
"""What any site can make the browser of a visitor ask for."""
COST = 0.02
"""Most time of the server for one such request [s]; a session takes 0.8 s."""


@pytest.mark.proof
@pytest.mark.parametrize(("method", "path", "headers"), LOADED)
def test_what_another_site_loads_is_refused_and_costs_next_to_nothing(
    served: Served, locked: Served, method: str, path: str, headers: dict[str, str]
) -> None:
    def seconds(one: Served) -> float:
        """Return the time on the processor for one request [s]."""
        began, times = one.process.cpu_times(), 10
        for _ in range(times):
            way = HTTPConnection("127.0.0.1", one.port, timeout=60)
            way.request(method, path, headers=headers)
            status = way.getresponse().status
            way.close()
            if path.startswith("/metadata"):  # no session
                assert status in {200, 302}
            else:
                assert 400 <= status < 500 or (one is locked and status == 302)
        now = one.process.cpu_times()
        return (now.user + now.system - began.user - began.system) / times

    for one in (served, locked):
        before = len(one.log.read_text())
        # The server may do other work meanwhile, such as a search for garbage of sessions before.
        assert min(seconds(one) for _ in range(3)) < COST
        assert "Traceback" not in one.log.read_text()[before:]


@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"Sec-Fetch-Site": "none", "Sec-Fetch-Dest": "document"},
        FOREIGN | {"Sec-Fetch-Dest": "document", "Sec-Fetch-Mode": "navigate"},  # a link
        {"Sec-Fetch-Site": "same-origin", "Sec-Fetch-Dest": "iframe"},
    ],
)
def test_what_a_person_opens_is_given(served: Served, headers: dict[str, str]) -> None:
    assert served.status("/", **headers) == 200


@pytest.mark.parametrize("address", ["127.0.0.1", "127.0.0.2", "localhost", "::1"])
def test_on_loopback_its_names_are_accepted_and_no_others(address: str) -> None:
    hosts = accepted_hosts(address, 5006)
    assert {"localhost:5006", "127.0.0.1:5006", "[::1]:5006"} <= hosts
    assert f"{NAME}:5006" not in hosts


@pytest.mark.parametrize("address", ["0.0.0.0", "::", "", "192.0.2.7", "lab.example.org"])
def test_no_address_opens_the_server_to_everybody(address: str) -> None:
    request = SimpleNamespace(connection=None)
    application = Application(**{SETTING: accepted_hosts(address, 5006)})
    for origin in ("http://evil.example:5006", "http://198.51.100.1:5006", "file://localhost:5006"):
        assert not is_accepted(origin, request, application)
    assert is_accepted(f"http://{NAME}:5006", request, application)


@pytest.mark.parametrize(
    ("more", "hosts"),
    [
        ("lab.example.org", {"lab.example.org:5006", "lab.example.org:80"}),
        ("https://Lab.example.org:8443/", {"lab.example.org:8443"}),
        ("[2001:db8::7]:80", {"[2001:db8::7]:80"}),
    ],
)
def test_further_origins_are_named(more: str, hosts: set[str]) -> None:
    assert accepted_hosts("::1", 5006, [more]) == hosts | accepted_hosts("::1", 5006)


@pytest.mark.parametrize(
    "more", ["*", "*.example.org", "", "a b", "a/b", "a:b", "a:99999", "user@host", "[::1"]
)
def test_what_is_no_host_is_refused(more: str) -> None:
    with pytest.raises(OriginError, match="accepted are"):
        accepted_hosts("127.0.0.1", 5006, [more])
