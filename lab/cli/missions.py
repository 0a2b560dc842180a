"""``ins-lab missions``, ``rename`` and ``delete``: list all missions, and manage your own."""

from __future__ import annotations

import contextlib
import sys
import warnings
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lab.cli.app import CommandError, argument, print_json
from lab.cli.options import AsJson
from lab.cli.terminal import table
from lab.missions import MissionError, broken_missions, delete_mission, rename_mission
from lab.missions import missions as find_missions

if TYPE_CHECKING:
    from lab.missions import Mission

OwnMission = Annotated[str, argument("MISSION", "Name of a mission of your own.")]


def list_missions(as_json: AsJson = False) -> None:
    """List all missions: those that ship with the lab, and your own."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # omitted missions are listed below
        found = find_missions()
    facts = [_facts(entry) for entry in found.values()]
    readable = [one for one in facts if one]
    for reason in broken_missions().values():
        print(f"ins-lab: mission left out: {reason}", file=sys.stderr)
    if as_json:
        print_json(readable)
        return
    rows = [(one["name"], one["title"], f"{one['duration_s']:.1f} s", one["origin"]) for one in readable]
    print(table(("name", "title", "duration", "origin"), rows, right={2}))


def rename(
    mission: OwnMission,
    new: Annotated[str, argument("NEW", "Its new name.")],
) -> None:
    """Give a mission of your own another name."""
    print(f"{mission} is now called {rename_mission(mission, new).name}")


def delete(
    mission: OwnMission,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Do not ask first.")] = False,
) -> None:
    """Delete a mission of your own and its recording; missions that ship cannot be deleted."""
    from lab.missions.library import user_place  # noqa: PLC0415 - rarely needed

    place = user_place(mission)
    if not yes:
        if not sys.stdin.isatty():
            raise CommandError(
                f"delete {mission}: there is no terminal for a question; add --yes to delete it"
            )
        with contextlib.redirect_stdout(sys.stderr):  # the prompt ends with a printed space
            typer.confirm(f"Delete {place} and its recording?", abort=True)
    delete_mission(mission)
    print(f"{mission} deleted")


def _facts(entry: Mission) -> dict[str, Any]:
    """Return the facts about a mission; empty if its recording cannot be read, which is reported."""
    try:
        duration = entry.duration
    except MissionError as error:
        print(f"ins-lab: mission {entry.name} left out: {error}", file=sys.stderr)
        return {}
    return {
        "name": entry.name,
        "title": entry.title,
        "description": " ".join(entry.description.split()),
        "duration_s": duration,
        "aircraft": entry.aircraft,
        "airport": entry.airport,
        "origin": entry.origin,
        "tags": list(entry.tags),
        "recording": str(entry.recording_path),
        "can_fly": entry.flight is not None,
    }
