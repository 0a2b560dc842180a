"""The figures of the page: what they are sent, on which axes, and how they follow the shared time."""

from __future__ import annotations

import dataclasses

import numpy as np
import pymap3d
import pytest
from bokeh.models import ColumnDataSource
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from lab.experiment.ensembles.seeds import run_ensemble
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.views.autocorrelation import AutocorrelationFigures
from lab.views.figures import TimeAxis, decade_ticks, set_ordinate, time_figure
from lab.views.quantities import (
    BLUE,
    CONSISTENCY,
    COVARIANCE,
    ENSEMBLE_CONSISTENCY,
    ERRORS,
    HEIGHT,
    HELD,
    INNOVATIONS,
    LAGS,
    SCALE_COVARIANCE,
    SCALE_ERRORS,
    SENSOR_ERRORS,
    TEMPERATURE,
    further_plots,
)
from lab.views.time_figures import TimeFigures
from lab.views.time_plot import THIN, Curve, TimePlot
from lab.views.track import TrackFigure


@pytest.fixture
def axis(result: Result) -> TimeAxis:
    axis = TimeAxis()
    axis.span(float(result.time[-1]))
    return axis


def source(figures: TimeFigures, clock: str = "time") -> ColumnDataSource:
    found = figures.figures[0].select_one(
        {"type": ColumnDataSource, "name": f"{clock}:{figures.plots[0].name}"}
    )
    assert isinstance(found, ColumnDataSource)
    return found


def test_nine_plots_share_one_small_source(result: Result, axis: TimeAxis) -> None:
    figures = TimeFigures(ERRORS, axis)
    figures.show(result)
    data = source(figures).data
    assert len(figures.figures) == 9
    assert {values.dtype for values in data.values()} == {np.dtype(np.float32)}
    assert sum(values.nbytes for values in data.values()) < 150_000
    for name, index in (("position_east", 0), ("position_north", 1), ("position_up", 2)):
        expected = result.errors["position"].values[:, index]
        assert data[name].max() == pytest.approx(expected.max(), rel=1e-6)
        assert data[name].min() == pytest.approx(expected.min(), rel=1e-6)


def test_all_time_axes_are_one(result: Result, axis: TimeAxis) -> None:
    figures = [
        *TimeFigures(ERRORS, axis).figures,
        *TimeFigures(COVARIANCE, axis).figures,
        *TimeFigures(INNOVATIONS, axis).figures,
    ]
    assert {id(fig.x_range) for fig in figures} == {id(axis.range)}
    assert all(axis.cursor in fig.renderers for fig in figures)
    assert axis.window == (0, pytest.approx(result.time[-1]))


def test_zoomed_in_every_sample_is_there(result: Result, axis: TimeAxis) -> None:
    figures = TimeFigures(ERRORS, axis)
    axis.range.update(start=100.0, end=101.0)
    figures.show(result)
    data = source(figures).data
    inside = (data["time"] >= 100) & (data["time"] <= 101)
    assert inside.sum() == 201
    expected = result.errors["attitude"].values[20_000:20_201, 2]
    np.testing.assert_allclose(data["attitude_heading"][inside], expected, rtol=1e-6)


def test_ordinates_hold_curve_and_band(result: Result, axis: TimeAxis) -> None:
    figures = TimeFigures(ERRORS, axis)
    figures.show(result)
    data = source(figures).data
    for plot, fig in zip(figures.plots, figures.figures, strict=True):
        assert plot.band is not None
        for column in (plot.curves[0].name, plot.band.low, plot.band.high):
            assert fig.y_range.start <= data[column].min()
            assert fig.y_range.end >= data[column].max()


def test_fixes_keep_their_own_times(result: Result, axis: TimeAxis) -> None:
    figures = TimeFigures(HEIGHT, axis)
    figures.show(result)
    data = source(figures, "time_gps").data
    np.testing.assert_allclose(data["time"], result.fixes.time, rtol=1e-6)
    np.testing.assert_allclose(data["height_fixes"], result.gps["height"].values, rtol=1e-6)


def test_another_flight_is_shown_whole(axis: TimeAxis) -> None:
    axis.range.update(start=150.0, end=160.0)
    axis.cursor.location = 155.0
    axis.span(100.0)
    assert axis.window == (0, 100)
    assert axis.time == 100


def test_autocorrelation_has_its_band(result: Result) -> None:
    figures = AutocorrelationFigures()
    figures.show(result)
    fig = figures.figures[0]
    data = fig.select_one({"type": ColumnDataSource}).data
    assert data["lag"].tolist() == list(range(1, LAGS + 1))
    r = result.autocorrelation["position"].values[1 : LAGS + 1, 0]
    assert np.array_equal(data["position_east"], r)
    assert fig.y_range.start <= r.min() < r.max() <= fig.y_range.end
    box = next(item for item in fig.center if hasattr(item, "fill_alpha") and hasattr(item, "bottom"))
    assert box.top == -box.bottom == pytest.approx(3 / np.sqrt(result.fixes.time.size), rel=0.02)


