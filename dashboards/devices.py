"""Devices: the sources that pages may open, set by the operator of the server."""

from __future__ import annotations

import os
from collections.abc import Sequence

from lab.data.streams.address import Address
from lab.data.streams.serial_port import serial_ports
from lab.data.streams.transport import TransportError
from lab.live.stations import Stations

VARIABLE = "INS_LAB_DEVICES"
"""Environment variable with the addresses for ``panel serve``, with blanks between them."""
ANY_SERIAL = "serial:*"
"""Stands for all serial ports of the computer."""

STATIONS = Stations()
"""What this server receives, for all pages that watch it."""

_decided: dict[str, tuple[str, ...]] = {}
"""Addresses set by the server of this process; they override the environment."""


def allow_devices(addresses: Sequence[str]) -> None:
    """Set the sources that pages of this process may open, beside simulated devices.

    Parameters
    ----------
    addresses
        Addresses as `lab.live.open` takes them, or `ANY_SERIAL`. Their options hold for all pages.

    Raises
    ------
    TransportError
        If one is no address.
    """
    for text in addresses:
        if text != ANY_SERIAL:
            Address.of(text)
    _decided[VARIABLE] = tuple(addresses)


def allowed_devices() -> dict[str, str]:
    """Return the addresses that pages may open, by what people call them."""
    found: dict[str, str] = {}
    for text in _decided.get(VARIABLE, tuple(os.environ.get(VARIABLE, "").split())):
        if text != ANY_SERIAL:
            found[text] = text
            continue
        try:
            ports = serial_ports()
        except TransportError:
            continue
        found |= {f"{port.name} {port.description}".strip(): port.address for port in ports}
    return found
