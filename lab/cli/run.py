"""``ins-lab run``: a mission navigated once: its errors, and the verdict on the filter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from lab.cli import options
from lab.cli.app import CommandError, option, print_json, working, writing
from lab.cli.export import check_export, write
from lab.cli.terminal import ProgressLine, format_list, paragraphs, table
from lab.missions import LogMission
from lab.missions import mission as find_mission

if TYPE_CHECKING:
    from lab.analysis.verdicts.verdict import Verdict
    from lab.experiment.experiment import Experiment
    from lab.experiment.result import Result

EXAMPLES = """\b
Examples:
  ins-lab run montreal
  ins-lab run los_angeles --seed 3 --out run.nc
  ins-lab run my_flight.csv --set navigator.r_scale=0.01 --json
  ins-lab run montreal --json --with budget > montreal.json
  ins-lab run montreal --set "sensors.gps.outages=[[60, 90]]"
  ins-lab run montreal --card ADIS16470
  ins-lab run montreal --algorithm my_filter.py:MyFilter
  ins-lab run montreal --export montreal.kml
  ins-lab run my_drive --set navigator.gate=0.999
  ins-lab run my_copter --from 1030 --to 1100 --vehicle copter
my_drive is the folder of a log, with imu.csv, gnss.csv and optionally ref.csv and log.toml.
A FILE.toml holds the same settings in tables, such as
  [sensors.gyro]
  noise_density = 0.02"""


_LOG_SETTINGS = {
    "--from": "navigator.log_from",
    "--to": "navigator.log_to",
    "--vehicle": "navigator.vehicle",
    "--heading": "navigator.initial_heading",
}


def run(
    mission: options.Mission,
    config: options.Config = None,
    card: options.Card = None,
    assumed: options.Assumed = True,
    assignments: options.Assignments = None,
    seed: options.Seed = None,
    own: options.AlgorithmFile = None,
    start: Annotated[
        float | None, option("--from", "SECONDS", "Start within a log, in the clock of its file.")
    ] = None,
    end: Annotated[
        float | None, option("--to", "SECONDS", "End within a log, in the clock of its file.")
    ] = None,
    vehicle: Annotated[
        str | None, option("--vehicle", "NAME", "Vehicle that carried the sensors of a log.")
    ] = None,
    heading: Annotated[
        float | None,
        option("--heading", "DEGREES", "True heading at the first sample of a log, if it is known."),
    ] = None,
    out: Annotated[Path | None, option("--out", "FILE.nc", "Write the whole result as netCDF.")] = None,
    export: Annotated[
        Path | None,
        option(
            "--export",
            "FILE",
            "Write the paths: .kml for Google Earth, .gpx for maps; or the estimate: .csv as a flight "
            "csv, and what ins-lab export lists.",
        ),
    ] = None,
    force: options.Force = False,
    as_json: options.AsJson = False,
    further: options.Further = None,
) -> None:
    """Navigate a mission; show the errors, and whether the filter states them correctly."""
    more = options.further_parts(further, as_json)
    options.check_out(out, force, ".nc", "a netCDF file", "--out")
    check_export(export, force, "--export")
    chosen = options.experiment(mission, config, card, assignments, seed, assumed)
    _set_log(chosen, {"--from": start, "--to": end, "--vehicle": vehicle, "--heading": heading})
    with working(chosen.mission) as progress:
        result = chosen.run(progress, algorithm=options.algorithm(own))
        if out is not None:
            write_result(result, out, force)
        if export is not None:
            write(result, export, force, "--export")
        if as_json:
            found = json_facts(result, more, progress, out=out, export=export)
        verdict = result.tried_verdict
    if as_json:
        print_json(found)
    else:
        print(report(result, verdict))


def report(result: Result, verdict: Verdict) -> str:
    """Return a result as text: its errors, its remarks, and a verdict."""
    return paragraphs(_errors(result), format_list(result.remarks), verdict_text(verdict))


def _set_log(chosen: Experiment, of_logs: Mapping[str, float | str | None]) -> None:
    """Apply the options for logs."""
    given = {name: value for name, value in of_logs.items() if value is not None}
    if given and not isinstance(find_mission(chosen.mission), LogMission):
        raise CommandError(
            f"{', '.join(given)}: only for sensor logs; {chosen.mission} is a simulated flight"
        )
    for name, value in given.items():
        chosen.set(_LOG_SETTINGS[name], value)


def write_result(result: Result, out: Path, force: bool) -> None:
    """Write a result as netCDF; `CommandError` if it cannot be written."""
    with writing(out, "--out"):
        result.to_netcdf(out, overwrite=force)


def json_facts(
    result: Result, more: Sequence[str], progress: ProgressLine, **written: Path | None
) -> dict[str, Any]:
    """Return a result as data for JSON, with what `--with` names, and the files that were written."""
    found = result.identify(progress) if "identification" in more else None
    files = {name: None if path is None else str(path) for name, path in written.items()}
    return {**result.to_dict(budget="budget" in more, identification=found), **files}


def _errors(result: Result) -> str:
    """Return the errors as a table; if they are unknown, the innovations."""
    if result.missing_reason("summary"):
        rows = [
            tuple(f"{cell:.3f}" if isinstance(cell, float) else str(cell) for cell in row)
            for row in result.whiteness.itertuples(index=False)
        ]
        return table(
            tuple(result.whiteness.columns), rows, right=set(range(1, len(result.whiteness.columns)))
        )
    from lab.experiment.datasets.tables import summary_rows  # noqa: PLC0415 - help does not need it

    columns, summary = summary_rows(result)
    # Fixed decimals align. Errors far below a millimetre, as without sensor noise, need powers of ten.
    form = ".3f" if min((float(row[2]) for row in summary), default=0.0) > 0.01 else ".2e"
    rows = [
        tuple(f"{cell:{form}}" if isinstance(cell, float) else str(cell) for cell in row) for row in summary
    ]
    return table(columns, rows, right=set(range(2, len(columns))))


def verdict_text(verdict: Verdict) -> str:
    """Return a verdict as text: the headline, then the findings and their advice."""
    basis = "" if verdict.consistent is None else f" ({verdict.basis})"
    lines = [f"Verdict{basis}: {verdict.headline}"]
    for number, finding in enumerate(verdict.findings):
        lines += [f"  {finding.sentence}"] if number else []
        lines += [f"  {finding.counsel} ({finding.evidence})"]
    lines += [f"  {one.sentence} {one.counsel}" for one in verdict.suggestions]
    lines += [f"  {verdict.note.counsel}"] if verdict.note else []
    return "\n".join(lines)
