"""The page Compare: what is added stands beside the shown result, is of its settings, and can be stopped."""

from __future__ import annotations

import re
from collections.abc import Iterator
from html import unescape
from pathlib import Path
from threading import Event
from typing import Any

import panel as pn
import pytest
from bokeh.models.annotations import Span
from panel.io.state import set_curdoc
from sensor_logs import tables, write
from walking import Walk, walking

from dashboards import ensembles
from dashboards.computing import SupersededError
from dashboards.pages import compare
from dashboards.pages.compare import OLD, Compare
from dashboards.sweep_choice import MOST_RUNS, sweepable
from lab.experiment.ensembles.comparison import models
from lab.experiment.ensembles.seeds import run_ensemble
from lab.experiment.experiment import Experiment
from lab.sensors.cards import card
from lab.views.run_comparison import RMS_HEADING, RMS_POSITION, assess
from lab.views.sweep_figure import METRICS


@pytest.fixture
def walk() -> Iterator[Walk]:
    """Return an open page with a result, on the tab Compare."""
    with pytest.MonkeyPatch.context() as patch, walking(patch) as opened:
        run(opened)
        opened.open("Compare")
        yield opened


def run(walk: Walk, **settings: object) -> None:
    walk.page.session.experiment = made(**settings)
    assert walk.run(made(**settings)).problem == ""


def made(**settings: object) -> Experiment:
    found = Experiment(mission="los_angeles")
    found.set("trajectory.imu_rate", 20)
    for path, value in settings.items():
        found.set(path.replace("__", "."), value)
    return found


def page(walk: Walk) -> Compare:
    found = walk.shown
    assert isinstance(found, Compare)
    return found


def choose(walk: Walk, name: str, on: bool = True) -> None:
    with set_curdoc(walk._document):
        page(walk)._add[name].value = on
    walk.settle()


def tick(walk: Walk, *names: str) -> None:
    for name in names:
        (box,) = [one for one in page(walk)._cards._boxes if name in one.options.values()]
        with set_curdoc(walk._document):
            box.value = [*box.value, name]
    walk.settle()


def sweep(walk: Walk, first: str, second: str = "", metric: str = METRICS[0], seeds: int = 3) -> None:
    choose(walk, "A sweep")
    choice = page(walk)._sweep.choice
    with set_curdoc(walk._document):
        choice._axes[0].setting.value, choice._axes[1].setting.value = first, second
        for axis in choice._axes:
            axis.steps.value = 3
        choice._seeds.value, choice._metric.value = seeds, metric
        page(walk)._sweep.run()
    walk.settle()


def value(walk: Walk, name: str, column: int) -> float:
    """Return a figure of a row as it is written."""
    found = page(walk)._table.object.split(f"<tr><td>{name}")[1].split("</tr>")[0]
    return float(re.findall(r"<td>(?:<b>)?([\d.e+-]+)", found)[column])


def test_alone_it_has_the_summary_and_says_how_to_compare(walk: Walk) -> None:
    assert "position east error" in walk.text()
    assert "to hold this result" in walk.text()
    assert not walk.complaints()


def test_all_error_models_stand_beside_the_shown_result(walk: Walk) -> None:
    shows, complete = page(walk), []
    draw = shows._draw_some

    def note(result: Any) -> None:
        draw(result)
        if len(shows._known) == 1 + len(models()):
            complete.append((shows._stop.visible, str(shows.words.object)))

    shows._draw_some = note  # type: ignore[method-assign]
    choose(walk, "All error models")
    assert not walk.complaints()
    cancels, words = complete[0]  # what a browser sees with the last row, before the work has ended
    assert not cancels
    assert shows.working not in words
    shown = walk.page.session.result
    for name in models():
        alone = made(navigator__model=name).run()
        assert value(walk, name, 0) == pytest.approx(assess(alone).values[RMS_POSITION], rel=6e-3)
    assert value(walk, "Now", 0) == value(walk, "phi", 0)
    assert shown.verdict.headline in unescape(page(walk)._table.object)
    choose(walk, "All error models", on=False)
    assert "invariant" not in walk.text()


