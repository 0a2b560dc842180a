"""Command line: ``ins-lab`` with the commands of `lab.cli` and the command that serves the dashboard."""

from __future__ import annotations

from dashboards import serve_command
from lab.cli import app, main

__all__ = ["app", "main"]

app.command("serve", epilog=serve_command.EXAMPLES)(serve_command.serve)
