"""``ins-lab fly``: a mission flown anew in JSBSim."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lab.cli.app import working
from lab.cli.options import Force
from lab.missions import fly_mission

EXAMPLES = """\b
Examples:
  ins-lab fly montreal
  ins-lab fly montreal --seed 12 --out my_missions"""


def fly(
    mission: Annotated[
        str,
        typer.Argument(
            metavar="MISSION",
            help="Name of a mission with a flight plan, or its .toml file.",
            show_default=False,
        ),
    ],
    seed: Annotated[
        int | None,
        typer.Option("--seed", metavar="N", help="Seed of the turbulence.", show_default="the plan's own"),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="FOLDER", help="Where the mission is written.", show_default="your own missions"
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Fly a mission's plan again in JSBSim and record it.

    Needs JSBSim: pip install 'ins-lab[fly]'. The same plan and seed give the same flight, bit by bit.
    """
    with working(mission) as progress:
        flown = fly_mission(
            mission,
            seed=seed,
            folder=out,
            overwrite=force,
            progress=lambda fraction: progress("flying", fraction),
        )
    print(f"{flown.recording_path}: {flown.duration:.1f} s flown")
