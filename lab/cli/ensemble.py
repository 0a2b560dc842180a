"""``ins-lab ensemble``: a mission navigated with many seeds: its errors, and the verdict on the filter."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lab.cli import options
from lab.cli.app import option, print_json, working, writing
from lab.cli.interrupt import STOPPED, interrupted
from lab.cli.run import verdict_text
from lab.cli.terminal import paragraphs, table

if TYPE_CHECKING:
    from threading import Event

    from lab.analysis.verdicts.verdict import Verdict
    from lab.base.progress import Progress
    from lab.experiment.ensembles.ensemble import Ensemble

EXAMPLES = """\b
Examples:
  ins-lab ensemble montreal
  ins-lab ensemble montreal --seeds 1000 --fast
  ins-lab ensemble los_angeles --card ADIS16470 --seeds 20 --out runs.nc
  ins-lab ensemble montreal --set navigator.q_scale=0.1 --json > runs.json
The rms is that of all runs and whole flights; 95 % of the runs have a smaller one than "95 %". The other
columns are of the errors after the fixes: rms, σ according to the filter, and the part of the errors inside
1 and 3 σ, which is 68.3 % and 99.7 % if the filter is right; with outages of GPS, rms and σ at their ends
follow. Ctrl-C shows the runs that are done."""

_COLUMNS = {
    "rms": "rms",
    "95 %": "p95",
    "after fixes": "fixes_rms",
    "σ": "fixes_sigma",
    "in 1 σ [%]": "inside_1_sigma",
    "in 3 σ [%]": "inside_3_sigma",
    "outage end": "outage_end",
    "σ there": "outage_end_sigma",
}
"""Columns of the table of errors, and their fields; the last two only with outages."""


def ensemble(
    mission: options.Mission,
    seeds: options.Seeds = 100,
    config: options.Config = None,
    card: options.Card = None,
    assumed: options.Assumed = True,
    assignments: options.Assignments = None,
    seed: options.Seed = None,
    own: options.AlgorithmFile = None,
    fast: options.Fast = False,
    workers: options.Workers = None,
    scheduler: options.Scheduler = None,
    out: Annotated[
        Path | None, option("--out", "FILE.nc", "Write the figures of each run and of each fix as netCDF.")
    ] = None,
    force: options.Force = False,
    as_json: options.AsJson = False,
) -> None:
    """Navigate a mission with many seeds; show the errors, and whether the filter states them correctly."""
    options.check_out(out, force, ".nc", "a netCDF file", "--out")
    chosen = options.experiment(mission, config, card, assignments, seed, assumed)
    from lab.experiment.ensembles.seeds import run_ensemble  # noqa: PLC0415 - takes a second

    began = time.monotonic()
    with (
        options.cluster_of(scheduler) as client,
        working(chosen.mission) as progress,
        interrupted() as pressed,
    ):
        found = run_ensemble(
            chosen,
            seeds,
            progress,
            workers=workers,
            algorithm=options.algorithm(own),
            cancelled=pressed.is_set,
            fast=fast,
            client=client,
        )
        seconds = time.monotonic() - began
        done = len(found.seeds) + len(found.diverged)
        verdict = _verdict(found, progress, pressed) if done == seeds else found.verdict
        facts = found.to_dict(verdict)
    facts |= {"wanted": seeds, "seconds": seconds, "out": None if out is None else str(out)}
    if as_json:
        print_json(facts)
    else:
        print(paragraphs(_heading(facts, done), _errors(facts), verdict_text(verdict)))
    if out is not None:
        with writing(out, "--out"):
            found.to_netcdf(out, overwrite=force)
    if done < seeds:
        print(f"ins-lab: stopped after {done:,} of {seeds:,} runs", file=sys.stderr)
        raise typer.Exit(STOPPED)


def _verdict(found: Ensemble, progress: Progress, pressed: Event) -> Verdict:
    """Return the verdict with its advice tried; as it is, if Ctrl-C ends the trials."""

    def tell(step: str, fraction: float) -> None:
        if pressed.is_set():
            raise KeyboardInterrupt
        progress(step, fraction)

    try:
        return found.with_advice_tried(tell)
    except KeyboardInterrupt:
        return found.verdict


def _heading(facts: Mapping[str, Any], done: int) -> str:
    """Return how many runs there are, and what is remarkable about them."""
    rate, wanted = done / max(facts["seconds"], 1e-9), facts["wanted"]
    runs = f"{done:,} run{'' if done == 1 else 's'}" if done == wanted else f"{done:,} of {wanted:,} runs"
    lines = [f"{facts['mission']}: {runs} in {facts['seconds']:.1f} s, {rate:.3g} per second"]
    return "\n".join((*lines, *(f"- {remark}" for remark in facts["remarks"])))


def _errors(facts: Mapping[str, Any]) -> str:
    """Return the errors as a table, the horizontal error, and NEES and NIS beside their expected values."""
    lines = []
    if facts["errors"] is None:
        lines.append("The errors are unknown.")
    else:
        columns = {
            title: name
            for title, name in _COLUMNS.items()
            if not name.startswith("outage") or facts["horizontal"]["outage_end"] is not None
        }
        rows = [
            (
                row["quantity"],
                row["unit"],
                *(shown(row[name], ".1f" if "%]" in title else ".3f") for title, name in columns.items()),
            )
            for row in facts["errors"]
        ]
        lines += [table(("quantity", "unit", *columns), rows, right=set(range(2, 2 + len(columns)))), ""]
        lines += _horizontal(facts["horizontal"])
    lines += [
        f"{name.upper()}: {format_beside(facts[name])}" for name in ("nees", "nis") if facts[name] is not None
    ]
    return "\n".join(lines)


def _horizontal(found: Mapping[str, float | None]) -> list[str]:
    """Return the horizontal position error in sentences."""
    lines = [f"Horizontal position error: 95 % of a flight below {shown(found['p95'])} m on average"]
    if found["outage_end"] is not None:
        lines.append(
            f"At the ends of the GPS outages: {shown(found['outage_end'])} m rms, below "
            f"{shown(found['outage_end_p95'])} m in 95 % of the runs"
        )
    return lines


def shown(value: float | None, form: str = ".3f") -> str:
    """Return a number as text; a dash if it is unknown."""
    return "–" if value is None else f"{value:{form}}"


def format_beside(found: Mapping[str, float] | None) -> str:
    """Return a mean NEES or NIS beside its expected value."""
    return "unknown" if found is None else f"{found['mean']:.2f} / {found['expected']:.0f}"
