"""Cause: why a device cannot be read, in words, by the error of the system."""

from __future__ import annotations

import errno
import socket
from collections.abc import Mapping

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


def in_words(number: int | None) -> str:
    """Return what an error number means for a device; empty for one that needs the system's own words."""
    return _WORDS.get(number, "") if number is not None else ""


def cause_of(error: OSError) -> str:
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
