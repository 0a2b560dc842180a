"""Flight plots: the flight itself over time, as estimated, in truth, and as measured."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lab.base.aid_table import AIDS
from lab.motion.frames.rotation import euler_from_quaternion, wrap
from lab.navigation.aids import HEADING, HEIGHT, MAGNETIC, NAMES, SENSORS, SHOWN
from lab.views.quantities import AXIS_COLOURS, BODY, ESTIMATE, FIXES, ROLL_PITCH_HEADING, TRUTH, plot_motion
from lab.views.quantities import HEIGHT as OF_HEIGHT
from lab.views.time_plot import AID_CLOCKS, Curve, FloatArray, Reader, TimePlot

if TYPE_CHECKING:
    from lab.experiment.result import Result

TURNS = 50
"""Most jumps of an angle at ±180° that are gaps of its curve: more are noise of a flight to the south, which
would be all gaps."""


def series(group: str, variable: str, part: Callable[[FloatArray], FloatArray]) -> Reader:
    """Return a reader of a part of a variable of a dataset, or NaN where a result has none.

    Parameters
    ----------
    group, variable
        The dataset, over the times of the samples, of the sample intervals or of the fixes, and its variable.
    part
        Takes its values (n, 3), and returns the samples (n,).
    """

    def read(result: Result) -> FloatArray:
        known = not result.missing_reason(group) and variable in getattr(result, group)
        if not known:
            return np.full((result.fixes.time if group == "gps" else result.time).shape, np.nan)
        values = part(getattr(result, group)[variable].values)
        return np.concatenate((values[:1], values)) if group == "imu" else values

    return read


def component(number: int) -> Callable[[FloatArray], FloatArray]:
    """Return what takes a component of vectors (n, 3)."""
    return lambda vectors: vectors[:, number]


def horizontal(vectors: FloatArray) -> FloatArray:
    """Return the length (n,) of the horizontal part of vectors (n, 3) along east, north, up."""
    return np.hypot(vectors[:, 0], vectors[:, 1])


def _angle(number: int) -> Callable[[FloatArray], FloatArray]:
    """Return what takes one of three angles [°], with a gap where it jumps at ±180°."""
    return lambda angles: with_gaps(angles[:, number])


def with_gaps(angles: FloatArray) -> FloatArray:
    """Return angles (n,) [°] with a gap where they jump at ±180°, so that no line crosses the plot."""
    jumps = np.flatnonzero(np.abs(np.diff(angles)) > 180.0)
    if 0 < jumps.size <= TURNS:
        angles = angles.copy()
        angles[jumps] = np.nan
    return angles


def _plot_motion(
    name: str,
    title: str,
    unit: str,
    variable: str,
    part: Callable[[FloatArray], FloatArray],
    *,
    has_fixes: bool = False,
) -> TimePlot:
    """Return a plot of estimate and truth, and of the fixes where they measure it."""
    estimate, truth, fixes = (series(group, variable, part) for group in ("solution", "truth", "gps"))
    return plot_motion(name, title, unit, estimate, truth, fixes if has_fixes else None)


def _plot_measured(variable: str, title: str, unit: str) -> tuple[TimePlot, ...]:
    """Return plots of what the IMU measured along its axes, and of the truth."""

    def of_axis(kind: str, number: int) -> Reader:
        return series("imu", f"{variable}{kind}", component(number))

    return tuple(
        TimePlot(
            name=f"{variable}_{axis}",
            title=f"{title}, {axis}",
            unit=unit,
            curves=(
                Curve(f"{variable}_{axis}_true", "truth", TRUTH, of_axis("_true", number), style="dashed"),
                Curve(f"{variable}_{axis}", "measured", AXIS_COLOURS[number], of_axis("", number)),
            ),
            scale="free",
        )
        for number, axis in enumerate(BODY)
    )


FLIGHT: tuple[TimePlot, ...] = (
    OF_HEIGHT[0],
    _plot_motion("ground_speed", "Ground speed", "m/s", "velocity", horizontal, has_fixes=True),
    OF_HEIGHT[2],
    *(
        _plot_motion(angle, angle.capitalize(), "°", "attitude", _angle(number))
        for number, angle in enumerate(ROLL_PITCH_HEADING)
    ),
    *_plot_measured("angular_rate", "Angular rate", "°/s"),
    *_plot_measured("specific_force", "Specific force", "m/s²"),
)
"""Height, speed and attitude, and what the IMU measured."""


def _aid(variable: str, kind: int) -> Reader:
    """Return a reader of a kind of measurements besides GPS: "measured", "estimate" or "truth".

    The estimate is what the filter expects to be measured, with its estimate of the sensor's own error.
    """
    unit, scale = SHOWN[kind]

    def read(result: Result) -> FloatArray:
        rows = result.aids.kind == kind
        nearest = np.searchsorted((result.time[1:] + result.time[:-1]) / 2, result.aids.time[rows])
        if variable == "truth":
            values = _truth(result, kind, nearest)
        else:
            innovation = result.solution_arrays.aid_innovation[rows]
            if kind == MAGNETIC:  # measured is a field: the heading that it shows
                expected = euler_from_quaternion(result.solution_arrays.q_nb[nearest])[:, 2]
            else:
                expected = result.aids.value[rows] + innovation
            values = expected if variable == "estimate" else expected - innovation
        if unit != "°":
            return scale * values
        angles = scale * wrap(values)
        return angles if variable == "measured" else with_gaps(angles)

    return read


def _truth(result: Result, kind: int, samples: NDArray[np.intp]) -> FloatArray:
    """Return the true height [m] or heading [rad] at some samples."""
    if result.truth_arrays is None:
        return np.full(samples.size, np.nan)
    true = result.truth_arrays.taken(samples)
    return np.asarray(true.height if kind == HEIGHT else true.euler[:, 2])


@functools.cache
def sensor_plots(kinds: tuple[int, ...]) -> tuple[TimePlot, ...]:
    """Return plots of what sensors besides IMU and GPS measured, given the kinds of measurements."""
    titles = {aid.name: aid.title.partition(" and ")[0] for aid in AIDS}
    plots = []
    for kind in kinds:
        if kind not in SENSORS:  # a condition without a sensor
            continue
        name = f"sensor_{NAMES[kind].replace(' ', '_')}"
        curves = [
            Curve(f"{name}_estimate", "estimate", ESTIMATE, _aid("estimate", kind)),
            Curve(f"{name}_measured", "measured", FIXES, _aid("measured", kind), style="points"),
        ]
        if kind in (HEIGHT, HEADING, MAGNETIC):
            curves.insert(1, Curve(f"{name}_true", "truth", TRUTH, _aid("truth", kind), style="dashed"))
        title = f"{titles[SENSORS[kind]]}, {NAMES[kind]}"
        plots.append(
            TimePlot(name, title, SHOWN[kind][0], tuple(curves), clock=AID_CLOCKS[kind], scale="free")
        )
    return tuple(plots)
