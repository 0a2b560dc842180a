"""What the plots declare agrees with what the datasets say of themselves, and with their numbers."""

from __future__ import annotations

import re

import numpy as np
import pytest

from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.navigation.aids import NAMES
from lab.navigation.filters.blocks import FURTHER
from lab.views.flight_plots import FLIGHT, sensor_plots
from lab.views.live_figures import LiveFigures
from lab.views.overview import BY_INNOVATIONS, CROSS_CHECKS, OVERVIEW, key_figures
from lab.views.quantities import (
    CONSISTENCY,
    COVARIANCE,
    ERRORS,
    HEIGHT,
    INNOVATIONS,
    SCALE_COVARIANCE,
    SCALE_ERRORS,
    SENSOR_ERRORS,
    TEMPERATURE,
    aid_plots,
    further_plots,
    with_scale,
)
from lab.views.rolling_figures import LiveErrorFigures
from lab.views.time_plot import TimePlot

PLOTS = {
    plot.name: plot for plot in (*ERRORS, *COVARIANCE, *SENSOR_ERRORS, *INNOVATIONS, *CONSISTENCY, *HEIGHT)
}


@pytest.fixture(scope="module")
def scaled() -> Result:
    """Return a run with 21 states and given scale factor errors."""
    experiment = Experiment(mission="los_angeles")
    experiment.set("trajectory.imu_rate", 50)
    experiment.set("navigator.states", 21)
    experiment.set("sensors.gyro.scale_factor", [1.0, -2.0, 3.0])
    experiment.set("sensors.accelerometer.scale_factor", 0.5)
    return experiment.run()


@pytest.mark.parametrize("plot", PLOTS.values(), ids=PLOTS)
def test_every_sample_has_its_time(plot: TimePlot, result: Result) -> None:
    times = result.time if plot.clock == "time" else result.fixes.time
    for curve in plot.curves:
        assert curve.read(result).shape == times.shape
    if plot.band is not None:
        low, high = plot.band.edges(result)
        assert low.shape == high.shape == times.shape
        assert np.all((low <= high) | np.isnan(low))
    if plot.fixes is not None:
        assert plot.fixes.read(result).shape == result.fixes.time.shape


def test_names_of_columns_are_unique() -> None:
    for page in (ERRORS, COVARIANCE, SENSOR_ERRORS, INNOVATIONS, CONSISTENCY, HEIGHT):
        names = [curve.name for plot in page for curve in plot.curves]
        assert len(names) == len(set(names))


def test_units_are_those_of_the_datasets(result: Result) -> None:
    for kind in ("position", "velocity", "attitude"):
        for plot in ERRORS:
            if plot.name.startswith(kind):
                assert plot.unit == result.errors[kind].attrs["units"] == result.sigma[kind].attrs["units"]
    for plot in SENSOR_ERRORS:
        variable = plot.name.rpartition("_")[0]
        assert plot.unit == result.sensor_errors[variable].attrs["units"]
    for plot in INNOVATIONS:
        variable = plot.name.split("_")[1]
        assert plot.unit == result.innovations[variable].attrs["units"]


UNITS = (
    ("nees|nis", ""), ("(position|velocity) innovations|innovations,", "σ"), ("scale factor", "%"),
    ("temperature", "°C"), ("sensitivity", "°/s/g"), ("angular rate|gyro (bias|drift)", "°/s"),
    ("accelerometer (bias|drift)", "mg"), ("force", "m/s²"), ("latency", "s"), ("speed|velocity", "m/s"),
    ("position|height|withheld|gps drift|barometer bias|lever arm", "m"),
    ("attitude|heading|roll|pitch|misalignment", "°"),
)  # fmt: skip
"""What a title speaks of, and the unit of that: the first that is found."""


def test_every_plot_has_the_unit_of_what_its_title_names() -> None:
    plots = (
        *(*ERRORS, *COVARIANCE, *SENSOR_ERRORS, *CONSISTENCY, *HEIGHT, *SCALE_ERRORS, *SCALE_COVARIANCE),
        *(*FLIGHT, *OVERVIEW, *BY_INNOVATIONS, *CROSS_CHECKS, *TEMPERATURE, *further_plots(FURTHER)),
        *(*aid_plots(tuple(range(len(NAMES)))), *sensor_plots(tuple(range(len(NAMES))))),
    )
    shown = {(plot.title.removesuffix(" innovation"), plot.unit) for plot in plots}
    for figures in (LiveFigures(), LiveErrorFigures(20.0)):
        drawn = (re.fullmatch(r"(.*) \[(.*)\]: none yet", one.title.text) for one in figures.figures)
        shown |= {(one[1], one[2]) for one in drawn if one}
    assert len(shown) > 70
    for title, unit in shown:
        assert unit == next(unit for words, unit in UNITS if re.search(words, title.lower())), title


