"""Invitation: what the laboratory shows to the owner of a phone, as data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

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