def test_the_track_is_in_metres_from_the_start(result: Result) -> None:
    track = TrackFigure()
    track.show(result, 0.0, [result])
    track.show_time(100.0)
    truth, estimate = result.truth, result.solution
    place = [estimate[name].sel(time=100.0, method="nearest") for name in ("latitude", "longitude")]
    start = [float(truth[name][0]) for name in ("latitude", "longitude")]
    east, north, _ = pymap3d.geodetic2enu(*map(float, place), 0.0, *start, 0.0)
    assert track._now.data["east"][0] == pytest.approx(east, abs=1e-2)
    assert track._now.data["north"][0] == pytest.approx(north, abs=1e-2)
    assert abs(track._true.data["east"][0]) < 1e-3 > abs(track._true.data["north"][0])
    assert list(track._ends.data["word"]) == ["start", "end"]
    assert track._ends.data["east"][1] == pytest.approx(track._estimated.data["east"][-1], rel=1e-6)
    assert np.array_equal(track._held.data["north"][0], track._estimated.data["north"])
    assert track.figure.match_aspect
    # A held flight on another continent leaves the axes as they are.
    for axis in (track.figure.x_range, track.figure.y_range):
        shown = [one.data_source for one in axis.renderers]
        assert track._estimated in shown and track._held not in shown
    sent = track._true.data
    track.show(result, 0.0)
    assert track._true.data is sent, "the same truth is not sent again"
    assert track._held.data["colour"] == []
    track.show(result, 0.0, [None, result])
    assert track._held.data["colour"] == [HELD[1]]


def test_averages_of_an_ensemble_are_drawn_in_their_narrower_interval(axis: TimeAxis) -> None:
    ensemble = run_ensemble(Experiment(mission="los_angeles"), 4)
    axis.span(float(ensemble.time[-1]))
    figures = TimeFigures(ENSEMBLE_CONSISTENCY, axis)
    figures.show(ensemble)
    data = source(figures).data
    np.testing.assert_allclose(data["time"], ensemble.time, rtol=1e-6)
    np.testing.assert_allclose(data["anees"], ensemble.at_fixes.mean("nees"), rtol=1e-5)
    low, high = chi2.interval(0.95, 4 * 15)
    np.testing.assert_allclose(data["anees_band_low"], low / 4, rtol=1e-5)
    np.testing.assert_allclose(data["anees_band_high"], high / 4, rtol=1e-5)


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (-1.0, 1.0), (1.0, 1.0), (np.nan, 1.0), (1.0, np.inf)])
def test_ends_without_a_logarithm_have_no_ticks(low: float, high: float) -> None:
    assert decade_ticks(low, high) == []


@given(st.floats(-37, 36), st.floats(0.25, 70))
def test_ticks_lie_on_the_axis_and_are_few_enough_to_be_read(start: float, decades: float) -> None:
    ends = (np.floor(4 * start) / 4, np.ceil(4 * (start + decades)) / 4)
    low, high = (10.0**end for end in ends)
    ticks = np.array(decade_ticks(low, high))
    assert ((ticks >= low) & (ticks <= high)).all()
    assert 2 <= ticks.size <= 12
    assert np.diff(np.log10(ticks)).min() > 0.04 * (ends[1] - ends[0])


@pytest.mark.parametrize("tiny", [0.0, 1e-40, 1e-13])
def test_sigmas_that_are_zero_are_named_and_the_others_drawn(
    result: Result, axis: TimeAxis, tiny: float
) -> None:
    """As σ of a scale factor is, where the sensor has no such error."""

    def constant(value: float) -> Curve:
        return Curve(f"s{value}", f"σ {value}", BLUE, lambda result: np.full(result.time.shape, value))

    def shown(*values: float) -> tuple[str, list[str], tuple[float, float]]:
        plot = TimePlot("s", "σ", "m", tuple(map(constant, values)), scale="logarithmic")
        figures = TimeFigures([plot], axis)
        figures.show(result)
        (fig,) = figures.figures
        labels = [item.label.value for legend in fig.legend for item in legend.items]
        return fig.title.text, labels, (fig.y_range.start, fig.y_range.end)

    assert shown(tiny)[0] == ("σ [m]" if tiny == 1e-13 else "σ [m]: zero")
    title, labels, (low, high) = shown(tiny, 2.0)
    assert title == "σ [m]"
    assert labels == ([f"σ {tiny}", "σ 2.0"] if tiny == 1e-13 else [f"σ {tiny}: zero", "σ 2.0"])
    assert low < (tiny if tiny == 1e-13 else 2.0) < 2.1 < high


