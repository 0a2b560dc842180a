"""``ins-lab compare``: error models side by side, on the same flights."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from lab.cli import options
from lab.cli.app import option, print_json, working
from lab.cli.terminal import paragraphs, table

if TYPE_CHECKING:
    from lab.experiment.ensembles.comparison import Compared

EXAMPLES = """\b
Examples:
  ins-lab compare montreal
  ins-lab compare montreal --models phi,psi --seeds 20
  ins-lab compare montreal --algorithm my_filter.py:MyFilter
  ins-lab compare los_angeles --set navigator.attitude_sigma=20 --json
  ins-lab compare montreal --seeds 1000 --scheduler scheduler.json
Every model gets the same flights: same sensors, same draws. Errors are root mean squares over all runs. NEES
and NIS stand beside their expected values. The time is the navigator's for one flight."""

_TITLES = ("model", "position [m]", "velocity [m/s]", "heading [°]", "NEES", "NIS", "time [ms]", "verdict")


def compare(
    mission: options.Mission,
    models: Annotated[
        str | None, option("--models", "NAME,...", "Error models, separated by commas; all by default.")
    ] = None,
    seeds: Annotated[
        int,
        typer.Option("--seeds", min=1, max=options.MOST_RUNS, metavar="N", help="Runs with each model."),
    ] = 1,
    config: options.Config = None,
    card: options.Card = None,
    assumed: options.Assumed = True,
    assignments: options.Assignments = None,
    seed: options.Seed = None,
    own: options.AlgorithmFiles = None,
    scheduler: options.Scheduler = None,
    as_json: options.AsJson = False,
) -> None:
    """Compare error models on the same flights: errors, consistency, time, verdict."""
    chosen = options.experiment(mission, config, card, assignments, seed, assumed)
    from lab.experiment.ensembles import comparison  # noqa: PLC0415 - takes a second

    names = None if models is None else [name.strip() for name in models.split(",")]
    with options.cluster_of(scheduler) as client, working(chosen.mission) as progress:
        rows = comparison.compare(
            chosen, names, seeds, progress, algorithms=options.algorithms(own), client=client
        )
    if as_json:
        gaps = {"assumed": chosen.sensors.assumed_terms(), "lacking": chosen.sensors.lacking_terms()}
        print_json([{**asdict(row), **gaps} for row in rows])
    else:
        print(paragraphs(_comparison(rows), chosen.sensors.card_remark()))


def _comparison(rows: Sequence[Compared]) -> str:
    """Return compared models as a table: rms errors, mean NEES and NIS with expected values, time."""
    cells = [
        (
            row.model,
            *(_format_value(value) for value in (row.position, row.velocity, row.heading)),
            _format_beside(row.nees, row.degrees, row.refusal),
            _format_beside(row.nis, row.nis_degrees, row.refusal),
            _format_value(1000 * row.seconds, ".0f"),
            row.verdict or f"Does not run: {row.refusal}",
        )
        for row in rows
    ]
    return table(_TITLES, cells, right=set(range(1, len(_TITLES) - 1)))


def _format_beside(value: float, degrees: int, refusal: str) -> str:
    """Return a mean NEES or NIS beside its expected value."""
    if math.isfinite(value):
        return f"{value:.2f} / {degrees}"
    return "–" if refusal else "unknown"


def _format_value(value: float, form: str = ".3f") -> str:
    return f"{value:{form}}" if math.isfinite(value) else "–"
