"""Invitation: what the owner of a phone is shown, and the addresses by which the phone reaches us."""

from __future__ import annotations

import contextlib
import ipaddress
import socket
from dataclasses import dataclass
from typing import Final

_ELSEWHERE: Final = (("192.0.2.1", socket.AF_INET), ("2001:db8::1", socket.AF_INET6))
"""Addresses of documentation (RFC 5737, RFC 3849): the system says by which address it would go there."""
WARNING: Final = (
    "Your browser warns that the connection is not private, because this computer made its certificate by "
    "itself. In your own network that is expected: choose “Advanced” (“Show Details” on an iPhone), then "
    "continue to the address below the QR code."
)
"""Two sentences about the warning of the browser."""
STEPS: Final = (
    "Connect the phone to the same network as this computer.",
    "Scan the QR code with the camera of the phone.",
    "Continue past the warning of the browser, type a name, and tap Start.",
)
"""What the owner does."""
LOOPBACK: Final = (
    "The phone server listens on this computer only, so no phone can reach it. Start the laboratory with an "
    "address of your network."
)
"""Said if no phone can come."""


@dataclass(frozen=True)
class Invitation:
    """What the laboratory shows.

    Attributes
    ----------
    key : int
        Number of the phone in the hub.
    address : str
        Address of the page for this phone; it holds the token.
    push_address : str
        Address for the app Sensor Logger, with the same token.
    qr : tuple of tuples of bool
        QR code of the address, rows of modules, True is dark, with a quiet zone of 4 modules.
    warning : str
        Two sentences about the warning of the browser.
    steps : tuple of str
        What the owner does.
    problem : str
        Why no phone can come; empty if one can.
    left : float
        Time until the invitation expires if nobody uses it [s].
    """

    key: int
    address: str
    push_address: str
    qr: tuple[tuple[bool, ...], ...]
    warning: str = WARNING
    steps: tuple[str, ...] = STEPS
    problem: str = ""
    left: float = 0.0


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
