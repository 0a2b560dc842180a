"""Processors: how many of them this process may use, with the share that its control groups say."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path

CONTROL_GROUPS = Path("/sys/fs/cgroup")


def processors() -> int:
    """Return the number of processors that this process may use, one or more.

    A computer may have more: the process may be bound to some, and a container has its share, which is
    rounded up.
    """
    return max(min(_limits()), 1)


def _limits() -> Iterator[int]:
    yield os.cpu_count() or 1
    if hasattr(os, "sched_getaffinity"):
        yield len(os.sched_getaffinity(0))
    for folder, version in control_group_folders("cpu"):
        names = ("cpu.max",) if version == 2 else ("cpu.cfs_quota_us", "cpu.cfs_period_us")
        numbers = " ".join(system_text(folder / name) for name in names).split()
        if len(numbers) == 2 and all(number.isdigit() for number in numbers) and int(numbers[1]) > 0:
            yield math.ceil(int(numbers[0]) / int(numbers[1]))


def control_group_folders(controller: str) -> Iterator[tuple[Path, int]]:
    """Iterate over the folders of this process's control groups and of their parents.

    Parameters
    ----------
    controller
        What is controlled, such as ``"memory"``.

    Yields
    ------
    tuple
        The folder, and the version of its files.
    """
    for line in system_text(Path("/proc/self/cgroup")).splitlines():
        _, kinds, path = [*line.split(":", 2), "", ""][:3]
        if kinds and controller not in kinds.split(","):
            continue
        root, version = (CONTROL_GROUPS / controller, 1) if kinds else (CONTROL_GROUPS, 2)
        group = root / path.lstrip("/")
        # In a container, the path may be that of the host, and only the root is visible.
        for folder in (group, *group.parents):
            yield folder, version
            if folder == root:
                break


def system_text(path: Path) -> str:
    """Return the content of a file of the system; empty if there is none."""
    try:
        return path.read_text(encoding="ascii", errors="replace")
    except OSError:
        return ""
