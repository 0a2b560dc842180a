"""Owner: who opened a source, and who else may watch it, change its axes and unplug it."""

from __future__ import annotations

from typing import NamedTuple


class Visitor(NamedTuple):
    """Who uses a page.

    Attributes
    ----------
    identity : str
        What all pages of one browser have in common, and no other page has.
    school_class : str
        Code of the class that the page attends or leads; empty outside of a class.
    teaches : bool
        Whether it is the page of a teacher.
    counted : str
        Those with the same text share the places of one visitor; empty for whoever has no limit.
    """

    identity: str = ""
    school_class: str = ""
    teaches: bool = False
    counted: str = ""


class Owner(NamedTuple):
    """Who opened a source: fixed when it was opened, except for `shared`.

    Attributes
    ----------
    identity : str
        As that of a `Visitor`.
    school_class : str
        Code of the class in which it was opened; empty outside of a class.
    teaches : bool
        Whether a teacher opened it.
    shared : bool
        Whether the owner shares it with the class.
    """

    identity: str = ""
    school_class: str = ""
    teaches: bool = False
    shared: bool = False


def owned_by(visitor: Visitor) -> Owner:
    """Return the owner of a source that a visitor opens now."""
    return Owner(visitor.identity, visitor.school_class, visitor.teaches)


def may_watch(visitor: Visitor, owner: Owner) -> bool:
    """Return whether a visitor may know of a source, and watch it.

    All may watch what a teacher opened, and what was opened outside of a class. Of what a student opened, the
    owner and the teacher of the class may; if it is shared, the class may.
    """
    if owner.teaches or not owner.school_class or visitor.identity == owner.identity:
        return True
    return visitor.school_class == owner.school_class and (visitor.teaches or owner.shared)


def may_change(visitor: Visitor, owner: Owner) -> bool:
    """Return whether a visitor may change the axes of a source, and unplug it.

    The owner may, and the teacher: of what a teacher opened, any teacher; else the teacher of the class.
    Outside of a class, all may.
    """
    if visitor.identity == owner.identity:
        return True
    if owner.teaches:
        return visitor.teaches
    return not owner.school_class or (visitor.teaches and visitor.school_class == owner.school_class)


def may_share(visitor: Visitor, owner: Owner) -> bool:
    """Return whether a visitor may share a source with the class: its owner may, while in the class."""
    is_own = visitor.identity == owner.identity and visitor.school_class == owner.school_class
    return is_own and bool(owner.school_class) and not owner.teaches


def may_join(visitor: Visitor, owner: Owner) -> bool:
    """Return whether a visitor who opens a source gets one that was opened alike, and not one of their own.

    Students get the source that their teacher opened alike. A teacher does not get that of a student: the
    class could not watch it.
    """
    if visitor.identity == owner.identity or owner.teaches:
        return True
    return not owner.school_class and not visitor.teaches
