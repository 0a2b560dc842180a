"""Live solution: what ``ins-lab live navigate`` prints of a solution, and sends with ``--to``."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated, Any

from lab.base.parameters.counted import count_noun
from lab.cli.app import CommandError, option

if TYPE_CHECKING:
    from lab.live.live_state import LiveState
    from lab.live.outlets.publisher import Publisher

Destinations = Annotated[
    list[str] | None,
    option(
        "--to",
        "PLACE",
        "Send the solution: udp:COMPUTER:PORT, tcp:PORT, ws:PORT, pty or mcap:FILE.mcap; may be "
        "repeated. Options follow a question mark: tcp:10110?protocol=nmea&hz=10.",
    ),
]
USUAL_RATE = 10.0
"""Rows per second that `--to` sends where nobody says how many [Hz]: those of a good receiver."""
SOLUTION_HEAD = (
    "TIME [s]  ROLL, PITCH, HEADING [deg]  1 SIGMA [deg]             POSITION [deg], HEIGHT [m]           "
    + "PHASE"
)
"""Head of the lines of `navigate`."""


def solution_line(known: LiveState, seconds: float) -> str:
    """Return a solution as a line below `SOLUTION_HEAD`."""
    import numpy as np  # noqa: PLC0415 - help does not need it

    euler, sigma = np.degrees(known.euler), np.degrees(known.euler_sigma)
    angles = "".join(f"{value:9.2f}" for value in (euler[0], euler[1], euler[2] % 360))
    spread = "".join(f"{value:8.2f}" for value in sigma)
    latitude, longitude = np.degrees(known.position[:2])
    place = f"{latitude:12.7f} {longitude:12.7f} {known.position[2]:8.1f}"
    if not np.isfinite(latitude):
        place = " " * 34
    return f"{seconds:8.1f} {angles} {spread}  {place}  {known.phase}"


def solution_row(known: LiveState) -> dict[str, Any]:
    """Return the row that `--to` sends, and in words what it rests on."""
    from lab.data.protocols.sent_solution import row_of  # noqa: PLC0415 - help does not need it
    from lab.live.outlets.publisher import sent_solution  # noqa: PLC0415 - help does not need it

    row = row_of(sent_solution(known))
    return row | {"reason": known.reason, "heading_source": known.heading_source}


@contextmanager
def publishing(places: Sequence[str], hz: float | None) -> Iterator[Publisher]:
    """Yield what sends the solution to the places of --to; say where, and at the end what was lost."""
    from lab.data.streams.transport import TransportError, describe_cause  # noqa: PLC0415 - help does not need it
    from lab.live.outlets.destination import RATES, Destination  # noqa: PLC0415 - help does not need it
    from lab.live.outlets.publisher import Publisher  # noqa: PLC0415 - help does not need it

    if hz is not None and not places:
        raise CommandError("--hz: needs --to, whose rows it counts")
    hz = USUAL_RATE if hz is None else hz
    if not RATES[0] <= hz <= RATES[1]:
        raise CommandError(f"--hz {hz:g}: accepted are {RATES[0]:g} to {RATES[1]:g} Hz")
    try:
        destinations = [Destination.of(place, hz) for place in places]
    except TransportError as error:
        raise CommandError(f"--to {error}") from error
    publisher = Publisher(destinations)
    try:
        publisher.open()
    except (OSError, ImportError) as error:
        why = describe_cause(error) if isinstance(error, OSError) else str(error)
        raise CommandError(f"--to {error.__notes__[0]}: {why}") from error
    try:
        for one, place in zip(destinations, publisher.places, strict=True):
            what = "messages of Foxglove" if one.kind == "mcap" else one.protocol
            reach = "; other computers can connect" if one.is_open else ""
            print(f"ins-lab: sends {what} at {one.hz:g} Hz: {place}{reach}", file=sys.stderr, flush=True)
        yield publisher
    finally:
        publisher.close()
        for place, (sent, lost, readers) in zip(publisher.places, publisher.counts, strict=True):
            by = f" to {count_noun(readers, 'reader')}" if readers else ""
            print(
                f"ins-lab: {place}: {count_noun(sent, 'row')} sent{by}, {lost + publisher.behind} lost",
                file=sys.stderr,
            )


def said_of(publisher: Publisher, said: set[str]) -> set[str]:
    """Print once each what those who read the solution should know; return all that was printed."""
    found = {
        f"--to {one.text}: its heights are above sea level, and that of the solution is not known: "
        f"{'the altitude is empty' if one.protocol == 'nmea' else 'positions are left out'}. geoid=METRES "
        "says how high the geoid is above the ellipsoid here"
        for one in publisher.without_height
    } | {f"a page of {origin} was refused; origin={origin} lets it in" for origin in publisher.refused}
    for sentence in sorted(found - said):
        print(f"ins-lab: {sentence}", file=sys.stderr, flush=True)
    return said | found
