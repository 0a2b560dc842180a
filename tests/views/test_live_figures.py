"""Live figures: what must not be drawn anew with each row."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bokeh.models.sources import ColumnDataSource

from lab.data.streams.rolling import THINNED
from lab.live.live_errors import LiveErrors
from lab.live.live_state import ALIGNING, ATTITUDE_ONLY, NAVIGATING, WAITING, LiveHistory, LiveState
from lab.views.live_figures import LiveFigures
from lab.views.rolling_figures import LiveErrorFigures


def test_no_legend_listens_to_a_stream() -> None:
    """A legend makes its elements again when anything changes that its entries reach."""
    legends = [legend for fig in LiveFigures().figures for legend in fig.legend]
    assert len(legends) == 7
    reached = {model for legend in legends for item in legend.items for model in item.references()}
    assert [one.name for one in reached if isinstance(one, ColumnDataSource) and one.name] == []


def row(time: float, angle: float) -> LiveHistory:
    """Return a row of a navigator at a time [s] whose angles are all alike [rad]."""
    return LiveHistory(
        time=np.array([time]),
        phase=np.zeros(1, np.int64),
        position=np.full((1, 3), np.nan),
        velocity_n=np.full((1, 3), time),
        euler=np.full((1, 3), angle),
        euler_sigma=np.full((1, 3), 0.1),
        bias=np.zeros((1, 6)),
        sigma=np.ones((1, 15)),
        fix_time=np.array([time]),
        innovation=np.ones((1, 6)),
        innovation_covariance=np.eye(6)[None],
        rejected=np.zeros(1, np.bool_),
    )


def test_a_turn_through_north_is_no_line_across_the_plot() -> None:
    """Rows come one by one; from 359° to 1°, the curve is interrupted."""
    figures = LiveFigures()
    for time, degrees in enumerate((358.0, 359.0, 1.0, 2.0, 3.0), 1):
        figures.add_history(row(float(time), float(np.radians(degrees))), 0.0)
    figures.show(LiveState(phase=WAITING, reason=""), 5.0)
    source = slow(figures)[1]
    np.testing.assert_allclose(source.data["heading"], [358, 359, np.nan, 2, 3], atol=1e-5)


def test_figures_that_take_turns_lose_nothing() -> None:
    figures = LiveFigures()
    state = LiveState(phase=WAITING, reason="")
    sent: list[int] = []
    for tick in range(1, 8):
        figures.add_history(row(float(tick), 0.01 * tick), 0.0)
        figures.show(state, float(tick), whole=False)
        sent.append(sum(len(source.data["time"]) for source in slow(figures)))
    # Five figures a tick with one new row each: those that wait bring theirs when it is their turn.
    assert sent[2] < 15
    assert sent[-1] > sent[3]
    figures.show(state, 7.0)
    for source in slow(figures):
        assert list(source.data["time"]) == [1, 2, 3, 4, 5, 6, 7]
        assert list(source.data["age"]) == [6, 5, 4, 3, 2, 1, 0]


def test_only_what_changes_in_the_overlay_is_painted_while_a_stream_moves() -> None:
    """A browser paints axes, titles and legends again with each change of a range or of a title."""
    figures = LiveFigures()
    unknown = LiveState(phase=WAITING, reason="")
    rows = np.zeros(2, THINNED)
    rows["time"] = 1.0, 2.0
    figures.add_samples(rows, 0.0)
    figures.show(replace(unknown, euler=np.zeros(3)), 2.0)
    still = [model for fig in figures.figures for model in (fig.x_range, fig.y_range, fig.title)]
    before = [model.properties_with_values() for model in still]
    rows["time"] = 3.0, 4.0
    figures.add_samples(rows, 0.0)
    figures.show(replace(unknown, euler=np.ones(3)), 4.0, words=False)
    assert [model.properties_with_values() for model in still] == before
    source = figures.figures[0].renderers[0].data_source
    assert list(source.data["age"]) == [3, 2, 1, 0]
    streamed = [one for fig in figures.figures for one in fig.renderers if one.data_source.name]
    assert {one.level for one in streamed} == {"overlay"}
    figures.widen(2.5)  # older rows are dropped but for one, to which the line begins
    figures.show(unknown, 4.0)
    assert list(source.data["age"]) == [3, 2, 1, 0]
    figures.widen(1.5)
    figures.show(unknown, 4.0)
    assert list(source.data["age"]) == [2, 1, 0]
    assert figures.figures[0].x_range.start == 1.5


def test_a_plot_without_values_says_so() -> None:
    """A heading that is only relative is not drawn, and its empty plot must not look broken."""
    figures = LiveFigures()
    rows = np.zeros(2, THINNED)
    rows["time"] = 1.0, 2.0
    figures.add_samples(rows, 0.0)
    figures.show(LiveState(phase=WAITING, reason=""), 2.0)
    titles = [fig.title.text for fig in figures.figures]
    assert titles[:2] == ["Angular rate [°/s]", "Specific force [m/s²]"]
    assert titles[4] == "Heading [°]: none yet"
    figures.clear()
    figures.show(LiveState(phase=WAITING, reason=""), 2.0)
    assert figures.figures[0].title.text == "Angular rate [°/s]: none yet"


@pytest.mark.parametrize("parts", [1, 300])
def test_a_curve_is_interrupted_where_nothing_was_known(parts: int) -> None:
    """A stream that broke begins again after its alignment; a page was there meanwhile, or comes later."""
    time = np.concatenate((np.arange(0, 100), np.arange(300, 500))) / 20
    axes = np.ones((len(time), 3))
    whole = LiveErrors(time, axes, axes, axes, axes, axes, axes)
    figures = LiveErrorFigures(20.0)
    for rows in np.array_split(np.arange(len(time)), parts):
        figures.add(LiveErrors(*(column[rows] for column in whole)), 0.0)
    figures.move(25.0)
    data = figures.figures[0].renderers[0].data_source.data
    known = np.isfinite(data["error"])
    assert (np.diff(data["time"]) > 0).all()
    assert np.diff(data["time"])[known[1:] & known[:-1]].max() < 0.051
    assert list(np.asarray(data["time"])[~known]) == [pytest.approx(9.975)]


def flown(seconds: float, unknown: tuple[float, float]) -> LiveHistory:
    """Return a circle of 100 m in a minute at 20 Hz; the position is unknown between two times [s]."""
    time = np.arange(1, round(20 * seconds) + 1) / 20
    angle = 2 * np.pi * time / 60
    position = np.stack((np.cos(angle), np.sin(angle), np.zeros_like(angle)), axis=-1) * (100 / 6.37e6)
    position[(time > unknown[0]) & (time < unknown[1])] = np.nan
    of_fixes = ("fix_time", "innovation", "innovation_covariance", "rejected")
    one = row(1.0, 0.0)._asdict()
    many = {name: np.repeat(value, 1 if name in of_fixes else len(time), 0) for name, value in one.items()}
    return LiveHistory(**many)._replace(time=time, position=position)


@pytest.mark.parametrize("parts", [1, 1200])
def test_the_ground_track_has_no_straight_lines_across_a_flight(parts: int) -> None:
    """A page that comes later gets all at once, others row by row; both draw the circle that was flown."""
    figures = LiveFigures()
    whole = flown(60.0, (20.0, 30.0))
    for time, position in zip(
        np.array_split(whole.time, parts), np.array_split(whole.position, parts), strict=True
    ):
        part = flown(len(time) / 20, (0.0, 0.0))._replace(time=time, position=position)
        figures.add_history(part, 0.0)
    figures.show(LiveState(phase=WAITING, reason=""), 60.0)
    data = figures.figures[8].select_one({"name": "live:track"}).data
    east, north = np.asarray(data["east"]), np.asarray(data["north"])
    steps = np.hypot(np.diff(east), np.diff(north))
    assert np.isnan(east).sum() == 1  # one interruption, of 10 s
    assert np.nanmax(steps) < 1.5 * 2 * np.pi * 100 / 60 / 10
    assert 480 < len(east) < 520


def test_titles_with_numbers_fit_above_their_plots() -> None:
    """Above a plot of 268 px, three in a row at 1440 px, are 46 characters of the title's 5.7 px."""
    figures = LiveFigures()
    figures.add_history(flown(1.0, (0.0, 0.0)), 0.0)
    for sigma, height, heading_sigma in ((0.46, 13.97, 0.1), (123.0, -12345.6, 0.1), (7.0, 999.9, 4.0)):
        state = LiveState(
            phase=WAITING,
            reason="",
            position=np.array([0.0, 0.0, height]),
            position_sigma=np.full(3, sigma),
            euler=np.radians([-179.96, -0.01, 233.33]),
            euler_sigma=np.array([0.1, 0.1, heading_sigma]),
        )
        figures.show(state, 1.0)
        titles = [figures.figures[k].title.text for k in (2, 8)]
        assert all(len(title) <= 46 and "e+" not in title for title in titles), titles
        assert ("relative" in titles[0]) == (heading_sigma > np.pi)
    assert titles == ["Roll −180.0°, pitch 0.0°, heading relative", "Ground track: σ 7 m, height 1000 m"]


