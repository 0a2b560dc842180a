"""History: the changes of an experiment, one after the other, for undo and redo, and for Back and Forward.

An entry holds the settings as text, as an address does, and never what a lesson or a homework hides.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import NamedTuple
from urllib.parse import parse_qsl

from dashboards.field_text import shown
from dashboards.mission_titles import mission_titles
from dashboards.query import default_settings
from dashboards.seen_names import seen_name
from dashboards.session import Glide
from dashboards.sigmas import sigma_at, to_sigma
from dashboards.teaching.moment import Place
from lab.missions import missions

MOST = 100
"""Most entries; the oldest ones are forgotten."""
QUIET = 1.0
"""Longest time between two steps of a slider by the keyboard that are one change [s]."""
LONGEST = 24
"""Longest value that the name of a change tells [characters]."""


class State(NamedTuple):
    """What an entry brings back.

    Attributes
    ----------
    settings : str
        The settings that differ from the defaults, as the query of an address.
    hidden : str
        What changes the result besides the settings, as `Experiment.hidden` names it; empty without it.
    tab : str
        Title of the tab that was open.
    place : tuple or None
        The lesson and the number of its step that was open; None without one.
    notes : str
        The notes on the flight, as the query of an address.
    """

    settings: str
    hidden: str
    tab: str
    place: Place | None
    notes: str = ""

    def has_settings_of(self, other: State) -> bool:
        """Return whether another state has the same settings, the same hidden and the same notes."""
        return (self.settings, self.hidden, self.notes) == (other.settings, other.hidden, other.notes)


class _Entry(NamedTuple):
    state: State
    called: str


class History:
    """The states of one page, the present one among them.

    Parameters
    ----------
    first
        The first state.
    clock
        Gives the time, monotonic [s].

    Attributes
    ----------
    position : int
        Number of the present state; the first one of the page is 0.
    sigmas : bool
        Whether changes of variances are named by σ.
    """

    def __init__(self, first: State, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._entries = {0: _Entry(first, "")}
        self._glide: Glide | None = None
        self._changed = 0.0
        self._new: list[int] = []
        self.position = 0
        self.sigmas = False

    @property
    def present(self) -> State:
        """The present state."""
        return self._entries[self.position].state

    @property
    def oldest(self) -> int:
        """Number of the oldest state that is kept."""
        return min(self._entries)

    @property
    def undone(self) -> str:
        """Name of the change that undo takes back; empty without one."""
        return self._name(self.position)

    @property
    def redone(self) -> str:
        """Name of the change that redo makes again; empty without one."""
        return self._name(self.position + 1)

    def record(self, state: State, called: str = "", glide: Glide | None = None) -> None:
        """Take the state after a change; what was undone before can no longer be made again.

        Parameters
        ----------
        state
            The state.
        called
            Name of the change; by default, the settings that differ name it.
        glide
            The motion of which the change is a part.
        """
        if state.has_settings_of(self.present):
            self.amend(state)
            return
        now, before = self._clock(), self._glide
        goes_on = before is not None and glide is not None and before.path == glide.path
        if not goes_on or (glide != before and now - self._changed >= QUIET):
            self._advance()
        self._entries[self.position] = _Entry(state, called)
        self._glide, self._changed = glide, now

    def amend(self, state: State) -> None:
        """Take the present state again, of which another part than the settings was changed."""
        self._entries[self.position] = self._entries[self.position]._replace(state=state)

    def visit(self, position: int) -> State | None:
        """Make another state the present one, and return it; None if it is not kept, or present already."""
        if position == self.position or position not in self._entries:
            return None
        self.position, self._glide = position, None
        return self._entries[position].state

    def take_new(self) -> list[tuple[int, State]]:
        """Return number and state of the entries that were made since the last call."""
        taken, self._new = self._new, []
        return [(number, self._entries[number].state) for number in taken if number in self._entries]

    def _advance(self) -> None:
        for number in [one for one in self._entries if one > self.position]:
            del self._entries[number]
        self._new = [number for number in self._new if number <= self.position]
        self.position += 1
        self._new.append(self.position)
        if len(self._entries) == MOST:
            del self._entries[self.oldest]

    def _name(self, position: int) -> str:
        """Return the name of the change that led to a state; empty if what was before it is not kept."""
        if position not in self._entries or position - 1 not in self._entries:
            return ""
        before, entry = self._entries[position - 1], self._entries[position]
        return entry.called or change_in_words(before.state.settings, entry.state.settings, self.sigmas)


def change_in_words(before: str, after: str, sigmas: bool = False) -> str:
    """Return what differs between two queries of settings; of variances, their roots if these are shown.

    >>> change_in_words("", "navigator.q_scale=0.1")
    'Navigator and filter: Q scale 1 → 0.1'
    >>> change_in_words("", "sensors.gps.position_variance=0.49", sigmas=True)
    'GPS receiver: Position σ 0.707107 → 0.7'
    """
    old, new = dict(parse_qsl(before)), dict(parse_qsl(after))
    paths = [path for path in old | new if old.get(path) != new.get(path)]
    paths.sort(key=lambda path: path != "mission")
    if not paths:
        return "The last change"
    words = [_change(path, old.get(path), new.get(path), sigmas) for path in paths[:2]]
    return ", ".join(words) if len(paths) <= 2 else f"{words[0]} and {len(paths) - 1} more"


def _change(path: str, old: str | None, new: str | None, sigmas: bool) -> str:
    name = seen_name(path, sigmas)
    values = [seen_value(path, text, sigmas) for text in (old, new)]
    return f"{name} {' → '.join(values)}" if all(len(value) <= LONGEST for value in values) else name


def seen_value(path: str, text: str | None, sigmas: bool) -> str:
    """Return a value of a query as its field shows it; None stands for the default."""
    if path == "mission":
        name = default_settings()[path] if text is None else text
        return {one: title for title, one in mission_titles(missions()).items()}.get(name, name)
    try:
        value = default_settings()[path] if text is None else json.loads(text)
    except ValueError:  # a word
        return str(text)
    if isinstance(value, list):
        value = tuple(tuple(part) if isinstance(part, list) else part for part in value)
    if sigmas and sigma_at(path) is not None:
        value = to_sigma(value if isinstance(value, tuple) else (value,) * 3)
    return {"True": "on", "False": "off", "": "none"}.get(shown(value), shown(value))
