"""Column proposals: what each column of a csv is taken for, and on which evidence, to be corrected."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from lab.base.files.file_content import read_whole
from lab.base.files.mission_error import MissionError, QuestionError
from lab.base.files.named_columns import MAX_BYTES
from lab.data.files.unit_names import UNITS
from lab.data.rebuild.raw_flight import ColumnUnit
from lab.data.sheets.column_names import IGNORED, Heading
from lab.data.sheets.sensor_csv import parse_override, units_of_imu
from lab.data.sheets.sheet import Sheet
from lab.data.sheets.sheet_blocks import read_sheets
from lab.data.sheets.sheet_clock import find_clock
from lab.data.sheets.sheet_fixes import find_fixes
from lab.data.sheets.sheet_layout import as_utf8, numbered_layout
from lab.data.sheets.sheet_sources import tables_in, to_csv_table

_LOOKED_AT = 2**21
"""Bytes of each table that are looked at: some minutes of an IMU."""
MOST = 300
"""Most columns for which there is a proposal."""
ANSWERED = "You said so."
"""Evidence for what a person says of a column."""
_UNSURE = ("guessed", "assumed")
"""How the sources of units begin that a person should look at."""


@dataclass(frozen=True)
class Proposal:
    """What a column is taken for.

    Attributes
    ----------
    file : str
        Name of the file.
    heading : str
        The heading; the number of the column where there is no header.
    said : str
        What it is, as ``--column`` takes it; ``-`` for one that is not read.
    evidence : str
        How this is known.
    unsure : bool
        Whether it is a guess, or the data do not decide it.
    """

    file: str
    heading: str
    said: str
    evidence: str
    unsure: bool = False


def column_proposals(
    paths: Sequence[Path], units: Mapping[str, str] | None = None, read: Sequence[ColumnUnit] = ()
) -> list[Proposal]:
    """Return what the columns of tables are taken for, in their order.

    Parameters
    ----------
    paths
        The files.
    units
        What a person says of columns, by heading.
    read
        Units in which columns were read; others are seen in the first rows.

    Raises
    ------
    MissionError
        If a file cannot be read, or what a person says is not accepted.
    """
    said = {heading: parse_override(text) for heading, text in (units or {}).items()}
    sheets: list[Sheet] = []
    found: dict[tuple[str, str], Proposal] = {}
    for path in paths:
        for name, data in tables_in(path, read_whole(path, MAX_BYTES)):
            head = to_csv_table(as_utf8(data[:_LOOKED_AT]))
            mine = read_sheets(name, head, said)
            sheets += mine
            if not mine:
                for text in _unnamed_headings(head):
                    found[name, text] = Proposal(name, text, IGNORED, "Its heading names no quantity.", True)
    seen, question = _units_in(sheets)
    seen |= {one.column: (one.unit, one.source) for one in read}
    for sheet in sheets:
        for one in sheet.headings:
            given = units is not None and one.text in units
            proposal = _propose_column(sheet.name, one, seen.get(one.text), question.get(one.text, ""), given)
            found.setdefault((sheet.name, one.text), proposal)
        for text in sheet.unknown:
            why = ANSWERED if text in said else "Its heading names no quantity."
            found.setdefault((sheet.name, text), Proposal(sheet.name, text, IGNORED, why))
    return list(found.values())[:MOST]


def format_override(heading: Heading, unit: str) -> str:
    """Return what a column is in a unit, as ``--column`` takes it."""
    return f"{'-' if heading.sign < 0 else ''}{heading.key}{f'[{unit}]' if unit else ''}"


def _propose_column(
    file: str, one: Heading, seen: tuple[str, str] | None, question: str, given: bool
) -> Proposal:
    unit, source = seen or (one.unit, one.source if one.unit else "")
    if question:
        return Proposal(
            file, one.text, format_override(one, ""), f"{question}: the data do not decide.", True
        )
    accepted = unit if unit in UNITS.get(one.kind, {}) else ""
    in_words = f"In {unit}: {source}." if unit and source else "Its heading names the quantity."
    evidence = ANSWERED if given else in_words
    unsure = source.startswith(_UNSURE) and not given
    unsure &= source != "assumed" or one.quantity not in {"latitude", "longitude"}
    return Proposal(file, one.text, format_override(one, accepted), evidence, unsure)


def _units_in(sheets: Sequence[Sheet]) -> tuple[dict[str, tuple[str, str]], dict[str, str]]:
    """Return unit and source of columns as the first rows show them, and units that they leave open."""
    found: dict[str, tuple[str, str]] = {}
    for sheet in sheets:
        clock = find_clock(sheet, sheet.has_imu)
        if clock is not None:
            how = "guessed by its size and steps" if clock.guessed else "as written"
            found[clock.column] = clock.unit, how
    question: dict[str, str] = {}
    gnss = None
    used: Sequence[ColumnUnit] = ()
    with contextlib.suppress(MissionError):
        fixes = find_fixes(sheets, with_height=False)
        gnss, used = fixes.gnss, fixes.units
    try:
        used = (*used, *units_of_imu(sheets, gnss))
    except QuestionError as error:
        words = " or ".join(error.choices)
        question = {heading: words for choice in error.choices.values() for heading in choice}
    except MissionError:
        pass
    found |= {one.column: (one.unit, one.source) for one in used}
    return found, question


def _unnamed_headings(head: bytes) -> Sequence[str]:
    """Return the headings of a table that name nothing, or the numbers of its columns."""
    layout = numbered_layout(head, {})
    if layout is None:
        return ()
    line = head.split(b"\n", layout.line + 1)[layout.line] if layout.line >= 0 else b""
    cells = [cell.strip(" \"'\r\ufeff") for cell in line.decode("utf-8", "replace").split(layout.delimiter)]
    return cells if len(cells) == len(layout.headings) and all(cells) else layout.headings
