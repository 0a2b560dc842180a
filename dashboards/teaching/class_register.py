"""Class register: the classes of one server, by the code in the link for students."""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Callable

from dashboards.teaching.moment import Moment
from dashboards.teaching.school_class import ClassError, SchoolClass

LETTERS = "abcdefghjkmnpqrstuvwxyz23456789"
"""Letters of a code: those that look alike in no font, as i, l, o, 0 and 1 do."""
LENGTH = 6
"""Letters of a code: 9e8 codes, which is too many to find one of a few classes by trying."""
MOST = 20
"""Most classes at once on one server: a school."""


class ClassRegister:
    """The classes; usable from any thread.

    Parameters
    ----------
    clock
        Gives the time, monotonic [s].
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._classes: dict[str, SchoolClass] = {}

    def open(self) -> SchoolClass:
        """Open a class under a code of its own.

        Raises
        ------
        ClassError
            If there are already `MOST`.
        """
        self.sweep()
        with self._lock:
            if len(self._classes) >= MOST:
                raise ClassError(f"This server has {MOST} classes already. Close one first.")
            code = _code()
            while code in self._classes:
                code = _code()
            made = self._classes[code] = SchoolClass(code, self._clock)
        return made

    def open_again(self, code: str, age: float, moment: Moment | None) -> None:
        """Open a class that a server before this one had, with what its teacher showed.

        Parameters
        ----------
        code
            Its code.
        age
            Time since it was opened [s].
        moment
            What its teacher showed; None for nothing.
        """
        made = SchoolClass(code.lower(), self._clock, age)
        made.moment = moment
        with self._lock:
            if len(self._classes) < MOST:
                self._classes.setdefault(made.code, made)

    def find(self, code: str) -> SchoolClass | None:
        """Return the class of a code, in large or small letters; None if there is none, or not any more."""
        self.sweep()
        with self._lock:
            return self._classes.get(code.lower())

    def classes(self) -> list[SchoolClass]:
        """Return all classes, in the order in which they were opened."""
        self.sweep()
        with self._lock:
            return list(self._classes.values())

    def close(self, school_class: SchoolClass) -> None:
        """End a class, and forget it."""
        with self._lock:
            self._classes.pop(school_class.code, None)
        school_class.close()

    def sweep(self) -> None:
        """End the classes that have expired; pages call this as they come and go."""
        with self._lock:
            expired = [one for one in self._classes.values() if one.expired]
        for one in expired:
            self.close(one)


def is_code(text: str) -> bool:
    """Return whether a text may be the code of a class."""
    return len(text) == LENGTH and all(letter in LETTERS for letter in text.lower())


def _code() -> str:
    return "".join(secrets.choice(LETTERS) for _ in range(LENGTH))


CLASSES = ClassRegister()
"""The classes of this process; each is dropped when its teacher closes it, or when it expires."""
