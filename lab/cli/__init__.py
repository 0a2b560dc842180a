"""The command line, ``ins-lab``: one file for each command; `app` collects them.

In: the words of a command line. Out: results on standard output, everything else on standard error. An error
that a person can correct gives one message and exit code 2. Commands import their dependencies when they run,
so that help appears at once.

Read first: `app`, `run`, `options`.
"""

from __future__ import annotations

from lab.cli.app import COMMANDS, app, main

__all__ = ["app", "main"]

# In the order of the help; `dashboards.command_line` adds the last one, which serves the dashboard.
COMMANDS |= {
    "missions": (
        "lab.cli.missions:list_missions",
        "List all missions: those that ship with the lab, and your own.",
    ),
    "run": (
        "lab.cli.run:run",
        "Navigate a mission; show the errors, and whether the filter states them correctly.",
    ),
    "report": (
        "lab.cli.report:report",
        "Write a run as one HTML file: verdict, plots, tables, and what repeats it.",
    ),
    "figure": (
        "lab.cli.figure:figure",
        "Write a plot of a run as a figure for print: PDF, SVG or PNG.",
    ),
    "compare": (
        "lab.cli.compare:compare",
        "Compare error models on the same flights: errors, consistency, time, verdict.",
    ),
    "ensemble": (
        "lab.cli.ensemble:ensemble",
        "Navigate a mission with many seeds; show the errors, and whether the filter states them correctly.",
    ),
    "sweep": (
        "lab.cli.sweep:sweep",
        "Navigate with values of settings, sensor cards or missions and many seeds; show the errors of each.",
    ),
    "outage": (
        "lab.cli.outage:outage",
        "Show which error a time without GPS leaves, sensor by sensor, with its own interval.",
    ),
    "budget": (
        "lab.cli.budget:error_budget",
        "Show the contribution of each source of error to the errors of a mission's solution.",
    ),
    "identify": (
        "lab.cli.identify:identify",
        "Find noise, latency and lever arm from the innovations, and whether they predict withheld fixes.",
    ),
    "numbers": (
        "lab.cli.numbers:numbers",
        "Show the noise of an IMU at rest and in motion, why they differ, and what a filter should assume.",
    ),
    "receiver": (
        "lab.cli.receiver:receiver",
        "Find the errors of a receiver's fixes, white and slow, beside its claims, and what a gate rejects.",
    ),
    "calibrate": (
        "lab.cli.calibrate:calibrate",
        "Find constant errors of an IMU, a magnetometer or a mounting from a log, judged on withheld data.",
    ),
    "judge": (
        "lab.cli.judge:judge",
        "Judge the filter of an autopilot's log, or of a csv of innovations.",
    ),
    "scoreboard": (
        "lab.cli.scoreboard:scoreboard",
        "Navigate public data sets with the lab and with other programs, and show who is ahead.",
    ),
    "fly": (
        "lab.cli.fly:fly",
        "Fly a mission's plan and record it.",
    ),
    "import": (
        "lab.cli.import_flight:import_flight",
        "Report on a recorded flight of any known format, rebuild it, and add it to your own missions.",
    ),
    "profile": (
        "lab.cli.profile:profile",
        "What the columns of a maker's csv are: list the profiles, propose one, and check one.",
    ),
    "record": (
        "lab.cli.record:record",
        "Record a mission from a running X-Plane.",
    ),
    "live": (
        "lab.cli.live:live",
        "Streams of sensors: find, watch, record, navigate with and simulate them.",
    ),
    "export": (
        "lab.cli.export:export",
        "Write the path of a mission: KML, GPX, a flight csv, or a trajectory for other programs.",
    ),
    "rename": (
        "lab.cli.missions:rename",
        "Give a mission of your own another name.",
    ),
    "delete": (
        "lab.cli.missions:delete",
        "Delete a mission of your own and its recording; missions that ship cannot be deleted.",
    ),
    "cards": (
        "lab.cli.cards:cards",
        "List the cards of real sensors, show one with its sources, or make one of a data sheet.",
    ),
    "allan": (
        "lab.cli.allan:allan",
        "Fit the noise terms of IEEE 952 to the Allan deviation of an IMU at rest, and test the fit.",
    ),
    "lesson": (
        "lab.cli.lesson:lesson",
        "Lessons of the page: list them, and check one of your own.",
    ),
    "homework": (
        "lab.cli.homework:homework",
        "Homework with hidden settings: make it, work with it, hand it in.",
    ),
    "grade": (
        "lab.cli.grade:grade",
        "Grade the hand-ins of a homework: run their settings, and compare their answers, in a row each.",
    ),
    "notebooks": (
        "lab.cli.notebooks:notebooks",
        "The lessons for Jupyter: list them, and copy them into a folder.",
    ),
    "warm": (
        "lab.cli.warm:warm",
        "Compile the filter ahead for every combination of settings, so that nobody waits for it.",
    ),
}
