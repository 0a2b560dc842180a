"""The figures and the words of the budget page: what they are sent, and what they say of a refusal."""

from __future__ import annotations

import numpy as np
import pytest
from bokeh.models import ColumnDataSource

from dashboards.pages.budget import Budget, sentence
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.views.budget import FAMILIES, SLOTS, BudgetFigures
from lab.views.figures import TimeAxis


@pytest.fixture
def axis(result: Result) -> TimeAxis:
    axis = TimeAxis()
    axis.span(float(result.time[-1]))
    return axis


def test_the_stack_ends_at_the_whole_and_each_layer_is_a_source(result: Result, axis: TimeAxis) -> None:
    figures = BudgetFigures(axis)
    figures.show(result.budget, result.observability, "heading")
    data = figures.figures[0].select_one({"type": ColumnDataSource, "name": "budget:shares"}).data
    shares = result.budget.share.sel(quantity="heading")
    for slot in range(shares.sizes["source"]):
        np.testing.assert_allclose(data[f"edge_{slot + 1}"] - data[f"edge_{slot}"], shares[slot], atol=1e-9)
    np.testing.assert_allclose(data[f"edge_{SLOTS}"], 100)
    assert all(fig.x_range is axis.range for fig in figures.figures)


def test_the_legend_names_what_counts(result: Result, axis: TimeAxis) -> None:
    figures = BudgetFigures(axis)
    figures.show(result.budget, result.observability, "position east")
    named = [item.label.value for item in figures._items if item.visible]
    assert "GPS position noise" in named
    assert "accelerometer white noise" not in named
    assert (
        float(result.budget.share.sel(quantity="position east", source="accelerometer white noise").max()) < 1
    )


@pytest.mark.proof
def test_every_source_that_can_be_set_has_a_family_of_colours() -> None:
    experiment = Experiment(mission="los_angeles")
    for sensor in ("gyro", "accelerometer"):
        for term in (
            "bias",
            "instability",
            "flicker",
            "rate_random_walk",
            "scale_factor",
            "scale_factor_sigma",
            "quantisation",
            "bias_temperature",
            "scale_temperature",
        ):
            experiment.set(f"sensors.{sensor}.{term}", 0.01)
        experiment.set(f"sensors.{sensor}.bandwidth", 10)
        experiment.set(f"sensors.{sensor}.range", 1)
        experiment.set(f"sensors.{sensor}.misalignment", 0.01)
    experiment.set("sensors.gyro.g_sensitivity", 0.01)
    experiment.set("sensors.accelerometer.vibration_density", 10)
    experiment.set("sensors.gps.correlated_sigma", 1.0)
    experiment.set("sensors.gps.latency", 0.1)
    experiment.set("sensors.gps.lever_arm", 1.0)
    experiment.set("navigator.latency", 0.0)
    experiment.set("navigator.lever_arm", 0.0)
    experiment.set("sensors.gps.outlier_rate", 0.1)
    for state in ("position", "velocity", "attitude"):
        experiment.set(f"navigator.{state}_error", 0.1)
    for sensor in ("barometer", "heading", "odometer", "airspeed"):
        experiment.set(f"sensors.{sensor}.fitted", True)
    experiment.set("sensors.heading.drift_sigma", 1.0)
    experiment.set("sensors.heading.source", "magnetometer")
    experiment.set("sensors.heading.declination", 0.0)
    experiment.set("navigator.no_slip", True)
    experiment.set("sensors.temperature.profile", "warm_up")
    sources = experiment.run().budget.source.values.tolist()
    experiment.set("sensors.temperature.compensation", True)
    experiment.set("sensors.temperature.thermometer_sigma", 0.1)
    sources += [source for source in experiment.run().budget.source.values if source not in sources]
    assert len(sources) == 6 + 2 * 14 + 1 + 2 + 1 + 6 + (3 + 4 + 2 + 4 + 1)
    assert len(sources) <= SLOTS
    for family, colours in FAMILIES.items():
        inside = [source for source in sources if source.partition(" ")[0] == family]
        assert 0 < len(inside) <= len(colours)


def test_sigma_has_ticks_at_both_ends_of_its_range(result: Result, axis: TimeAxis) -> None:
    figures = BudgetFigures(axis)
    for quantity in result.budget.quantity.values:
        figures.show(result.budget, result.observability, str(quantity))
        fig = figures.figures[1]
        ticks = np.array(fig.yaxis[0].ticker.ticks)
        assert 2 <= ticks.size <= 12
        assert fig.y_range.start <= ticks[0] <= 10 * fig.y_range.start
        assert fig.y_range.end / 10 <= ticks[-1] <= fig.y_range.end


def test_the_sentence_says_where_the_errors_come_from(result: Result) -> None:
    words = sentence(result, "heading")
    assert "gyro white noise" in words
    assert "in the first right turn" in words
    assert "°" in words


def silent(_stage: str, _fraction: float) -> None:
    """Take progress."""


def test_a_page_tells_why_there_is_no_budget(axis: TimeAxis) -> None:
    experiment = Experiment(mission="los_angeles")
    experiment.set("navigator.model", "nonlinear")
    page = Budget(axis)
    refused = experiment.run()
    assert "linear model" in page._attempt(refused, silent).problem


def test_a_page_draws_the_quantity_that_is_chosen(result: Result, axis: TimeAxis) -> None:
    page = Budget(axis)
    page._paint(result, page._attempt(result, silent).result)
    assert "σ of the heading" in page.words.object
    page._choice.value = "roll"
    assert "σ of the roll" in page.words.object
