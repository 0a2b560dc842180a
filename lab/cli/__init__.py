"""The command line, ``ins-lab``: one file for each command; `app` collects them.

Read first: `app`, `run`, `options`.

Results go to standard output, everything else to standard error. An error that a person can correct gives one
message and exit code 2. Commands import their dependencies when they run, so that help appears at once.
"""

from __future__ import annotations

from lab.cli import (
    allan,
    budget,
    cards,
    compare,
    export,
    fly,
    grade,
    homework,
    identify,
    import_flight,
    lesson,
    live,
    missions,
    notebooks,
    record,
    run,
    warm,
)
from lab.cli.app import app, main

__all__ = ["app", "main"]

# In the order of the help; `dashboards.command_line` adds the last one, which serves the dashboard.
app.command("missions")(missions.list_missions)
app.command("run", epilog=run.EXAMPLES)(run.run)
app.command("compare", epilog=compare.EXAMPLES)(compare.compare)
app.command("budget", epilog=budget.EXAMPLES)(budget.error_budget)
app.command("identify", epilog=identify.EXAMPLES)(identify.identify)
app.command("fly", epilog=fly.EXAMPLES)(fly.fly)
app.command("import", epilog=import_flight.EXAMPLES)(import_flight.import_flight)
app.command("record", epilog=record.EXAMPLES)(record.record)
app.add_typer(live.live, epilog=live.EXAMPLES)
app.command("export", epilog=export.EXAMPLES)(export.export)
app.command("rename")(missions.rename)
app.command("delete")(missions.delete)
app.command("cards", epilog=cards.EXAMPLES)(cards.list_cards)
app.command("allan", epilog=allan.EXAMPLES)(allan.allan)
app.add_typer(lesson.lesson, epilog=lesson.EXAMPLES)
app.add_typer(homework.homework, epilog=homework.EXAMPLES)
app.command("grade", epilog=grade.EXAMPLES)(grade.grade)
app.add_typer(notebooks.notebooks, epilog=notebooks.EXAMPLES)
app.command("warm", epilog=warm.EXAMPLES)(warm.warm)
