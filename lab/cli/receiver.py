"""``ins-lab receiver``: what the fixes of a receiver are worth, beside what it claims."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lab.base.files.atomic_file import write_file
from lab.cli.app import CommandError, argument, option, print_json, working
from lab.cli.options import AsJson, Force, check_out
from lab.cli.terminal import format_list, paragraphs, table

if TYPE_CHECKING:
    from lab.experiment.receiver_report import ReceiverReport

EXAMPLES = """\b
Examples:
  ins-lab receiver my_drive
  ins-lab receiver my_drive --gate 0.999 --settings receiver.toml
  ins-lab receiver ublox.ubx
  ins-lab receiver flight.ulg
A sensor log, a file with an IMU and a receiver, or one of fixes alone: NMEA, UBX or another protocol of
devices."""


def receiver(
    source: Annotated[str, argument("MISSION|FILE", "Sensor log, or file of fixes.")],
    gate: Annotated[
        float,
        typer.Option("--gate", min=0.5, max=0.999999, metavar="P", help="Gate whose reach is stated."),
    ] = 0.999,
    settings: Annotated[
        Path | None,
        option("--settings", "OUT.toml", "Write all settings with the found sizes, for --config."),
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Find the errors of a receiver's fixes, white and slow, beside its claims, and what a gate rejects."""
    from lab.experiment.log_file import is_log_file  # noqa: PLC0415 - help does not need it
    from lab.experiment.receiver import receiver as examine  # noqa: PLC0415 - help does not need it

    check_out(settings, force, ".toml", "settings", "--settings")
    if settings is not None and is_log_file(source):
        raise CommandError(
            f"--settings {settings}: settings are of a mission; ins-lab import {source} --as log makes one "
            "of a file with an IMU"
        )
    with working(source) as progress:
        found = examine(source, gate, progress)
        if settings is not None:
            _write(settings, found)
    if as_json:
        from lab.run.provenance import describe_origin  # noqa: PLC0415 - help does not need it

        print_json({**describe_origin(), **found.to_dict()})
    else:
        print(_text(found))


def _write(path: Path, found: ReceiverReport) -> None:
    if found.experiment is None:
        raise CommandError(f"--settings {path}: settings are of a sensor log, and {found.source} has no IMU")
    write_file(path, found.experiment.to_toml())


def _text(found: ReceiverReport) -> str:
    rows = [
        (
            row.kind,
            row.axis,
            str(row.fixes),
            _number(row.claimed),
            _number(row.white),
            "none" if row.slow == 0 else _number(row.slow),
            _number(row.tau),
            str(row.outliers),
            _number(row.nis),
        )
        for row in found.rows
    ]
    header = (
        *("fixes", "axis", "number", "claims [m]", "white [m]", "slow [m]", "τ [s]", "outliers"),
        "NIS of the second half",
    )
    parts = [f"The receiver of {found.source}.", table(header, rows, right={2, 3, 4, 5, 6, 7, 8})]
    if found.by_satellites:
        several = [
            (f"{low} to {high}" if high < 99 else f"{low} or more", str(count), f"{size:.2f}")
            for low, high, count, size in found.by_satellites
        ]
        parts.append(table(("satellites", "fixes", "innovations in σ"), several, right={1, 2}))
    return paragraphs(*parts, format_list(found.sentences))


def _number(value: float) -> str:
    return "unknown" if math.isnan(value) else f"{value:.3g}"
