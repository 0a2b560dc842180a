"""Address space: how much memory a process may address, where the system enforces a bound."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from lab.base.processors import system_text


def address_space() -> int:
    """Return the address space of this process [bytes]."""
    pages = system_text(Path("/proc/self/statm")).split()
    return int(pages[0]) * os.sysconf("SC_PAGE_SIZE") if pages else 0


def limit_memory(more: int) -> None:
    """Bound the memory that this process takes from now on; Linux enforces it, nothing happens elsewhere.

    Parameters
    ----------
    more
        Most memory beyond what the process has now [bytes].
    """
    if sys.platform != "linux":
        return
    import resource  # noqa: PLC0415 - not there on Windows

    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    most = address_space() + more
    resource.setrlimit(
        resource.RLIMIT_AS, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard)
    )