def test_cards_are_loaded_as_the_chooser_loads_them_and_at_most_six(walk: Walk) -> None:
    choose(walk, "Sensor cards")
    tick(walk, "ADIS16470", "HG4930")
    alone = made()
    card("HG4930").load(alone)
    assert value(walk, "HG4930", 0) == pytest.approx(assess(alone.run()).values[RMS_POSITION], rel=6e-3)
    assert value(walk, "HG4930", 0) != value(walk, "ADIS16470", 0)
    lines = [line for box in page(walk)._cards._boxes for line in box.options]
    assert "ADIS16470 · 0.0057 °/s/√Hz · 8 °/h" in lines
    tick(walk, "BMI088", "BMI270", "VN-100", "VN-310", "STIM300")
    assert len(page(walk)._cards.chosen) == 6
    assert "STIM300" not in walk.text()
    assert "STIM300" not in [name for box in page(walk)._cards._boxes for name in box.value]


def test_rows_follow_the_settings_and_old_ones_are_marked_until_then(walk: Walk) -> None:
    choose(walk, "All error models")
    before = value(walk, "psi", 0)
    with set_curdoc(walk._document):
        page(walk)._end_outdated_work()  # as when a run begins
    assert page(walk)._table.styles == compare.PALE
    assert OLD in walk.text()
    run(walk, navigator__r_scale=0.01)
    assert value(walk, "psi", 0) != before
    assert page(walk)._table.styles == compare.PLAIN
    assert OLD not in walk.text()
    walk.page.session.experiment = made()  # whose run is refused, so the shown result is that of before
    with set_curdoc(walk._document):
        walk.page.pages._draw_again(page(walk))
    walk.settle()
    assert page(walk)._table.styles == compare.PALE
    assert OLD in walk.text()


def test_a_comparison_is_stopped_and_goes_on(walk: Walk, monkeypatch: pytest.MonkeyPatch) -> None:
    begun, go_on = Event(), Event()

    def slow(experiment: Experiment, name: str, progress: Any, _show: Any) -> Any:
        if name != "phi":
            begun.set()
            go_on.wait(60)
            progress("waits", 0.5)
        return assess(experiment.run())

    monkeypatch.setattr(compare, "_of_model", slow)
    with set_curdoc(walk._document):
        page(walk)._add["All error models"].value = True
    assert begun.wait(60)
    with set_curdoc(walk._document):
        page(walk)._stop.clicks += 1
    go_on.set()
    walk.settle()
    assert value(walk, "phi", 0) > 0  # what was done stays
    assert walk.text().count("Stopped.") == len(models()) - 1
    assert page(walk)._stop.label == "Go on"
    with set_curdoc(walk._document):
        page(walk)._report(walk.page.session.result, "1 of 4")  # it was on its way
    assert "Computing" not in walk.text()
    monkeypatch.undo()
    with set_curdoc(walk._document):
        page(walk)._stop.clicks += 1
    walk.settle()
    assert "Stopped." not in walk.text()
    assert not page(walk)._stop.visible


def test_seeds_of_the_shown_and_of_held_results_have_a_row_each(walk: Walk) -> None:
    with set_curdoc(walk._document):
        walk.page._holding.hold()
    run(walk, navigator__q_scale=0.1)
    choose(walk, "Seeds")
    assert "Navigator and filter: Q scale 1 → 0.1" in walk.text()  # what the rows differ in
    with set_curdoc(walk._document):
        page(walk)._seeds.value = 3
    walk.settle()
    assert "Mean of 3 seeds" in walk.text()
    table = page(walk)._table.object.split("Mean of 3 seeds")[1]
    assert table.count("±\u2009") > 10
    each = [assess(made(navigator__q_scale=0.1, seed=seed).run()).values[RMS_HEADING] for seed in (1, 2, 3)]
    assert f"{sum(each) / 3:.3g}" in table
    assert table.index("A · ") < table.index("Now")
    assert not walk.complaints()


