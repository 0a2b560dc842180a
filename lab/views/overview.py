"""Overview: the plots, figures and sentences that say at a glance how good the navigation of a run is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from lab.sensors.cards import card_in_force, cards
from lab.views.flight_plots import horizontal, series
from lab.views.quantities import BLUE, CONSISTENCY, COVARIANCE, ERRORS
from lab.views.run_comparison import mean_over_degrees
from lab.views.time_plot import Band, Curve, FloatArray, TimePlot

if TYPE_CHECKING:
    from lab.analysis.cross_checks import CrossChecks
    from lab.experiment.ensembles.ensemble import Ensemble
    from lab.experiment.result import Result


@dataclass(frozen=True)
class Bound(Band):
    """The region in which the length of an error is expected: up to `factor` times its root mean square."""

    @property
    def label(self) -> str:
        """Label in a legend: a length has one side."""
        return f"{self.factor:g}σ"

    def edges(self, result: Result | Ensemble) -> tuple[FloatArray, FloatArray]:
        """Return the lower edge, which is zero, and the upper one, each (n,)."""
        high = self.factor * self.sigma(result)
        return np.zeros_like(high), high


def _length(vectors: FloatArray) -> FloatArray:
    """Return the lengths (n,) of vectors (n, 3)."""
    return np.asarray(np.sqrt(np.einsum("ni,ni->n", vectors, vectors)))


def _of_length(variable: str, title: str, unit: str, length: Callable[[FloatArray], FloatArray]) -> TimePlot:
    """Return a plot of the length of an error, and of three times its σ."""
    curve = Curve(f"overview_{variable}", "error", BLUE, series("errors", variable, length))
    band = Bound(f"overview_{variable}_band", 3, BLUE, series("sigma", variable, length))
    return TimePlot(f"overview_{variable}", title, unit, (curve,), band=band, scale="free")


def _heading() -> TimePlot:
    """Return a plot of the heading error with ±3σ, in the colour of the other errors."""
    plot = ERRORS[-1]
    assert plot.band is not None
    curve = Curve("overview_heading", "error", BLUE, plot.curves[0].read)
    band = Band("overview_heading_band", 3, BLUE, plot.band.sigma)
    return TimePlot("overview_heading", "Heading error", plot.unit, (curve,), band=band)


_, NIS, POSITION_INNOVATIONS, VELOCITY_INNOVATIONS = CONSISTENCY
OVERVIEW: tuple[TimePlot, ...] = (
    _of_length("position", "Horizontal position error", "m", horizontal),
    _of_length("velocity", "Velocity error", "m/s", _length),
    _heading(),
    NIS,
)
"""Where the errors are known."""
BY_INNOVATIONS: tuple[TimePlot, ...] = (POSITION_INNOVATIONS, VELOCITY_INNOVATIONS, COVARIANCE[2], NIS)
"""Of a log without reference."""


def _of_checks(name: str, title: str, unit: str, label: str, band: type[Band], **clock: Any) -> TimePlot:
    """Return a plot of one of the cross checks of a run, with ±3σ."""
    style: Literal["points", "line"] = "points" if clock else "line"
    curve = Curve(f"check_{name}", label, BLUE, attrgetter(name), style)
    expected = band(f"check_{name}_band", 3, BLUE, attrgetter(f"{name}_sigma"))
    return TimePlot(
        f"check_{name}",
        title,
        unit,
        (curve,),
        band=expected,
        scale="free" if band is Bound else "symmetric",
        **clock,
    )


CROSS_CHECKS: tuple[TimePlot, ...] = (
    _of_checks("withheld", "Withheld fixes", "m", "fix from prediction", Bound, clock="time_gps"),
    _of_checks("apart", "Smoother: position", "m", "filter from smoother", Bound),
    _of_checks("turned", "Smoother: heading", "°", "filter from smoother", Band),
)
"""Of what a run tells of its own errors; drawn of `lab.analysis.cross_checks.CrossChecks`."""


class Number(NamedTuple):
    """One of the figures of a run.

    Attributes
    ----------
    value, label : str
        The value with its unit, and what it is.
    step : str
        What one can do next.
    page : str
        Title of the page where one does it.
    """

    value: str
    label: str
    step: str
    page: str


def key_figures(result: Result) -> list[Number]:
    """Return six figures of a run; of a log without reference, those of its innovations and its content."""
    nis = mean_over_degrees(result, "innovations", "nis")
    if result.missing_reason("errors"):
        innovations, time = result.innovations, result.time
        squares = np.nansum(innovations["position"].values ** 2, axis=1)
        fixes, rejected = result.fixes.time.size, np.count_nonzero(result.solution_arrays.fix_rejected)
        used = squares[np.isfinite(innovations["nis"].values)]
        rms = float(np.sqrt(used.mean())) if used.size else np.nan
        return [
            Number(_format_value(rms, "m"), "Position innovations, rms", "See them", "Innovations"),
            Number(_format_value(nis), "NIS, expected 1", "Identify noise …", "Verdict"),
            Number(
                _format_value(100 * rejected / fixes if fixes else np.nan, "%"),
                "Fixes rejected",
                "See them",
                "Innovations",
            ),
            Number(_format_value(float(time[-1] - time[0]), "s"), "Duration", "See the flight", "Flight"),
            Number(_format_value(fixes), "GPS fixes", "See the track", "Ground track"),
            Number(
                _format_value((time.size - 1) / float(time[-1] - time[0]), "Hz"),
                "IMU rate",
                "Check its noise",
                "Allan",
            ),
        ]
    nees = mean_over_degrees(result, "consistency", "nees")
    (east, north, _up), velocities, (_roll, _pitch, heading), inside = _of_errors(result)
    return [
        Number(
            _format_value(np.sqrt(east + north), "m"), "Horizontal position, rms", "See the errors", "Errors"
        ),
        Number(_format_value(np.sqrt(velocities.sum()), "m/s"), "Velocity, rms", "See the errors", "Errors"),
        Number(_format_value(np.sqrt(heading), "°"), "Heading, rms", "See its sources", "Budget"),
        Number(_format_value(inside, "%"), "Inside 3σ, expected 99.7", "See σ", "Covariance"),
        Number(_format_value(nees), "NEES, expected 1", "Read the verdict", "Verdict"),
        Number(_format_value(nis), "NIS, expected 1", "See innovations", "Innovations"),
    ]


def _of_errors(result: Result) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Return the mean squares (3,) of the errors of position, velocity and attitude, and percent inside 3σ.

    What is unknown is NaN.
    """
    sums, counts, inside = np.zeros((3, 3)), np.zeros((3, 3)), 0.0
    for part in result.parts():  # of a long flight, the errors are not kept
        for number, kind in enumerate(("position", "velocity", "attitude")):
            errors, sigma = part.errors[kind].values, part.sigma[kind].values
            known = np.isfinite(errors)
            sums[number] += np.sum(errors**2, axis=0, where=known)
            counts[number] += np.count_nonzero(known, axis=0)
            inside += float(np.count_nonzero(np.abs(errors) <= 3 * sigma))
    squares = np.divide(sums, counts, out=np.full((3, 3), np.nan), where=counts > 0)
    is_known = counts.all() and not result.missing_reason("coverage")
    return squares[0], squares[1], squares[2], 100 * inside / counts.sum() if is_known else np.nan


