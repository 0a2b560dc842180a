"""``ins-lab outage``: which sensors hold a wish without GPS."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lab.cli import options
from lab.cli.app import option, print_json, working, writing
from lab.cli.interrupt import STOPPED, interrupted
from lab.cli.terminal import paragraphs, table
from lab.missions import mission as find_mission

if TYPE_CHECKING:
    from lab.experiment.experiment import Experiment
    from lab.experiment.outage_table import OutageTable

EXAMPLES = """\b
Examples:
  ins-lab outage montreal
  ins-lab outage montreal --cards all --seeds 100 --wish 10
  ins-lab outage montreal --seconds 30 --cards BMI088,ADIS16470 --out outages.nc
  ins-lab outage montreal --set navigator.q_scale=0.1 --json
Each run has one outage. The begins are spread over the flight; each card has the same. "95 %" stands beside
its own 95 % interval, from the number of runs. For a log, fixes are withheld: an outage, then fixes for twice
as long, in three turns. Ctrl-C shows the runs that are done."""


def outage(
    mission: options.Mission,
    seconds: Annotated[float, typer.Option("--seconds", metavar="S", help="Length of an outage [s].")] = 60.0,
    cards: Annotated[
        str | None,
        option(
            "--cards",
            "NAME,...|all",
            "Sensor cards, each with the filter that suits it; by default the sensors of the settings.",
        ),
    ] = None,
    seeds: options.Seeds = 100,
    wish: Annotated[
        float | None, option("--wish", "M", "Horizontal error that 95 % of the outages shall not exceed [m].")
    ] = None,
    exact: Annotated[
        bool,
        typer.Option("--exact", help="Propagate the covariance at each IMU sample, not 20 times a second."),
    ] = False,
    workers: options.Workers = None,
    scheduler: options.Scheduler = None,
    config: options.Config = None,
    assignments: options.Assignments = None,
    seed: options.Seed = None,
    out: Annotated[Path | None, option("--out", "FILE.nc", "File for the errors of all runs.")] = None,
    force: options.Force = False,
    as_json: options.AsJson = False,
) -> None:
    """Show which error a time without GPS leaves, sensor by sensor, with its own interval."""
    options.check_out(out, force, ".nc", "a netCDF file", "--out")
    chosen = options.experiment(mission, config, None, assignments, seed)
    names = cards if cards in (None, "all") else [name.strip() for name in str(cards).split(",")]

    with (
        options.cluster_of(scheduler) as client,
        working(chosen.mission) as progress,
        interrupted() as pressed,
    ):
        found = chosen.outage(
            seconds,
            names,
            seeds,
            wish,
            fast=not exact,
            workers=workers,
            progress=progress,
            cancelled=pressed.is_set,
            client=client,
        )
    if as_json:
        from lab.run.provenance import describe_origin  # noqa: PLC0415 - help does not need it

        print_json({**describe_origin(chosen), **found.to_dict(), "out": None if out is None else str(out)})
    else:
        print(_text(found, chosen))
    if out is not None:
        given = {"cards": names, "seeds": seeds, "wish": wish, "fast": not exact}
        _write(found, chosen, given, out, force)
    if pressed.is_set() or found.ended:
        print("ins-lab: stopped; the table is that of the runs that are done", file=sys.stderr)
        raise typer.Exit(STOPPED)


def _text(found: OutageTable, chosen: Experiment) -> str:
    """Return a table of outages as text, with what limits the errors, and the remarks."""
    titles, rows = found.cells()
    shown = table(titles, rows, right={2, 3, 4, 6, 7})
    note = chosen.sensors.card_remark() if len(rows) == 1 else ""
    return paragraphs(shown, found.tuning, *found.remarks, note)


def _write(found: OutageTable, chosen: Experiment, given: Mapping[str, Any], out: Path, force: bool) -> None:
    """Write the errors of all runs as netCDF; `CommandError` if they cannot be written."""
    from lab.base.result_files import write_netcdf  # noqa: PLC0415 - rarely needed
    from lab.run.provenance import OUTAGES, collect_facts, dataset_digest, netcdf_attributes  # noqa: PLC0415 - rarely needed

    data = found.dataset
    facts = collect_facts(
        chosen,
        find_mission(chosen.mission),
        OUTAGES,
        given={"seconds": found.seconds, **given},
        result_sha256=dataset_digest(data),
    )
    about = netcdf_attributes(facts, f"Outages of {found.seconds:g} s, {chosen.mission}")
    with writing(out, "--out"):
        write_netcdf(out, lambda: {"outages": data}, about, overwrite=force)
