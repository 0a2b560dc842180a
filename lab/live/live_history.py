"""Live history: what the live navigator showed, for plots; bounded, and never changed later."""

from __future__ import annotations

from typing import Final

import numpy as np

from lab.data.streams.rolling import Rolling
from lab.live.live_state import HistoryCursor, LiveHistory, euler_with_sigma

RATE: Final = 20.0
"""Rows of the history per second [Hz]: more than a plot shows."""
KEPT: Final = 36000
"""Rows that are kept: half an hour, in 25 MB."""
FIXES_KEPT: Final = 18000
"""Innovations that are kept: half an hour at 10 Hz, in 12 MB."""

_SOLUTION: Final = {
    "position": (3,), "velocity_n": (3,), "q_nb": (4,), "bias": (6,), "variance": (15,), "covariance": (2, 3),
}  # fmt: skip
"""Columns of what the filter estimates: shape of a row."""
_ROWS: Final[dict[str, tuple[int, ...]]] = {"time": (), "phase": (), **_SOLUTION}
"""Columns of the history: shape of a row."""
_INNOVATIONS: Final = {"time": (), "innovation": (6,), "innovation_covariance": (6, 6), "rejected": ()}
"""Columns of the innovations."""


class History:
    """The history of a live navigator."""

    def __init__(self) -> None:
        self._rows = Rolling(_ROWS, {"phase": np.int64})
        self._fixes = Rolling(_INNOVATIONS, {"rejected": np.bool_})
        self._next = -np.inf  # time from which the next row is kept

    def add(self, samples: Rolling, start: int, epoch: float, phase: int, *, has_position: bool) -> None:
        """Keep new samples, at `RATE`.

        Parameters
        ----------
        samples
            Rows with a solution.
        start
            Number of the first new one.
        epoch
            Time of the host at their time 0 [s].
        phase
            Number of the phase.
        has_position
            Whether position and velocity mean something.
        """
        time = samples.rows("time", start, samples.end) + epoch
        if not time.size or time[-1] < self._next:
            return
        step = np.floor(time * RATE)
        solved = samples.rows("q_nb", start, samples.end).any(axis=1)
        rows = np.flatnonzero((np.diff(step, prepend=step[0] - 1) > 0) & (time >= self._next) & solved)
        self._next = float(np.floor(time[-1] * RATE) + 1) / RATE
        columns = {name: samples.rows(name, start, samples.end)[rows] for name in _SOLUTION}
        columns["variance"] = columns["variance"][:, :15]
        if not has_position:
            columns["position"] = columns["velocity_n"] = np.full((rows.size, 3), np.nan)
        self._rows.append(time=time[rows], phase=np.full(rows.size, phase), **columns)
        self._rows.forget(self._rows.end - KEPT)

    def add_fixes(self, fixes: Rolling, start: int, end: int, epoch: float) -> None:
        """Keep the innovations of fixes by their numbers; `epoch` as of `add`."""
        columns = {name: fixes.rows(name, start, end) for name in _INNOVATIONS}
        self._fixes.append(**columns | {"time": columns["time"] + epoch})
        self._fixes.forget(self._fixes.end - FIXES_KEPT)

    def since(self, cursor: HistoryCursor) -> tuple[HistoryCursor, LiveHistory]:
        """Return the rows since a cursor that are still kept, and the next cursor."""
        rows, fixes = self._rows, self._fixes
        start = min(max(cursor.row, rows.first), rows.end)
        first = min(max(cursor.fix, fixes.first), fixes.end)
        part = {name: rows.rows(name, start, rows.end).copy() for name in _ROWS}
        euler, sigma = euler_with_sigma(part["q_nb"], part["variance"], part["covariance"])
        with np.errstate(invalid="ignore"):
            sigmas = np.sqrt(part["variance"])
        seen = [fixes.rows(name, first, fixes.end).copy() for name in _INNOVATIONS]
        solution = [part[name] for name in ("time", "phase", "position", "velocity_n")]
        columns = [*solution, euler, sigma, part["bias"], sigmas, *seen]
        return HistoryCursor(rows.end, fixes.end), LiveHistory(*columns)
