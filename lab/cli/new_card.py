"""``ins-lab cards new``: a card from the numbers of a data sheet, in its words and units."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lab.base.files.atomic_file import write_file
from lab.base.parameters.setting_error import SettingError
from lab.cli.app import CommandError, argument, option, print_json
from lab.cli.card_table import card_text, facts, number
from lab.cli.options import AsJson, Force, check_out

if TYPE_CHECKING:
    from lab.sensors.cards import Card
    from lab.sensors.data_sheet import DataSheet, SheetNumber

NEW_EXAMPLES = """\b
Examples:
  ins-lab cards new my_imu.toml
  ins-lab cards new my_imu.toml --name "My IMU" --grade consumer --source "data sheet, rev. 2" \\
    --gyro "noise density=3.8 mdps/sqrt(Hz)" --gyro "zero-rate offset=0.5 dps" \\
    --accelerometer "noise=1.2 mg rms in 100 Hz" --accelerometer "bias stability=36 ug"
Without numbers, the command asks for them on a terminal. Without a file, the card goes to standard output.
Units are those of data sheets: mdps/sqrt(Hz), deg/sqrt(h), ug, % FS, LSB at 16.4 LSB/dps, ppm/K."""

Numbers = list[str] | None


def new_card(
    out: Annotated[Path | None, argument("[OUT.toml]", "File to write.")] = None,
    name: Annotated[str | None, option("--name", "NAME", "Name of the sensor.")] = None,
    maker: Annotated[str, option("--maker", "MAKER", "Manufacturer.")] = "",
    grade: Annotated[
        str | None,
        option(
            "--grade",
            "GRADE",
            "consumer, industrial, tactical or navigation: what the sheet lacks is then typical of it; "
            "or own: then it is zero.",
        ),
    ] = None,
    source: Annotated[str | None, option("--source", "TEXT", "Document and revision.")] = None,
    gyro: Annotated[
        Numbers, option("--gyro", "WORD=NUMBER UNIT", "A number of the gyros; may be repeated.")
    ] = None,
    accelerometer: Annotated[
        Numbers,
        option("--accelerometer", "WORD=NUMBER UNIT", "A number of the accelerometers; may be repeated."),
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Make a card of the numbers of a data sheet, in its words and units; show what is assumed or missing."""
    from lab.sensors.data_sheet import DataSheet  # noqa: PLC0415 - takes half a second

    check_out(out, force, ".toml", "a card", "OUT.toml")
    given = [("gyro", text) for text in gyro or []]
    given += [("accelerometer", text) for text in accelerometer or []]
    if not given and not sys.stdin.isatty():
        raise CommandError(
            "cards new: accepted are --gyro and --accelerometer WORD=NUMBER UNIT, or a terminal to ask on"
        )
    if given:
        if name is None and out is not None:
            name = out.stem
        lacking = [
            option
            for option, text in (("--name", name), ("--grade", grade), ("--source", source))
            if text is None
        ]
        if lacking:
            raise CommandError(f"cards new: {lacking[0]} is missing")
        sheet = DataSheet(name or "", maker, grade or "", source or "")
        for found in sheet.take_all(given):
            if found.reading:
                _print_text(_reading(found))
        made = sheet.card()
    else:
        made = interview(_ask, name or (out.stem if out else ""), maker, grade, source)
        if out is not None and not typer.confirm(f"Write {out}?", default=True, err=True):
            raise CommandError("nothing was written")
    if out is not None:
        write_file(out, made.to_toml())
    if as_json:
        print_json({**facts(made), "file": None if out is None else str(out)})
    elif out is None:
        print(made.to_toml())
    else:
        print(card_text(made))
        print(f"\nWritten: {out}. Use it with ins-lab run montreal --card {out}")


def _reading(found: SheetNumber) -> str:
    return f"read as {number(found.datum.value)} {found.datum.unit}: {found.reading}"


def _ask(question: str, default: str) -> str:
    return str(typer.prompt(question, default=default, show_default=bool(default), err=True))


def interview(
    ask: Callable[[str, str], str],
    name: str = "",
    maker: str = "",
    grade: str | None = None,
    source: str | None = None,
) -> Card:
    """Ask for the numbers of a data sheet one by one, and return the card.

    An answer that is not accepted is refused with the reason, and asked again. An empty one leaves the term
    out.

    Parameters
    ----------
    ask
        Called with a question and the answer to be proposed; returns the answer.
    name, maker, grade, source
        Proposed or known answers.
    """
    from lab.sensors.cards import GRADES  # noqa: PLC0415 - takes half a second
    from lab.sensors.data_sheet import DataSheet, asked_terms  # noqa: PLC0415 - takes half a second
    from lab.sensors.suite import TRIADS  # noqa: PLC0415 - takes half a second

    _print_text("A number with its unit, as the sheet writes it; an empty answer leaves it out.")
    while True:
        try:
            sheet = DataSheet(
                name=ask("Name of the sensor", name),
                maker=ask("Manufacturer", maker),
                grade=ask(f"Grade ({', '.join(GRADES)}: own assumes nothing)", grade or "own"),
                source=ask("Source: document and revision", source or ""),
            )
            break
        except SettingError as error:
            _print_text(str(error))
    while True:
        for triad in TRIADS:
            _print_text(f"\n{triad.capitalize()}s")
            _about_triad(ask, sheet, triad, asked_terms(triad))
        try:
            return sheet.card()
        except SettingError as error:
            _print_text(str(error))


def _about_triad(
    ask: Callable[[str, str], str], sheet: DataSheet, triad: str, terms: Sequence[object]
) -> None:
    from lab.sensors.data_sheet import SheetTerm  # noqa: PLC0415 - takes half a second
    from lab.sensors.suite import TRIADS  # noqa: PLC0415 - takes half a second

    for term in terms:
        assert isinstance(term, SheetTerm)
        example = term.examples[TRIADS.index(triad)]
        while True:
            answer = ask(f"{term.asks}, such as {example}", "").strip()
            if not answer:
                break
            try:
                found = sheet.take(triad, term.setting, answer)
            except SettingError as error:
                _print_text(str(error))
                continue
            if found.reading:
                _print_text(_reading(found))
            break


def _print_text(text: str) -> None:
    print(text, file=sys.stderr)
