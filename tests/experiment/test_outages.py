"""Outages over seeds, begins and sensors are those of single runs, and wrong requests are answered."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from lab import Experiment, SettingError, card
from lab.base.progress import StoppedError
from lab.experiment.ensembles import outages
from lab.experiment.ensembles.outage_blocks import Block, errors_in, plan_blocks, times_since
from lab.experiment.ensembles.outages import match_filter, perfect_filter_errors
from lab.experiment.ensembles.seed_lanes import SeedLanes
from lab.experiment.ensembles.seeds import at_fast_rate
from lab.experiment.outage_table import OutageErrors, OutageRow, OutageTable, believed_radius, fewest_values
from lab.navigation.checks import DivergedError

SECONDS = 20.0
CARDS = ("BMI088", "ADIS16470", "STIM300")
"""Cards whose filters are the same one: it is compiled once."""


def made(**settings: object) -> Experiment:
    found = Experiment(mission="los_angeles")
    found.set("trajectory.imu_rate", 50)
    for path, value in settings.items():
        found.set(path.replace("__", "."), value)
    return found


def alone(experiment: Experiment, seed: int, begin: float) -> tuple[float, float]:
    """Return horizontal and vertical error at the end of an outage, of a run by itself."""
    mine = experiment.copy()
    mine.set("seed", seed)
    mine.set("sensors.gps.outages", [(begin + 0.1, begin + SECONDS + 0.001)])
    position = mine.run().errors.position.sel(time=begin + SECONDS, method="nearest").values
    return float(np.hypot(*position[:2])), float(abs(position[2]))


@pytest.mark.parametrize("fast", [True, False])
def test_a_table_of_three_cards_is_that_of_single_runs(fast):
    table = made().outage(SECONDS, CARDS, seeds=[3, 1, 8], fast=fast)
    assert [row.name for row in table.rows] == list(CARDS)
    for row in table.rows:
        errors = row.errors
        assert errors is not None
        assert errors.seeds.tolist() == [3, 1, 8]
        assert np.array_equal(errors.begins, table.rows[0].errors.begins)
        experiment = made()
        card(row.name).load(experiment)
        experiment = at_fast_rate(experiment) if fast else experiment
        for seed, begin, horizontal, vertical in zip(
            errors.seeds.tolist(),
            errors.begins,
            errors.horizontal[:, -1],
            errors.vertical[:, -1],
            strict=True,
        ):
            assert (horizontal, vertical) == pytest.approx(alone(experiment, seed, begin), rel=1e-7)


@pytest.mark.parametrize(
    "name",
    [
        "MEMSense AccelRate3D",
        *(pytest.param(one, marks=pytest.mark.proof) for one in ("ADIS16470", "HG9900")),
    ],
)
def test_runs_abreast_are_single_runs(name):
    experiment, block, since = made(), Block(40.0, (1, 2, 5, 6)), times_since(SECONDS)
    card(name).load(experiment)
    lanes = SeedLanes.of(experiment)
    if lanes is None:
        pytest.skip(f"{name}: its filter has states that runs abreast lack")
    together, single = (errors_in(experiment, block, since, one) for one in (lanes, None))
    for mine, other in zip(together, single, strict=True):
        assert np.allclose(mine, other, rtol=1e-7)
    again = errors_in(experiment, block, since, lanes)
    assert np.array_equal(again.horizontal, together.horizontal)


def test_begins_are_spread_evenly_over_the_usable_part():
    experiment = made()
    duration = float(experiment.run().time[-1])
    blocks = plan_blocks(experiment, SECONDS, range(1, 101))
    begins = np.array([block.begin for block in blocks])
    assert [seed for block in blocks for seed in block.seeds] == list(range(1, 101))
    assert len(blocks) == 13
    assert {len(block.seeds) for block in blocks} == {7, 8}
    settled = min(30.0, 0.2 * duration)
    assert begins.min() >= settled
    assert begins.max() + SECONDS <= duration
    gaps = np.diff(np.concatenate(([settled], begins, [duration - SECONDS])))
    assert np.allclose(gaps[1:-1], gaps[1:-1].mean(), atol=1.01)
    assert gaps[[0, -1]].max() < gaps.mean()
    later = np.array([block.begin for block in plan_blocks(experiment, SECONDS, range(101, 201), turn=1)])
    assert np.abs(later[:, None] - begins).min() >= 1
    assert len(plan_blocks(experiment, SECONDS, range(20))) == 20


def test_the_last_fix_is_at_the_begin_and_none_is_used_until_the_end():
    experiment = made(sensors__gps__period=0.4, sensors__gps__latency=0.3)
    (block,) = plan_blocks(experiment, SECONDS, [4])
    since = times_since(SECONDS)
    errors = errors_in(experiment, block, since)
    solution = experiment.copy()
    solution.set("seed", 4)
    end = block.begin + SECONDS
    solution.set("sensors.gps.outages", [(block.begin + 0.2, end + 0.31)])
    result = solution.run()
    used = result.fix_validity
    assert used[used <= block.begin + 1e-9].max() == pytest.approx(block.begin - 0.3)
    assert used[used > block.begin].min() > end
    position = result.errors.position.sel(time=end, method="nearest").values
    assert errors.horizontal[0, -1] == pytest.approx(np.hypot(*position[:2]), rel=1e-7)


def test_the_number_of_threads_changes_nothing():
    one, two = (made().outage(SECONDS, "STIM300", 6, workers=workers) for workers in (1, 2))
    for mine, other in zip(one.rows[0].errors, two.rows[0].errors, strict=True):
        assert np.array_equal(mine, other)


def test_a_sensor_on_the_border_gets_more_runs_and_the_others_do_not():
    first = made().outage(SECONDS, None, 100)
    wish = first.rows[0].most.value
    more = made().outage(SECONDS, None, 100, wish)
    assert more.rows[0].runs in (200, 300, 400)
    assert len(set(more.rows[0].errors.seeds.tolist())) == more.rows[0].runs
    assert made().outage(SECONDS, None, 100, 100 * wish).rows[0].decision(100 * wish) == "pass"
    assert made().outage(SECONDS, None, 100, 0.01 * wish).rows[0].runs == 100
    assert first.rows[0].decision(0.01 * wish) == "fail"


def test_a_matched_filter_gains_nothing_from_tuning_and_a_wrong_one_does():
    table = made().outage(SECONDS, None, 100)
    assert "matched to its sensors" in table.tuning
    wrong = made(navigator__q_scale=1e-3, navigator__r_scale=30.0).outage(SECONDS, None, 100)
    row = wrong.rows[0]
    assert row.perfect.basis == "covariance"
    own = table.rows[0].most
    assert own.low < row.perfect.most < own.high
    gain = row.most.value / row.perfect.most
    assert gain > 1.3
    assert f"can gain up to a factor {gain:.2g}." in wrong.tuning
    assert row.honesty.startswith("errors")


def test_the_covariance_of_a_perfect_filter_is_the_error_budget():
    """The truth-model covariance analysis of the same outage has the same σ, within 3 %."""
    experiment = made()
    (block,) = plan_blocks(experiment, SECONDS, [2])
    errors = errors_in(experiment, block, times_since(SECONDS))
    experiment.update(
        {"seed": 2, "sensors": {"gps": {"outages": [(block.begin + 0.5, block.begin + SECONDS)]}}}
    )
    budget = experiment.run().budget
    total = budget.total.sel(time=block.begin + SECONDS, method="nearest")
    assert abs(float(total.time) - block.begin - SECONDS) < 0.03
    level = np.hypot(*total.sel(quantity=["position east", "position north"]).values)
    assert errors.sigma[0, -1] == pytest.approx(level, rel=0.03)


def test_a_perfect_filter_whose_runs_contradict_its_covariance_is_known_by_its_runs():
    ten = np.full((100, 2), 10.0)
    errors = OutageErrors(np.arange(100), np.zeros(100), ten, ten, ten, np.tile([50.0, 50.0, 0.0], (100, 1)))
    assert perfect_filter_errors(errors).basis == "covariance"
    assert perfect_filter_errors(errors._replace(horizontal=1.2 * ten)) == (12.0, "ensemble")


def test_matched_assumes_what_the_sensors_have():
    experiment = made()
    card("BMI088").load(experiment)
    as_loaded = experiment.to_dict()
    wrong = experiment.copy()
    wrong.update({"navigator": {"q_scale": 3, "gate": 0.99, "states": 15, "estimate_misalignments": False}})
    wrong.update({"navigator": {"estimate_g_sensitivity": False, "r_factors": 2.0, "latency": 0.5}})
    assert match_filter(wrong).to_dict() == as_loaded
    assert match_filter(experiment).to_dict() == as_loaded
    drifting = made(sensors__gps__correlated_sigma=2.0)
    assert match_filter(drifting).navigator.estimate_gps_drift


def test_a_run_that_diverges_counts_as_infinite(monkeypatch):
    def fail(_self, *_arguments, **_options):
        raise DivergedError("it diverged")

    monkeypatch.setattr(outages.SeedLanes, "of", staticmethod(lambda _experiment: None))
    monkeypatch.setattr(Experiment, "run", fail)
    (row,) = made(seed=77).outage(SECONDS, "BMI088", 3).rows
    assert np.isinf(row.errors.horizontal).all()
    assert row.most.value == np.inf
    assert row.decision(1e9) == "fail"
    assert row.honesty == "unknown"


def test_a_sensor_that_is_refused_says_why(monkeypatch):
    real = outages.errors_in

    def refuse(experiment, *arguments, **options):
        if experiment.navigator.states == 21:
            raise SettingError("no such filter")
        return real(experiment, *arguments, **options)

    monkeypatch.setattr(outages, "errors_in", refuse)
    table = made(seed=55).outage(SECONDS, ["MEMSense AccelRate3D", "BMI270"], 2)
    good, bad = table.rows
    assert (good.runs, bad.runs, bad.refusal) == (2, 0, "no such filter")
    assert "Does not run: no such filter" in table.cells()[1][1]
    assert table.to_dict()["rows"][1]["refusal"] == "no such filter"
    with pytest.raises(SettingError, match="no such filter"):
        made(seed=56).outage(SECONDS, "BMI270", 2)


def test_what_is_done_is_kept_when_it_is_cancelled():
    told: list[float] = []

    def note(_words: str, fraction: float) -> None:
        told.append(fraction)

    table = made(seed=31).outage(
        SECONDS, "STIM300", 12, workers=1, progress=note, cancelled=lambda: len(told) >= 2
    )
    assert 2 <= table.rows[0].runs < 12
    with pytest.raises(StoppedError, match="before the first"):
        made(seed=32).outage(SECONDS, "STIM300", 2, cancelled=lambda: True)


def test_an_exception_of_the_progress_ends_the_work():
    class NoMoreError(Exception):
        pass

    def stop(_words: str, _fraction: float) -> None:
        raise NoMoreError

    with pytest.raises(NoMoreError):
        made(seed=33).outage(SECONDS, None, 4, progress=stop)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"seconds": 0}, "seconds: 0 is not accepted; accepted is a number of 1 or more"),
        ({"seconds": float("nan")}, "seconds: nan is not accepted"),
        ({"seconds": "60"}, "seconds: '60' is not accepted"),
        ({"seconds": 1e6}, "does not fit into the flight, which lasts"),
        ({"wish": 0}, "wish: 0 is not accepted; accepted is a number above 0"),
        ({"wish": True}, "wish: True is not accepted"),
        ({"cards": []}, 'cards: none named; accepted are "all"'),
        ({"cards": "BMI0888"}, "Did you mean BMI088?"),
        ({"seeds": 0}, "seeds: 0 contains no run"),
        ({"seeds": [1.5]}, "contains what is no whole number"),
        ({"workers": 0}, "workers: 0 is no number of threads"),
    ],
)
def test_wrong_arguments_are_answered(arguments, words):
    with pytest.raises(ValueError, match=r".*") as found:
        made().outage(**arguments)
    assert words in str(found.value)


def test_a_table_is_a_frame_a_dataset_and_json():
    table = made().outage(SECONDS, ["STIM300", "BMI088"], 3, wish=5.0)
    frame = table.to_frame()
    assert frame["card"].tolist() == ["STIM300", "BMI088"]
    assert frame["grade"].tolist() == ["tactical", "consumer"]
    data = table.dataset
    assert data.horizontal.shape == (2, *table.rows[0].errors.horizontal.shape)
    assert data.horizontal.attrs["units"] == "m"
    assert float(data.since[-1]) == SECONDS
    assert float(data.horizontal_95[0, -1]) == table.rows[0].most.value
    read = json.loads(json.dumps(table.to_dict(), allow_nan=False))
    assert read["rows"][0]["to_m"] is None
    assert table.rows[0].decision(5.0) in repr(table)
    assert f"{fewest_values(0.95)} give one" in table.remarks[0]


def test_rows_with_more_runs_than_others_share_a_dataset():
    one = made().outage(SECONDS, "STIM300", 3)
    two = made().outage(SECONDS, "STIM300", 5)
    rows = (one.rows[0], replace(two.rows[0], name="more"), OutageRow("none", "", None, refusal="no"))
    both = OutageTable("m", SECONDS, None, one.since, rows)
    assert both.dataset.sizes["run"] == 5
    assert np.isnan(both.dataset.horizontal[0, 3:]).all()


def test_the_radius_of_what_a_filter_believes_is_that_of_plane_normal_errors():
    assert believed_radius(np.array([[4.0, 4.0, 0.0]]), 0.95) == pytest.approx(2 * 2.4477, rel=2e-3)
    assert believed_radius(np.array([[9.0, 1e-12, 0.0]]), 0.95) == pytest.approx(3 * 1.95996, rel=1e-2)
    rng = np.random.default_rng(1)
    P = np.array([[4.0, 1.5], [1.5, 1.0]])
    drawn = np.hypot(*rng.multivariate_normal((0, 0), P, size=200_000).T)
    assert believed_radius(np.array([[4.0, 1.0, 1.5]]), 0.95) == pytest.approx(
        np.quantile(drawn, 0.95), rel=1e-2
    )
    assert np.isnan(believed_radius(np.full((2, 3), np.nan), 0.95))


def test_honest_is_a_filter_whose_belief_is_in_the_interval():
    rng = np.random.default_rng(5)
    errors = rng.normal(size=(2, 400)) * 3.0
    shown = np.hypot(*errors)[:, None]
    covariance = np.tile([9.0, 9.0, 0.0], (400, 1))
    given = OutageErrors(np.arange(400), np.zeros(400), shown, shown, shown, covariance)
    assert OutageRow("", "", given).honesty == "yes"
    assert OutageRow("", "", given._replace(covariance=covariance / 9)).honesty.endswith("× larger")
    assert OutageRow("", "", given._replace(covariance=4 * covariance)).honesty.endswith("× smaller")
