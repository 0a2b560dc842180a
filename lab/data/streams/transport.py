"""Transport: brings the bytes of a device, with the time at which they arrived."""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable


class TransportError(ValueError):
    """A transport cannot be used as named; the message says why and what is accepted."""


class Chunk(NamedTuple):
    """Bytes that arrived together.

    Attributes
    ----------
    arrival : float
        Time at which they were there, of the host's monotonic clock; of a replay, that recorded [s].
    data : bytes
        The bytes; empty if the waiting time ended first.
    """

    arrival: float
    data: bytes


@runtime_checkable
class Transport(Protocol):
    """Anything that brings bytes; one thread opens, reads and closes it.

    It may have a method ``end()`` besides, which is called once after the last `close` and frees what must
    outlast a lost connection, such as the file of a replay; and an attribute ``remark`` with sentences on
    what comes, or on why nothing does.

    Attributes
    ----------
    address : str
        The address it was opened by, such as ``serial:/dev/ttyUSB0?baud=115200``.
    reconnects : bool
        Whether to open it again after it was lost.
    """

    address: str
    reconnects: bool

    def open(self) -> None:
        """Connect.

        Raises
        ------
        OSError
            If there is no such device or computer, or it does not answer; the message is for people.
        """
        ...

    def read(self, longest: float) -> Chunk:
        """Wait for bytes.

        Parameters
        ----------
        longest
            Longest waiting time [s]; then the chunk is empty.

        Raises
        ------
        OSError
            If the device is gone.
        EOFError
            If nothing more will come, as at the end of a replay.
        """
        ...

    def close(self) -> None:
        """Free the port; may be repeated."""
        ...


class Pluggable(Protocol):
    """A simulated device that a transport reads, in its attribute ``device``."""

    def unplug(self, seconds: float) -> None:
        """Pull the plug; the device plugs itself in again after some time [s]."""
        ...


class NoTransport:
    """What a closed source has in place of its transport: nothing comes any more."""

    reconnects = False

    def __init__(self, address: str) -> None:
        self.address = address

    def open(self) -> None:
        """Refuse; raises `OSError`."""
        raise OSError("it is closed")

    def read(self, _longest: float) -> Chunk:
        """Bring nothing; raises `EOFError`."""
        raise EOFError("Closed.")

    def close(self) -> None:
        """Do nothing."""
