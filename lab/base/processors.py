"""Processors: how many of them this process may use."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator

from lab.base import control_groups


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
    for folder, version in control_groups.folders("cpu"):
        names = ("cpu.max",) if version == 2 else ("cpu.cfs_quota_us", "cpu.cfs_period_us")
        numbers = " ".join(control_groups.text(folder / name) for name in names).split()
        if len(numbers) == 2 and all(number.isdigit() for number in numbers) and int(numbers[1]) > 0:
            yield math.ceil(int(numbers[0]) / int(numbers[1]))
