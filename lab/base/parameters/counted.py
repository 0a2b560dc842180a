"""Counted: a number of things as a text, in the singular for one."""

from __future__ import annotations

_HISSING = ("s", "x", "z", "ch", "sh")


def count_noun(count: int, what: str) -> str:
    """Return a number and a noun.

    >>> counted(1, "fix"), counted(2, "fix"), counted(0, "sample")
    ('1 fix', '2 fixes', '0 samples')

    Parameters
    ----------
    count
        How many.
    what
        The noun in the singular.
    """
    ending = "" if count == 1 else "es" if what.endswith(_HISSING) else "s"
    return f"{count} {what}{ending}"


def was_or_were(count: int) -> str:
    """Return the verb after a number of things, was or were."""
    return "was" if count == 1 else "were"
