"""Memory: the memory that a run needs, the available memory, and a check before the run."""

from __future__ import annotations

import ctypes
import mmap
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from lab.base.histories import SINGLE
from lab.base.processors import control_group_folders, system_text
from lab.navigation.filters.kalman import MEASUREMENTS

BESIDE = 202
"""Memory per sample besides the solution [bytes]: truth 60, measured increments 48, true ones 24, and work
space; measured on four hours at 200 Hz."""
DRIFT = 48
"""Memory per sample for each triad with a varying bias [bytes]."""
ARM = 33
"""Memory per sample for the angular rates about each fix, needed with a lever arm [bytes]; measured, see
`lab.navigation.lever_arm.mean_rates_at_fixes`."""
ALWAYS = 256 * 2**20
"""Memory that a run may use without a check [bytes]: the limit of the cache, which is available anyway."""
SPARE = 0.9
"""Fraction of the available memory that a run may use; the rest is for other work."""
VERY_LONG = 2**19
"""Number of samples beyond which freed large blocks are given back at once, 44 minutes at 200 Hz: the pages
of a block must be made anew each time, which takes a run of 0.3 million samples 3 to 9 % longer."""
BLOCK = 4 * 2**20
"""Size from which a block is large [bytes]: below a column of a very long flight in float64."""
_USUAL_BLOCK = 32 * 2**20
"""Size from which the C library never keeps a freed block [bytes], its own bound on 64 bits."""
SERVED_BLOCK = 256 * 2**10
"""Size from which the C library gives a freed block back at once in a server [bytes]: its pages come and go,
and what they leave between the blocks of others never goes back. A run takes as long as without it."""
_ARENA_MAX, _MMAP_THRESHOLD, _TRIM_THRESHOLD = -8, -3, -1
"""Numbers of the options M_ARENA_MAX, M_MMAP_THRESHOLD and M_TRIM_THRESHOLD in malloc.h."""

_changing = threading.Lock()
_very_long: list[int] = []
"""Numbers of samples of the very long flights that are worked on, in any thread."""
_usual_block = [_USUAL_BLOCK]
"""Size from which a freed block goes back while there is no very long flight [bytes]."""

_GROUP_FILES = {
    1: ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
    2: ("memory.max", "memory.current", "inactive_file"),
}
"""By the version of a control group, the files with its limit and with what it uses, and the name of its
file cache, which the system can release."""


class TooLongError(ValueError):
    """A run needs more memory than is available."""


def check_memory(needed: int, samples: int, rate: float) -> None:
    """Raise `TooLongError` if a run needs more memory than is available.

    Parameters
    ----------
    needed
        Memory that it needs [bytes]; see `bytes_per_run`.
    samples
        Number of samples.
    rate
        Their rate [Hz].

    Raises
    ------
    TooLongError
        If it needs more; the message gives the longest possible flight.
    """
    if needed <= ALWAYS:
        return
    there = SPARE * available()
    if needed > there:
        part = there / needed
        raise TooLongError(
            f"{samples / rate:.6g} s at {rate:g} Hz need {needed / 1e9:.2g} GB of memory, and "
            f"{there / 1e9:.2g} GB are available. Accepted here are up to {part * samples / rate:.4g} s at "
            f"this rate, or up to {part * rate:.3g} Hz (trajectory.imu_rate)"
        )


def at_once(needed: int, wanted: int) -> int:
    """Return how many runs fit into the available memory, one or more, of those that are wanted at once.

    Parameters
    ----------
    needed
        Memory that each needs [bytes].
    wanted
        Number of runs.
    """
    return max(min(wanted, int(SPARE * available() / max(needed, 1))), 1)


def bytes_per_run(
    samples: int,
    fixes: int,
    *,
    states: int,
    drifting: int,
    exact: bool,
    arm: bool,
    aids: int = 0,
) -> int:
    """Return the memory that a run needs [bytes].

    Parameters
    ----------
    samples, fixes
        Numbers of samples and fixes.
    states
        Number of error states of the filter.
    drifting
        Number of triads with a varying bias.
    exact
        Whether all histories are float64, as for the engine filterpy.
    arm
        Whether the filter assumes a lever arm.
    aids
        Number of measurements besides fixes.
    """
    each = bytes_per_sample(samples, states=states, drifting=drifting, exact=exact, arm=arm)
    return samples * each + fixes * bytes_per_fix(states) + aids * bytes_per_aid(states)


def bytes_per_sample(samples: int, *, states: int, drifting: int, exact: bool, arm: bool) -> int:
    """Return the memory per sample of a run [bytes]; see `bytes_per_run`."""
    position, others = 3, 7 + states + 12 + (states - 15)
    precise = exact or samples <= SINGLE
    return BESIDE + DRIFT * drifting + ARM * arm + 8 * position + (8 if precise else 4) * others


def bytes_per_fix(states: int) -> int:
    """Return the memory per fix [bytes]: P, H, two covariances, and copies for a smoother."""
    return 8 * (2 * states**2 + 4 * MEASUREMENTS * states + 3 * MEASUREMENTS**2)


def bytes_per_aid(states: int) -> int:
    """Return the memory per measurement besides fixes [bytes]: row of H, gain, and 10 numbers of its own."""
    return 8 * (2 * states + 10)


def give_back() -> None:
    """Give freed memory back to the system, where the C library is that of GNU.

    It keeps freed blocks of up to 32 MB for itself. Making the curve of a long flight leaves some 100 MB of
    them, which the histories, each in a block of its own, cannot use.
    """
    if sys.platform == "linux":
        trim = getattr(_c_library(), "malloc_trim", None)
        if trim is not None:
            trim(0)


