"""What the plots declare agrees with what the datasets say of themselves, and with their numbers."""

from __future__ import annotations

import numpy as np
import pytest

from lab.result import Result
from lab.views.quantities import CONSISTENCY, COVARIANCE, ERRORS, HEIGHT, INNOVATIONS, SENSOR_ERRORS, TimePlot

PLOTS = {
    plot.name: plot for plot in (*ERRORS, *COVARIANCE, *SENSOR_ERRORS, *INNOVATIONS, *CONSISTENCY, *HEIGHT)
}


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


def test_all_fifteen_states_appear_once_in_their_units(result: Result) -> None:
    sigma = result.state_sigma["sigma"].values
    units = result.state_sigma["unit"].values
    shown = []
    for plot in COVARIANCE:
        for curve in plot.curves:
            values = curve.read(result)
            (state,) = [index for index in range(15) if np.shares_memory(values, sigma[:, index])]
            assert plot.unit == units[state]
            shown.append(state)
    assert sorted(shown) == list(range(15))


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
