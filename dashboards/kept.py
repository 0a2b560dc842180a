"""Kept: what the browser of a page stores of it besides its address, for the page that comes back.

That is the open step of a lesson and the settings before it, the solved steps, the name and the own settings
of a student in a class, what is typed into a homework, what the page Compare adds, and the last changes of
settings, if the connection was cut before the server had heard them. The browser stores it for one of its
tabs, and the server for nobody: whoever alters it alters a page of their own.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple

from dashboards.teaching.moment import Key, Place
from dashboards.teaching.school_class import MOST_LESSONS, MOST_STEPS

LONGEST = 32 * 2**10
"""Longest text that a page stores, and takes back [characters]: half of what a message may have."""
LONGEST_WORD = 2**10
"""Longest name, title or answer in it [characters]."""
MOST_ENTRIES = 64
"""Most answers of a homework in it: twice those of the longest homework that ships."""


class Own(NamedTuple):
    """The own settings of a student who follows a teacher: their query, the open tab, and the time [s]."""

    settings: str
    page: str
    time: float


class Typed(NamedTuple):
    """What is typed into a homework, which is named as on its server: name, chosen faults, and answers."""

    homework: str
    name: str
    faults: tuple[str, ...]
    answers: tuple[str, ...]


class Change(NamedTuple):
    """A change of a setting: its path, the part of its field that was changed, and what that part sent."""

    path: str
    part: str
    value: bool | float | str


class Kept(NamedTuple):
    """What a browser stores of a page.

    Attributes
    ----------
    place : tuple or None
        The open lesson, and the number of its step from 0.
    hides : bool
        Whether the hidden fault of that lesson is on.
    solved : mapping
        The solved steps of each lesson, from 0.
    name : str
        Name that a student of a class typed.
    own : Own or None
        Settings that a student left to follow the teacher.
    typed : Typed or None
        What is typed into a homework of the server.
    compared : mapping
        What the page Compare adds to the table; see `dashboards.pages.compare.Compare.kept`.
    unheard : tuple of Change
        The changes that the server did not hear any more; the browser alone knows them.
    before : str or None
        The settings of before the open lesson, as a query; None without one.
    """

    place: Place | None = None
    hides: bool = False
    solved: Mapping[Key, tuple[int, ...]] = MappingProxyType({})
    name: str = ""
    own: Own | None = None
    typed: Typed | None = None
    compared: Mapping[str, Any] = MappingProxyType({})
    unheard: tuple[Change, ...] = ()
    before: str | None = None

    @property
    def text(self) -> str:
        """The text that a browser stores; empty for nothing, and for more than it may store."""
        if self == Kept():
            return ""
        solved = [[*key, list(steps)] for key, steps in self.solved.items() if steps]
        parts = self._replace(place=None, solved=MappingProxyType({}))._asdict()
        parts |= {"solved": solved, "place": [*self.place[0], self.place[1]] if self.place else None}
        parts |= {"compared": dict(self.compared), "before": None if self.before is None else [self.before]}
        text = json.dumps({name: part for name, part in parts.items() if part})
        return text if len(text) <= LONGEST else ""


@dataclass(frozen=True)
class Keeping:
    """Ways to what a browser stores of a page.

    Attributes
    ----------
    parts : callable
        Returns what it is to store.
    take : callable
        Makes the page show what was brought; the second value says whether the address is the same as then.
    """

    parts: Callable[[], Kept]
    take: Callable[[Kept, bool], None]


def brought_back(text: object) -> tuple[Kept, bool]:
    """Return what a browser brings back, and whether its address is the one that belongs to it.

    A page may be sent anything: what is not as `Kept.text` writes it counts as nothing.
    """
    try:
        found: Any = json.loads(text) if isinstance(text, str) and len(text) <= 2 * LONGEST else None
        inner = json.loads(found["kept"])
        is_same = found.get("is_same") is True
        unheard = tuple(_changes(found.get("unheard"))) if is_same else ()
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return Kept(), False
    return (
        (_read_kept(inner)._replace(unheard=unheard), is_same) if isinstance(inner, dict) else (Kept(), False)
    )


def _changes(found: object) -> Iterable[Change]:
    for one in _read_list(found)[:MOST_ENTRIES]:
        match one:
            case [str(path), str(part), bool() | int() | float() | str() as value]:
                yield Change(path, part, value[:LONGEST_WORD] if isinstance(value, str) else value)


def _read_kept(parts: dict[str, Any]) -> Kept:
    match parts.get("place"):
        case [str(origin), str(name), int(number)] if number >= 0:
            place: Place | None = (origin, name), number
        case _:
            place = None
    solved = dict[Key, tuple[int, ...]]()
    for one in _read_list(parts.get("solved"))[:MOST_LESSONS]:
        match one:
            case [str(origin), str(name), [*steps]]:
                solved[origin, name] = tuple(sorted({n for n in steps if n in range(MOST_STEPS)}))
    match parts.get("own"):
        case [str(settings), str(page), int() | float() as time] if 0 <= time < float("inf"):
            own: Own | None = Own(settings, page[:LONGEST_WORD], float(time))
        case _:
            own = None
    match parts.get("typed"):
        case [str(homework), str(name), [*faults], [*answers]]:
            typed: Typed | None = Typed(
                homework, name[:LONGEST_WORD], _read_words(faults), _read_words(answers)
            )
        case _:
            typed = None
    match parts.get("before"):
        case [str(settings)]:
            before: str | None = settings
        case _:
            before = None
    called, compared = parts.get("name"), parts.get("compared")
    return Kept(
        place,
        parts.get("hides") is True,
        solved,
        called[:LONGEST_WORD] if isinstance(called, str) else "",
        own,
        typed,
        compared if isinstance(compared, dict) else {},
        before=before,
    )


def _read_list(value: object) -> list[Any]:
    return value if isinstance(value, list) else []


def _read_words(values: Iterable[object]) -> tuple[str, ...]:
    return tuple(one[:LONGEST_WORD] if isinstance(one, str) else "" for one in values)[:MOST_ENTRIES]
