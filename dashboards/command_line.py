"""Command line: ``ins-lab`` with the commands of `lab.cli` and the command that serves the dashboard."""

from __future__ import annotations

from lab.cli import app, main
from lab.cli.app import COMMANDS

__all__ = ["COMMANDS", "app", "main"]

COMMANDS["serve"] = (
    "dashboards.serve_command:serve",
    "Serve the dashboard, and open it in a browser if there is a screen.",
)
