"""Identification: simulated controls, of which the true noise, latency and lever arm are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from sensor_logs import tables, write

from lab import Experiment, ResultError
from lab.analysis.identification.assumptions import PARAMETERS, Assumed, Known, parameters
from lab.analysis.identification.identification import HeldOut, predicts_better
from lab.analysis.identification.likelihood import Estimate, InnovationSeries, maximise
from lab.analysis.identification.noise_intervals import logarithm_intervals
from lab.analysis.identification.observable import find_observable, find_refuted
from lab.analysis.identification.renavigation import subject
from lab.base.parameters.setting_error import SettingError
from lab.missions import read_sensor_log
from lab.navigation.belief import belief
from lab.navigation.log_navigation import navigate_log
from lab.sensors.cards import card, read_cards

LIMIT = 4.0
"""Errors in σ that none of a dozen estimates has by chance, of Gaussian ones 1 in 1300 runs."""


def wrong(seed: int) -> Experiment:
    """Return an experiment whose filter is wrong in all that is identified."""
    made = Experiment(mission="montreal", seed=seed)
    made.sensors.gps.latency = 0.2
    made.sensors.gps.lever_arm = (2.0, 0.0, 0.0)
    made.navigator.update({"q_scale": 0.1, "r_scale": 10.0, "latency": 0.0, "lever_arm": (0.0, 0.0, 0.0)})
    return made


@pytest.fixture(scope="module")
def control():
    made = wrong(3)
    return made, made.run().identify()


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """Return the log of an aeroplane that shakes: 0.5 m/s² at 100 Hz, gyros 0.001 rad/s."""
    log = tables(40, 190, lever_arm=(2.0, 0.0, 0.0))
    shaking = np.random.default_rng(7).normal(scale=0.5, size=(len(log.imu), 3))
    shaken = np.column_stack((log.imu[:, :4], log.imu[:, 4:] + shaking))
    return write(tmp_path_factory.mktemp("logs") / "drive", log._replace(imu=shaken))


@pytest.fixture(scope="module")
def of_the_drive(drive):
    made = Experiment(mission=str(drive))
    return made, made.run().identify()


def within(row, true: float) -> bool:
    """Return whether the true value is as near as the error bar says; that of noise in its logarithm."""
    if row.unit in {"s", "m"}:
        return abs(row.after - true) < LIMIT * row.sigma
    found, half = np.sqrt(row.low * row.high), np.log(row.high / row.low) / (2 * 1.96)
    return abs(np.log(found / true)) < LIMIT * half


@pytest.mark.proof
def test_what_the_filter_assumes_wrongly_is_found(control):
    _, found = control
    rows = {row.parameter: row for row in found.rows}
    true = {
        "gyro noise density": 0.05,
        "horizontal position variance": 0.5,
        "vertical position variance": 0.5,
        "velocity variance": 0.2,
        "latency": 0.2,
        "lever arm forward": 2.0,
        "lever arm right": 0.0,
        "lever arm down": 0.0,
    }
    for name, value in true.items():
        assert rows[name].observable, name
        assert within(rows[name], value), rows[name]
    assert rows["horizontal position variance"].before == pytest.approx(5.0)
    assert rows["gyro noise density"].before == pytest.approx(0.05 * np.sqrt(0.1))
    assert found.white
    assert found.recommended
    assert found.at_bounds == ()
    assert "neighbouring fixes share" in found.remarks[0]
    assert found.after.position_error < 0.75 * found.before.position_error
    assert 0.8 < found.after.in_sigma < 1.25
    assert found.inside[1] > 0.9
    # The accelerometers' noise is far below what fixes of 0.4 m/s show.
    assert not rows["accelerometer noise density"].observable
    assert not rows["accelerometer noise density"].applied
    assert rows["accelerometer noise density"].after == rows["accelerometer noise density"].before


def test_the_settings_change_what_the_filter_assumes_and_not_the_sensors(control):
    made, found = control
    changed = made.copy().update(found.settings())
    assert changed.sensors.to_dict() == made.sensors.to_dict()
    assumed = belief(changed.sensors, changed.navigator)
    rows = {row.parameter: row for row in found.rows}
    assert np.degrees(np.sqrt(assumed.noise[0])) == pytest.approx(rows["gyro noise density"].after, rel=1e-4)
    assert assumed.R[2, 2] == pytest.approx(rows["vertical position variance"].after, rel=1e-4)
    assert changed.run().verdict.headline != made.run().verdict.headline


@pytest.mark.proof
def test_the_noise_of_a_log_is_found(of_the_drive):
    made, found = of_the_drive
    rows = {row.parameter: row for row in found.rows}
    true = np.hypot(0.5, 0.02) / np.sqrt(100.0) / 9.80665e-6  # 100 times what is assumed
    assert within(rows["accelerometer noise density"], true)
    assert (
        rows["gyro noise density"].low < np.degrees(1e-3) / np.sqrt(100.0) < rows["gyro noise density"].high
    )
    for name in ("horizontal position variance", "vertical position variance", "velocity variance"):
        assert rows[name].unit == "× own"
        assert within(rows[name], 1.0), rows[name]
    assert within(rows["lever arm forward"], 2.0)
    assert within(rows["latency"], 0.0)
    assert found.recommended
    changed = made.copy().update(found.settings())
    assumed = belief(changed.sensors, changed.navigator)
    expected = rows["accelerometer noise density"].after * 9.80665e-6
    assert np.sqrt(assumed.noise[3:6].mean()) == pytest.approx(expected, rel=1e-4)
    assert 0.8 < found.after.in_sigma < 1.2
    assert found.inside[1] > 0.85 > found.inside[0]


@pytest.mark.proof
def test_a_card_of_a_log_can_be_loaded(of_the_drive, tmp_path):
    _, found = of_the_drive
    path = tmp_path / "own.toml"
    path.write_text(found.card("own").to_toml(), encoding="utf-8")
    (card,) = read_cards(path).values()
    told = card.terms["accelerometer"]["noise_density"].value
    assert told == pytest.approx(found.settings()["sensors"]["accelerometer"]["noise_density"], rel=1e-3)


def test_a_withheld_fix_changes_nothing_and_shows_the_error_of_the_prediction(drive):
    log, made = read_sensor_log(drive), Experiment()
    times = log.gnss.time
    withheld = (times >= 60.0) & (times <= 70.0)
    run = navigate_log(log, made.sensors, made.navigator, withheld=withheld)
    without = navigate_log(log, made.sensors, made.navigator, [(59.99, 70.01)])
    np.testing.assert_allclose(run.solution.velocity_n, without.solution.velocity_n, atol=1e-6)
    np.testing.assert_allclose(run.solution.variance, without.solution.variance, rtol=1e-5)
    rows = np.flatnonzero((run.fixes.time > 60) & (run.fixes.time < 70))
    at = np.searchsorted(run.imu.time, run.fixes.time[rows])
    expected = run.solution.position[at, 2] - run.fixes.position[rows, 2]
    np.testing.assert_allclose(-run.solution.innovation[rows, 2], expected, atol=0.05)


def test_r_factors_are_of_each_part(drive):
    made = Experiment()
    made.navigator.update({"r_scale": 2.0, "r_factors": (1.0, 3.0, 5.0)})
    R = np.diag(belief(made.sensors, made.navigator).R)
    np.testing.assert_allclose(R, [1.0, 1.0, 3.0, 2.0, 2.0, 2.0])
    run = navigate_log(read_sensor_log(drive), made.sensors, made.navigator)
    np.testing.assert_allclose(np.diag(run.belief.R[0]), [0.5, 0.5, 1.5, 0.1, 0.1, 0.1])
    with pytest.raises(SettingError, match="velocity"):
        made.set("navigator.r_factors", (1, 1, 0))


@pytest.mark.proof
def test_what_the_innovations_do_not_refute_is_left_as_it_is():
    """A Q that is too small: the advice of the verdict is taken over, and no lever arm, latency or R."""
    made = Experiment(mission="montreal", seed=1001)
    made.set("trajectory.imu_rate", 50)
    made.navigator.q_scale = 0.1
    found = made.run().identify()
    for row in found.rows:
        stays = row.observable and row.low <= row.before <= row.high
        assert not (stays and row.applied), row
        assert row.applied or row.after == row.before, row
    assert list(found.settings()) == ["navigator"]
    assert list(found.settings()["navigator"]) == ["q_scale"]
    assert found.settings()["navigator"]["q_scale"] == pytest.approx(1.0, rel=0.5)
    assert "navigator.q_scale" in found.cure
    assert made.copy().update(found.settings()).run().verdict.consistent
    # The drives of the biases are zero, so half of the choice has a scale of its own for each noise.
    (half,) = found.settings(["gyro noise density"]).values()
    assumed = belief(made.sensors, made.copy().update({"navigator": half}).navigator)
    assert np.degrees(np.sqrt(assumed.noise[0])) == pytest.approx(found.rows[0].after, rel=1e-4)
    assert np.sqrt(assumed.noise[3:6].mean()) == pytest.approx(found.rows[1].before * 9.80665e-6, rel=1e-4)
    assert found.settings([]) == {"navigator": {}}


def test_latency_and_lever_arm_that_hide_each_other_are_not_both_set_back():
    """Each interval contains zero, as both move the fixes along the track; together they do not."""
    value, covariance = np.zeros(11), np.eye(11)
    value[7], value[8] = 1.0, 1.0
    covariance[7, 8] = covariance[8, 7] = -0.98
    estimate = Estimate(
        value, np.ones(11), covariance, 0.0, InnovationSeries(np.zeros(0), np.zeros(0)), True, 1
    )
    known = {at: Known(value[at], 1.0, value[at] - 1.96, value[at] + 1.96, False) for at in range(11)}
    left = find_refuted(estimate, known, np.zeros(11))
    assert left[7:9].sum() == 1
    assert not left[:7].any()
    assert not left[9:].any()


def test_chance_changes_a_parameter_in_one_run_of_twenty():
    rng, changed = np.random.default_rng(3), 0
    for value in rng.standard_normal((400, 11)):
        estimate = Estimate(
            value, np.ones(11), np.eye(11), 0.0, InnovationSeries(np.zeros(0), np.zeros(0)), True, 1
        )
        known = {at: Known(value[at], 1.0, value[at] - 1.96, value[at] + 1.96, False) for at in range(11)}
        changed += find_refuted(estimate, known, np.zeros(11)).any()
    assert changed < 0.05 * 400 + 4 * np.sqrt(0.05 * 400)


@pytest.mark.proof
def test_noise_is_found_beside_other_sensors_and_further_states():
    """What states of the filter estimate stays with them."""
    made = Experiment(mission="los_angeles", seed=1001)
    made.set("trajectory.imu_rate", 50)
    made.sensors.barometer.fitted = True
    made.navigator.update({"estimate_lever_arm": True, "r_scale": 20.0})
    found = made.run().identify()
    rows = {row.parameter: row for row in found.rows}
    for name in ("horizontal position variance", "velocity variance"):
        assert rows[name].before == pytest.approx(20 * {"h": 0.5, "v": 0.2}[name[0]])
        assert within(rows[name], {"h": 0.5, "v": 0.2}[name[0]]), rows[name]
    assert not any(rows[f"lever arm {axis}"].observable for axis in ("forward", "right", "down"))
    assert "lever_arm" not in found.settings()["navigator"]
    assert found.recommended


@pytest.mark.proof
def test_the_least_r_is_a_tenth_of_the_receivers_own(tmp_path):
    """Fixes that share nearly all of their errors look as good as they differ from one to the next."""
    log = tables(40, 130)
    log.gnss[:, 7:10] = 8.0  # [m], where neighbouring fixes differ by 0.5 m
    found = Experiment(mission=str(write(tmp_path / "log", log))).run().identify()
    rows = {row.parameter: row for row in found.rows}
    for name in ("horizontal position variance", "vertical position variance"):
        assert rows[name].after == pytest.approx(0.1, rel=1e-6)
        assert name in found.at_bounds
    assert any("At a bound: horizontal position variance" in remark for remark in found.remarks)


@pytest.mark.parametrize("seed", [1001, 1017, 1023, 1024, 1026])
def test_a_few_outages_do_not_refute_what_explains_all_innovations(seed):
    """A flight of two minutes has five outages, in which the wrong noise, and not the true one, had luck."""
    made = Experiment(mission="los_angeles", seed=seed)
    loaded = Experiment(mission="los_angeles")
    card("BMI088").load(loaded)
    for own, given in zip(_triads(made), _triads(loaded), strict=True):
        own.update({term: given.get(term) for term in ("noise_density", "bias_sigma")})
    r = 0.1 if seed % 2 else 10.0
    made.update({"trajectory": {"imu_rate": 50.0}, "navigator": {"r_scale": r}})
    made.navigator.q_scale = 10.0 if seed % 4 < 2 else 0.1
    found = made.run().identify()
    assert found.white and found.recommended
    for row in found.rows[4:7]:
        assert row.observable and within(row, row.before / r)


@pytest.mark.parametrize(
    ("after", "grown"),
    [
        ((1.0, 4.0, 9.0, 16.0, 40.0), False),  # one outage of five
        ((2.0, 5.5, 10.4, 17.8, 26.3), True),  # each by as much
        ((1.3, 4.0, 9.0, 16.0, 24.0), False),
    ],
)
def test_an_error_grows_if_the_outages_agree(after, grown):
    """A paired t-test; without white innovations, the limit is that of 5 % for all alike."""
    before = HeldOut(50, 3.3, 1.0, 1.0, -2.0, (1.0, 4.0, 9.0, 16.0, 25.0))
    held = HeldOut(50, float(np.sqrt(np.mean(after))), 1.0, 1.0, -1.0, after)
    differences = np.subtract(after, before.by_outage)
    assert (stats.ttest_1samp(differences, 0.0, alternative="greater").pvalue < 0.05) == grown
    assert predicts_better(before, held, white=True) is not grown
    assert not predicts_better(before, held._replace(log_likelihood=-3.0), white=True)
    assert predicts_better(before, held) == (held.position_error <= 1.05 * before.position_error)


def _triads(one: Experiment):
    return one.sensors.gyro, one.sensors.accelerometer


def test_too_few_fixes_are_refused():
    made = Experiment(mission="montreal")
    made.sensors.gps.outages = [(40, 200)]
    with pytest.raises(ResultError, match="at least 20"):
        made.run().identify()


def test_a_run_navigated_anew_after_an_alignment_is_that_run():
    """What an alignment left is in P0, and in how fast the filter lets its biases fade."""
    made = Experiment(mission="montreal", seed=2)
    made.update({"sensors": {"gyro": {"instability": 0.05}}, "navigator": {"alignment": 30.0}})
    result = made.run()
    again = subject(result)
    seen, _ = again.navigate(made, np.zeros(again.stamps.size, bool))
    np.testing.assert_allclose(seen.innovation, result.solution_arrays.innovation, rtol=1e-9, atol=1e-12)


def test_another_lever_arm_shifts_the_start(drive):
    run, arm = Experiment(mission=str(drive)).run(), np.array([2.0, -1.0, 0.5])
    changed = run.experiment.copy().update({"navigator": {"lever_arm": arm.tolist()}})
    anew = navigate_log(run.recorded.log, changed.sensors, changed.navigator).alignment.start
    shifted = run.recorded.alignment.with_longer_arm(arm - run.own_lever_arm).start
    np.testing.assert_allclose(shifted.position, anew.position, rtol=1e-14)
    np.testing.assert_allclose(shifted.velocity_n, anew.velocity_n, rtol=1e-9)
    assert np.linalg.norm(shifted.velocity_n - run.recorded.alignment.start.velocity_n) > 1e-4


class Sum:
    """A search for two noises of which the innovations show the sum alone."""

    masks = ()

    def __init__(self, variance: float) -> None:
        self.innovation = np.random.default_rng(3).normal(size=(400, 6)) * np.sqrt(variance)

    def run(self, by):
        """Return the innovations if the filter assumes some noises."""
        total = 0.01 + np.exp(2 * by[0]) + np.exp(2 * by[1])
        return InnovationSeries(self.innovation, np.tile(total * np.eye(6), (400, 1, 1)))


def test_the_upper_end_of_a_noise_is_where_it_stands_for_all_others():
    """Ln σ of 2,400 values has the standard deviation 1/√4800."""
    search = Sum(2.0)
    whole = parameters(Assumed(np.ones(12), np.ones(3), 0.0, np.zeros(3)), np.full(3, 0.1))
    held = np.arange(PARAMETERS) > 1
    search.held = held
    joint = maximise(search.run, whole, np.zeros(PARAMETERS), held)
    beside = np.log(np.sqrt(0.5))  # as far as the other noise of 1.5 leaves it
    known = {0: Known(beside, 0.1, beside - 0.2, beside + 0.2, bounded=True)}
    low, high = logarithm_intervals(search, whole, joint, np.zeros(4), known)[0]
    highest = np.log(np.sqrt(np.mean(search.innovation**2) - 0.01)) + 1.96 / np.sqrt(4800)
    assert high == pytest.approx(highest, abs=0.004)
    assert low == -np.inf


def test_a_noise_for_which_another_can_stand_is_not_observable():
    """Each is surely not zero beside the other as estimated, but the innovations show their sum alone."""
    search = Sum(2.0)
    search.held = np.arange(PARAMETERS) > 1
    whole = parameters(Assumed(np.ones(12), np.ones(3), 0.0, np.zeros(3)), np.full(3, 0.1))
    joint = maximise(search.run, whole, np.zeros(PARAMETERS), search.held)
    sure = replace(joint, sigma=np.where(search.held, 0.0, 0.1))
    nothing = np.zeros(PARAMETERS, bool)
    _, shown, bounded, _ = find_observable(search, whole, sure, nothing, lambda *_: None, 0.5)
    assert not shown[:2].any()
    assert not bounded[:2].any()
