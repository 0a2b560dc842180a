"""Log outages: which error fixes show that were withheld from the filter of a sensor log.

The protocol is that of published comparisons: no fix for a minute, then fixes for two, and so on to the end
of the log. In three turns, each an outage later than the one before, the outages cover all of the log after
the filter has converged. Nobody knows the true position of a log. The error of an outage is the difference
from its last withheld fix, and includes the error of that fix.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lab.analysis.cross_checks import LARGEST_PART, SETTLING
from lab.analysis.identification.renavigation import subject
from lab.analysis.identification.withheld import innovations_of_withheld
from lab.base.arrays import Flags, FloatArray
from lab.base.parameters.setting_error import SettingError
from lab.base.progress import Progress, StoppedError
from lab.experiment.experiment import Experiment
from lab.experiment.outage_table import OutageErrors, OutageTable
from lab.navigation.checks import DivergedError

Indices = NDArray[np.intp]

TURNS = 3
"""Number of turns, and from one begin of a turn to the next, in lengths of an outage."""
AS_LONG = 0.1
"""Largest difference, as a fraction, of the time without fixes at the last withheld one from the length of
the outage: a log may have gaps of its own."""
_ROUNDING = 1e-9
"""Of times [s]."""


def log_outages(
    table: OutageTable,
    experiments: Sequence[Experiment],
    progress: Progress | None,
    partial: Callable[[OutageTable], None] | None,
    cancelled: Callable[[], bool] | None,
) -> OutageTable:
    """Return the outages of a log, of the filter of each experiment.

    Parameters
    ----------
    table
        The table, whose rows are empty.
    experiments
        The experiment of each row: its sensors are assumptions of the filter.
    progress, partial, cancelled
        As of `Experiment.outage`; `partial` is called after each row, and `cancelled` asked before it.

    Raises
    ------
    ValueError
        If no outage fits into the log, or no filter can navigate it.
    """
    rows = list(table.rows)
    for number, experiment in enumerate(experiments):
        if cancelled is not None and cancelled():
            break

        def tell(part: float, number: int = number) -> None:
            if progress is not None:
                progress(f"{rows[number].name}, withholding fixes", (number + part) / len(rows))

        try:
            errors, fix_sigma = _errors_of_outages(experiment, table.seconds, table.since, tell)
            rows[number] = replace(rows[number], errors=errors)
            table = replace(table, fix_sigma=fix_sigma)
        except (SettingError, DivergedError) as error:
            rows[number] = replace(rows[number], refusal=str(error))
        table = replace(table, rows=tuple(rows))
        if partial is not None:
            partial(table)
    if not any(row.errors or row.refusal for row in rows):
        raise StoppedError(f"stopped before the first of {len(rows)} filters was done")
    if all(row.refusal for row in rows):
        raise SettingError("; ".join(dict.fromkeys(row.refusal for row in rows)))
    return table


def _errors_of_outages(
    experiment: Experiment, seconds: float, since: FloatArray, tell: Callable[[float], None]
) -> tuple[OutageErrors, float]:
    """Return the errors of the outages of a filter, and σ of the fixes [m]."""
    tell(0.0)
    run = experiment.run()
    again = subject(run)
    first, last = again.span
    settled = first + min(SETTLING, LARGEST_PART * (last - first))
    found: list[OutageErrors] = []
    for turn, withheld in outage_turns(again.stamps, settled, last, seconds):
        tell((1 + turn) / (1 + TURNS))
        seen = innovations_of_withheld(again, run.experiment, mask_withheld(again.stamps, withheld))
        found += [
            _errors_of(seen.innovation, seen.covariance, again.stamps, rows, since, turn) for rows in withheld
        ]
    if not found:
        raise ValueError(
            f"seconds: no outage of {seconds:g} s fits into the log, which is navigated for "
            f"{last - first:.0f} s; accepted is at most {int(max(last - settled, 0))} s"
        )
    R = np.median(run.belief.R.reshape(-1, *run.belief.R.shape[-2:]), axis=0)
    return OutageErrors.joined(found), float(np.sqrt(R[0, 0] + R[1, 1]))


def outage_turns(
    stamps: FloatArray, start: float, end: float, seconds: float, turns: int = TURNS
) -> list[tuple[int, list[Indices]]]:
    """Return the fixes that each outage withholds, turn by turn; turns without an outage are left out.

    Parameters
    ----------
    stamps : (m,) array
        Time stamps of the fixes [s].
    start, end
        First begin, and latest end of an outage [s].
    seconds
        Length of an outage [s].
    turns
        Number of turns, each an outage later than the one before.
    """
    found = []
    for turn in range(turns):
        begins = np.arange(start + turn * seconds, end - seconds + _ROUNDING, TURNS * seconds)
        withheld = [_find_withheld(stamps, begin, seconds) for begin in begins]
        withheld = [rows for rows in withheld if rows.size]
        if withheld:
            found.append((turn, withheld))
    return found


def mask_withheld(stamps: FloatArray, withheld: Sequence[Indices]) -> Flags:
    """Return the mask (m,) of the fixes that some outages withhold."""
    mask: Flags = np.zeros(stamps.size, dtype=np.bool_)
    mask[np.concatenate(withheld)] = True
    return mask


def _find_withheld(stamps: FloatArray, begin: float, seconds: float) -> Indices:
    """Return the fixes that an outage withholds; none if it ends without a fix, or began long before."""
    rows = np.flatnonzero((stamps >= begin) & (stamps < begin + seconds))
    if not rows.size or not rows[0]:
        return rows[:0]
    longest = stamps[rows[-1]] - stamps[rows[0] - 1]
    return rows if abs(longest - seconds) <= AS_LONG * seconds else rows[:0]


def _errors_of(
    innovation: FloatArray,
    covariance: FloatArray,
    stamps: FloatArray,
    rows: Indices,
    since: FloatArray,
    turn: int,
) -> OutageErrors:
    """Return the errors of an outage: at each time since its begin, from the withheld fix nearest to it."""
    ages = stamps[rows] - stamps[rows[0] - 1]
    nearest = np.abs(ages[:, None] - since).argmin(axis=0)
    nearest[-1] = ages.size - 1
    apart = np.abs(ages[nearest] - since)
    apart[-1] = 0.0
    at = rows[nearest]
    known = apart <= np.diff(since).max() / 2
    north, east, down = np.where(known, innovation[at, :3].T, np.nan)
    S = covariance[at]
    sigma = np.sqrt(S[:, 0, 0] + S[:, 1, 1])
    return OutageErrors(
        np.array([turn]),
        stamps[rows[:1] - 1],
        np.hypot(north, east)[None],
        np.abs(down)[None],
        np.where(known, sigma, np.nan)[None],
        np.array([[S[-1, 0, 0], S[-1, 1, 1], S[-1, 0, 1]]]),
    )
