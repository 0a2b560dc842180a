"""Epochs: the messages of a receiver with one time, which make one fix.

A fix is complete with the last kind of message that the time before had, so it does not wait for the next
one; the first does. A lost message costs the wait, and not the fix.
"""

from __future__ import annotations

from collections.abc import Set as AbstractSet
from typing import Generic, TypeVar

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
        self.is_taken = False


class Epochs(Generic[Message]):
    """Groups the messages of one stream.

    Parameters
    ----------
    positions
        Kinds of messages of which an epoch needs one to make a fix.
    whole
        Kinds that make a fix alone.
    waits
        Whether an epoch is complete with the next one only. A file has time for that, and then a lost message
        does not cut the next epoch short.
    """

    def __init__(
        self, positions: AbstractSet[str], whole: AbstractSet[str] = frozenset(), waits: bool = False
    ) -> None:
        self._waits = waits
        self._positions = positions
        self._whole = whole
        self._usual: frozenset[str] = frozenset()
        self._epoch: Epoch[Message] = Epoch()

    @property
    def now(self) -> float | None:
        """The time of the present epoch."""
        return self._epoch.now

    def anew(self, kind: str, now: float | None) -> Epoch[Message] | None:
        """Begin an epoch if a message is not of the present one; return that, if it is complete by this.

        Parameters
        ----------
        kind
            Kind of the message.
        now
            Its time. Without one it belongs to the present epoch, unless that has a time and this kind.
        """
        epoch = self._epoch
        if now == epoch.now or (now is None and kind not in epoch.said):
            return None
        done = self.finish()
        self._epoch = Epoch(now)
        return done

    def take(self, kind: str, message: Message, end: int) -> Epoch[Message] | None:
        """Take a message of the present epoch; return that, if it is complete with it.

        Parameters
        ----------
        kind, message
            Its kind, and what it says.
        end
            As of `Epoch`.
        """
        epoch = self._epoch
        epoch.said.setdefault(kind, message)
        epoch.end = end
        is_usual = bool(self._usual) and self._usual <= epoch.said.keys()
        if epoch.is_taken or not (kind in self._whole or is_usual):
            return None
        epoch.is_taken = True
        return epoch

    def finish(self) -> Epoch[Message] | None:
        """Return the present epoch, if it makes a fix and was not returned before."""
        epoch = self._epoch
        if not epoch.said.keys() & self._positions:
            return None
        self._usual = frozenset() if self._waits else frozenset(epoch.said)
        if epoch.is_taken:
            return None
        epoch.is_taken = True
        return epoch