def test_a_sweep_of_one_setting_is_a_curve_and_of_two_a_map(walk: Walk) -> None:
    sweep(walk, "navigator.q_scale", metric="Heading, rms", seeds=2)
    (fig,) = walk.figures()
    assert "Heading" in fig.title.text
    assert fig.xaxis[0].axis_label == "Navigator and filter: Q scale"
    drawn = fig.renderers[-1].data_source.data
    assert drawn["x"].tolist() == pytest.approx([0.1, 1.0, 10.0])
    alone = [assess(made(navigator__q_scale=0.1, seed=seed).run()).values[RMS_HEADING] for seed in (1, 2)]
    assert drawn["mean"][0] == pytest.approx((sum(one**2 for one in alone) / 2) ** 0.5)
    run(walk, navigator__q_scale=3.0)  # the sweep has this setting's own values, so it stays
    assert walk.figures()[0].renderers[-1].data_source.data["mean"].tolist() == drawn["mean"].tolist()
    run(walk, navigator__r_scale=3.0)
    assert walk.figures()[0].renderers[-1].data_source.data["mean"].tolist() != drawn["mean"].tolist()
    sweep(walk, "navigator.q_scale", "sensors.gyro.noise_density", seeds=1)
    (fig,) = walk.figures()
    assert len(fig.renderers[0].data_source.data["value"]) == 9
    assert not walk.complaints()
    choose(walk, "A sweep", on=False)
    assert walk.figures() == []


def test_a_sweep_over_a_variance_has_the_sigma_that_its_field_shows(walk: Walk) -> None:
    path = "sensors.gps.position_variance"
    run(walk, sensors__gps__position_variance=0.49)
    sweep(walk, path, seeds=1)
    axis = page(walk)._sweep.choice._axes[0]
    assert (axis.start.value, axis.end.value) == (0.07, 7.0)
    assert page(walk)._sweep.plan.values == {path: pytest.approx((0.0049, 0.49, 49.0))}
    (fig,) = walk.figures()
    assert fig.xaxis[0].axis_label == "GPS receiver: Position σ [m]"
    assert fig.renderers[-1].data_source.data["x"].tolist() == pytest.approx([0.07, 0.7, 7.0])
    assert [span.location for span in fig.center if isinstance(span, Span)] == pytest.approx([0.7])
    mean = fig.renderers[-1].data_source.data["mean"].tolist()
    with set_curdoc(walk._document):
        walk.page.session.shows_sigmas = False
    walk.settle()
    assert (axis.start.value, axis.end.value) == pytest.approx((0.0049, 49.0))
    assert "GPS receiver: Position variance" in axis.setting.options
    (fig,) = walk.figures()
    assert fig.xaxis[0].axis_label == "GPS receiver: Position variance [m²]"
    assert fig.renderers[-1].data_source.data["x"].tolist() == pytest.approx([0.0049, 0.49, 49.0])
    assert fig.renderers[-1].data_source.data["mean"].tolist() == mean
    assert not walk.complaints()


def test_a_sweep_that_cannot_be_says_why(walk: Walk) -> None:
    sweep(walk, "navigator.q_scale", "navigator.q_scale")
    assert "two different settings" in walk.text()
    sweep(walk, "navigator.q_scale", "navigator.r_scale", seeds=2 * MOST_RUNS)
    assert "accepted are up to" in walk.text()
    choice = page(walk)._sweep.choice._axes[0]
    for start, end, said in (
        (None, 1.0, "two different numbers"),
        (-1.0, 1.0, "above zero"),
        (1.0, 1e9, "Q scale"),
    ):
        with set_curdoc(walk._document):
            page(walk)._sweep.choice._axes[1].setting.value, page(walk)._sweep.choice._seeds.value = "", 1
            choice.start.value, choice.end.value = start, end
            page(walk)._sweep.run()
        walk.settle()
        assert said in walk.text()
        assert walk.figures() == []


def test_the_settings_of_a_sweep_are_numbers_that_have_an_effect() -> None:
    offered = sweepable(Experiment(), is_log=False)
    assert {"navigator.q_scale", "sensors.gyro.noise_density", "sensors.gps.period"} < set(offered)
    assert not {"seed", "navigator.model", "sensors.barometer.noise", "navigator.p0"} & set(offered)
    fitted = Experiment()
    fitted.set("sensors.barometer.fitted", True)
    assert "sensors.barometer.noise" in sweepable(fitted, is_log=False)
    assert "navigator.attitude_error" not in sweepable(Experiment(), is_log=True)


