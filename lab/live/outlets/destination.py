"""Destination: where a solution goes, as whoever starts the command wrote it: ``udp:127.0.0.1:9870``."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from lab.data.protocols.nmea_encoder import TALKER
from lab.data.streams.address import LAST_PORT, parse_options
from lab.data.streams.transport import TransportError
from lab.live.phone.invitation import is_loopback

HOME: Final = "127.0.0.1"
"""Where a listener listens unless another address is named: other computers cannot reach it."""
FORMS: Final = {
    "udp": "udp:COMPUTER:PORT",
    "tcp": "tcp:PORT or tcp:ADDRESS:PORT",
    "ws": "ws:PORT or ws:ADDRESS:PORT",
    "pty": "pty",
    "mcap": "mcap:FILE.mcap",
}
"""Forms of destinations, by their kind."""
PROTOCOLS: Final = ("json", "nmea", "mavlink")
"""What is sent; a Foxglove program on ``ws``, and a file, get the messages of Foxglove."""
CLOCKS: Final = ("receiver", "computer")
"""Whose clock gives UTC while the receiver has said none; the receiver's is empty then."""
RATES: Final = (0.1, 200.0)
"""Rows per second that are accepted [Hz]: a call of the navigator costs 0.4 ms."""
GEOID: Final = 120.0
"""Largest height of the geoid above or below the ellipsoid [m]: it goes from -106 to +85."""
_OPTIONS: Final = {
    "udp": ("protocol", "hz", "geoid", "talker", "utc"),
    "tcp": ("protocol", "hz", "geoid", "talker", "utc"),
    "ws": ("protocol", "hz", "geoid", "talker", "utc", "origin"),
    "pty": ("protocol", "hz", "geoid", "talker", "utc"),
    "mcap": ("hz", "geoid"),
}
_ORIGIN: Final = re.compile(r"[a-z][a-z0-9+.-]*://[^\s/?#]+", re.IGNORECASE)


@dataclass(frozen=True)
class Destination:
    """A place to send to, and what is sent there.

    Attributes
    ----------
    text : str
        As it was written.
    kind : str
        A key of `FORMS`.
    host, port : str, int
        Computer or address, and port.
    path : Path
        A file.
    protocol : str
        One of `PROTOCOLS`.
    hz : float
        Rows per second.
    geoid : float
        Height of the geoid above the ellipsoid [m]; NaN where it is not given.
    talker : str
        Talker of sentences of NMEA.
    by_computer : bool
        Whether the clock of the computer is sent as UTC while the receiver gives none.
    origins : frozenset of str
        Origins of pages of a browser that may read a WebSocket.
    """

    text: str
    kind: str
    host: str = ""
    port: int = 0
    path: Path = Path()
    protocol: str = "json"
    hz: float = 1.0
    geoid: float = float("nan")
    talker: str = TALKER
    by_computer: bool = False
    origins: frozenset[str] = frozenset()

    @classmethod
    def of(cls, text: str, hz: float) -> Destination:
        """Return a destination that a person wrote; `hz` where it does not say how many rows.

        Raises
        ------
        TransportError
            If it is none.
        """
        address, mark, query = text.strip().partition("?")
        kind, colon, place = address.partition(":")
        if kind not in FORMS or not address.isprintable():
            raise TransportError(f"{text!r} is no place to send to; accepted are {', '.join(FORMS.values())}")
        options = parse_options(text, query, strict=bool(mark))
        for name in options:
            if name not in _OPTIONS[kind]:
                raise TransportError(
                    f"{text!r}: {name!r} is no option of {kind}; accepted are {', '.join(_OPTIONS[kind])}"
                )
        host, port, path = _parse_place(text, kind, colon + place)
        origins = frozenset(
            one.strip().lower() for one in options.get("origin", "").split(",") if one.strip()
        )
        for origin in origins:
            if not _ORIGIN.fullmatch(origin):
                raise TransportError(
                    f"{text!r}: origin {origin!r}; accepted are such as https://app.foxglove.dev"
                )
        talker = options.get("talker", TALKER)
        if not re.fullmatch(r"[A-Z]{2}", talker):
            raise TransportError(f"{text!r}: talker {talker!r}; accepted are two capital letters, such as GP")
        return cls(
            text,
            kind,
            host,
            port,
            path,
            protocol=_choose_option(text, options, "protocol", PROTOCOLS),
            hz=_number(text, options, "hz", hz, *RATES),
            geoid=_number(text, options, "geoid", math.nan, -GEOID, GEOID),
            talker=talker,
            by_computer=_choose_option(text, options, "utc", CLOCKS) == CLOCKS[1],
            origins=origins,
        )

    @property
    def is_open(self) -> bool:
        """Whether it listens, and other computers may connect."""
        return self.kind in {"tcp", "ws"} and not is_loopback(self.host)


def _parse_place(text: str, kind: str, rest: str) -> tuple[str, int, Path]:
    """Return host and port, or path, of what stands behind the kind, with its colon."""
    place = rest.removeprefix(":")
    if kind == "pty":
        if rest:
            raise TransportError(f"{text!r}: pty takes no place; accepted are pty and pty?protocol=nmea")
        if os.name != "posix":
            raise TransportError(
                f"{text!r}: there are no pseudo-terminals on this system; accepted is tcp:PORT"
            )
        return "", 0, Path()
    if kind == "mcap":
        if not place.lower().endswith(".mcap"):
            raise TransportError(f"{text!r}: accepted is the name of a new file that ends in .mcap")
        return "", 0, Path(place)
    host, _, port = place.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    # Port 0 has the system choose one to listen on; nothing can be sent to it.
    least = 1 if kind == "udp" else 0
    if not re.fullmatch(r"[0-9]{1,5}", port) or not least <= int(port) <= LAST_PORT:
        raise TransportError(
            f"{text!r}: names no port from {least} to {LAST_PORT}; accepted is {FORMS[kind]}"
        )
    return host or HOME, int(port), Path()


def _choose_option(text: str, options: Mapping[str, str], name: str, accepted: tuple[str, ...]) -> str:
    """Return what an option says; the first that is accepted where it is not given."""
    value = options.get(name, accepted[0])
    if value not in accepted:
        raise TransportError(f"{text!r}: {name} {value!r}; accepted are {', '.join(accepted)}")
    return value


def _number(
    text: str, options: Mapping[str, str], name: str, usual: float, least: float, most: float
) -> float:
    """Return the number that an option says; the usual one where it is not given."""
    if name not in options:
        return usual
    try:
        found = float(options[name])
    except ValueError:
        found = math.nan
    if not least <= found <= most:
        raise TransportError(f"{text!r}: {name} {options[name]!r}; accepted are {least:g} to {most:g}")
    return found
