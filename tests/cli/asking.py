"""How tests ask the command line: in this process, or in one of its own."""

from __future__ import annotations

import os
import subprocess
import sys

from typer.testing import CliRunner
from typer.testing import Result as Answer

from dashboards import command_line

RUN_SECONDS = 240
"""What a cold start may take, with the navigator to be compiled, before it counts as hung."""


def ask(*arguments: str) -> Answer:
    """Return what the command line answers, in this process."""
    return CliRunner().invoke(command_line.app, list(arguments))


def process(*arguments: str, **environment: str) -> subprocess.CompletedProcess[bytes]:
    """Return what the command line answers in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "dashboards", *arguments],
        capture_output=True,
        env={**os.environ, **environment},
        timeout=RUN_SECONDS,
        check=False,
    )


def refused(answer: Answer, *words: str) -> None:
    """Check that an answer is a message on standard error with these words, and exit code 2."""
    assert answer.exit_code == 2, answer.output
    assert answer.stdout == ""
    assert "Traceback" not in answer.stderr
    for word in words:
        assert word in answer.stderr
