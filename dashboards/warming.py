"""Warming: a process of lowest priority beside the server, which compiles the filter ahead."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys


class Warming:
    """Compiles the filter for every combination of settings, so that no visitor waits for the compiler.

    The process ends by itself, after some minutes, or sooner if all is compiled already.
    """

    def __init__(self) -> None:
        # A process of its own: threads would share the interpreter's lock with the pages.
        self._process = subprocess.Popen(
            [sys.executable, "-c", "from lab.cli import main; main()", "warm", "--idle"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        )

    def end(self) -> None:
        """End the process if it still works; what it has compiled stays."""
        with contextlib.suppress(ProcessLookupError):
            self._process.terminate()
        self._process.wait()
