"""Spikes: single samples of an IMU that are no motion, in a whole log and as they come.

The rule for samples as they come is that for a whole log, but for what only a whole log shows. A live stream
and the log that was recorded of it follow it both, so the decision depends on the samples alone, and not on
the pieces in which they arrive. Only samples near a jump wait for later ones: four, and eight if they are far
from their neighbours.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray

LEAST = np.repeat((17.5, 80.0), 3)
"""Smallest distance from the neighbours of a spike: 1000 °/s [rad/s] and 8 g [m/s²]. Measured: up to
0.8 rad/s and 10 m/s² on cars and walkers; 9.4 rad/s and 85 m/s² in the crash of a copter."""
NEIGHBOURS = 9
"""Samples of which the median is taken: it ignores up to four."""
USUAL = 0.99
"""Quantile of the distances that the log shows, which up to a percent of spikes hardly raises."""
BEYOND_LOG = 20.0
"""Distance of a spike over that quantile. Measured: up to 10 in the crash of a copter."""
AROUND = 51
"""Samples around a spike that are compared with it: half a second at 100 Hz, over which impacts ring."""
MAX_SPIKES = 3
"""Most spikes of an axis among these: more of them are a motion, or a sensor that is not to be trusted."""
BEYOND_AROUND = 6.0
"""Distance of a spike over the largest others around it. Measured: up to 3 where distances are large."""


def spikes(rates: FloatArray) -> NDArray[np.bool_]:
    """Return which samples of an IMU (n,) are spikes.

    Parameters
    ----------
    rates : (n, 6) array
        Angular rate [rad/s] and specific force [m/s²].
    """
    found = np.zeros(len(rates), np.bool_)
    # A spike is a jump there and back; hardly any log has one, and only those are looked at closely.
    jumps = (np.abs(np.diff(rates, axis=0)) > LEAST / 2).any(axis=0)
    if len(rates) < AROUND or not jumps.any():
        return found
    from scipy.ndimage import median_filter, rank_filter  # noqa: PLC0415 - takes a while, and is rarely needed

    for axis in np.flatnonzero(jumps):
        distance = np.abs(rates[:, axis] - median_filter(rates[:, axis], NEIGHBOURS))
        around = rank_filter(distance, -1 - MAX_SPIKES, AROUND)
        limit = np.maximum(LEAST[axis], BEYOND_LOG * np.quantile(distance, USUAL))
        found |= distance > np.maximum(limit, BEYOND_AROUND * around)
    return found


PAST: Final = 2048
"""Samples before a spike that say what is usual: 20 s at 100 Hz; `1 - USUAL` of them are a knock a second."""
FEWEST: Final = 20
"""Fewest samples, the spike and those after it included, among which one can be found: a stream waits for as
many to know their interval."""
_SIDE: Final = NEIGHBOURS // 2
"""Neighbours on each side; as many samples after a spike are compared with it."""
_AFTER: Final = 2 * _SIDE
"""Samples after a spike that decide about it: those compared with it have neighbours too."""


class StreamSpikes:
    """The search for spikes in one stream.

    >>> found = StreamSpikes()
    >>> found.accept(np.zeros((3, 6)))
    array([False, False, False])
    """

    def __init__(self) -> None:
        self._values = np.empty((0, 6))
        self._waiting = 0  # of them, at the end

    def accept(self, values: FloatArray) -> NDArray[np.bool_]:
        """Return which of the waiting and the new samples, in their order, are spikes, as far as it is known.

        Parameters
        ----------
        values : (n, 6) array
            Angular rate [rad/s] and specific force [m/s²] of the next samples.
        """
        return self._decide_samples(values, whole=False)

    def finish(self) -> NDArray[np.bool_]:
        """Return which of the waiting samples are spikes: no more will come."""
        return self._decide_samples(self._values[:0], whole=True)

    def _decide_samples(self, values: FloatArray, *, whole: bool) -> NDArray[np.bool_]:
        """Decide about samples; with `whole`, about all of them."""
        begin = len(self._values) - self._waiting
        values = self._values = np.concatenate((self._values, values))
        end, found = len(values), np.zeros(len(values), np.bool_)
        suspects = self._suspects(begin)
        far = self._distance(suspects) > LEAST
        for at, axes in zip(suspects.tolist(), far, strict=True):
            decides = at + (_AFTER if axes.any() else _SIDE)  # the last sample that does
            if decides >= end and not whole:
                # All after it wait as well: a spike is judged by neighbours of which none is undecided.
                end = at
                break
            found[at] = any(self._is_spike(at, axis) for axis in np.flatnonzero(axes).tolist())
        self._waiting = len(values) - end
        self._forget()
        return found[begin:end]

    def _suspects(self, begin: int) -> NDArray[np.intp]:
        """Return the samples from one on that jump, or follow a jump as the next of a few spikes do."""
        # A jump just before may be the first of a few spikes that reach into the new samples.
        reach = max(0, begin - MAX_SPIKES)
        jumps = np.zeros(len(self._values) - reach, np.bool_)
        jumps[1:] = (np.abs(np.diff(self._values[reach:], axis=0)) > LEAST / 2).any(axis=1)
        near = np.flatnonzero(jumps)[:, None] + np.arange(MAX_SPIKES) + reach
        near = np.unique(near)
        return near[(near >= begin) & (near < len(self._values))]

    def _distance(self, rows: NDArray[np.intp]) -> FloatArray:
        """Return the distances (k, 6) of samples from the medians of their neighbours."""
        n = len(self._values)
        # At both ends the neighbours lie on one side.
        first = np.clip(rows - _SIDE, 0, max(0, n - NEIGHBOURS))
        around = np.minimum(first[:, None] + np.arange(NEIGHBOURS), n - 1)
        return np.asarray(np.abs(self._values[rows] - np.median(self._values[around], axis=1)))

    def _is_spike(self, at: int, axis: int) -> bool:
        """Return whether a sample that is far from its neighbours on an axis is a spike."""
        end = min(at + _SIDE + 1, len(self._values))
        if end < FEWEST:
            return False
        mine = self._distance(np.array([at]))[0, axis]
        near = self._distance(np.arange(max(0, end - AROUND), end))[:, axis]
        if mine <= BEYOND_AROUND * _largest_but(MAX_SPIKES, near):
            return False
        past = self._distance(np.arange(max(0, end - PAST), end))[:, axis]
        return bool(mine > BEYOND_LOG * _largest_but(max(MAX_SPIKES, round((1 - USUAL) * past.size)), past))

    def _forget(self) -> None:
        """Keep the samples that decide about later ones, in fewer moves than samples."""
        kept = PAST + NEIGHBOURS + self._waiting
        if len(self._values) > 2 * kept:
            # A copy: a view would keep the whole array alive.
            self._values = self._values[-kept:].copy()


def stream_spikes(values: FloatArray) -> NDArray[np.bool_]:
    """Return which samples (n,) of a whole stream are spikes; `values` as of `StreamSpikes.take`."""
    found = StreamSpikes()
    return np.concatenate((found.accept(values), found.finish()))


def _largest_but(count: int, values: FloatArray) -> float:
    """Return the largest value but for a number of larger ones."""
    return float(np.partition(values, -1 - count)[-1 - count])