@cache
def _c_library() -> ctypes.CDLL:
    """Return the C library of this process; each other object of it leaves a class as cyclic garbage."""
    return ctypes.CDLL(None)


def keep_few_freed_blocks() -> None:
    """Give freed blocks back to the system from `SERVED_BLOCK` on, until the process ends, for a server.

    The C library of GNU otherwise keeps blocks of up to 32 MB, in heaps of up to eight threads for each
    processor: after fifteen streams at 1 kHz that had ended, 0.8 GB.
    """
    change = _mallopt()
    if change is not None:
        with _changing:
            _usual_block[0] = SERVED_BLOCK
            change(_ARENA_MAX, 2)
            change(_TRIM_THRESHOLD, 4 * SERVED_BLOCK)
            change(_MMAP_THRESHOLD, SERVED_BLOCK)


def _mallopt() -> Callable[[int, int], int] | None:
    """Return the function that sets an option of the C library's memory, where there is one."""
    return getattr(_c_library(), "mallopt", None) if sys.platform == "linux" else None


@contextmanager
def large_blocks_given_back(samples: int) -> Iterator[None]:
    """Give freed blocks from `BLOCK` on back to the system at once, while work on a very long flight runs.

    The C library of GNU keeps freed blocks of up to 32 MB, for each thread apart; with them, comparing the
    error models over four hours at 200 Hz took 1.62 GB instead of 1.46. Work in other threads meanwhile only
    takes longer. The C library has one setting for all threads, so the last work that ends resets it.

    Parameters
    ----------
    samples
        Number of samples; up to `VERY_LONG`, nothing changes.
    """
    change = _mallopt()
    if change is None or samples <= VERY_LONG:
        yield
        return
    with _changing:
        _very_long.append(samples)
        change(_MMAP_THRESHOLD, min(BLOCK, _usual_block[0]))
    try:
        yield
    finally:
        with _changing:
            _very_long.remove(samples)
            if not _very_long:
                change(_MMAP_THRESHOLD, _usual_block[0])


class Retiring:
    """An array in float64 whose rows are not needed exactly any more, part by part, the last part first.

    They are kept in float32, and on Linux their memory is given back to the system at once.

    Parameters
    ----------
    exact : (n, k) array
        The array. Nothing else may need a row after it has been retired: it becomes zero.

    Attributes
    ----------
    kept : (n, k) array
        The retired rows in float32.
    left : int
        Number of rows, the first ones, that are not retired.
    """

    def __init__(self, exact: NDArray[np.float64]) -> None:
        # Computations with it give float64.
        self.kept = cast(NDArray[np.float64], np.empty(exact.shape, np.float32))
        self.left = exact.shape[0]
        self._exact = exact

    def retire(self, first: int) -> None:
        """Keep the rows from a number on in float32 only."""
        rows = slice(first, self.left)
        self.kept[rows] = self._exact[rows]
        release_pages(self._exact[first:])
        self.left = first


def release_pages(values: NDArray[Any]) -> None:
    """Give the whole pages of memory in a contiguous array back to the system, which makes them zero.

    Where the system is not Linux, nothing happens.
    """
    if sys.platform != "linux" or not values.flags.c_contiguous:
        return
    page, begin = mmap.PAGESIZE, values.ctypes.data
    first, last = -(-begin // page) * page, (begin + values.nbytes) // page * page
    if last > first:
        advise = _c_library().madvise
        advise(ctypes.c_void_p(first), ctypes.c_size_t(last - first), mmap.MADV_DONTNEED)


def available() -> int:
    """Return the memory that this process can still take without swapping [bytes].

    This is the smallest of the system's available memory, the control groups' remaining memory, and the
    process limit.
    """
    return max(min(_sources()), 0)


def resident() -> int:
    """Return the memory that this process has now [bytes]; 0 where the system does not tell."""
    pages = system_text(Path("/proc/self/statm")).split()
    return int(pages[1]) * os.sysconf("SC_PAGE_SIZE") if pages else 0


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


def _sources() -> Iterator[int]:
    yield _of_system()
    yield from _of_groups()
    if sys.platform != "win32":
        import resource  # noqa: PLC0415 - not there on Windows

        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        if limit != resource.RLIM_INFINITY:
            yield limit - address_space()


def _of_system() -> int:
    """Return the available memory of the system; if unknown, so much that nothing is refused."""
    for line in system_text(Path("/proc/meminfo")).splitlines():
        if line.startswith("MemAvailable:"):
            return int(line.split()[1]) * 1024
    try:
        # macOS does not report the available memory, so half of the total is used.
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2
    except (AttributeError, ValueError, OSError):
        return sys.maxsize


def _of_groups() -> Iterator[int]:
    """Iterate over the remaining memory of this process's control groups and their parents."""
    for folder, version in control_group_folders("memory"):
        limit, used, cached = _GROUP_FILES[version]
        numbers = [system_text(folder / name).strip() for name in (limit, used)]
        if all(number.isdigit() for number in numbers):
            yield int(numbers[0]) - int(numbers[1]) + _file_cache_size(folder, cached)


def _file_cache_size(folder: Path, name: str) -> int:
    """Return the file cache within the memory of a control group, which the system can release."""
    for line in system_text(folder / "memory.stat").splitlines():
        key, _, value = line.partition(" ")
        if key == name and value.strip().isdigit():
            return int(value)
    return 0
