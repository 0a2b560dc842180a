"""School class: the moment that a teacher shows, the pages that see it, and the steps that they have solved.

A class belongs to the pages in it. It knows them as seats, which hold no settings and no document. Its only
lasting content is what the teacher shows.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable
from contextvars import Context
from typing import NamedTuple

from dashboards.teaching.moment import Key, Moment
from lab.live.phone.hub import plain_name

ALONE = 30 * 60.0
"""Time after which a class without its teacher ends [s]: longer than the break of a double lesson."""
LIFETIME = 12 * 3600.0
"""Time after which a class ends in any case [s]: a day's work."""
MOST_SEATS = 100
"""Most pages in one class: two large classes of school."""
MOST_LESSONS = 50
"""Most lessons of which one seat keeps the solved steps; the laboratory ships twenty."""
MOST_STEPS = 20
"""Most steps of a lesson, as its file may have."""

FULL = f"The class is full: {MOST_SEATS} pages follow it already."


class ClassError(ValueError):
    """A class cannot be opened or joined."""


class Seat:
    """One page in a class.

    Parameters
    ----------
    notify
        Called when the class has changed, in any thread; it must return at once.
    is_present
        Returns whether a browser is connected to the page.

    Attributes
    ----------
    name : str
        What the student typed as a name, as plain text of bounded length; empty without one.
    follows : bool
        Whether the page follows the teacher.
    """

    def __init__(self, notify: Callable[[], None], is_present: Callable[[], bool]) -> None:
        self.notify = notify
        self.is_present = is_present
        self.name = ""
        self.follows = True
        self._solved: dict[Key, set[int]] = {}

    def call(self, typed: str) -> None:
        """Take a name that was typed."""
        self.name = plain_name(typed)

    def solve(self, lesson: Key, step: int) -> None:
        """Note that a step of a lesson, counted from 0, is solved."""
        known = lesson in self._solved or len(self._solved) < MOST_LESSONS
        if known and 0 <= step < MOST_STEPS:
            self._solved.setdefault(lesson, set()).add(step)

    def solved(self, lesson: Key) -> frozenset[int]:
        """Return the solved steps of a lesson."""
        return frozenset(self._solved.get(lesson, ()))


class Named(NamedTuple):
    """A student who typed a name, and the steps that are solved, counted from 0."""

    name: str
    solved: tuple[int, ...]


class Tally(NamedTuple):
    """The students of a class as its teacher sees them.

    Attributes
    ----------
    present, following : int
        Number of students whose page is open in a browser, and of those who follow.
    solved : dict
        How many of those present have solved each step of a lesson, by the number of the step from 0.
    named : tuple of Named
        Those present who typed a name, in the order of the names.
    """

    present: int
    following: int
    solved: dict[int, int]
    named: tuple[Named, ...]


