"""Process place: which of the processes of a server this one is.

The classes and the streams live in the first process, because they belong to many pages, and a device or a
port can be opened once. `dashboards.front` sends the visitors of both there.
"""

from __future__ import annotations

STREAMS = "Live"
"""Title of the page with the streams; the address of a page says whether it is open."""

_place: list[int] = []
"""Number of this process among those of the server, from 0; empty for a server of one process."""


def take_place(number: int) -> None:
    """Say which process this is, from 0."""
    _place[:] = [number]


def number() -> int:
    """Return the number of this process, from 0."""
    return _place[0] if _place else 0


def is_one_of_several() -> bool:
    """Return whether the server has several processes.

    A connection of a proxy then carries one request, because the next one may belong to another process.
    """
    return bool(_place)


def is_first() -> bool:
    """Return whether classes and streams live in this process."""
    return number() == 0
