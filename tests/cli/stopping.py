"""Stopping: a command in a process of its own that is sent Ctrl-C while it works."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest
from asking import RUN_SECONDS

cannot_stop = pytest.mark.skipif(os.name == "nt", reason="Windows cannot send Ctrl-C to one process")


def stopped(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Return what a command answers that is sent Ctrl-C once it has told of a run."""
    command = [sys.executable, "-m", "dashboards", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        assert running.stderr is not None
        told = next(line for line in running.stderr if " runs" in line)
        running.send_signal(signal.SIGINT)
        out, error = running.communicate(timeout=RUN_SECONDS)
    return subprocess.CompletedProcess(command, running.returncode, out, told + error)
