"""Addresses: those by which a phone in the same network reaches this computer."""

from __future__ import annotations

import contextlib
import ipaddress
import socket
from typing import Final

_ELSEWHERE: Final = (("192.0.2.1", socket.AF_INET), ("2001:db8::1", socket.AF_INET6))
"""Addresses of documentation (RFC 5737, RFC 3849): the system says by which address it would go there."""


def is_loopback(host: str) -> bool:
    """Return whether a host is this computer for itself only."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def is_any(host: str) -> bool:
    """Return whether a host stands for all addresses of this computer."""
    return host in {"", "0.0.0.0", "::"}


def own_addresses() -> list[str]:
    """Return the addresses of this computer in its networks, the one that leads outside first.

    Nothing is sent. The list is empty without a network.
    """
    found = []
    for there, family in _ELSEWHERE:
        with contextlib.suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.connect((there, 9))
            found.append(str(probe.getsockname()[0]))
    with contextlib.suppress(OSError):
        found += [str(info[4][0]) for info in socket.getaddrinfo(socket.gethostname(), None)]
    usable = [one for one in found if not is_loopback(one) and not is_any(one) and "%" not in one]
    return [one for one in dict.fromkeys(usable) if not ipaddress.ip_address(one).is_link_local]


def in_address(host: str, port: int) -> str:
    """Return host and port as an address on the web has them."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