def _format_value(value: float, unit: str = "") -> str:
    """Return a number of three digits with its unit."""
    if not np.isfinite(value):
        return "–"
    text = f"{value:,.0f}".replace(",", "\u2009") if abs(value) >= 1000 else f"{value:.3g}"
    return f"{text}\u2009{unit}" if unit else text


def describe_run(result: Result) -> str:
    """Return in two sentences what a run is, and what its plots show."""
    title = result.mission.title or result.mission.name
    if result.recorded is None:
        return (
            f"A simulated flight, “{title}”, with {_sensors(result)}. "
            "Blue: how wrong the navigation is; shade: how wrong it believes to be."
        )
    if result.missing_reason("errors"):
        return (
            f"A sensor log, “{title}”, without a reference, so the true errors are unknown. "
            "Points: how far the fixes are from the navigation; shade: how far the filter expects them to be."
        )
    return (
        f"A sensor log, “{title}”, with a reference. "
        "Blue: how far the navigation is from it; shade: how far it believes to be."
    )


def checks_in_words(found: CrossChecks) -> str:
    """Return in sentences how far withheld fixes and the smoothed solution are from the filter."""
    said = []
    for name, words in (
        ("withheld", "Fixes withheld for 10 s are predicted within {} (rms)"),
        ("apart", "Filter and smoother differ by {} (rms)"),
    ):
        size, sigma = getattr(found, name), getattr(found, f"{name}_sigma")
        known = np.isfinite(size) & np.isfinite(sigma)
        if known.any():
            rms, expected = (
                _format_value(float(np.sqrt(np.mean(one[known] ** 2))), "m") for one in (size, sigma)
            )
            said.append(f"{words.format(rms)}; the filter expects {expected}.")
        elif name == "withheld":
            said.append("The log is too short to withhold fixes.")
    return " ".join([*said, *([f"There is no smoothed solution: {found.problem}"] if found.problem else [])])


def _sensors(result: Result) -> str:
    """Return the sensors of a simulated flight in words, unless they are hidden."""
    if not result.shows_sensor_errors:
        return "sensors whose errors are hidden"
    name = card_in_force(result.experiment.sensors)
    if name is None:
        return "an IMU and a GPS receiver of your own settings"
    grade = cards()[name].grade
    return f"an IMU of {grade} grade ({name}) and GPS" if grade else f"the IMU {name} and GPS"
