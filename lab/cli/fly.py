"""``ins-lab fly``: a plan flown in JSBSim, or waypoints or motion commands carried out without it."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from lab.cli.app import argument, option, working
from lab.cli.interrupt import interrupted
from lab.cli.options import Force, MissionFolder
from lab.missions import fly_mission

EXAMPLES = """\b
Examples:
  ins-lab fly montreal
  ins-lab fly my_plan.toml
  ins-lab fly motion_def.csv
  ins-lab fly montreal --seed 12 --out my_missions"""

ENDED_EARLY = 3
"""Exit code of a flight that did not reach the end of its plan."""


def fly(
    mission: Annotated[
        str,
        argument(
            "MISSION",
            "Name of a mission with a plan, its .toml file, or a motion definition of gnss-ins-sim.",
        ),
    ],
    seed: Annotated[int | None, option("--seed", "N", "Seed of the turbulence.", "the plan's own")] = None,
    out: MissionFolder = None,
    force: Force = False,
) -> None:
    """Fly a mission's plan and record it.

    A plan lists manoeuvres, flown in JSBSim (pip install 'ins-lab[fly]'), or waypoints or commands, which
    need no simulator; missions/README.md shows each. The same plan and seed give the same flight, bit
    for bit.

    A flight that ends early (a stall, the ground, a plan that cannot be flown, Ctrl-C) is kept as far as it
    went; a message says why, and the exit code is 3.
    """
    with working(mission) as progress, interrupted() as cancelled:
        flown = fly_mission(
            mission,
            seed=seed,
            folder=out,
            overwrite=force,
            progress=lambda fraction: progress("flying", fraction),
            cancelled=cancelled.is_set,
        )
    print(f"{flown.recording_path}: {flown.duration:.1f} s flown")
    if flown.ending:
        print(f"ins-lab: {flown.ending}; the flight up to that point is kept", file=sys.stderr)
        raise typer.Exit(ENDED_EARLY)