def test_ticks_of_a_logarithmic_axis_do_not_crowd(axis: TimeAxis) -> None:
    fig = time_figure("σ", axis, logarithmic=True)
    for low, high in ((0.1, 0.6), (0.02, 3.0), (1e-7, 1e2)):
        set_ordinate(fig, low, high)
        ticks = np.log10(fig.yaxis[0].ticker.ticks) / np.log10(high / low)
        assert 3 <= ticks.size <= 10
        assert np.diff(ticks).min() > 0.07


def test_titles_have_the_rms_and_the_share_inside_the_band(result: Result, axis: TimeAxis) -> None:
    """As the tables of the whole flight have them, which are computed elsewhere."""
    figures = TimeFigures(ERRORS, axis)
    figures.show(result)
    summary = result.summary.set_index("quantity")["rms"]
    for fig, error in zip(figures.figures, summary, strict=True):
        heading, rms, inside = fig.title.text.split(f"{THIN}·{THIN}")
        assert heading.endswith("]")
        assert float(rms.removeprefix("rms ")) == pytest.approx(error, rel=0.05)
        assert float(inside.removesuffix(f"{THIN}% in 3σ")) <= 100
    low, high = 20.0, 60.0
    axis.range.update(start=low, end=high)
    figures.show(result)
    seen = (result.time >= low) & (result.time <= high)
    for fig, name in zip(figures.figures[:3], ("east", "north", "up"), strict=True):
        error = result.errors["position"].sel(axis=name).values[seen]
        sigma = result.sigma["position"].sel(axis=name).values[seen]
        share = 100 * np.mean(np.abs(error) <= 3 * sigma)
        *_, rms, inside = fig.title.text.split(f"{THIN}·{THIN}")
        assert rms == f"rms {np.sqrt(np.mean(error**2)):.2g}"
        assert float(inside.split(THIN)[0]) == pytest.approx(share, abs=0.5 if share < 99.5 else 0.05)


def test_the_share_of_a_long_flight_is_that_of_its_parts(result: Result, axis: TimeAxis) -> None:
    whole, parts = (TimeFigures(SENSOR_ERRORS, axis) for _ in range(2))
    thinned = whole._thinned(result, axis.window)
    long = dataclasses.replace(result)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(type(result), "is_long", True)
        again = parts._thinned(long, axis.window)
    assert again.inside == thinned.inside
    (one, *_) = (plot.judged_heading(again.inside[plot.name]) for plot in parts.plots)
    assert one.startswith(f"Gyro bias, x [°/s]{THIN}·{THIN}truth ")


def test_nees_and_nis_have_the_share_in_their_interval(result: Result, axis: TimeAxis) -> None:
    figures = TimeFigures(CONSISTENCY, axis)
    figures.show(result)
    nees, nis, *innovations = (fig.title.text for fig in figures.figures)
    nis_values = result.innovations["nis"].values
    low, high = chi2.interval(0.95, 6)
    share = 100 * np.mean((nis_values >= low) & (nis_values <= high))
    assert nis.endswith(f"{share:.0f}{THIN}% in the 95 % band")
    assert "rms" not in nees
    assert all("rms " in title for title in innovations)


def test_held_results_are_drawn_beside_and_sent_once(result: Result, axis: TimeAxis) -> None:
    """In the same window, a moved slider sends the new result alone."""
    changed = result.experiment.copy()
    changed.set("navigator.r_scale", 400.0)
    other = changed.run()
    figures = TimeFigures(ERRORS, axis)
    figures.show(result)
    alone = figures.figures[0].y_range.end
    figures.show(result, [other])
    held = figures._layers[0]._sources["time"].source
    drawn = held.data["position_east"]
    assert drawn.max() == pytest.approx(other.errors["position"].values[:, 0].max(), rel=1e-6)
    assert figures.figures[0].y_range.end > alone  # σ of the held one is larger
    assert all(glyph.visible for glyph in figures._layers[0]._glyphs)
    figures.show(result, [other])
    assert held.data["position_east"] is drawn
    axis.range.update(start=20.0, end=30.0)
    figures.show(result, [other])
    assert held.data["time"].max() < 31.0
    axis.range.update(start=20.0, end=120.0)  # of more samples than a plot has pixels
    figures.show(result, [None, other])
    assert not any(glyph.visible for glyph in figures._layers[0]._glyphs)
    table = axis.samples[figures.figures[0].id]()
    inside = (result.time >= 20.0) & (result.time <= 120.0)
    assert inside.sum() > 2 * figures._buckets
    assert np.array_equal(table.index, result.time[inside])
    assert list(table) == [
        *(f"{mark}{name} [m]" for mark in ("", "B: ") for name in ("±3σ from", "±3σ to", "error"))
    ]
    for mark, one in (("", result), ("B: ", other)):
        sigma, error = one.sigma["position"].values[inside, 0], one.errors["position"].values[inside, 0]
        expected = np.stack((-3 * sigma, 3 * sigma, error), axis=-1)
        assert np.array_equal(table.filter(regex=f"^{mark}[±e]"), expected)
    axis.whole()
    figures.show(result)
    assert not any(glyph.visible for glyph in figures._layers[0]._glyphs)
    assert figures.figures[0].y_range.end == alone


