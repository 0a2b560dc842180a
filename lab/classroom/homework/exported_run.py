"""Exported run: what a student exported of a homework, repeated by the teacher with the key.

An export has the shown settings and, in place of what is hidden, the name of the homework. Another seed than
that of the homework is sealed for the teacher. With the key, the run is done again and compared bit for bit,
so that the teacher knows whether a file is of the run that it claims.
"""

from __future__ import annotations

import base64
import binascii
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from lab.classroom.homework.homework_file import Keyed
from lab.classroom.homework.scenario import seed_context
from lab.classroom.homework.sealing import SealError
from lab.classroom.lessons.quantities import QUANTITIES
from lab.experiment.saved_result import HEADED, WHOLE, SavedResult, open_result
from lab.run.memory import TooLongError
from lab.run.run import ResultError

ENDINGS = (".nc", ".json", ".parquet", *HEADED, *WHOLE)
"""Endings of the names of exports."""
REPEATED, DIFFERENT, REFUSED = "repeated", "different", "refused"
"""Whether the run gives the same bits, other ones, or is not done."""


class Repeated(NamedTuple):
    """What the run of an export gave.

    Attributes
    ----------
    status : str
        `REPEATED`, `DIFFERENT` or `REFUSED`.
    remark : str
        Why, in words.
    figures : dict of str to float
        The asked figures of the result.
    changes : mapping
        The settings that the student changed, by their path.
    is_memory : bool
        Whether it was refused because the memory does not suffice.
    """

    status: str
    remark: str
    figures: Mapping[str, float] = {}
    changes: Mapping[str, Any] = {}
    is_memory: bool = False


def repeat(keyed: Keyed, path: Path, figures: tuple[str, ...]) -> Repeated:
    """Run again what a file was exported of, in this process and without bounds.

    Parameters
    ----------
    keyed
        The homework with its key.
    path
        The file.
    figures
        Names of the figures; see `lab.classroom.lessons.quantities`.
    """
    try:
        saved = open_result(path)
        changes = _changes(keyed, saved)
        result = keyed.homework.experiment_with(changes).run()
        found = {name: QUANTITIES[name].of(result) for name in figures}
        same, others = saved.is_repeated_by(result), saved.other_versions
    except Exception as error:  # whatever one file does, the others are graded
        kind = "" if isinstance(error, ValueError | OSError) else f"{type(error).__name__}: "
        words = str(error).removeprefix(f"{path}: ")
        return Repeated(REFUSED, f"{kind}{words}", is_memory=isinstance(error, MemoryError | TooLongError))
    if same:
        return Repeated(REPEATED, "its run gives the same figures to the last bit", found, changes)
    why = "; ".join(f"{name} was {then}, and is {now} here" for name, (then, now) in others.items())
    return Repeated(
        DIFFERENT, f"its run gives other figures ({why or 'with the same versions'})", found, changes
    )


def _changes(keyed: Keyed, saved: SavedResult) -> dict[str, Any]:
    """Return the settings that the student changed, and the seed.

    Raises
    ------
    ResultError
        If the export is of another homework, of one with variants, of many runs, or of an own algorithm.
    SettingError
        If a setting differs that the homework does not let a student change.
    """
    homework, scenario = keyed.homework, keyed.homework.scenario
    kind, name, *sealed = (*saved.sealed.split(), "", "")[:3]
    if kind != "homework" or name != homework.name:
        what = f"the homework {name[:64]}" if kind == "homework" else "no homework"
        raise ResultError(f"is an export of {what}; accepted are those of {homework.name}")
    if keyed.varies:
        raise ResultError(
            "is of a homework that differs from student to student, and an export names no student; "
            "accepted is the hand-in"
        )
    if saved.kind != "result" or saved.facts.get("algorithm"):
        raise ResultError("is of many runs, or of an own algorithm; accepted are exports of single runs")
    seed = scenario.shown.seed
    if sealed[0]:
        try:
            seed = int(keyed.key.open(base64.b64decode(sealed[0], validate=True), seed_context(name)))
        except (SealError, binascii.Error) as error:
            raise ResultError(f"its seed {error or 'is damaged'}") from error
    shown = saved.experiment
    shown.set("seed", scenario.shown.seed)
    return {**scenario.changes(shown), "seed": seed}
