"""Epoch sums: values of many runs at the same times, added run by run.

Only sums are kept, so that the memory does not grow with the number of runs. Runs are added one after the
other in the order of their seeds, and so are the sums of blocks of runs: the result is then the same bits,
whoever computed which block.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray


@dataclass(eq=False)
class EpochSums:
    """Sums over runs of named values at epochs.

    Attributes
    ----------
    time : (m,) array
        The epochs of all runs [s].
    total : dict of str to (m, ...) array
        Sum of the known values of each name.
    count : dict of str to (m, ...) array
        Number of the known values.
    """

    time: FloatArray = field(default_factory=lambda: np.zeros(0))
    total: dict[str, FloatArray] = field(default_factory=dict)
    count: dict[str, FloatArray] = field(default_factory=dict)

    def add(self, time: FloatArray, values: Mapping[str, FloatArray]) -> None:
        """Add the values of a run.

        Parameters
        ----------
        time : (k,) array
            Its epochs, increasing [s]; those that no run had before become new epochs.
        values : dict of str to (k, ...) array
            Its values by name; unknown ones are NaN. Every run has the same names.
        """
        at = self._find_rows(time)
        for name, value in values.items():
            if name not in self.total:
                shape = (self.time.size, *value.shape[1:])
                self.total[name], self.count[name] = np.zeros(shape), np.zeros(shape)
            known: NDArray[np.bool_] | int = 1
            if np.isnan(value.sum()):  # one pass over the values of most runs
                known = ~np.isnan(value)
                value = np.where(known, value, 0.0)  # noqa: PLW2901
            self.total[name][at] += value
            self.count[name][at] += known

    def join(self, other: EpochSums) -> None:
        """Add the sums of other runs, which stay as they are."""
        at = self._find_rows(other.time)
        for mine, theirs in ((self.total, other.total), (self.count, other.count)):
            for name, values in theirs.items():
                if name not in mine:
                    mine[name] = np.zeros((self.time.size, *values.shape[1:]))
                mine[name][at] += values

    def mean(self, name: str) -> FloatArray:
        """Return the mean over the runs at each epoch (m, ...); NaN where no run has a value."""
        return _divide_by_count(self.total[name], self.count[name])

    def mean_of_all(self, name: str) -> FloatArray:
        """Return the mean over runs and epochs (...)."""
        return _divide_by_count(self.total[name].sum(axis=0), self.count[name].sum(axis=0))

    def copy(self) -> Self:
        """Return the sums so far, which further runs do not change."""
        return type(self)(
            self.time.copy(),
            {name: values.copy() for name, values in self.total.items()},
            {name: values.copy() for name, values in self.count.items()},
        )

    def _find_rows(self, time: FloatArray) -> NDArray[np.intp] | slice:
        """Return the rows of some epochs, after adding rows for the new ones."""
        if np.array_equal(self.time, time):  # as of most runs, and a slice is not copied
            return slice(None)
        at = np.searchsorted(self.time, time)
        if at.size and (at[-1] == self.time.size or not np.array_equal(self.time[at], time)):
            epochs = np.union1d(self.time, time)
            before, self.time = np.searchsorted(epochs, self.time), epochs
            for kept in (self.total, self.count):
                for name, values in kept.items():
                    kept[name] = np.zeros((epochs.size, *values.shape[1:]))
                    kept[name][before] = values
            at = np.searchsorted(epochs, time)
        return at


def _divide_by_count(total: FloatArray, count: FloatArray) -> FloatArray:
    return np.asarray(np.divide(total, count, out=np.full(np.shape(total), np.nan), where=count > 0))