def test_the_figures_of_a_glance_are_those_of_the_tables(result: Result) -> None:
    rms = result.summary.set_index("quantity")["rms"]
    east, north, *velocity = (rms[f"{one}"] for one in rms.index[:6] if one != "position up")
    expected = {
        "Horizontal position, rms": (np.hypot(east, north), "m"),
        "Velocity, rms": (np.linalg.norm(velocity), "m/s"),
        "Heading, rms": (rms["attitude heading"], "°"),
    }
    found = {one.label: one.value for one in key_figures(result)}
    assert list(found)[:3] == list(expected)
    for label, (value, unit) in expected.items():
        assert found[label] == f"{value:.3g}\N{THIN SPACE}{unit}"


@pytest.mark.parametrize("n", [15, 21])
def test_all_states_appear_once_in_their_units(n: int, scaled: Result, result: Result) -> None:
    result = scaled if n == 21 else result
    sigma = result.state_sigma["sigma"].values
    units, names = result.state_sigma["unit"].values, result.state_sigma["state"].values
    shown = []
    for plot in with_scale(result, COVARIANCE, SCALE_COVARIANCE):
        for curve in plot.curves:
            values = curve.read(result)
            (state,) = [index for index in range(n) if np.shares_memory(values, sigma[:, index])]
            assert plot.unit == units[state]
            assert names[state].split()[0] == plot.name.split("_")[0]
            shown.append(state)
    assert sorted(shown) == list(range(n))


def test_scale_factors_are_shown_against_the_truth(scaled: Result) -> None:
    plots = with_scale(scaled, SENSOR_ERRORS, SCALE_ERRORS)
    assert [plot.heading for plot in plots[6:]] == [
        f"{sensor} scale factor error, {axis} [%]" for sensor in ("Gyro", "Accelerometer") for axis in "xyz"
    ]
    for plot, given in zip(plots[6:], (1.0, -2.0, 3.0, 0.5, 0.5, 0.5), strict=True):
        estimate, truth = (curve.read(scaled) for curve in plot.curves)
        np.testing.assert_allclose(truth, given, rtol=1e-12)
        assert estimate[0] == 0
        assert plot.band is not None
        low, high = plot.band.edges(scaled)
        np.testing.assert_allclose((low + high) / 2, estimate, atol=1e-12)


def test_without_scale_states_nothing_extra_is_shown(result: Result) -> None:
    assert with_scale(result, SENSOR_ERRORS, SCALE_ERRORS) == SENSOR_ERRORS
    assert with_scale(result, COVARIANCE, SCALE_COVARIANCE) == COVARIANCE
    assert not any("scale" in str(name) for name in result.sensor_errors)


def test_east_north_up_of_the_covariance_is_that_of_the_errors(result: Result) -> None:
    for plot, variable in zip(COVARIANCE[:2], ("position", "velocity"), strict=True):
        for index, curve in enumerate(plot.curves):
            axis = result.sigma[variable]["axis"].values[index]
            assert curve.label == axis
            np.testing.assert_allclose(curve.read(result), result.sigma[variable].sel(axis=axis).values)


def test_errors_are_estimate_minus_truth_in_the_order_of_their_titles(result: Result) -> None:
    up = next(plot for plot in ERRORS if plot.title == "Position error, up")
    expected = result.solution["height"].values - result.truth["height"].values
    np.testing.assert_allclose(up.curves[0].read(result), expected, atol=1e-6)
    north = next(plot for plot in ERRORS if plot.title == "Velocity error, north")
    difference = result.solution["velocity"] - result.truth["velocity"]
    np.testing.assert_allclose(north.curves[0].read(result), difference.sel(axis="north").values, atol=1e-9)
    heading = next(plot for plot in ERRORS if plot.title == "Attitude error, heading")
    estimate, truth = (
        data["attitude"].sel(angle="heading").values for data in (result.solution, result.truth)
    )
    turned = (estimate - truth + 180) % 360 - 180
    np.testing.assert_allclose(heading.curves[0].read(result), turned, atol=1e-9)


def test_the_band_is_three_sigma(result: Result) -> None:
    plot = ERRORS[0]
    assert plot.band is not None
    low, high = plot.band.edges(result)
    np.testing.assert_allclose(high, 3 * result.sigma["position"].sel(axis="east").values)
    np.testing.assert_allclose(low, -high)
    assert plot.band.label == "±3σ"
