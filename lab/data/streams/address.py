"""Address: what names a source of samples, such as ``serial:/dev/ttyUSB0?baud=115200&protocol=vectornav``."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from urllib.parse import parse_qsl, quote

from lab.data.streams.transport import TransportError

LONGEST = 1000
"""Longest address that is read [characters]: a path of 255 and all options."""
MOST_OPTIONS = 32
"""Most options of an address."""
FORMS = (
    "serial:PORT?baud=115200",
    "udp:PORT or udp:ADDRESS:PORT",
    "tcp:COMPUTER:PORT",
    "replay:FILE?speed=1",
    "simulated:MISSION?device=vectornav",
    "xplane:COMPUTER:PORT?card=ADIS16470",
    "sensorserver:COMPUTER:PORT",
)
"""Forms of addresses, one for each kind."""
KINDS = tuple(form.partition(":")[0] for form in FORMS)
"""Kinds of sources."""
COMMON = ("protocol", "columns", "column", "unit", "axes", "rate", "name")
"""Options that every kind has: how the bytes are decoded, mapped to the vehicle and timed."""

MAX_SEED = 2**31
"""Largest seed of a simulated device."""
LAST_PORT = 2**16 - 1
"""Largest number of a port of TCP and UDP."""

_PORT = re.compile(r"/dev/|COM\d+$")
"""Names of serial ports."""
_KIND = re.compile(r"([a-z]+):(.*)", re.DOTALL)


@dataclass(frozen=True)
class Address:
    """An address, taken apart.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    place : str
        What stands between the colon and the question mark.
    options : dict of str to str
        What stands behind it.
    """

    kind: str
    place: str
    options: dict[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, text: str) -> Address:
        """Return an address that a person wrote.

        Raises
        ------
        TransportError
            If it has none of the `FORMS`.
        """
        if len(text) > LONGEST:
            raise TransportError(
                f"the address has {len(text)} characters; accepted are up to {LONGEST} characters"
            )
        found = _KIND.fullmatch(text.strip())
        if found is None or found[1] not in KINDS:
            raise TransportError(
                f"{text!r} names no source{_suggest_address(text)}; accepted are {_list_words(FORMS)}"
            )
        place, _, query = found[2].partition("?")
        if not place or not place.isprintable():
            raise TransportError(f"{text!r} names no {found[1]} source; accepted is {_form(found[1])}")
        return cls(found[1], place, parse_options(text, query, strict=bool(query)))

    def check(self, own: Iterable[str]) -> None:
        """Refuse options that a source of this kind does not have.

        Parameters
        ----------
        own
            Options of this kind beside the `COMMON` ones.

        Raises
        ------
        TransportError
            Naming the option, and those that are accepted.
        """
        accepted = (*own, *COMMON)
        for name in self.options:
            if name not in accepted:
                raise TransportError(
                    f"{self}: {name!r} is no option of a {self.kind} source; accepted are "
                    f"{_list_words(accepted)}"
                )

    def number(self, name: str, usual: float, least: float, most: float, unit: str = "") -> float:
        """Return a number among the options.

        Parameters
        ----------
        name
            Name of the option.
        usual
            The number where it is not given.
        least, most
            What is accepted.
        unit
            Its unit, for messages.

        Raises
        ------
        TransportError
            If it is no number within the bounds.
        """
        text = self.options.get(name)
        if text is None:
            return usual
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not least <= value <= most:
            between = f"{least:.12g} to {most:.12g} {unit}".rstrip()
            raise TransportError(f"{self}: {name} = {text!r}; accepted are {between}")
        return value

    def whole(self, name: str, usual: int, least: int, most: int) -> int:
        """Return a whole number among the options; see `number`."""
        value = self.number(name, usual, least, most)
        if value != int(value):
            raise TransportError(f"{self}: {name} = {self.options[name]!r}; accepted are whole numbers")
        return int(value)

    def __str__(self) -> str:
        options = "&".join(f"{name}={quote(value, safe='/:,.-[]°²')}" for name, value in self.options.items())
        return f"{self.kind}:{self.place}{'?' if options else ''}{options}"


def parse_options(text: str, query: str, *, strict: bool) -> dict[str, str]:
    """Return the options behind the question mark of an address, which `text` is in messages.

    Raises
    ------
    TransportError
        If they are none; with `strict`, an empty text is none, too.
    """
    try:
        return dict(parse_qsl(query, True, strict_parsing=strict, max_num_fields=MOST_OPTIONS))
    except ValueError as error:
        raise TransportError(
            f"{text!r}: {query!r} are no options; accepted is NAME=VALUE, several with & between them"
        ) from error


def computer_and_port(address: Address, usual: str | None = None) -> tuple[str, int]:
    """Return name or number of a computer, and a port, of an address.

    Parameters
    ----------
    address
        An address with ``COMPUTER:PORT``; IPv6 numbers stand in brackets.
    usual
        The computer where only a port is given; None to refuse that.

    Raises
    ------
    TransportError
        If there is no port from 1 to 65535, or no computer.
    """
    computer, colon, port = address.place.rpartition(":")
    computer = computer.removeprefix("[").removesuffix("]")
    if not colon and usual is not None:
        computer = usual
    if not computer or not re.fullmatch(r"[0-9]{1,5}", port) or not 1 <= int(port) <= LAST_PORT:
        raise TransportError(f"{address}: names no port from 1 to 65535; accepted is {_form(address.kind)}")
    return computer, int(port)


def _form(kind: str) -> str:
    return next(form for form in FORMS if form.startswith(f"{kind}:"))


def _suggest_address(text: str) -> str:
    """Return how the source is written of which a text is the bare name; empty if it is none."""
    if text.endswith(".inslab"):
        return f": a recording is replay:{text}"
    if _PORT.match(text):
        return f": a serial port is serial:{text}"
    return ""


def _list_words(words: Iterable[str]) -> str:
    return ", ".join(words)
