"""Front of several processes: where a request belongs, whatever it is."""

from __future__ import annotations

import secrets
import zlib

import pytest
from bokeh.util.token import generate_jwt_token, generate_session_id
from hypothesis import given
from hypothesis import strategies as some

from dashboards.front import choose_process

KEYS = [secrets.token_bytes(32) for _ in range(3)]
BROWSER = secrets.token_urlsafe(32)


def head(target: str, **headers: str) -> bytes:
    """Return the head of a request."""
    lines = [f"GET {target} HTTP/1.1", *(f"{name}: {value}" for name, value in headers.items())]
    return "\r\n".join((*lines, "", "")).encode()


@pytest.mark.parametrize("number", range(3))
def test_a_websocket_belongs_to_the_process_that_signed_its_token(number: int) -> None:
    token = generate_jwt_token(generate_session_id(KEYS[number], True), KEYS[number], True)
    upgrade = {"Upgrade": "websocket", "Sec-WebSocket-Protocol": f"bokeh, {token}"}
    # Also behind a proxy with a path, and whatever cookies the browser has.
    for path in ("/ws", "/lab/ws"):
        assert choose_process(head(path, **upgrade, Cookie=f"ins_lab_browser_5006={BROWSER}"), KEYS) == number
    forged = generate_jwt_token(generate_session_id(b"x" * 32, True), b"x" * 32, True)
    assert choose_process(head("/ws", **{"Sec-WebSocket-Protocol": f"bokeh, {forged}"}), KEYS) is None


@pytest.mark.parametrize(
    "target", ["/?class=abcdef", "/?seed=2&class=abcdef", "/?tab=Live", "/teach?key=x", "/login"]
)
def test_classes_and_streams_belong_to_the_first_process(target: str) -> None:
    assert choose_process(head(target, Cookie=f"ins_lab_browser_5006={BROWSER}"), KEYS) == 0
    assert choose_process(head("/", Cookie="a=b; ins_lab_teacher_5006=x"), KEYS) == 0


def test_a_browser_stays_with_its_process_and_a_view_with_its_page() -> None:
    cookie = f"other=1; ins_lab_browser_5006={BROWSER}"
    expected = zlib.crc32(BROWSER.encode()) % 3
    assert {choose_process(head(path, Cookie=cookie), KEYS) for path in ("/", "/?tab=Errors")} == {expected}
    for number in range(3):
        assert choose_process(head(f"/viser/{number}.abc/", Cookie=cookie), KEYS) == number
    assert choose_process(head("/viser/3.abc/"), KEYS) is None
    assert choose_process(head("/"), KEYS) is None
    spread = {
        choose_process(head("/", Cookie=f"ins_lab_browser={secrets.token_urlsafe(32)}"), KEYS)
        for _ in range(50)
    }
    assert spread == {0, 1, 2}


@given(some.binary(max_size=300))
def test_whatever_is_sent_belongs_somewhere(content: bytes) -> None:
    for sent in (
        content,
        b"GET " + content,
        b"GET /ws HTTP/1.1\r\nSec-WebSocket-Protocol: bokeh, " + content,
    ):
        assert choose_process(sent, KEYS) in {None, 0, 1, 2}
