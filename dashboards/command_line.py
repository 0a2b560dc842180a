"""Command line: ``ins-lab`` with the commands of `lab.cli` and the command that serves the dashboard."""

from __future__ import annotations

try:
    import lab

    if "Experiment" not in getattr(lab, "__all__", ()):
        place = getattr(lab, "__file__", None) or "a folder without __init__.py"
        raise SystemExit(
            f"ins-lab: the package lab ({place}) is not that of INS Lab. Another package called lab was "
            "installed or removed after it, or stands before it on the path. The two cannot be in one "
            "environment. Uninstall both (python -m pip uninstall lab ins-lab), and install ins-lab again, "
            "the other package in an environment of its own."
        )

    from lab.cli import app, main
    from lab.cli.app import COMMANDS
except KeyboardInterrupt:  # Ctrl-C while it starts: nothing has begun
    raise SystemExit(130) from None

__all__ = ["COMMANDS", "app", "main"]

COMMANDS["serve"] = (
    "dashboards.serve_command:serve",
    "Serve the dashboard, and open it in a browser if there is a screen.",
)