class SchoolClass:
    """One class; joined and counted from any thread, shown and closed in that of the server.

    Parameters
    ----------
    code
        Its code, which is in the link for students.
    clock
        Gives the time, monotonic [s].
    age
        Time since it was opened, on the server before this one too [s].

    Attributes
    ----------
    code : str
        Its code.
    moment : Moment or None
        What the teacher shows; None before the first.
    closed : bool
        Whether it has ended.
    """

    def __init__(self, code: str, clock: Callable[[], float] = time.monotonic, age: float = 0.0) -> None:
        self.code = code
        self.moment: Moment | None = None
        self.closed = False
        self._clock = clock
        self._lock = threading.RLock()
        self._seats: list[Seat] = []
        self._leader: Seat | None = None
        self._untold: dict[Seat, None] = {}
        self._telling: asyncio.Task[None] | None = None
        self._led = clock()
        self._begun = self._led - age

    @property
    def age(self) -> float:
        """Time since it was opened [s]."""
        return self._clock() - self._begun

    @property
    def is_led(self) -> bool:
        """Whether a page that is open in a browser leads the class."""
        with self._lock:
            if self._leader is None or not self._leader.is_present():
                return False
            self._led = self._clock()
            return True

    @property
    def has_leader(self) -> bool:
        """Whether a page leads the class, also one whose connection is lost just now."""
        return self._leader is not None

    @property
    def expired(self) -> bool:
        """Whether the class has lost its teacher for `ALONE`, or is older than `LIFETIME`."""
        now = self._clock()
        return now - self._begun >= LIFETIME or (not self.is_led and now - self._led >= ALONE)

    def join(self, seat: Seat) -> None:
        """Take a seat.

        Raises
        ------
        ClassError
            If the class is full, or has ended.
        """
        with self._lock:
            if self.closed:
                raise ClassError(f"The class {self.code} has ended.")
            if len(self._seats) >= MOST_SEATS:
                raise ClassError(FULL)
            self._seats.append(seat)
        self._tell_leader()

    def leave(self, seat: Seat) -> None:
        """Give a seat up, or the lead, of which all who follow are told."""
        with self._lock:
            self._seats = [one for one in self._seats if one is not seat]
            self._untold.pop(seat, None)
            leaves = self._leader is seat
            followers = [one for one in self._seats if leaves and one.follows]
            if leaves:
                self._led, self._leader = self._clock(), None
        for one in followers:
            one.notify()
        self._tell_leader()

    def lead(self, seat: Seat) -> None:
        """Give the lead to a page of a teacher; the page that had it is told, or else all who follow."""
        with self._lock:
            before, self._leader, self._led = self._leader, seat, self._clock()
            self._seats = [one for one in self._seats if one is not seat]
            told = [one for one in self._seats if one.follows] if before is None else [before]
        for one in told:
            if one is not seat:
                one.notify()

    def is_led_by(self, seat: Seat) -> bool:
        """Return whether a page has the lead; the class then waits for its teacher anew."""
        if self._leader is not seat or self.closed:
            return False
        self._led = self._clock()
        return True

    def show(self, seat: Seat, moment: Moment, loop: asyncio.AbstractEventLoop | None = None) -> None:
        """Show a moment to all who follow; from a page without the lead, nothing is taken.

        Parameters
        ----------
        seat
            The page that shows it.
        moment
            What it shows.
        loop
            The running loop of the server, which spreads the work of many pages; None to tell all at once.
        """
        with self._lock:
            if not self.is_led_by(seat):
                return
            self.moment = moment
            followers = [one for one in self._seats if one.follows]
        self._report(followers, loop)

    def changed(self) -> None:
        """Tell the teacher that a student has solved a step, typed a name, wandered off or come back."""
        self._tell_leader()

    def tally(self, lesson: Key | None) -> Tally:
        """Return how many students are here, follow, and have solved each step of a lesson."""
        with self._lock:
            here = [seat for seat in self._seats if seat.is_present()]
        solved = Counter[int]()
        named = []
        for seat in here:
            steps = seat.solved(lesson) if lesson is not None else frozenset[int]()
            solved.update(steps)
            if seat.name:
                named.append(Named(seat.name, tuple(sorted(steps))))
        named.sort(key=lambda one: one.name.casefold())
        return Tally(len(here), sum(seat.follows for seat in here), dict(solved), tuple(named))

    def close(self) -> None:
        """End the class: forget what was shown and who was here, and tell all pages."""
        with self._lock:
            seats = [*self._seats, *([self._leader] if self._leader is not None else [])]
            self.closed, self.moment, self._leader = True, None, None
            self._seats = []
        for seat in seats:
            seat.notify()

    def _report(self, seats: Iterable[Seat], loop: asyncio.AbstractEventLoop | None) -> None:
        """Tell pages of a new moment: in a server one by one, with other requests in between."""
        self._untold |= dict.fromkeys(seats)
        if loop is None:
            while self._untold:
                self._next().notify()
        elif self._telling is None or self._telling.done():
            # In an empty context, because that of the caller refers to the teacher's document.
            self._telling = loop.create_task(self._tell_in_turns(), context=Context())

    async def _tell_in_turns(self) -> None:
        while self._untold:
            self._next().notify()
            await asyncio.sleep(0)

    def _next(self) -> Seat:
        seat = next(iter(self._untold))
        del self._untold[seat]
        return seat

    def _tell_leader(self) -> None:
        leader = self._leader
        if leader is not None:
            leader.notify()
