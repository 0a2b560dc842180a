"""Notes: what people write on stretches of a flight: undone one by one, and passed on with the address.

A note is text, whoever wrote it and whatever link brought it: it is never read as markup.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import parse_qsl, quote, urlencode

from lab.views.flight_notes import ACCEPTED, LONGEST, plain_text, read_note

if TYPE_CHECKING:
    from dashboards.session import Session

NOTE = "note"
"""What names a note in an address; there is one for each."""
MOST = 20
"""Most notes of a flight: more are not told apart in the lane."""
ROOM = 4096
"""Longest part of an address with notes [characters]: half of what a link may have."""
MOST_FIELDS = 200
"""Most fields an address may hold; there are fewer than 100 settings."""
MOST_NAMED = 3
"""Most wrong notes of a link that are named; the rest is ignored."""
SHORT = 24
"""Longest text of a note in the name of a change [characters]."""


class Note(NamedTuple):
    """A note.

    Attributes
    ----------
    start, end : float
        Its stretch of time in the plots [s]; the same for a moment.
    text : str
        What it says.
    mission : str
        The flight.
    """

    start: float
    end: float
    text: str
    mission: str


def query_of_notes(notes: Iterable[Note], mission: str) -> str:
    """Return the notes of a flight as the query of an address."""
    return urlencode(
        [(NOTE, _format_note(one)) for one in notes if one.mission == mission], safe=":,", quote_via=quote
    )


def notes_of_query(query: str, mission: str) -> tuple[tuple[Note, ...], list[str]]:
    """Return the notes of an address, and messages about those that are not accepted."""
    try:
        fields = parse_qsl(query, keep_blank_values=True, max_num_fields=MOST_FIELDS)
    except ValueError:  # `experiment_of_query` reports it
        return (), []
    found, problems = list[Note](), list[str]()
    for text in [value for name, value in fields if name == NOTE]:
        read = read_note(text)
        if read is None:
            problems.append(f"The link has note={text[:40]}, which was ignored; {ACCEPTED}")
            continue
        note = Note(*read, mission)
        if len(found) == MOST or len(query_of_notes([*found, note], mission)) > ROOM:
            problems.append(f"The link has too many notes; the first {len(found)} are shown.")
            break
        else:
            found.append(note)
    return tuple(found), problems[:MOST_NAMED]


def _format_note(note: Note) -> str:
    times = [f"{time:.1f}".removesuffix(".0") for time in (note.start, note.end)]
    return f"{'-'.join(dict.fromkeys(times))}:{note.text}"


class Notes:
    """The notes of a page on the flight that it shows.

    Parameters
    ----------
    session
        The session, which keeps them.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._given: tuple[Note, ...] = ()

    @property
    def here(self) -> tuple[Note, ...]:
        """The notes on the flight of the settings, in the order in which they were written."""
        mission = self._session.experiment.mission
        return tuple(one for one in self._session.notes if one.mission == mission)

    def write(self, start: float, end: float, typed: str) -> None:
        """Write a note on a stretch of time [s]; without a text, none."""
        text, start, end = plain_text(typed)[:LONGEST], round(start, 1), round(end, 1)
        if text and 0 <= start <= end:
            note = Note(start, end, text, self._session.experiment.mission)
            self._take((*self.here, note), f"Note: {_shorten_note(text)}")

    def change(self, number: int, typed: str) -> None:
        """Give a note another text; without a text, delete it."""
        if not 0 <= number < len(self.here):
            return
        before, text = self.here[number], plain_text(typed)[:LONGEST]
        after = (before._replace(text=text),) if text else ()
        called = f"Note: {_shorten_note(text)}" if text else f"Note deleted: {_shorten_note(before.text)}"
        self._take((*self.here[:number], *after, *self.here[number + 1 :]), called)

    def bring(self, query: str) -> list[str]:
        """Take the notes of an address or of a state of the history; return what is not accepted."""
        mission = self._session.experiment.mission
        found, problems = notes_of_query(query, mission)
        others = tuple(one for one in self._session.notes if one.mission != mission)
        self._session.notes = (*others, *found)
        return problems

    def take_given(self, given: tuple[Note, ...]) -> None:
        """Have the notes of a teacher beside one's own, as far as there is room, in place of those before."""
        found = [one for one in self._session.notes if one not in self._given]
        own = len(found)
        for note in given:
            there = [one for one in (*found, note) if one.mission == note.mission]
            room = len(there) <= MOST and len(query_of_notes(there, note.mission)) <= ROOM
            if room and note not in found:
                found.append(note)
        self._given = tuple(found[own:])
        if tuple(found) != self._session.notes:
            self._session.notes = tuple(found)

    def _take(self, notes: tuple[Note, ...], called: str) -> None:
        """Have other notes, as one change."""
        mission = self._session.experiment.mission
        if notes == self.here:
            return
        is_more = len(notes) > len(self.here)
        if (is_more and len(notes) > MOST) or len(query_of_notes(notes, mission)) > ROOM:
            self._session.problem = (
                f"A flight has up to {MOST} notes, of {ROOM} characters together in a link. Delete one first."
            )
            return
        others = tuple(one for one in self._session.notes if one.mission != mission)
        self._session.notes = (*others, *notes)
        self._session.record(called, None)


def _shorten_note(text: str) -> str:
    return text if len(text) <= SHORT else f"{text[: SHORT - 1]}…"
