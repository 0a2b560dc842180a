"""Spline windows: a spline through very many knots, as splines through windows, made when needed.

Solving a spline through millions of knots takes kilobytes of memory per knot. The effect of a knot on a cubic
spline decreases by a factor of 3.7 from knot to knot, so a window with `OVERLAP` more knots on both sides
gives the same curve to the last digit.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

import numpy as np

from lab.base.arrays import FloatArray
from lab.motion.kinematics.cubic_spline import cubic_spline

Spline = TypeVar("Spline")

WINDOW = 2**17
"""Knots in a window: 11 minutes at 200 Hz, which need some 130 MB during the solution. A flight with fewer
knots has one spline, which is kept."""
OVERLAP = 64
"""Additional knots at both ends of a window: 3.7 to the power of 64 is 10 to the power of 36, beyond double
precision."""


class SplineWindows(Generic[Spline]):
    """A spline that is computed window by window.

    Parameters
    ----------
    times : (n,) array
        Knots [s].
    make
        Returns the spline through the knots of a slice.

    Attributes
    ----------
    only
        The spline, if all knots are in one window; otherwise None.
    """

    def __init__(self, times: FloatArray, make: Callable[[slice], Spline]) -> None:
        self.only = make(slice(None)) if times.size <= WINDOW else None
        self._knots = times.size
        if self.only is not None:
            return
        self._make = make
        self._starts = np.arange(0, times.size - 1, WINDOW)
        self._ends = times[self._starts[1:]]
        # Cached, because reading a flight in order needs the same window many times.
        self._last: tuple[int, Spline] | None = None
        self._lock = threading.Lock()

    @property
    def kept(self) -> int:
        """Largest number of knots with a kept spline."""
        return min(self._knots, WINDOW + 2 * OVERLAP)

    def __call__(self, times: FloatArray, evaluate: Callable[[Spline, FloatArray], FloatArray]) -> FloatArray:
        """Evaluate a function of the spline at times in any order, with rows in that order.

        Parameters
        ----------
        times : (m,) array
            Times within the knots [s].
        evaluate
            Called with the spline of a window and the times in it.
        """
        if self.only is not None:
            return evaluate(self.only, times)
        windows = np.searchsorted(self._ends, times, side="right")
        parts = [(windows == window, int(window)) for window in np.unique(windows)]
        if len(parts) < 2:
            return evaluate(self._window(parts[0][1] if parts else 0), times)
        values = [evaluate(self._window(window), times[here]) for here, window in parts]
        out = np.empty((times.size, *values[0].shape[1:]))
        for (here, _), value in zip(parts, values, strict=True):
            out[here] = value
        return out

    def _window(self, window: int) -> Spline:
        """Return the spline of a window."""
        with self._lock:
            if self._last is None or self._last[0] != window:
                start = int(self._starts[window])
                self._last = None  # one computation at a time
                around = slice(max(start - OVERLAP, 0), start + WINDOW + 1 + OVERLAP)
                self._last = window, self._make(around)
            return self._last[1]


class CubicCurve:
    """A cubic spline through values.

    Parameters
    ----------
    times : (n,) array
        Knots [s].
    values : (n, 3) array
        Values at the knots.
    """

    def __init__(self, times: FloatArray, values: FloatArray) -> None:
        self._spline = SplineWindows(times, lambda part: cubic_spline(times[part], values[part]))
        self._values = values if self._spline.only is None else values[:0].copy()

    def __call__(self, times: FloatArray, derivative: int = 0) -> FloatArray:
        """Return the values, or a time derivative of them, at times within the knots (m, 3)."""
        return self._spline(times, lambda spline, at: spline(at, derivative))

    def motion(self, times: FloatArray) -> list[FloatArray]:
        """Return the values and their first and second time derivatives at times (m, 3)."""
        return np.split(self._spline(times, lambda spline, at: spline.derivatives(at, range(3))), 3, axis=1)

    @property
    def nbytes(self) -> int:
        """Memory of the cached data, besides the knots [bytes]."""
        # Four coefficients of each component, and a time.
        return self._spline.kept * (4 * 3 + 1) * 8 + int(self._values.nbytes)