def test_the_legend_of_the_ground_track_has_room_above_the_points() -> None:
    """Its text takes 25 px of the 120 px of a plot in a row of three."""
    for turn in np.radians(np.arange(0, 360, 30)):
        figures = LiveFigures()
        along = np.linspace(0, 1e-3, 50)
        position = np.stack((along * np.cos(turn), along * np.sin(turn), 0 * along), axis=-1)
        part = flown(2.5, (0.0, 0.0))
        figures.add_history(part._replace(position=position, time=np.arange(1, 51) / 10), 0.0)
        figures.show(LiveState(phase=WAITING, reason=""), 5.0)
        fig = figures.figures[8]
        north = np.asarray(fig.select_one({"name": "live:track"}).data["north"])
        low, high = fig.y_range.start, fig.y_range.end
        assert low <= north.min()
        assert north.max() <= low + 0.79 * (high - low)


def test_the_title_of_the_ground_track_says_whose_sigma_it_shows() -> None:
    """Without a position of its own, the navigator shows that of the last fix."""
    titles = {}
    for phase in (NAVIGATING, ATTITUDE_ONLY, ALIGNING):
        figures = LiveFigures()
        figures.add_history(flown(1.0, (0.0, 0.0)), 0.0)
        known = {"position": np.zeros(3), "position_sigma": np.full(3, 0.7)}
        figures.show(LiveState(phase=phase, reason="", **known), 1.0)
        titles[phase] = figures.figures[8].title.text
    assert titles[NAVIGATING] == "Ground track: σ 0.7 m, height 0 m"
    assert titles[ATTITUDE_ONLY] == titles[ALIGNING] == "Ground track: last fix, σ 0.7 m, height 0 m"


def slow(figures: LiveFigures) -> list[ColumnDataSource]:
    """Return the sources of the figures that take turns: tilt, heading, σ, velocity and innovations."""
    return [fig.renderers[0].data_source for fig in figures.figures[3:8]]
