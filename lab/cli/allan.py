"""``ins-lab allan``: the noise of an IMU at rest, from its log or simulated from a card."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lab.base.files.atomic_file import write_file
from lab.base.parameters.setting_error import SettingError
from lab.cli import options
from lab.cli.app import CommandError, argument, option, print_json, working
from lab.cli.card_table import ASSUMED, FOOT, number
from lab.cli.terminal import format_list, paragraphs, table

if TYPE_CHECKING:
    from lab.analysis.allan import NoiseTerms
    from lab.analysis.rest import Record, RestRecords
    from lab.sensors.cards import Card

EXAMPLES = """\b
Examples:
  ins-lab allan imu.csv
  ins-lab allan imu.csv --card my_imu.toml
  ins-lab allan ADIS16470 --seed 3
  ins-lab allan Gyroscope.csv --unit x=°/s
  ins-lab allan flight.ulg
A log is any file with an IMU that ins-lab import --as log reads; gyros alone are enough."""


def allan(
    record: Annotated[
        str,
        argument(
            "FILE",
            "Log of an IMU at rest, of any format; or a card, by name or .toml file, simulated at rest.",
        ),
    ],
    out: Annotated[Path | None, option("--card", "OUT.toml", "Write a card of the log.")] = None,
    seed: Annotated[
        int,
        typer.Option("--seed", min=0, max=2**32 - 1, metavar="N", help="Seed of the simulation."),
    ] = 1,
    units: options.Units = None,
    columns: options.Columns = None,
    rate: options.SampleRate = None,
    assumed: options.Assumed = True,
    force: options.Force = False,
    as_json: options.AsJson = False,
) -> None:
    """Fit the noise terms of IEEE 952 to the Allan deviation of an IMU at rest, and test the fit."""
    is_log = (Path(record).is_file() and not record.lower().endswith(".toml")) or record.lower().endswith(
        ".csv"
    )
    given = options.corrections(units, columns)
    if (given or rate is not None) and not is_log:
        raise CommandError("--unit, --column and --rate are for logs")
    options.check_rate(rate)
    if out is not None:
        if not is_log:
            raise CommandError(f"--card {out}: a card is made from a log, and {record} is not one")
        options.check_out(out, force, ".toml", "a card", "--card")
    with working(record) as progress:
        progress("reading" if is_log else "simulating", 0.0)
        card = None if is_log else _card(record, assumed)
        records = _records(record, card, seed, given, rate or 0.0)
        progress("fitting", 0.5)
        terms = _fit_records(records)
        if out is not None:
            _write_card(out, records, Path(record).name)
    if as_json:
        print_json({"record": record, "remarks": list(records.remarks), **_facts(records, terms)})
    else:
        print(paragraphs(_terms(terms, card), _goodness(terms), format_list(records.remarks)))


def _card(name: str, assumed: bool) -> Card:
    from lab.sensors.cards import card  # noqa: PLC0415 - takes half a second

    try:
        return card(name, assumed=assumed)
    except SettingError as error:
        hint = "" if name.lower().endswith(".toml") else ", or a file with a log"
        raise CommandError(f"{error}{hint}") from error


def _records(record: str, card: Card | None, seed: int, given: Mapping[str, str], rate: float) -> RestRecords:
    from lab.analysis import rest  # noqa: PLC0415 - takes half a second
    from lab.sensors.suite import SensorSuite  # noqa: PLC0415 - takes half a second

    if card is None:
        return rest.read_log(Path(record), given, rate)
    return rest.RestRecords(rest.simulate(SensorSuite().update(card.settings()), seed))


def _fit_records(records: Mapping[str, Record]) -> dict[str, NoiseTerms]:
    from lab.analysis import rest  # noqa: PLC0415 - takes half a second

    return rest.noise_terms(records)


def _terms(fitted: Mapping[str, NoiseTerms], card: Card | None) -> str:
    """Return the fitted terms as a table, beside those of the simulated card."""
    from lab.analysis import rest  # noqa: PLC0415 - takes half a second

    rows = []
    for triad, terms in fitted.items():
        for name, term in rest.in_setting_units(triad, terms).items():
            own = card.value(triad, name) if card and name in rest.TERMS.values() else None
            for index, axis in enumerate("xyz"):
                value, sigma = f"{term['value'][index]:.4g}", f"{term['sigma'][index]:.2g}"
                figures = value.replace("nan", "–"), sigma.replace("nan", "–"), term["unit"]
                beside = number(own[index] if isinstance(own, list) else own)
                beside += ASSUMED if card and card.is_assumed(triad, name) else ""
                rows.append((triad, axis, term["label"], *figures, beside))
    header = ("group", "axis", "term", "fitted", "σ", "unit", "card")
    width = len(header) if card else len(header) - 1
    text = table(header[:width], [row[:width] for row in rows], right={3, 4, 6})
    return f"{text}\n\n{FOOT}" if any(row[-1].endswith(ASSUMED) for row in rows) else text


def _goodness(fitted: Mapping[str, NoiseTerms]) -> str:
    """Return the goodness of the fits as a table, with an explanation of poor fits."""
    from lab.analysis import rest  # noqa: PLC0415 - takes half a second

    rows = [
        (triad, axis, f"{chi_square:.1f}", f"{degrees:.0f}", f"{p_value:.2g}")
        for triad, terms in fitted.items()
        for axis, chi_square, degrees, p_value in zip(
            "xyz", terms.chi_square, terms.degrees, terms.p_value, strict=True
        )
    ]
    text = table(("group", "axis", "χ² of the fit", "degrees of freedom", "p"), rows, right={2, 3, 4})
    poor = rest.about_fit(fitted)
    return f"{text}\n\n{poor}" if poor else text


def _facts(records: Mapping[str, Record], fitted: Mapping[str, NoiseTerms]) -> dict[str, dict[str, Any]]:
    """Return deviations with their 95 % intervals in SI units, terms in units of the settings, and fits."""
    from lab.analysis import allan, rest  # noqa: PLC0415 - takes half a second

    answer = {}
    for triad, terms in fitted.items():
        record = records[triad]
        found = allan.deviation(record.rates, record.dt)
        low, high = found.interval()
        answer[triad] = {
            "samples": len(record.rates),
            "dt_s": record.dt,
            "unit": "rad/s" if triad == "gyro" else "m/s²",
            "tau_s": found.tau,
            "deviation": found.deviation,
            "low": low,
            "high": high,
            "terms": rest.in_setting_units(triad, terms),
            "low_pass_hz": terms.low_pass.cut_off if terms.low_pass else None,
            "fit": {
                "chi_square": terms.chi_square,
                "degrees_of_freedom": terms.degrees,
                "p_value": terms.p_value,
            },
        }
    return answer


def _write_card(path: Path, records: Mapping[str, Record], source: str) -> None:
    """Write the card of a record at rest, named as the file."""
    from lab.analysis import rest  # noqa: PLC0415 - takes half a second

    try:
        card = rest.card_of(path.stem, records, source)
    except ValueError as error:
        raise CommandError(f"--card {path}: {error}") from error
    write_file(path, card.to_toml())
