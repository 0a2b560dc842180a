"""Observability: manoeuvres found in flights made of them, and which of them brings what, as theory says."""

from __future__ import annotations

import numpy as np
import pytest

from lab.analysis import observability as file
from lab.analysis.observability import SMOOTHING, manoeuvres, observability, observability_table
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.motion.truth.trajectory import Truth

DT = 0.05

PLAN = (
    # kind, seconds, acceleration [m/s²], turn [°/s], climb [m/s]
    ("rest", 10.0, 0.0, 0.0, 0.0),
    ("take-off run", 20.0, 2.0, 0.0, 0.0),
    ("climb", 30.0, 0.0, 0.0, 3.0),
    ("right turn", 30.0, 0.0, 3.0, 3.0),
    ("level stretch", 20.0, 0.0, 0.0, 0.0),
    ("left turn", 40.0, 0.0, -4.0, 0.0),
    ("descent", 30.0, 0.0, 0.0, -3.0),
    ("right turn", 20.0, 0.0, 6.0, 0.0),
    ("braking", 20.0, -2.0, 0.0, 0.0),
    ("rest", 15.0, 0.0, 0.0, 0.0),
)


def flown() -> Truth:
    """Return a flight that follows the plan."""
    steps = [np.tile(values, (round(seconds / DT), 1)) for _, seconds, *values in PLAN]
    rates = np.concatenate(steps)
    n = rates.shape[0]
    speed = np.maximum(np.append(0.0, np.cumsum(rates[:, 0] * DT)), 0)
    yaw = np.radians(np.append(350.0, 350 + np.cumsum(rates[:, 1] * DT)))
    climb = np.append(rates[0, 2], rates[:, 2])
    velocity = np.stack((speed * np.cos(yaw), speed * np.sin(yaw), -climb), axis=-1)
    zero = np.zeros(n + 1)
    euler = np.stack((zero, zero, (yaw + np.pi) % (2 * np.pi) - np.pi), axis=-1)
    return Truth(DT * np.arange(n + 1), zero, zero, zero, velocity, np.zeros((n + 1, 4)), euler)


def test_manoeuvres_are_those_that_were_flown() -> None:
    found = manoeuvres(flown())
    assert [stretch.kind for stretch in found] == [kind for kind, *_ in PLAN]
    edges = np.cumsum([0.0, *(seconds for _, seconds, *_ in PLAN)])
    np.testing.assert_allclose([stretch.start for stretch in found], edges[:-1], atol=SMOOTHING)
    assert found[-1].end == edges[-1]
    assert [here.end for here in found[:-1]] == [there.start for there in found[1:]]


def test_several_of_a_kind_are_counted_and_one_alone_is_not() -> None:
    names = [stretch.name for stretch in manoeuvres(flown())]
    assert [name for name in names if "turn" in name] == [
        "first right turn",
        "left turn",
        "second right turn",
    ]
    assert len(set(names)) == len(names)


def test_the_flight_of_montreal_is_told_as_its_plan_has_it() -> None:
    kinds = [stretch.kind for stretch in manoeuvres(Experiment().run().truth_arrays)]
    assert kinds[:3] == ["rest", "take-off run", "climb"]
    assert [kind for kind in kinds if "turn" in kind] == ["right turn", "right turn", "left turn"]


@pytest.fixture(scope="module")
def result() -> Result:
    return Experiment().run()


def test_reductions_telescope_and_shares_sum_to_the_whole(result: Result) -> None:
    found = observability(result)
    last = result.solution_arrays.fix_sample[-1]
    first, end = result.sigma["attitude"].values[[0, last], 2]
    total = float(found.reduction.sel(quantity="heading").sum())
    assert total == pytest.approx(np.log(first / end), rel=1e-9)
    np.testing.assert_allclose(found.share.sum("segment"), 100)
    assert np.all(found.share >= 0)


def test_fixes_only_help(result: Result) -> None:
    found = observability(result)
    assert np.all(found.sigma <= found.free * 1.02)
    np.testing.assert_allclose(found.sigma[0], found.free[0], rtol=1e-3)


def test_without_fixes_sigma_is_what_it_is_without_fixes() -> None:
    experiment = Experiment()
    experiment.set("sensors.gps.outages", [(0.0, 1000.0)])
    for name, value in (("gyro.noise_density", 1e-4), ("gyro.bias_sigma", 1e-4)):
        experiment.set(f"sensors.{name}", value)
    for name in ("position", "velocity", "attitude"):
        experiment.set(f"navigator.{name}_sigma", 1e-3)
    experiment.set("sensors.accelerometer.bias_sigma", 0.01)
    found = observability(experiment.run())
    np.testing.assert_allclose(found.sigma, found.free, rtol=0.01)
    assert float(found.free.sel(quantity="gyro bias x")[-1]) == pytest.approx(1e-4)


def test_the_heading_is_seen_while_the_velocity_turns_and_not_at_rest(result: Result) -> None:
    """Its error shows in the velocity as f × φ of the horizontal specific force (Groves, ch. 14.2.6)."""
    share = observability(result).share.sel(quantity="heading")
    kinds = np.array([stretch.kind for stretch in manoeuvres(result.truth_arrays)])
    turns = np.char.find(kinds, "turn") >= 0
    assert float(share[turns].sum()) > 80
    assert float(share[kinds == "rest"].sum()) < 1


def test_the_vertical_accelerometer_needs_no_manoeuvre(result: Result) -> None:
    """Gravity is known and the vertical velocity seen: its bias is known within a minute, others are not."""
    found = observability(result)
    known = found.sigma.sel(time=60, method="nearest") / found.sigma[0]
    assert float(known.sel(quantity="accelerometer bias z")) < 0.25
    assert float(known.sel(quantity="accelerometer bias x")) > 0.5


def test_the_table_says_it_in_words(result: Result) -> None:
    table = observability_table(observability(result)).set_index("quantity")
    assert table.loc["heading", "brought by"].endswith("% in the left turn")
    assert table.loc["gyro bias x", "unit"] == "°/s"
    assert "at rest" in table.loc["position east", "brought by"]


def test_what_lasts_too_short_belongs_to_what_was_before() -> None:
    truth = flown()
    bump = (truth.time > 100) & (truth.time < 102)
    truth.velocity_n[bump, 2] = -5.0
    assert [stretch.kind for stretch in manoeuvres(truth)] == [kind for kind, *_ in PLAN]


def test_the_slope_is_that_of_numpy() -> None:
    values = np.random.default_rng(1).normal(size=1001)
    np.testing.assert_array_equal(file._slope(values, 0.01), np.gradient(values, 0.01))
