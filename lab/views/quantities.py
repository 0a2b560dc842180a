"""Quantities: names, units, colours and bands of all plots, declared once for page and notebook."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lab.analysis.consistency import chi_square_interval
from lab.motion.frames.east_north_up import east_north_up_sizes
from lab.navigation.aids import NAMES, SHOWN
from lab.navigation.filters.blocks import SCALES
from lab.navigation.filters.blocks import block as find_block
from lab.navigation.filters.error_models import ATT, POS, VEL
from lab.views.time_plot import AID_CLOCKS, Band, Clock, Curve, FloatArray, Interval, Reader, TimePlot

if TYPE_CHECKING:
    from lab.experiment.ensembles.ensemble import Ensemble
    from lab.experiment.result import Result
    from lab.run.run import Run

BLUE, GREEN, ORANGE = "#3b8eea", "#12a67c", "#e8862e"
AXIS_COLOURS = (BLUE, GREEN, ORANGE)
TRUTH, ESTIMATE, FIXES, CURSOR = "#8b95a5", BLUE, "#c2569b", "#e5484d"

NOTES = "#c99a1b"
"""Colour of the notes on a flight."""
HELD = ("#9b5de5", "#d6457f", "#8a9a2e", "#7d8794")
"""Colours of held results, visible on white and on black."""
LETTERS = "ABCD"
"""Their names."""

_AT_FIXES = ("gps", "innovations", "consistency")
"""Datasets over the times of the fixes."""


def _unknown_values(result: Result, group: str, variable: str) -> FloatArray | None:
    """Return NaN (n,) for unknown quantities of a sensor log."""
    if not result.missing_reason(group) and variable in getattr(result, group):
        return None
    return np.full((result.fixes.time if group in _AT_FIXES else result.time).shape, np.nan)


def _component(group: str, variable: str, index: int) -> Reader:
    def read(result: Result) -> FloatArray:
        unknown = _unknown_values(result, group, variable)
        if unknown is not None:
            return unknown
        values: FloatArray = getattr(result, group)[variable].values
        # A held result may have fewer states than the shown one.
        return values[:, index] if index < values.shape[1] else np.full(values.shape[0], np.nan)

    return read


def _errors(variable: str, title: str, unit: str, components: tuple[str, str, str]) -> tuple[TimePlot, ...]:
    return tuple(
        TimePlot(
            name=f"{variable}_{component}",
            title=f"{title}, {component}",
            unit=unit,
            curves=(
                Curve(f"{variable}_{component}", "error", colour, _component("errors", variable, index)),
            ),
            band=Band(f"{variable}_{component}_band", 3, colour, _component("sigma", variable, index)),
        )
        for index, (component, colour) in enumerate(zip(components, AXIS_COLOURS, strict=True))
    )


EAST_NORTH_UP = ("east", "north", "up")
ROLL_PITCH_HEADING = ("roll", "pitch", "heading")
BODY = ("x", "y", "z")

ERRORS: tuple[TimePlot, ...] = (
    *_errors("position", "Position error", "m", EAST_NORTH_UP),
    *_errors("velocity", "Velocity error", "m/s", EAST_NORTH_UP),
    *_errors("attitude", "Attitude error", "°", ROLL_PITCH_HEADING),
)


def _sigmas(name: str, title: str, unit: str, labels: Sequence[str], states: Sequence[int]) -> TimePlot:
    return TimePlot(
        name=f"{name}_sigma",
        title=f"σ of the {title}",
        unit=unit,
        curves=tuple(
            Curve(f"{name}_sigma_{label}", label, colour, _component("state_sigma", "sigma", state))
            for label, colour, state in zip(labels, AXIS_COLOURS, states, strict=True)
        ),
        scale="logarithmic",
    )


def _along_enu(block: slice) -> tuple[int, ...]:
    """Return the states of a block along east, north and up; the filter has them along north, east, down."""
    return tuple(east_north_up_sizes(np.arange(block.start, block.stop)).tolist())


COVARIANCE: tuple[TimePlot, ...] = (
    _sigmas("position", "position", "m", EAST_NORTH_UP, _along_enu(POS)),
    _sigmas("velocity", "velocity", "m/s", EAST_NORTH_UP, _along_enu(VEL)),
    _sigmas("attitude", "attitude, about", "°", ("east", "north", "vertical"), _along_enu(ATT)),
    _sigmas("gyro_bias", "gyro biases", "°/s", BODY, (9, 10, 11)),
    _sigmas("accelerometer_bias", "accelerometer biases", "mg", BODY, (12, 13, 14)),
)
"""Numbers are those of the states, in the order of `error_models.STATES`."""
SCALE_COVARIANCE: tuple[TimePlot, ...] = (
    _sigmas("gyro_scale", "gyro scale factors", "%", BODY, (15, 16, 17)),
    _sigmas("accelerometer_scale", "accelerometer scale factors", "%", BODY, (18, 19, 20)),
)
"""Beside these with 21 states."""


def _plot_estimate(
    name: str, title: str, unit: str, colour: str, estimate: Reader, truth: Reader, sigma: Reader
) -> TimePlot:
    """Return a plot of the estimate of an error with its ±3σ, and of its true value."""
    curves = (
        Curve(name, "estimate", colour, estimate),
        Curve(f"{name}_true", "truth", TRUTH, truth, style="dashed"),
    )
    band = Band(f"{name}_band", 3, colour, sigma, centre=estimate)
    return TimePlot(name, title, unit, curves, band=band, scale="free")


def _estimates(variable: str, title: str, unit: str) -> tuple[TimePlot, ...]:
    plots = []
    for index, (axis, colour) in enumerate(zip(BODY, AXIS_COLOURS, strict=True)):
        names = variable, f"{variable}_true", f"{variable}_sigma"
        readers = (_component("sensor_errors", name, index) for name in names)
        plots.append(_plot_estimate(f"{variable}_{axis}", f"{title}, {axis}", unit, colour, *readers))
    return tuple(plots)


SENSOR_ERRORS: tuple[TimePlot, ...] = (
    *_estimates("gyro_bias", "Gyro bias", "°/s"),
    *_estimates("accelerometer_bias", "Accelerometer bias", "mg"),
)
SCALE_ERRORS: tuple[TimePlot, ...] = (
    *_estimates("gyro_scale", "Gyro scale factor error", "%"),
    *_estimates("accelerometer_scale", "Accelerometer scale factor error", "%"),
)
"""Beside these with 21 states."""


def _read_further_state(variable: str, state: str) -> Reader:
    def read(result: Result) -> FloatArray:
        nothing = np.full(result.time.shape, np.nan)
        if not result.solution_arrays.further.shape[1]:  # as of a held result with fewer states
            return nothing
        found = result.further_states
        if variable not in found or state not in found["state"].values:
            return nothing
        return np.asarray(found[variable].sel(state=state).values)

    return read


@functools.cache
def further_plots(names: tuple[str, ...]) -> tuple[TimePlot, ...]:
    """Return plots of the estimates of the further states of a filter, given its blocks."""
    plots = []
    for block in (find_block(name) for name in names if name not in SCALES):
        for index, state in enumerate(block.names):
            name, colour = state.replace(" ", "_"), AXIS_COLOURS[index % len(AXIS_COLOURS)]
            readers = (_read_further_state(variable, state) for variable in ("estimate", "truth", "sigma"))
            title = state[0].upper() + state[1:]
            plots.append(_plot_estimate(name, title, block.shown_unit, colour, *readers))
    return tuple(plots)


def _innovation(
    name: str, title: str, unit: str, colour: str, value: Reader, sigma: Reader, clock: Clock
) -> TimePlot:
    """Return a plot of an innovation, as points, with its ±3σ."""
    name = f"innovation_{name}"
    curve = Curve(name, "innovation", colour, value, style="points")
    return TimePlot(name, title, unit, (curve,), band=Band(f"{name}_band", 3, colour, sigma), clock=clock)


def _aid(variable: str, kind: int) -> Reader:
    def read(result: Result) -> FloatArray:
        values: FloatArray = result.aiding[variable].values[result.aids.kind == kind]
        return values

    return read


@functools.cache
def aid_plots(kinds: tuple[int, ...]) -> tuple[TimePlot, ...]:
    """Return plots of the innovations of the measurements besides GPS, given their kinds."""
    plots = []
    for place, kind in enumerate(kinds):
        name, title = NAMES[kind].replace(" ", "_"), f"{NAMES[kind][0].upper()}{NAMES[kind][1:]} innovation"
        unit, colour, clock = SHOWN[kind][0], AXIS_COLOURS[place % 3], AID_CLOCKS[kind]
        value, sigma = _aid("innovation", kind), _aid("sigma", kind)
        plots.append(_innovation(name, title, unit, colour, value, sigma, clock))
    return tuple(plots)


def times_of_aid(result: Run, clock: Clock) -> NDArray[np.float64]:
    """Return the times of a kind of measurements besides GPS, given by its clock."""
    return np.asarray(result.aids.time[result.aids.kind == AID_CLOCKS.index(clock)], dtype=np.float64)


def kinds_of_aids(result: Result) -> tuple[int, ...]:
    """Return the kinds of the measurements besides GPS of a result."""
    return tuple(int(kind) for kind in np.unique(result.aids.kind))


def with_scale(
    result: Result, plots: tuple[TimePlot, ...], scale_plots: tuple[TimePlot, ...]
) -> tuple[TimePlot, ...]:
    """Return plots of the biases, and of the scale factors if a result has estimates of them."""
    return plots + scale_plots if result.solution_arrays.scale.size else plots


def _of_temperature(variable: str) -> Reader:
    def read(result: Result) -> FloatArray:
        values = result.temperature[variable].values
        return np.concatenate((values[:1], values))

    return read


_THERMAL = (
    Curve("temperature_true", "truth", BLUE, _of_temperature("true"), is_whole=True),
    Curve(
        "temperature_reading",
        "thermometer",
        ORANGE,
        _of_temperature("reading"),
        style="dashed",
        is_whole=True,
    ),
)
TEMPERATURE = (TimePlot("temperature", "Temperature of the IMU", "°C", _THERMAL, scale="free"),)
"""Shown if a temperature profile is set."""


def _innovations(variable: str, unit: str) -> tuple[TimePlot, ...]:
    return tuple(
        _innovation(
            f"{variable}_{axis}",
            f"Innovation, {axis}",  # the unit says which; with rms and share, no more has room
            unit,
            colour,
            _component("innovations", variable, index),
            _component("innovations", f"{variable}_sigma", index),
            "time_gps",
        )
        for index, (axis, colour) in enumerate(zip(EAST_NORTH_UP, AXIS_COLOURS, strict=True))
    )


INNOVATIONS: tuple[TimePlot, ...] = (
    *_innovations("position", "m"),
    *_innovations("velocity", "m/s"),
)


def _scalar(group: str, variable: str) -> Reader:
    def read(result: Result) -> FloatArray:
        unknown = _unknown_values(result, group, variable)
        values: FloatArray = getattr(result, group)[variable].values if unknown is None else unknown
        return values

    return read


def _chi_square(name: str, variable: str, colour: str, group: str) -> TimePlot:
    """Return a plot of a quantity that should be χ²-distributed, with its 95 % interval."""

    def edges(result: Result) -> tuple[float, float]:
        if result.missing_reason(group):
            return np.nan, np.nan
        return chi_square_interval(getattr(result, group)[variable].attrs["degrees"])

    def half(result: Result) -> FloatArray:
        low, high = edges(result)
        return np.full(result.fixes.time.shape, (high - low) / 2)

    def middle(result: Result) -> FloatArray:
        return np.full(result.fixes.time.shape, sum(edges(result)) / 2)

    curve = Curve(variable, variable.upper(), colour, _scalar(group, variable), style="points")
    band = Interval(f"{variable}_band", 1, colour, half, centre=middle)
    return TimePlot(variable, name, "", (curve,), band=band, clock="time_gps", scale="free")


def _normalised(variable: str) -> TimePlot:
    """Return a plot of the three innovations of a kind, each divided by its σ."""

    def reader(index: int) -> Reader:
        def read(result: Result) -> FloatArray:
            innovations = result.innovations
            values: FloatArray = (innovations[variable] / innovations[f"{variable}_sigma"]).values[:, index]
            return values

        return read

    def unit(result: Result) -> FloatArray:
        return np.ones(result.fixes.time.shape)

    curves = tuple(
        Curve(f"normalised_{variable}_{axis}", axis, colour, reader(index), style="points")
        for index, (axis, colour) in enumerate(zip(EAST_NORTH_UP, AXIS_COLOURS, strict=True))
    )
    band = Band(f"normalised_{variable}_band", 3, TRUTH, unit)
    title = f"{variable.capitalize()} innovations"
    return TimePlot(f"normalised_{variable}", title, "σ", curves, band=band, clock="time_gps")


def _average(name: str, variable: str, colour: str, clock: Clock = "time") -> TimePlot:
    """Return a plot of a χ² averaged over the runs of an ensemble, with its 95 % interval."""

    def reader(suffix: str) -> Callable[[Ensemble], FloatArray]:
        def read(ensemble: Ensemble) -> FloatArray:
            values: FloatArray = ensemble.consistency[f"{variable}{suffix}"].values
            return values

        return read

    low, high = reader("_low"), reader("_high")
    band = Interval(
        f"{variable}_band",
        1,
        colour,
        lambda ensemble: (high(ensemble) - low(ensemble)) / 2,
        centre=lambda ensemble: (high(ensemble) + low(ensemble)) / 2,
    )
    curve = Curve(variable, "average", colour, reader(""), style="points")
    return TimePlot(variable, name, "", (curve,), band=band, clock=clock, scale="free")


CONSISTENCY: tuple[TimePlot, ...] = (
    _chi_square("NEES: normalised errors", "nees", BLUE, "consistency"),
    _chi_square("NIS: normalised innovations", "nis", GREEN, "innovations"),
    _normalised("position"),
    _normalised("velocity"),
)

ENSEMBLE_CONSISTENCY: tuple[TimePlot, ...] = (
    _average("NEES, average over the runs", "anees", BLUE),
    _average("NIS, average over the runs", "anis", GREEN),
    _average("Position NEES between fixes, average over runs", "anees_between", BLUE, "time_between"),
)


def plot_motion(
    name: str, title: str, unit: str, estimate: Reader, truth: Reader, fixes: Reader | None = None
) -> TimePlot:
    """Return a plot of estimate and truth, and of the fixes where they measure it."""
    curves = (
        Curve(f"{name}_estimate", "estimate", ESTIMATE, estimate),
        Curve(f"{name}_true", "truth", TRUTH, truth, style="dashed"),
    )
    of_fixes = fixes and Curve(f"{name}_fixes", "GPS fixes", FIXES, fixes, style="points")
    return TimePlot(name, title, unit, curves, fixes=of_fixes, scale="free")


_FLOWN = ("solution", "truth", "gps")
HEIGHT: tuple[TimePlot, ...] = (  # component 2 of a vector is down
    plot_motion("height", "Height above the ellipsoid", "m", *(_scalar(group, "height") for group in _FLOWN)),
    ERRORS[2],
    plot_motion(
        "velocity_up",
        "Vertical velocity, up",
        "m/s",
        *(_component(group, "velocity", 2) for group in _FLOWN),
    ),
)

LAGS = 30
"""Largest plotted lag of the autocorrelation, in fixes."""
