"""Epochs: the messages of a receiver with one time, which make one fix.

A fix is complete with the last kind of message that the time before had, so it does not wait for the next
one; the first does. A lost message costs the wait, and not the fix.
"""

from __future__ import annotations

from collections.abc import Callable
from collections.abc import Set as AbstractSet
from typing import Generic, TypeVar

from lab.data.protocols.rows import Rows

Message = TypeVar("Message")


class Epoch(Generic[Message]):
    """What the messages of one time say.

    Attributes
    ----------
    now : float or None
        Their time; None if it is not known.
    said : dict
        The first message of each kind.
    end : int
        Number of bytes of the stream up to the end of the last one.
    """

    def __init__(self, now: float | None = None) -> None:
        self.now = now
        self.said: dict[str, Message] = {}
        self.end = 0
        self.is_added = False


class Epochs(Generic[Message]):
    """Groups the messages of one stream.

    Attributes
    ----------
    present : Epoch
        The epoch that goes on.

    Parameters
    ----------
    add
        Adds the fix of a complete epoch to rows.
    positions
        Kinds of messages of which an epoch needs one to make a fix.
    whole
        Kinds that make a fix alone.
    waits
        Whether an epoch is complete with the next one only. A file has time for that, and then a lost message
        does not cut the next epoch short.
    """

    def __init__(
        self,
        add: Callable[[Epoch[Message], Rows], None],
        positions: AbstractSet[str],
        whole: AbstractSet[str] = frozenset(),
        waits: bool = False,
    ) -> None:
        self.present: Epoch[Message] = Epoch()
        self._add, self._positions, self._whole, self._waits = add, positions, whole, waits
        self._usual: frozenset[str] = frozenset()

    def begin(self, kind: str, now: float | None, rows: Rows) -> None:
        """Begin an epoch if a message is not of the present one, which is complete by this.

        Parameters
        ----------
        kind
            Kind of the message.
        now
            Its time. Without one it belongs to the present epoch, unless that has a time and this kind.
        rows
            Takes the fix.
        """
        epoch = self.present
        if now != epoch.now and (now is not None or kind in epoch.said):
            self.finish(rows)
            self.present = Epoch(now)

    def take(self, kind: str, message: Message, end: int, rows: Rows) -> None:
        """Take a message of the present epoch, and add the fix that is complete with it.

        Parameters
        ----------
        kind, message
            Its kind, and what it says.
        end
            As of `Epoch`.
        rows
            Takes the fix.
        """
        epoch = self.present
        epoch.said.setdefault(kind, message)
        epoch.end = end
        if kind in self._whole or (self._usual and self._usual <= epoch.said.keys()):
            self._add_once(epoch, rows)

    def finish(self, rows: Rows) -> None:
        """Add the fix of the present epoch, if it makes one."""
        said = self.present.said.keys()
        if said & self._positions:
            self._usual = frozenset() if self._waits else frozenset(said)
            self._add_once(self.present, rows)

    def _add_once(self, epoch: Epoch[Message], rows: Rows) -> None:
        if not epoch.is_added:
            epoch.is_added = True
            self._add(epoch, rows)
