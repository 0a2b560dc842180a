"""Forwarded: what a proxy says of its visitors, believed only of the proxies that the operator names.

A visitor can send the same headers. Without `--proxy`, they only take away the rights of a visitor on the
computer of the server (`dashboards.browser`).
"""

from __future__ import annotations

import ipaddress
from collections.abc import Sequence

from tornado.httputil import HTTPServerRequest

Network = ipaddress.IPv4Network | ipaddress.IPv6Network

_believed: list[Network] = []
"""Networks of the proxies that the server of this process believes."""


def networks(proxies: Sequence[str]) -> list[Network]:
    """Return the networks that addresses name, such as ``127.0.0.1`` or ``172.16.0.0/12``.

    Raises
    ------
    ValueError
        If one of them is neither an address nor a network.
    """
    return [ipaddress.ip_network(one, strict=False) for one in proxies]


def trust_proxies(proxies: Sequence[str]) -> None:
    """Believe what proxies at these addresses say of their visitors."""
    _believed[:] = networks(proxies)


def is_encrypted(request: HTTPServerRequest) -> bool:
    """Return whether the browser of a request talks TLS, to the server or to a believed proxy."""
    if request.protocol == "https":
        return True
    said = request.headers.get_list("X-Forwarded-Proto")
    return _is_believed(request.remote_ip) and bool(said) and said[-1].split(",")[-1].strip() == "https"


def computer(request: HTTPServerRequest) -> str:
    """Return the address of the computer of a request: the last one that no believed proxy has.

    A believed proxy appends the address from which it was asked to `X-Forwarded-For`; what stands before it
    may be anything.
    """
    address = str(request.remote_ip)
    chain = ",".join(request.headers.get_list("X-Forwarded-For")).split(",")
    while chain and _is_believed(address):
        said = chain.pop().strip()
        try:
            address = str(ipaddress.ip_address(said))
        except ValueError:
            break
    return address


def _is_believed(address: str | None) -> bool:
    try:
        found = ipaddress.ip_address(address or "")
    except ValueError:
        return False
    found = getattr(found, "ipv4_mapped", None) or found
    return any(found in network for network in _believed)
