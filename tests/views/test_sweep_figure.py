"""Figures of a sweep: the curve is the mean of the runs, the map has a cell for each pair of values."""

from __future__ import annotations

import numpy as np
import pytest
from bokeh.models import ColumnDataSource, LogScale, Span

from lab.experiment.experiment import Experiment
from lab.experiment.sweep import Sweep
from lab.views.sweep_figure import METRICS, is_known, metric, sweep_figure

VALUES = [4.0, 0.25, 1.0]
PERIODS = [1.0, 2.0]


@pytest.fixture(scope="module")
def sweep() -> Sweep:
    experiment = Experiment(mission="los_angeles", seed=4)
    experiment.set("trajectory.imu_rate", 20)
    return experiment.sweep({"navigator.q_scale": VALUES, "sensors.gps.period": PERIODS}, 3)


def data(fig: object) -> dict[str, np.ndarray]:
    found = [one.data_source for one in fig.renderers if isinstance(one.data_source, ColumnDataSource)]
    return found[-1].data


@pytest.mark.parametrize("name", METRICS)
def test_a_curve_is_the_mean_of_the_runs_in_the_band_of_them(sweep: Sweep, name: str) -> None:
    one = sweep.sel(period=1.0)
    fig = sweep_figure(one, name, {"navigator.q_scale": 2.0})
    drawn = data(fig)
    assert drawn["x"].tolist() == sorted(VALUES)
    runs = metric(one.dataset, name).runs.sortby("q_scale").transpose("q_scale", "seed").values
    squared = name.endswith("rms")
    mean = np.sqrt((runs**2).mean(axis=1)) if squared else runs.mean(axis=1)
    assert drawn["mean"] == pytest.approx(mean)
    assert (drawn["low"] <= drawn["high"]).all()
    assert isinstance(fig.x_scale, LogScale)
    (mark,) = fig.select(Span)
    assert mark.location == 2.0


def test_the_figures_of_merit_are_those_of_the_run_alone(sweep: Sweep) -> None:
    alone = Experiment(mission="los_angeles", seed=5)
    alone.update({"trajectory": {"imu_rate": 20}, "navigator": {"q_scale": 4.0}})
    result = alone.run()
    at = sweep.dataset.sel(q_scale=4.0, period=1.0, seed=5)
    position = result.errors["position"].values
    assert float(metric(at, "Horizontal position, 95 %").runs) == pytest.approx(
        np.quantile(np.hypot(position[:, 0], position[:, 1]), 0.95)
    )
    assert float(metric(at, "Position, rms").runs) == pytest.approx(
        np.sqrt(np.mean(np.sum(position**2, axis=1)))
    )
    nees = float(result.consistency.nees.mean()) / 15
    assert float(metric(at, "NEES per state").runs) == pytest.approx(nees)


def test_a_map_has_a_cell_for_each_pair(sweep: Sweep) -> None:
    drawn = data(sweep_figure(sweep, "Heading, rms", {}))
    assert len(drawn["value"]) == 6
    runs = sweep.dataset.rms.sel(quantity="attitude heading")
    for x, y, value in zip(drawn["x"], drawn["y"], drawn["value"], strict=True):
        cell = runs.sel(q_scale=x, period=y).values
        assert value == pytest.approx(np.sqrt(np.mean(cell**2)))
    # The cells of a geometric row share the logarithms between its values evenly.
    assert sorted(set(drawn["left"]))[1] == pytest.approx(0.5)
    assert ((drawn["left"] < drawn["x"]) & (drawn["x"] < drawn["right"])).all()
    assert ((drawn["bottom"] < drawn["y"]) & (drawn["y"] < drawn["top"])).all()


def test_what_is_unknown_is_known_to_be(sweep: Sweep) -> None:
    assert is_known(sweep, "Position, rms")
    lost = Sweep(sweep.mission, sweep.settings, sweep.dataset.copy(deep=True))
    lost.dataset["rms"].values[...] = np.nan
    assert not is_known(lost, "Position, rms")
    assert is_known(lost, "NIS per measured value")
    holes = Sweep(sweep.mission, sweep.settings, sweep.dataset.copy(deep=True))
    holes.dataset["rms"].loc[{"q_scale": 4.0}] = np.nan
    assert data(sweep_figure(holes.sel(period=1.0), "Position, rms", {}))["x"].tolist() == [0.25, 1.0]
    sweep_figure(holes, "Position, rms", {})
