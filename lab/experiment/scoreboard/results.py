"""Results: the rows that stood, in a JSON file under version control. A row is replaced, and never removed.

Each row of the registry's sets and programs has a number, in the order in which they first stood; a row that
is taken away leaves a gap. Figures that a newer row replaces stay in it under ``earlier``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lab.base.files.atomic_file import write_file
from lab.base.files.file_content import read_whole
from lab.base.files.mission_error import MissionError
from lab.base.plain_data import to_plain_data
from lab.experiment.scoreboard.comparison import AWAITED, MISSING, RUN, STATISTICS, Row, rows_not_run
from lab.experiment.scoreboard.registry import LAB, DataSet, data_set, data_sets

RESULTS = Path(__file__).with_name("results.json")
SCHEMA, VERSION = "ins-lab scoreboard", 1
"""Name and number of the form for JSON."""
MAX_BYTES = 2**22
"""Largest file of results [bytes]: 36 rows have 40 kB."""
_KEPT = ("version", "date", "outcome", "outages", "figures", "processor_s")
"""What stays of a row that is replaced."""
EVEN = 1.02
"""Ratio of two errors below which neither program is ahead: `identify` promises no more."""


@dataclass(frozen=True)
class Kept:
    """A row as it is kept.

    Attributes
    ----------
    number : int
        Place in the order in which the rows first stood, from 1.
    row : Row
        The newest result.
    earlier : tuple of dict
        Those that it replaced, oldest first.
    """

    number: int
    row: Row
    earlier: tuple[Mapping[str, Any], ...] = ()

    @property
    def key(self) -> tuple[str, str]:
        """Data set and program."""
        return self.row.data, self.row.program


def kept_rows(path: Path = RESULTS) -> list[Kept]:
    """Return the rows of a file, in their order.

    Raises
    ------
    MissionError
        If it cannot be read, is no such file, or rows are missing or there twice.
    """
    try:
        content = json.loads(read_whole(path, MAX_BYTES))
        form = content["schema"], content["schema_version"]
        found = [
            Kept(int(one.pop("number")), earlier=tuple(one.pop("earlier", ())), row=Row(**one))
            for one in content["rows"]
        ]
    except MissionError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise MissionError(f"{path}: is no file of results of the scoreboard: {error}") from error
    if form != (SCHEMA, VERSION):
        raise MissionError(f"{path}: is {form[0]!r}, version {form[1]}; accepted is {SCHEMA!r}, {VERSION}")
    if [one.number for one in found] != list(range(1, len(found) + 1)):
        raise MissionError(
            f"{path}: the numbers of its rows are not 1 to {len(found)}: a row was removed or moved"
        )
    if len({one.key for one in found}) != len(found):
        raise MissionError(f"{path}: a data set has two rows of one program")
    return found


def merge_rows(kept: Sequence[Kept], rows: Sequence[Row]) -> list[Kept]:
    """Return kept rows with newer ones in their places; rows of the registry that never ran are added.

    A result is not replaced by a row without one.
    """
    newest = {(row.data, row.program): row for row in rows}
    found = [_replace_row(one, newest.pop(one.key, None)) for one in kept]
    never = [row for about in data_sets().values() for row in rows_not_run(about)]
    known = {one.key for one in found}
    for row in never:
        key = (row.data, row.program)
        if key not in known:
            found.append(Kept(len(found) + 1, newest.pop(key, row)))
    return found


def _replace_row(kept: Kept, row: Row | None) -> Kept:
    if row is None or (kept.row.outcome == RUN and row.outcome not in (RUN, "refused")):
        return kept
    if kept.row.outcome == AWAITED:
        return Kept(kept.number, row, kept.earlier)
    old = {name: getattr(kept.row, name) for name in _KEPT}
    same = old["version"] == row.version and _round_figures(old["figures"]) == _round_figures(row.figures)
    return Kept(kept.number, row, kept.earlier if same else (*kept.earlier, old))


def _round_figures(found: Mapping[str, float]) -> dict[str, str]:
    return {name: f"{value:.4g}" for name, value in found.items()}


def write(path: Path, kept: Sequence[Kept]) -> None:
    """Write rows into a file, which appears whole or not at all.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    rows = [{"number": one.number, **one.row._asdict(), "earlier": one.earlier} for one in kept]
    data = to_plain_data({"schema": SCHEMA, "schema_version": VERSION, "rows": rows})
    write_file(path, json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False).encode() + b"\n")


def known_files(kept: Sequence[Kept], name: str) -> dict[str, str]:
    """Return the SHA-256 of the files with which a set was run first."""
    return next((dict(one.row.files) for one in kept if one.row.data == name and one.row.files), {})


