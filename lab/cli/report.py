"""``ins-lab report``: a run as one HTML file, which opens without a network and repeats the run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from lab.cli import options
from lab.cli.app import CommandError, option, print_json, working, writing

EXAMPLES = """\b
Examples:
  ins-lab report montreal --to montreal.html
  ins-lab report montreal --set navigator.q_scale=0.1 --to wrong_q.html
  ins-lab report my_drive --to my_drive.html --note "60-75:The tunnel" --note "120:Here it stops"
  ins-lab report montreal --to montreal.html --json > montreal.json"""


def report(
    mission: options.Mission,
    to: Annotated[Path, option("--to", "FILE.html", "File to write.")],
    config: options.Config = None,
    card: options.Card = None,
    assumed: options.Assumed = True,
    assignments: options.Assignments = None,
    seed: options.Seed = None,
    own: options.AlgorithmFile = None,
    note: Annotated[
        list[str] | None,
        option(
            "--note",
            "START-END:TEXT",
            "Note on a stretch of the flight, or on a moment [s]; more of them with more --note.",
        ),
    ] = None,
    force: options.Force = False,
    as_json: options.AsJson = False,
    further: options.Further = None,
) -> None:
    """Write a run as one HTML file: verdict, plots, tables, and what repeats it."""
    from lab.cli.run import json_facts  # noqa: PLC0415 - help does not need it

    more = options.further_parts(further, as_json)
    options.check_out(to, force, ".html", "an HTML file", "--to")
    notes = [_note(text) for text in note or ()]
    chosen = options.experiment(mission, config, card, assignments, seed, assumed)
    with working(chosen.mission) as progress:
        result = chosen.run(progress, algorithm=options.algorithm(own))
        with writing(to, "--to"):
            result.report(to, overwrite=force, notes=notes)
        if as_json:
            found = json_facts(result, more, progress, report=to)
    if as_json:
        print_json(found)
    else:
        print(to)


def _note(text: str) -> tuple[float, float, str]:
    from lab.views.flight_notes import ACCEPTED, read_note  # noqa: PLC0415 - help does not need it

    note = read_note(text)
    if note is None:
        raise CommandError(f"--note {text[:40]}: {ACCEPTED}")
    return note
