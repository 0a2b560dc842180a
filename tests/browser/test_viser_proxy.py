"""The way to a viser server: only a token signed here opens it, and only to the port it holds."""

from __future__ import annotations

import secrets

import pytest
from bokeh.document import Document
from hypothesis import given
from hypothesis import strategies as st

from dashboards.viser_proxy import client_page, port_of, sign, web_application

SECRET = secrets.token_bytes(32)


@given(st.integers(1, 65535))
def test_a_token_holds_its_port(port: int) -> None:
    assert port_of(sign(port, SECRET), SECRET) == port


def test_two_tokens_for_a_port_differ() -> None:
    assert sign(8080, SECRET) != sign(8080, SECRET)


def test_another_secret_opens_nothing() -> None:
    assert port_of(sign(8080, secrets.token_bytes(32)), SECRET) is None


@given(st.data())
def test_a_changed_token_opens_nothing(data: st.DataObject) -> None:
    token = sign(8080, SECRET)
    place = data.draw(st.integers(0, len(token) - 1))
    other = data.draw(st.sampled_from("0123456789abcdef.-_x"))
    changed = token[:place] + other + token[place + 1 :]
    assert (port_of(changed, SECRET) == 8080) == (changed == token)


@pytest.mark.parametrize("token", ["", ".", "..", "22", "22.", "22.ab.", "é.ü.ß", "22.ab.00"])
def test_nonsense_opens_nothing(token: str) -> None:
    assert port_of(token, SECRET) is None


def test_the_client_is_one_page() -> None:
    page, tag = client_page()
    assert b"<html" in page[:200].lower()
    assert tag.startswith('"')


def test_without_a_browser_there_is_no_way() -> None:
    with pytest.raises(RuntimeError, match="open in a browser"):
        web_application(Document())
