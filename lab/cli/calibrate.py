"""``ins-lab calibrate``: constant errors of an IMU, a magnetometer or a mounting, judged on withheld data."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from lab.base.files.atomic_file import write_file
from lab.cli import options
from lab.cli.app import CommandError, argument, group, option, print_json, working
from lab.cli.terminal import format_list, paragraphs, table

if TYPE_CHECKING:
    from lab.experiment.calibration import Found

EXAMPLES = """\b
Examples:
  ins-lab calibrate imu bench.csv --out sensor.toml
  ins-lab calibrate magnetometer rover.bin --out sensor.toml --force
  ins-lab calibrate mounting my_drive --out sensor.toml --force
  ins-lab import drive.csv --as log --axes y,x,-z --calibration sensor.toml
  ins-lab live navigate serial:/dev/ttyUSB0 --calibration sensor.toml
A file that is there already keeps what it knows of the other sensors."""

calibrate = group("calibrate")

Logs = Annotated[list[Path], argument("LOG...", "File of a log, or a mission that is one.")]
Out = Annotated[
    Path | None,
    option("--out", "FILE.toml", "Write what gains, for --calibration of import and live, and for log.toml."),
]


@calibrate.command("imu", epilog=EXAMPLES)
def imu(
    logs: Logs,
    latitude: Annotated[
        float | None,
        option("--latitude", "DEG", "Of the place, for gravity.", "of the fixes", min=-90, max=90),
    ] = None,
    units: options.Units = None,
    columns: options.Columns = None,
    out: Out = None,
    card: Annotated[
        Path | None, option("--card", "CARD.toml", "Write a sensor card with these errors.")
    ] = None,
    force: options.Force = False,
    as_json: options.AsJson = False,
) -> None:
    """Find bias, scale factor and misalignment of both triads from rests in many attitudes and turns between.

    Put the IMU down in the six faces of a box, each of them twice or more, and in some attitudes between, for
    three seconds each.
    """
    from lab.experiment.calibration import calibrate_imu, card_of  # noqa: PLC0415 - help does not need it

    options.check_out(out, True, ".toml", "a calibration", "--out")
    options.check_out(card, force, ".toml", "a card", "--card")
    with working(str(logs[0])):
        found = calibrate_imu(logs, latitude, options.corrections(units, columns))
        if card is not None:
            try:
                write_file(card, card_of(found, card.stem).to_toml())
            except ValueError as error:
                raise CommandError(f"--card {card}: {error}") from error
    _answer(found, out, force, as_json)


@calibrate.command("magnetometer", epilog=EXAMPLES)
def magnetometer(
    logs: Logs,
    units: options.Units = None,
    columns: options.Columns = None,
    out: Out = None,
    force: options.Force = False,
    as_json: options.AsJson = False,
) -> None:
    """Find hard and soft iron from a log in which the device turns in all directions, or once round."""
    from lab.experiment.calibration import calibrate_magnetometer  # noqa: PLC0415 - help does not need it

    options.check_out(out, True, ".toml", "a calibration", "--out")
    with working(str(logs[0])):
        found = calibrate_magnetometer(logs, options.corrections(units, columns))
    _answer(found, out, force, as_json)


@calibrate.command("mounting", epilog=EXAMPLES)
def mounting(
    mission: Annotated[str, argument("MISSION|FILE", "Sensor log of a drive on wheels.")],
    config: options.Config = None,
    assignments: options.Assignments = None,
    out: Out = None,
    force: options.Force = False,
    as_json: options.AsJson = False,
) -> None:
    """Find the small angles of the IMU in a vehicle on wheels, so that wheels help instead of harm."""
    from lab.experiment.calibration import applied_to, calibrate_mounting  # noqa: PLC0415 - help does not need it
    from lab.experiment.log_file import open_mission  # noqa: PLC0415 - beside it

    options.check_out(out, True, ".toml", "a calibration", "--out")
    with working(mission) as progress, open_mission(mission) as drive:
        chosen = options.experiment(drive, config, None, assignments, None)
        found = calibrate_mounting(chosen, progress)
        applied = applied_to(chosen.mission)
    _answer(found, out, force, as_json, applied)


def _answer(found: Found, out: Path | None, force: bool, as_json: bool, applied: Path | None = None) -> None:
    """Write the file, if one is asked for, and print what was found."""
    from lab.experiment.calibration import written  # noqa: PLC0415 - beside what it goes with

    if as_json:
        print_json(_facts(found))
    else:
        rows = [
            (
                term.group,
                term.name,
                term.axis,
                f"{term.value:+.4g}",
                f"{term.sigma:.2g}",
                term.unit,
                _interval(term),
            )
            for term in found.stated
        ]
        head = ("group", "term", "axis", "value", "σ", "unit", "95 % interval")
        shown = table(head, rows, right={3, 4}) if rows else "No number is stated."
        print(paragraphs(shown, format_list(found.sentences)))
    if out is None:
        return
    if out.exists() and not force:
        raise CommandError(
            f"--out {out}: exists already; --force renews what this calibration knows and keeps the other "
            "sensors"
        )
    whole = written(found, out, applied)
    if not as_json:
        print(f"\n{out}: {whole.words}")


def _interval(term: Any) -> str:
    low, high = term.interval
    return f"{low:+.4g} to {high:+.4g}"


def _facts(found: Found) -> dict[str, Any]:
    return {
        "terms": [
            {**term._asdict(), "low": term.interval[0], "high": term.interval[1]} for term in found.stated
        ],
        "judgements": [{**vars(one), "gains": one.gains} for one in found.judgements],
        "sentences": list(found.sentences),
    }
