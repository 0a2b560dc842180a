"""Time plot: the curves of a plot over time, the region in which they are expected, and their clock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from lab.navigation.aids import NAMES

if TYPE_CHECKING:
    from lab.experiment.ensembles.ensemble import Ensemble
    from lab.experiment.result import Result

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
