"""``ins-lab budget``: the contribution of each source of error to the errors of a mission's solution."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np

from lab.cli.app import CommandError, option, print_json, working
from lab.cli.options import AsJson, Assignments, Assumed, Card, Config, Mission, Seed, experiment
from lab.cli.terminal import paragraphs, table

if TYPE_CHECKING:
    import xarray as xr

EXAMPLES = """\b
Examples:
  ins-lab budget montreal
  ins-lab budget montreal --set navigator.r_scale=100
  ins-lab budget los_angeles --at 60 --json
The columns are 1σ of all three components together, and the share of the variance. The total is σ of the
true errors, whether the filter is right or wrong. The JSON adds the filter's own σ and every component."""


def error_budget(
    mission: Mission,
    config: Config = None,
    card: Card = None,
    assumed: Assumed = True,
    assignments: Assignments = None,
    seed: Seed = None,
    at: Annotated[float | None, option("--at", "TIME", "Time of the budget, in seconds.", "the end")] = None,
    as_json: AsJson = False,
) -> None:
    """Show the contribution of each source of error to the errors of a mission's solution."""
    chosen = experiment(mission, config, card, assignments, seed, assumed)
    with working(chosen.mission) as progress:
        result = chosen.run(progress)
        _check_time(at, float(result.time[-1]))
        dataset = result.budget
    there = dataset.isel(time=-1) if at is None else dataset.sel(time=at, method="nearest")
    if as_json:
        from lab.experiment.json_form import budget_to_json  # noqa: PLC0415 - help does not need it
        from lab.run.provenance import describe_origin  # noqa: PLC0415 - beside it

        print_json({**describe_origin(chosen), "remarks": list(result.remarks), **budget_to_json(there)})
    else:
        print(paragraphs(_budget(there), chosen.sensors.card_remark()))


def _check_time(at: float | None, end: float) -> None:
    if at is not None and not 0 <= at <= end:
        raise CommandError(f"--at {at:g}: accepted is a time from 0 to {end:g} s, the end of the flight")


def _budget(there: xr.Dataset) -> str:
    """Return a budget at one time as text: the sources by size, their total, and the omitted errors.

    Each kind of quantity is one number, of all three components together: the root of the sum of the
    variances of east, north and up, or of roll, pitch and heading.
    """
    kinds = (("position", "m"), ("velocity", "m/s"), ("attitude", "°"))
    parts = (there.sigma.values[:, :9] ** 2).reshape(-1, 3, 3).sum(axis=2)
    parts = np.concatenate((parts, parts.sum(axis=0, keepdims=True)))
    shares = 100 * parts / parts[-1]
    names = [*there.source.values.tolist(), "total"]
    order = [*np.argsort(-shares[:-1].sum(axis=1), kind="stable"), len(names) - 1]
    rows = [
        (
            str(names[row]),
            *(
                cell
                for variance, share in zip(parts[row], shares[row], strict=True)
                for cell in (f"{np.sqrt(variance):.3g}", f"{share:.1f}")
            ),
        )
        for row in order
    ]
    header = [title for kind, unit in kinds for title in (f"{kind} [{unit}]", f"{kind} [%]")]
    text = table(("source", *header), rows, right=set(range(1, 7)))
    left_out = there.attrs["left_out"]
    return f"{text}\n\nNot in the budget: {left_out}" if left_out else text