@pytest.mark.parametrize("plots", [COVARIANCE + SCALE_COVARIANCE, SENSOR_ERRORS + SCALE_ERRORS, TEMPERATURE])
def test_a_held_result_may_have_fewer_states_than_the_shown_one(
    result: Result, axis: TimeAxis, plots: tuple[TimePlot, ...]
) -> None:
    made = result.experiment.copy()
    made.update({"navigator": {"states": 21}, "sensors": {"temperature": {"profile": "climb"}}})
    figures = TimeFigures(plots, axis)
    figures.show(made.run(), [result])
    assert figures._layers[0]._columns["time"]["time"].size


def test_a_held_result_may_lack_the_further_states(result: Result, axis: TimeAxis) -> None:
    made = result.experiment.copy()
    made.update({"navigator": {"states": 21, "estimate_misalignments": True, "estimate_g_sensitivity": True}})
    more = made.run()
    figures = TimeFigures(further_plots(more.blocks), axis)
    figures.show(more, [result])
    columns = figures._layers[0]._columns["time"]
    assert np.isnan(columns["gyro_misalignment_xy"]).all()


def test_values_beyond_three_sigma_are_marked_and_no_others(result: Result) -> None:
    overconfident = Experiment().update({"navigator": {"q_scale": 0.1}}).run()
    axis = TimeAxis()
    axis.span(float(result.time[-1]))
    figures, shown = TimeFigures(ERRORS, axis), overconfident
    far = np.abs(shown.errors["attitude"].values[:, 2]) > 3 * shown.sigma["attitude"].values[:, 2]
    first = float(shown.time[far][0])
    for window in ((0.0, axis.duration), (first - 0.5, first + 0.5)):
        axis.range.update(start=window[0], end=window[1])
        figures.show(shown)
        marks = (
            figures.figures[0].select_one({"type": ColumnDataSource, "name": "outside:position_east"}).data
        )
        inside = (marks["time"] >= window[0]) & (marks["time"] <= window[1])
        heading = marks["attitude_heading_outside"][inside]
        sizes = np.abs(shown.errors["attitude"].values[:, 2])
        sigma = shown.sigma["attitude"].values[:, 2]
        beyond = (sizes > 3 * sigma) & (shown.time >= window[0]) & (shown.time <= window[1])
        assert np.isin(np.abs(heading[np.isfinite(heading)]), sizes[beyond].astype(np.float32)).all()
        assert np.isfinite(heading).sum() <= 800
        if window[1] - window[0] < 2:  # each sample is drawn
            np.testing.assert_array_equal(
                marks["time"][inside & np.isfinite(marks["attitude_heading_outside"])],
                shown.time[beyond].astype(np.float32),
            )
        assert marks["time"].size > 0


def test_five_percent_beyond_an_interval_are_not_marked(result: Result, axis: TimeAxis) -> None:
    figures = TimeFigures(CONSISTENCY, axis)
    figures.show(result)
    assert {name for plot in CONSISTENCY for name in plot.outside} == {
        f"normalised_{kind}_{way}_outside"
        for kind in ("position", "velocity")
        for way in ("east", "north", "up")
    }


def test_the_figures_of_a_page_say_once_what_their_curves_are(result: Result) -> None:
    axis = TimeAxis(hover=False)
    figures = [*TimeFigures(HEIGHT, axis).figures, *TimeFigures(COVARIANCE, axis).figures]
    assert not any(tool for fig in figures for tool in fig.tools if type(tool).__name__ == "HoverTool")
    names = [{renderer.name for renderer in fig.renderers} - {None, "time cursor"} for fig in figures]
    assert names[0] == {"estimate", "truth", "GPS fixes"} and not figures[0].legend
    assert names[1] == {"error", "±3σ", "outside ±3σ"}
    assert names[3] == {"east", "north", "up"} and figures[3].legend  # only these plots have such curves