def test_every_setting_of_a_sweep_suggests_values_that_it_accepts(walk: Walk) -> None:
    choose(walk, "A sweep")
    axis = page(walk)._sweep.choice._axes[0]
    for path in sweepable(made(), is_log=False):
        axis.setting.value = path
        for number in axis.values():
            made().set(path, number)


def test_another_row_is_what_the_percent_are_relative_to(walk: Walk) -> None:
    choose(walk, "All error models")
    assert page(walk)._baseline.options == ["Now", *models()]
    with set_curdoc(walk._document):
        page(walk)._baseline.value = "invariant"
    found = page(walk)._table.object.split("<tr><td>invariant")[1].split("</tr>")[0]
    assert "%" not in found


def test_a_log_without_reference_stands_beside_a_flight(walk: Walk, tmp_path: Path) -> None:
    with set_curdoc(walk._document):
        walk.page._holding.hold()
    folder = write(tmp_path / "drive", tables(60, 90), 'title = "Drive"')
    (folder / "ref.csv").unlink()
    log = Experiment(mission=str(folder))
    walk.page.session.experiment = log.copy()
    assert walk.run(log).problem == ""
    assert "–" in walk.text()
    assert "Now: This log has no reference, so its errors are unknown" in walk.text()
    assert not walk.complaints()
    choose(walk, "Seeds")
    assert "of a sensor log would all be the same" in walk.text()
    sweep(walk, "navigator.r_scale")
    assert "unknown. This log has no reference" in walk.text()
    with set_curdoc(walk._document):
        page(walk)._sweep.choice._metric.value = METRICS[-1]
    assert len(walk.figures()) == 1
    with set_curdoc(walk._document):
        walk.page._holding.hold()
    log.set("navigator.r_scale", 4.0)
    walk.page.session.experiment = log.copy()
    assert walk.run(log).problem == ""
    assert all(name in walk.text() for name in ("A · ", "B · ", "Now"))


def test_nothing_but_known_rows_is_kept(walk: Walk) -> None:
    choose(walk, "All error models")
    for scale in (2.0, 3.0, 4.0):
        run(walk, navigator__r_scale=scale)
    assert len(page(walk)._known) == 1 + len(models())
    assert isinstance(page(walk).view, pn.Column)


def test_what_a_browser_makes_up_reads_no_file_and_runs_no_flood(walk: Walk, tmp_path: Path) -> None:
    stolen = tmp_path / "card.toml"
    stolen.write_text(card("BMI088").to_toml(), encoding="utf-8")
    choose(walk, "Sensor cards")
    with set_curdoc(walk._document):
        page(walk)._cards._boxes[0].value = [str(stolen)]
    walk.settle()
    assert page(walk)._cards.chosen == ()
    assert "BMI088" not in walk.text()
    page(walk)._seeds.param["value"].bounds = None
    page(walk)._seeds.value = 10**9
    assert page(walk)._count == compare.MOST_SEEDS
    choose(walk, "A sweep")
    choice = page(walk)._sweep.choice
    with set_curdoc(walk._document):
        for made_up in ("mission", "seed", "x.y", "navigator.own_states"):
            choice._axes[0].setting.value = made_up
            page(walk)._sweep.run()
            assert page(walk)._sweep.plan is None


def test_runs_that_another_page_gave_up_are_run_for_the_one_that_waits(
    walk: Walk, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []

    def given_up_once(*given: Any, **options: Any) -> Any:
        calls.append(given)
        if len(calls) == 1:
            raise SupersededError
        return run_ensemble(*given, **options)

    monkeypatch.setattr(ensembles, "run_ensemble", given_up_once)
    found = ensembles.ensemble(made(seed=77).run(), 2, lambda _stage, _fraction: None)
    assert len(found.seeds) == 2

    def gives_up(_stage: str, _fraction: float) -> None:
        raise SupersededError

    calls.clear()
    with pytest.raises(SupersededError):
        ensembles.ensemble(made(seed=78).run(), 2, gives_up)
