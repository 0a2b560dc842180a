"""Warming: the process beside the server has the lowest priority and ends with the server."""

from __future__ import annotations

import os
import sys
import time

import pytest

from dashboards.warming import Warming
from lab.base.compiling.compiled_cache import LOWEST_PRIORITY

PATIENCE = 60.0
"""Longest time until the process has read its imports [s]."""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no niceness")
def test_it_works_when_no_other_does_and_ends_when_asked() -> None:
    warming = Warming()
    process = warming._process
    try:
        deadline = time.monotonic() + PATIENCE
        while (
            process.poll() is None
            and os.getpriority(os.PRIO_PROCESS, process.pid) != LOWEST_PRIORITY
            and time.monotonic() < deadline
        ):
            time.sleep(0.05)
        assert process.poll() is None
        assert os.getpriority(os.PRIO_PROCESS, process.pid) == LOWEST_PRIORITY
    finally:
        warming.end()
    assert process.returncode is not None
    warming.end()  # a signal and the end of the server may both ask
