"""``ins-lab identify``: sensor noise, latency and lever arm from the innovations."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from lab.base.files.atomic_file import write_file
from lab.cli.app import CommandError, option, print_json, working
from lab.cli.options import AsJson, Assignments, Config, Force, Mission, Seed, check_out, experiment
from lab.cli.terminal import format_list, paragraphs, table

if TYPE_CHECKING:
    from lab.analysis.identification.identification import Identification

EXAMPLES = """\b
Examples:
  ins-lab identify my_drive
  ins-lab identify my_drive --card my_imu.toml --settings my_drive_settings.toml
  ins-lab run my_drive --config my_drive_settings.toml
  ins-lab identify montreal --set navigator.q_scale=0.01
The intervals are 95 % intervals. Parameters that the log does not show, or whose interval contains the
assumed value, keep it."""


def identify(
    mission: Mission,
    config: Config = None,
    assignments: Assignments = None,
    seed: Seed = None,
    out: Annotated[Path | None, option("--card", "OUT.toml", "Write a card of the sensors.")] = None,
    settings: Annotated[
        Path | None,
        option("--settings", "OUT.toml", "Write all settings, including the identified ones, for --config."),
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Find noise, latency and lever arm from the innovations, and whether they predict withheld fixes."""
    check_out(out, force, ".toml", "a card", "--card")
    check_out(settings, force, ".toml", "settings", "--settings")
    chosen = experiment(mission, config, None, assignments, seed)
    with working(chosen.mission) as progress:
        found = chosen.run(lambda stage, fraction: progress(stage, 0.1 * fraction)).identify(
            lambda stage, fraction: progress(stage, 0.1 + 0.9 * fraction)
        )
        if out is not None:
            write_file(out, _card(found, out))
        if settings is not None:
            write_file(settings, chosen.copy().update(found.settings()).to_toml())
    if as_json:
        from lab.experiment.json_form import identification_to_json  # noqa: PLC0415 - help does not need it
        from lab.run.provenance import describe_origin  # noqa: PLC0415 - beside it

        print_json({**describe_origin(chosen), **identification_to_json(found)})
    else:
        print(_text(found))


def _card(found: Identification, out: Path) -> str:
    card = found.card(out.stem)
    if not card.terms:
        raise CommandError(
            f"--card {out}: the innovations show no parameter that a card has; --settings writes what the "
            "filter assumes"
        )
    return card.to_toml()


def _text(found: Identification) -> str:
    rows = [
        (
            row.parameter,
            row.unit,
            f"{row.before:.4g}",
            f"{row.after:.4g}",
            f"{row.sigma:.2g}" if row.observable else "",
            row.words,
        )
        for row in found.rows
    ]
    header = ("parameter", "unit", "before", "after", "σ", "95 % interval")
    return paragraphs(table(header, rows, right={2, 3, 4}), found.sentence, format_list(found.remarks))
