"""Transport: brings the bytes of a device, with the time at which they arrived, or says why it cannot."""

from __future__ import annotations

import errno
import socket
from collections.abc import Mapping
from typing import NamedTuple, Protocol, runtime_checkable

_WORDS: Mapping[int, str] = {
    errno.ENOENT: "there is no such port",
    errno.ENODEV: "there is no such port",
    errno.ENXIO: "there is no such port",
    errno.EBUSY: "another program uses it",
    errno.EAGAIN: "another program uses it",  # what pyserial gets for a port that is locked
    errno.EACCES: "the system does not allow it to this user (for a serial port on Linux, the group "
    "dialout may)",
    errno.EPERM: "the system does not allow it to this user",
    errno.ENOTTY: "it is no serial port",
    errno.EINVAL: "it does not accept these settings",
    errno.EISDIR: "it is a folder",
    errno.EADDRINUSE: "another program listens on this port",
    errno.EADDRNOTAVAIL: "this computer does not have this address",
    errno.ECONNREFUSED: "nobody listens there",
    errno.ECONNRESET: "the other side broke the connection",
    errno.ECONNABORTED: "the connection broke",
    errno.EPIPE: "the other side ended the connection",
    errno.ETIMEDOUT: "the other side does not answer",
    errno.EHOSTUNREACH: "the other computer cannot be reached",
    errno.ENETUNREACH: "no network leads there",
    errno.EIO: "the device was unplugged",
}
"""What a person can do something about, by the number of the error."""


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

    def close(self) -> None:
        """Free the port; may be repeated."""


class Pluggable(Protocol):
    """A simulated device that a transport reads, in its attribute ``device``."""

    def unplug(self, seconds: float) -> None:
        """Pull the plug; the device plugs itself in again after some time [s]."""


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


def in_words(number: int | None) -> str:
    """Return what an error number means for a device; empty for one that needs the system's own words."""
    return _WORDS.get(number, "") if number is not None else ""


def describe_cause(error: OSError) -> str:
    """Return why a device cannot be opened or read, as a clause.

    Parameters
    ----------
    error
        What opening or reading raised; a message that the transport wrote is kept.
    """
    if isinstance(error, socket.gaierror):
        return "no computer with this name is found"
    if isinstance(error, TimeoutError) and error.errno is None:
        return "the other side does not answer"
    return (in_words(error.errno) or error.strerror or str(error) or type(error).__name__).rstrip(".")
