"""Headers of proxies: only those that the operator names are believed; of a chain, the last stranger."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from tornado.httputil import HTTPHeaders

from dashboards.forwarded import computer, is_encrypted, networks, trust_proxies

PROXY, VISITOR = "127.0.0.1", "203.0.113.7"


@pytest.fixture(autouse=True)
def nobody() -> Iterator[None]:
    """Believe nobody after a test."""
    yield
    trust_proxies(())


def request(remote: str, **headers: str) -> Any:
    """Return a request from an address."""
    named = HTTPHeaders({name.replace("_", "-"): value for name, value in headers.items()})
    return SimpleNamespace(remote_ip=remote, protocol="http", headers=named)


def test_nobody_is_believed_unless_named() -> None:
    lies = request(VISITOR, X_Forwarded_For="198.51.100.1", X_Forwarded_Proto="https")
    assert computer(lies) == VISITOR
    assert not is_encrypted(lies)
    trust_proxies([PROXY])
    assert computer(lies) == VISITOR
    assert not is_encrypted(lies)


@pytest.mark.parametrize(
    ("chain", "found"),
    [
        (VISITOR, VISITOR),
        (f"10.0.0.1, {PROXY}, {VISITOR}", VISITOR),  # what stands before may be anything
        (f"{VISITOR}, 172.18.0.5", VISITOR),
        (f"<script>, {VISITOR}", VISITOR),
        ("<script>", PROXY),
        ("", PROXY),
        (f"{VISITOR}, unknown", PROXY),
    ],
)
def test_the_last_computer_that_is_no_proxy_counts(chain: str, found: str) -> None:
    trust_proxies([PROXY, "172.16.0.0/12"])
    assert computer(request(PROXY, X_Forwarded_For=chain)) == found


def test_the_last_word_about_tls_counts() -> None:
    trust_proxies([PROXY])
    assert is_encrypted(request(PROXY, X_Forwarded_Proto="https"))
    assert is_encrypted(request(f"::ffff:{PROXY}", X_Forwarded_Proto="http, https"))
    assert not is_encrypted(request(PROXY, X_Forwarded_Proto="https, http"))
    assert not is_encrypted(request(PROXY))


@pytest.mark.parametrize("wrong", ["lab.example.org", "10.0.0.0/99", "", "*"])
def test_what_is_no_address_is_refused(wrong: str) -> None:
    with pytest.raises(ValueError, match="does not appear"):
        networks([wrong])
