"""Memory: how much a run needs, how much there is, and a message before a run that needs more."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

from lab.histories import LONG
from lab.navigation.kalman import MEASUREMENTS

BESIDE = 230
"""What a sample takes beside the solution [bytes]: truth 88, measured increments 48, true ones 24, and room
to work in; measured on four hours at 200 Hz."""
DRIFT = 48
"""What a sample takes for each triad whose bias changes [bytes]."""
ARM = 49
"""What a sample takes for the sum of all turns, where a lever arm asks for the rate about each fix [bytes];
measured, see `lab.navigation.lever_arm.turns`."""
ALWAYS = 256 * 2**20
"""What a run may take without asking [bytes]: the limit of the cache, which is there anyway."""
SPARE = 0.9
"""Part of the available memory that a run may take; the rest is for what goes on beside it."""

_CONTROL_GROUPS = Path("/sys/fs/cgroup")


class TooLongError(ValueError):
    """A run needs more memory than there is."""


def check_memory(
    samples: int, fixes: int, rate: float, *, states: int, drifting: int, exact: bool, arm: bool
) -> None:
    """Refuse a run that needs more memory than is available.

    Parameters
    ----------
    samples, fixes
        How many there are.
    rate
        Rate of the samples [Hz].
    states
        Number of error states of the filter.
    drifting
        Number of triads whose bias changes.
    exact
        Whether all histories are kept in float64, as by the smoother.
    arm
        Whether the filter assumes a lever arm.

    Raises
    ------
    TooLongError
        If it needs more; the message says how long a flight may be.
    """
    each = bytes_per_sample(samples, states=states, drifting=drifting, exact=exact, arm=arm)
    needed = samples * each + fixes * bytes_per_fix(states)
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


def bytes_per_sample(samples: int, *, states: int, drifting: int, exact: bool, arm: bool) -> int:
    """Return the memory that a sample of a run takes [bytes]; see `check_memory`."""
    motion, shown = 10, states + 12 + (states - 15)
    precise = exact or samples <= LONG
    return BESIDE + DRIFT * drifting + ARM * arm + 8 * motion + (8 if precise else 4) * shown


def bytes_per_fix(states: int) -> int:
    """Return the memory that a fix takes [bytes]: P, H, two covariances, and copies of a smoother."""
    return 8 * (2 * states**2 + 4 * MEASUREMENTS * states + 3 * MEASUREMENTS**2)


def available() -> int:
    """Return the memory that this process can still take without swapping [bytes].

    The least of what the system has, what its control group may take, and what its own limit allows.
    """
    return max(min(_sources()), 0)


def _sources() -> Iterator[int]:
    yield _of_system()
    yield from _of_groups()
    if sys.platform != "win32":
        import resource  # noqa: PLC0415 - not there on Windows

        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        if limit != resource.RLIM_INFINITY:
            yield limit - _taken()


def _of_system() -> int:
    """Return what the system says is available; where it does not say, so much that nothing is refused."""
    for line in _read(Path("/proc/meminfo")).splitlines():
        if line.startswith("MemAvailable:"):
            return int(line.split()[1]) * 1024
    try:
        # macOS does not say what is available: half of what there is.
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2
    except (AttributeError, ValueError, OSError):
        return sys.maxsize


def _of_groups() -> Iterator[int]:
    """Iterate over what the control groups of this process, and those they are in, may still take."""
    for line in _read(Path("/proc/self/cgroup")).splitlines():
        _, kinds, path = [*line.split(":", 2), "", ""][:3]
        if not kinds:  # version 2
            root, names = _CONTROL_GROUPS, ("memory.max", "memory.current", "inactive_file")
        elif "memory" in kinds.split(","):
            root = _CONTROL_GROUPS / "memory"
            names = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
        else:
            continue
        group = root / path.lstrip("/")
        # In a container the path may be that of the host, and only the root is there.
        for folder in (group, *group.parents):
            limit, used = (_read(folder / name).strip() for name in names[:2])
            if limit.isdigit() and used.isdigit():
                yield int(limit) - int(used) + _cached(folder, names[2])
            if folder == root:
                break


def _cached(folder: Path, name: str) -> int:
    """Return how much of what a control group uses is a cache of files, which the system gives back."""
    for line in _read(folder / "memory.stat").splitlines():
        key, _, value = line.partition(" ")
        if key == name and value.strip().isdigit():
            return int(value)
    return 0


def _taken() -> int:
    """Return the address space that this process takes [bytes]."""
    pages = _read(Path("/proc/self/statm")).split()
    return int(pages[0]) * os.sysconf("SC_PAGE_SIZE") if pages else 0


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii", errors="replace")
    except OSError:
        return ""
