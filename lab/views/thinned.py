"""Thinned: what the figures of a result show in a stretch of time, thinned to the pixels of a plot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lab.run.run import Run
from lab.views.envelope import FloatArray, envelope, envelope_in_parts
from lab.views.quantities import times_of_aid
from lab.views.time_plot import AID_CLOCKS, Clock, Inside, TimePlot

if TYPE_CHECKING:
    from lab.experiment.ensembles.ensemble import Ensemble
    from lab.experiment.result import Result

AT_ONCE = 2**15
"""Samples of a long flight that are read together, with some 700 bytes of datasets each."""


class Thinned(NamedTuple):
    """What the figures of a result show in a window of time.

    Attributes
    ----------
    columns : dict of str to dict of str to (n,) array
        Columns by their names, by the clock of the samples.
    inside : dict of str to Inside
        How the samples lie in the band, by the name of the plot.
    outside : dict of str to (m,) array
        Times, and the values beyond ±3σ by `TimePlot.outside`, NaN elsewhere.
    """

    columns: dict[Clock, dict[str, FloatArray]]
    inside: dict[str, Inside]
    outside: dict[str, FloatArray]


def thinned(
    plots: Sequence[TimePlot],
    result: Result | Ensemble,
    window: tuple[float, float],
    buckets: int,
    clocks: Sequence[Clock],
) -> Thinned:
    """Return what plots show of a result.

    Parameters
    ----------
    plots, result
        The plots, and what they show.
    window
        Visible stretch of time [s].
    buckets
        Number of intervals to which it is thinned.
    clocks
        Clocks of the columns that are wanted.
    """
    columns: dict[Clock, dict[str, FloatArray]] = {}
    inside = {plot.name: Inside() for plot in plots}

    def count_samples(clock: Clock, names: Sequence[str], values: Sequence[FloatArray], seen: slice) -> None:
        found = {name: one[seen] for name, one in zip(names, values, strict=True)}
        for plot in plots:
            if plot.clock == clock:
                inside[plot.name] += plot.inside(found)

    for clock in clocks:
        names = list(dict.fromkeys(name for plot in plots for name in find_columns(plot, clock)))
        times = find_times(result, clock)
        if clock == "time" and getattr(result, "is_long", False):
            assert isinstance(result, Run)

            def read(
                first: int, last: int, run: Any = result, clock: Clock = clock, names: list[str] = names
            ) -> list[FloatArray]:
                values = _part(plots, run, first, last)
                count_samples(clock, names, values, slice(None))
                return values

            time, values = envelope_in_parts(times, read, window, buckets, AT_ONCE)
        else:
            whole = _series(plots, result, clock)
            seen = slice(*np.searchsorted(times, window + np.array((0.0, 1e-9))).tolist())
            count_samples(clock, names, whole, seen)
            time, values = envelope(times, whole, window, buckets)
        named = zip(("time", *names), (time, *values), strict=True)
        columns[clock] = {name: series.astype(np.float32) for name, series in named}
    return Thinned(columns, inside, _values_outside(plots, columns, buckets))


def find_columns(
    plot: TimePlot, clock: Clock, result: Result | Ensemble | None = None
) -> dict[str, FloatArray]:
    """Return the names of a plot's columns at a clock, with their samples if there is a result."""
    nothing = np.zeros(0)
    columns: dict[str, FloatArray] = {}
    if plot.clock == clock:
        columns |= {curve.name: nothing if result is None else curve.read(result) for curve in plot.curves}
        if plot.band is not None:
            edges = (nothing, nothing) if result is None else plot.band.edges(result)
            columns |= dict(zip((plot.band.low, plot.band.high), edges, strict=True))
    if plot.fixes is not None and clock == "time_gps":
        columns[plot.fixes.name] = nothing if result is None else plot.fixes.read(result)
    return columns


def _values_outside(
    plots: Sequence[TimePlot], columns: dict[Clock, dict[str, FloatArray]], buckets: int
) -> dict[str, FloatArray]:
    """Return the values beyond ±3σ among thinned ones, at most two for each bucket.

    Of a bucket, the largest band counts: a value must be beyond the band at all times that share its pixel.
    """
    names = [name for plot in plots for name in plot.outside]
    parts: list[dict[str, FloatArray]] = []
    for clock, there in columns.items():
        marks: dict[str, FloatArray] = {}
        for plot in plots:
            if plot.clock != clock or plot.band is None:
                continue
            low, high = there[plot.band.low], there[plot.band.high]
            if low.size == 2 * buckets:
                # Of a stretch, each series has its two values in an order of its own.
                low = low.reshape(-1, 2).min(axis=1).repeat(2)
                high = high.reshape(-1, 2).max(axis=1).repeat(2)
            for name, curve in plot.outside.items():
                values = there[curve]
                marks[name] = np.where((values < low) | (values > high), values, np.float32(np.nan))
        if marks:
            seen = np.any([np.isfinite(one) for one in marks.values()], axis=0)
            parts.append({"time": there["time"][seen]} | {name: one[seen] for name, one in marks.items()})
    sizes = [part["time"].size for part in parts]
    empty = [np.full(size, np.nan, np.float32) for size in sizes]
    return {
        name: np.concatenate([part.get(name, gap) for part, gap in zip(parts, empty, strict=True)])
        for name in ("time", *names)
        if parts
    }


def _series(plots: Sequence[TimePlot], result: Result | Ensemble, clock: Clock) -> list[FloatArray]:
    """Return all columns at a clock, besides the time."""
    columns: dict[str, FloatArray] = {}
    for plot in plots:
        columns |= find_columns(plot, clock, result)
    return list(columns.values())


def _part(plots: Sequence[TimePlot], result: Result, first: int, last: int) -> list[FloatArray]:
    """Return the columns of a long flight over the IMU's time, from one sample up to another."""
    if any(curve.is_whole for plot in plots for curve in plot.curves):
        return [values[first:last] for values in _series(plots, result, "time")]
    before = max(first - 1, 0)  # of the first sample of a part, not everything is known
    return [values[first - before :] for values in _series(plots, result.part(before, last), "time")]


def find_times(result: Result | Ensemble, clock: Clock) -> FloatArray:
    """Return the times of a clock of a result [s]."""
    # An ensemble has no IMU times; its times are those of the fixes.
    if clock == "time":
        return result.time
    if clock in AID_CLOCKS:
        assert isinstance(result, Run)  # an ensemble has none
        return times_of_aid(result, clock)
    return result.grid if clock == "time_between" else result.fixes.time  # type: ignore[union-attr]
