"""Time plot: the curves of a plot over time, the region in which they are expected, and their clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.navigation.aids import NAMES

if TYPE_CHECKING:
    from lab.experiment.ensembles.ensemble import Ensemble
    from lab.experiment.result import Result

THIN = "\u2009"
"""Thin space: three of these plots stand side by side, and a title has the width of one."""

FloatArray = NDArray[np.floating]
Reader = Callable[[Any], FloatArray]
"""Returns samples (n,) of a result or of an ensemble."""
Clock = str
"""Name of the time stamps of curves, one of `CLOCKS`."""
AID_CLOCKS: tuple[Clock, ...] = tuple(f"aid {kind}" for kind in range(len(NAMES)))
"""Clocks of the measurements besides GPS, by their kind."""
CLOCKS: tuple[Clock, ...] = ("time", "time_gps", "time_between", *AID_CLOCKS)
"""All clocks: of the samples, of the fixes, between fixes, and those of the other measurements."""


@dataclass(frozen=True)
class Curve:
    """One curve of a plot.

    Attributes
    ----------
    name
        Unique name; also the name of the column with its samples.
    label
        Label in a legend or a hover box.
    colour
        Line colour, visible on white and on black.
    read
        Returns the samples (n,) of a result.
    style
        Line style.
    is_whole
        Whether it must be read from the whole flight, because its noise is drawn for all samples together.
    """

    name: str
    label: str
    colour: str
    read: Reader
    style: Literal["line", "dashed", "points"] = "line"
    is_whole: bool = False


@dataclass(frozen=True)
class Band:
    """The region in which a curve is expected: `factor` standard deviations about `centre`, or about zero."""

    name: str
    factor: float
    colour: str
    sigma: Reader
    centre: Reader | None = None

    @property
    def label(self) -> str:
        """Label in a legend."""
        return f"±{self.factor:g}σ"

    @property
    def low(self) -> str:
        """Name of the column of the lower edge."""
        return f"{self.name}_low"

    @property
    def high(self) -> str:
        """Name of the column of the upper edge."""
        return f"{self.name}_high"

    def edges(self, result: Result | Ensemble) -> tuple[FloatArray, FloatArray]:
        """Return the lower and the upper edge, each (n,)."""
        half = self.factor * self.sigma(result)
        return (
            (-half, half) if self.centre is None else (self.centre(result) - half, self.centre(result) + half)
        )


@dataclass(frozen=True)
class Interval(Band):
    """The region that contains a curve with a probability of 95 %, given by its centre and half-width."""

    @property
    def label(self) -> str:
        """Label in a legend."""
        return "95 %"


class Inside(NamedTuple):
    """How many values of a stretch of time lie in the band of a plot.

    Attributes
    ----------
    number, inside : int
        Numbers of known values, and of those inside the band.
    squares : float
        Sum of the squares of these values; zero where they are no errors.
    """

    number: int = 0
    inside: int = 0
    squares: float = 0.0

    def __add__(self, other: Any) -> Inside:
        """Return the numbers of two stretches together."""
        return Inside(*(one + more for one, more in zip(self, other, strict=True)))


@dataclass(frozen=True)
class TimePlot:
    """Curves of one unit over time.

    Attributes
    ----------
    name
        Unique name.
    title
        Title without the unit.
    unit
        Unit of the ordinate.
    curves
        The curves; the first is on top.
    band
        Region in which the first curve is expected.
    fixes
        The same quantity from the GPS fixes, drawn below the curves at the times of the fixes.
    clock
        Coordinate of the samples of curves and band: IMU time, time of the fixes, times of a kind of other
        measurements, or, for an ensemble, once a second between the fixes.
    scale
        Scale of the ordinate: zero in the middle, free, or logarithmic.
    """

    name: str
    title: str
    unit: str
    curves: tuple[Curve, ...]
    band: Band | None = None
    fixes: Curve | None = None
    clock: Clock = "time"
    scale: Literal["symmetric", "free", "logarithmic"] = "symmetric"

    @property
    def heading(self) -> str:
        """Title and unit, as printed above the plot."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title

    @property
    def drawn(self) -> tuple[Curve, ...]:
        """All curves, with the fixes."""
        return self.curves if self.fixes is None else (*self.curves, self.fixes)

    @property
    def judged(self) -> tuple[Curve, ...]:
        """The curves that should lie in the band: of a band about an estimate, the truth."""
        if self.band is None:
            return ()
        is_about_estimate = self.band.centre is not None and not isinstance(self.band, Interval)
        return self.curves[1:] if is_about_estimate else self.curves

    @property
    def outside(self) -> dict[str, str]:
        """Columns of the values beyond ±3σ, with their curves; beyond an interval are 5 % anyway."""
        if isinstance(self.band, Interval):
            return {}
        return {f"{curve.name}_outside": curve.name for curve in self.judged}

    def inside(self, columns: Mapping[str, FloatArray]) -> Inside:
        """Return how some samples lie in the band.

        Parameters
        ----------
        columns
            Samples (n,) of the curves and of both edges of the band, by the names of their columns.
        """
        if self.band is None:
            return Inside()
        low, high = columns[self.band.low], columns[self.band.high]
        found = Inside()
        for values in (columns[curve.name] for curve in self.judged):
            known = np.isfinite(values) & np.isfinite(low)
            within = np.count_nonzero((low <= values) & (values <= high) & known)
            squares = np.sum(values**2, where=known, dtype=np.float64) if self.band.centre is None else 0.0
            found += Inside(int(np.count_nonzero(known)), int(within), float(squares))
        return found

    def judged_heading(self, inside: Inside) -> str:
        """Return title and unit with the rms of the errors, and the share inside the band."""
        if self.band is None or not inside.number:
            return self.heading
        share = 100 * inside.inside / inside.number
        shown = f"{share:.1f}" if 99.5 <= share < 100 else f"{share:.0f}"
        parts = [self.heading]
        if isinstance(self.band, Interval):
            parts.append(f"{shown}{THIN}% in the {self.band.label} band")
        elif self.band.centre is None:
            size = np.sqrt(inside.squares / inside.number)
            rms = f"{size:.2g}" if size < 99.5 else f"{size:.0f}"
            parts += [f"rms {rms}", f"{shown}{THIN}% in {self.band.label.removeprefix('±')}"]
        else:
            parts.append(f"truth {shown}{THIN}% in {self.band.label.removeprefix('±')}")
        return f"{THIN}·{THIN}".join(parts)