def describe_standing(about: DataSet, rows: Sequence[Row]) -> tuple[str, str]:
    """Return how our row of a set stands beside the others, in a sentence, and what it rests on."""
    ours = next((row for row in rows if row.program == LAB), None)
    if ours is None or ours.outcome != RUN:
        why = "the data were not at hand" if ours is None or ours.outcome == AWAITED else ours.reason
        return "No result.", why
    statistic = about.published[0].statistic if about.published else "horizontal_rms_m"
    mine = ours.figures[statistic]
    others = [
        (row.figures[statistic], row.program) for row in rows if row.program != LAB and row.outcome == RUN
    ]
    others += [
        (one.figure, f"{one.program} (published)")
        for one in about.published
        if one.kind == "result" and one.statistic == statistic
    ]
    basis = (
        f"{STATISTICS[statistic]}, {_describe_row(about, ours)}; {about.protocol.words}; "
        f"{_CHECKED[ours.checked]}"
    )
    if not others:
        return f"{LAB} {mine:.3g} m; there is nothing beside it.{_tolerances(about, ours)}", basis
    best, who = min(others)
    if max(mine, best) < EVEN * min(mine, best):
        word = "is even with"
    else:
        word = f"is {mine / best:.2f} × worse than" if mine > best else f"is {best / mine:.2f} × better than"
    sentence = f"{LAB} {mine:.3g} m {word} the best of the others, {who} {best:.3g} m."
    return sentence + _tolerances(about, ours), basis


_CHECKED = {
    "registered": "SHA-256 of the files as registered",
    "first result": "SHA-256 of the files as at the first result",
    "nothing": "no SHA-256 of these files was known before",
}


def _tolerances(about: DataSet, ours: Row) -> str:
    """Return a sentence on the tolerances that others state; empty if they state none."""
    stated = [one for one in about.published if one.kind == "tolerance"]
    if not stated:
        return ""
    beyond = [one for one in stated if ours.figures[one.statistic] > one.figure]
    words = ", ".join(f"{STATISTICS[one.statistic]} {one.figure:g} m" for one in (beyond or stated))
    return f" It is {'beyond' if beyond else 'within'} the tolerances of {stated[0].program}: {words}."


def _describe_row(about: DataSet, row: Row) -> str:
    to = {
        "fixes": "the last withheld fix",
        "reference": "the reference of the set",
        "truth": "the true flight",
    }[about.against]
    return f"{row.outages} outages, from {to}" if row.outages else f"the whole run, from {to}"


def tabulate_rows(about: DataSet, rows: Sequence[Row]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return the titles and the cells of the table of a set: its rows, and what others published."""
    shown = ["horizontal_rms_m", "horizontal_median_m", "horizontal_worst_m", "three_d_rms_m"]
    shown += [one.statistic for one in about.published if one.statistic not in shown]
    shown = list(dict.fromkeys(shown))
    titles = ("program", *(f"{STATISTICS[name]} [m]" for name in shown), "s of processor", "times real time")
    lines = []
    for row in rows:
        if row.outcome != RUN:
            words = row.outcome if row.outcome != "refused" else f"refused: {row.reason}"
            lines.append((_name_row(row), words, *("–",) * (len(titles) - 2)))
            continue
        speed = f"{row.log_s / row.processor_s:.0f}" if row.processor_s else "–"
        cells = [f"{row.figures[name]:.3g}" for name in shown]
        lines.append((_name_row(row), *cells, f"{row.processor_s:.3g}", speed))
    for program in dict.fromkeys(one.program for one in about.published):
        stated = {one.statistic: one for one in about.published if one.program == program}
        cells = [_state_published(stated[name]) if name in stated else "–" for name in shown]
        lines.append((f"{program}, published", *cells, "–", "–"))
    return titles, lines


def _name_row(row: Row) -> str:
    return f"{row.program} {row.version}".strip()


def _state_published(one: Any) -> str:
    if one.kind == "range":
        return f"{one.figure:g} to {one.highest:g}"
    return f"< {one.figure:g} (tolerance)" if one.kind == "tolerance" else f"{one.figure:g}"


def list_notes(about: DataSet) -> list[str]:
    """Return what must be known with the table of a set: where protocol, settings and figures are from."""
    places = dict.fromkeys((one.program, one.where) for one in about.published if one.where != "as above")
    return [*about.terms, *(f"{program}, published: {where}" for program, where in places)]


def program_notes(rows: Sequence[Row]) -> list[str]:
    """Return what the programs of some rows assumed, and what must be known with their figures."""
    ran = [row for row in rows if row.outcome == RUN]
    found = [f"{row.program}: {row.settings}." for row in ran]
    found += [f"{row.program}: {row.reason}." for row in ran if row.reason]
    found += [f"{row.program} is not installed: {row.reason}." for row in rows if row.outcome == MISSING]
    return list(dict.fromkeys(found))


def of_set(kept: Sequence[Kept], name: str) -> list[Row]:
    """Return the newest rows of a set."""
    data_set(name)
    return [one.row for one in kept if one.row.data == name]
