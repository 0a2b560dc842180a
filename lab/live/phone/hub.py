"""Hub: the phones of one laboratory, and who may send."""

from __future__ import annotations

import hashlib
import secrets
import threading
import time
import unicodedata
from collections.abc import Callable
from typing import Final, NamedTuple

from lab.data.streams.transport import Chunk, TransportError
from lab.live.phone.phone import Phone, PhoneState

UNUSED: Final = 15 * 60.0
"""Time after which an invitation that nobody used expires [s]: long enough to find the phone."""
LIFETIME: Final = 12 * 3600.0
"""Time after which a phone must be invited anew [s]: a day's work."""
MOST: Final = 60
"""Most phones and invitations at once: two classes."""
LONGEST_NAME: Final = 40
"""Letters of a name that are kept."""


class Ticket(NamedTuple):
    """The right of one phone to send samples.

    Attributes
    ----------
    key : int
        Number of the phone in the hub.
    token : str
        Secret that gives the right, and nothing else; the hub keeps its hash only.
    """

    key: int
    token: str


class PhoneHub:
    """Invites phones, knows them by their tokens, and lists them; usable from any thread.

    Parameters
    ----------
    unused, lifetime
        Times after which an invitation expires [s]: if nobody uses it, and in any case.
    clock
        Gives the time, monotonic [s].
    """

    def __init__(
        self, unused: float = UNUSED, lifetime: float = LIFETIME, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._unused = unused
        self._lifetime = lifetime
        self._clock = clock
        # Reentrant, since `_sweep` forgets phones under the lock of its caller.
        self._lock = threading.RLock()
        self._phones: dict[int, Phone] = {}
        self._count = 0

    def invite(self) -> Ticket:
        """Return a ticket for one phone.

        Raises
        ------
        TransportError
            If there are already `MOST` phones and invitations.
        """
        with self._lock:
            self._sweep()
            if len(self._phones) >= MOST:
                raise TransportError(f"{MOST} phones are invited already: forget one first")
            self._count += 1
            token = secrets.token_urlsafe(32)
            now = self._clock()
            until = (now + min(self._unused, self._lifetime), now + self._lifetime)
            self._phones[self._count] = Phone(self._count, _digest(token), until, self._clock)
            return Ticket(self._count, token)

    def phones(self) -> list[PhoneState]:
        """Return the states of all phones and invitations, in the order of the invitations."""
        with self._lock:
            self._sweep()
            return [phone.state() for phone in self._phones.values()]

    def transport(self, key: int) -> PhoneTransport:
        """Return a transport that reads what a phone sends.

        Raises
        ------
        TransportError
            If there is no such phone.
        """
        with self._lock:
            if key not in self._phones:
                raise TransportError(f"there is no phone {key}: accepted are {sorted(self._phones)}")
            return PhoneTransport(self._phones[key])

    def forget(self, key: int) -> None:
        """Withdraw the invitation of a phone: it cannot send any more. Unknown ones are left alone."""
        with self._lock:
            phone = self._phones.pop(key, None)
        if phone is not None:
            phone.withdraw()

    def forget_all(self) -> None:
        """Withdraw all invitations."""
        with self._lock:
            keys = list(self._phones)
        for key in keys:
            self.forget(key)

    def phone_of(self, token: str) -> Phone | None:
        """Return the phone that a token belongs to; None if it is wrong or has expired.

        All tokens are compared, each in constant time, so the time taken says nothing about them.
        """
        digest = _digest(token)
        with self._lock:
            found = [phone for phone in self._phones.values() if phone.is_known_by(digest)]
        return found[0] if found and not found[0].expired else None

    def claim(self, phone: Phone, device: str, name: str) -> bool:
        """Let a device use an invitation, under the name that its owner typed; return whether it may."""
        with self._lock:
            return phone.claim(device, lambda: self._free_name(name, phone))

    def _free_name(self, typed: str, phone: Phone) -> str:
        name = plain_name(typed) or phone.name
        taken = {other.name for other in self._phones.values() if other is not phone}
        number = 2
        free = name
        while free in taken:
            free = f"{name} ({number})"
            number += 1
        return free

    def _sweep(self) -> None:
        """Forget invitations that expired without a phone, and phones that expired."""
        for key in [key for key, phone in self._phones.items() if phone.expired]:
            self.forget(key)


def plain_name(typed: str) -> str:
    """Return a name without control characters and marks that change the direction of writing, shortened."""
    kept = [letter if not unicodedata.category(letter).startswith("C") else " " for letter in typed[:400]]
    return " ".join("".join(kept).split())[:LONGEST_NAME].strip()


def _digest(token: str) -> bytes:
    return hashlib.sha256(token.encode("utf-8", "surrogatepass")).digest()


class PhoneTransport:
    """Reads what a phone sends, as lines for the decoder ``phone``; a `lab.data.streams.transport.Transport`.

    What came before it was opened is not kept. Each chunk is what one request brought.

    Parameters
    ----------
    phone
        A phone of a hub; its address is ``phone:NAME`` with the name that its owner typed.
    """

    def __init__(self, phone: Phone) -> None:
        self.address = f"phone:{phone.name}"
        self.reconnects = False
        self._phone = phone
        self._open = False

    def open(self) -> None:
        """Begin to keep what comes.

        Raises
        ------
        OSError
            If another transport reads this phone.
        """
        if not self._open:
            self._phone.start_reading()
            self._open = True

    def read(self, longest: float) -> Chunk:
        """Wait for a request of the phone.

        Parameters
        ----------
        longest
            Longest waiting time [s]; then the chunk is empty.

        Raises
        ------
        OSError
            If the transport is not open.
        EOFError
            If the phone may not send any more, and all is read.
        """
        if not self._open:
            raise OSError(f"{self.address} is not open")
        chunk = self._phone.read(longest, lambda: self._open)
        if chunk is None and not self._open:
            raise OSError(f"{self.address} was closed")
        return chunk or Chunk(time.monotonic(), b"")

    def close(self) -> None:
        """Stop; what comes from now on is not kept."""
        if self._open:
            self._open = False
            self._phone.stop_reading()
