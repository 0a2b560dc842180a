"""Factors on R and Q: chosen by withheld fixes, and judged by fixes that they were not chosen by."""

from __future__ import annotations

import numpy as np
import pytest
from sensor_logs import described

from lab import Experiment
from lab.analysis.identification.assumptions import FIX, NOISE, assumed, scaled_rows, tabulate_parameters
from lab.analysis.identification.factors import FEWEST, choose, scale_noise
from lab.analysis.identification.identification import predicts_better
from lab.analysis.identification.likelihood import InnovationSeries
from lab.analysis.identification.renavigation import subject
from lab.analysis.identification.withheld import EVERY, OUTAGE, TURNS, held_out, outages
from lab.base.parameters.setting_error import SettingError
from lab.navigation.belief import belief
from lab.run.experiment_settings import ExperimentSettings


def flown(**navigator: float):
    made = Experiment(mission="los_angeles", seed=5)
    made.set("trajectory.imu_rate", 50)
    made.navigator.update(navigator)
    result = made.run()
    again = subject(result)
    turns = [
        mask
        for shift in (0.0, EVERY / TURNS / 2)
        for mask in outages(again.stamps, 10.0, again.span[1], shift)
    ]
    return result, again, turns, np.zeros(again.stamps.size, np.bool_)


@pytest.fixture(scope="module")
def wrong():
    """Return a run whose filter takes R 30 times too large."""
    return flown(r_scale=30.0)


def test_outages_are_of_ten_seconds_every_minute_and_no_fix_is_withheld_twice():
    stamps = np.arange(0.0, 300.0, 0.5)
    turns = [*outages(stamps, 30.0, 280.0), *outages(stamps, 30.0, 280.0, EVERY / TURNS / 2)]
    assert len(turns) == 2 * TURNS
    assert np.sum(turns, axis=0).max() == 1
    for mask in turns:
        withheld = stamps[mask]
        assert 30.0 <= withheld.min() <= withheld.max() <= 280.0
        begins = withheld[np.diff(withheld, prepend=-np.inf) > 1]
        np.testing.assert_array_equal(np.diff(begins), EVERY)
        assert np.all(np.isin(begins[0] + np.arange(0, OUTAGE, 0.5), withheld))


def test_a_factor_that_was_wrong_is_chosen(wrong):
    result, again, turns, dropped = wrong
    found = choose(again, result.experiment, turns, dropped)
    assert found is not None
    assert found.r <= 0.1
    assert predicts_better(found.before, found.after)
    right = scale_noise(result.experiment, 1 / 30, 1.0)
    assert found.after.position_error < 1.25 * held_out(again, right, turns, dropped).position_error
    assert found.before == held_out(again, result.experiment, turns, dropped)


def test_a_choice_is_judged_by_fixes_it_was_not_made_by(wrong):
    result, again, turns, dropped = wrong
    found = choose(again, result.experiment, turns, dropped)
    assert found is not None
    best = scale_noise(result.experiment, found.r, found.q)
    # The best of all turns, judged by the same turns, looks better than what is told.
    assert found.after.position_error >= held_out(again, best, turns, dropped).position_error


@pytest.mark.proof
def test_a_filter_that_is_right_is_left_as_it_is():
    result, again, turns, dropped = flown()
    found = choose(again, result.experiment, turns, dropped)
    assert found is None or found.after.position_error > 0.9 * found.before.position_error


def test_too_few_outages_choose_nothing(wrong):
    result, again, turns, dropped = wrong
    assert choose(again, result.experiment, turns[: FEWEST - 1], dropped) is None


class FigureWording:
    """A run of five outages, whose errors and σ for each R are given."""

    def __init__(self) -> None:
        self.stamps, self.span = np.arange(50.0), (0.0, 50.0)

    def navigate(self, experiment, withheld):
        """Return the innovations that these settings give."""
        r = experiment.navigator.r_scale if experiment.navigator.q_scale == 1.0 else 1.0
        error, sigma = {0.1: (0.8, 1.0), 0.03: (0.79, 0.6)}.get(round(r, 3), (1.0, 3.0))
        sigmas = np.full(50, sigma)
        if r < 0.05:
            sigmas[10:30] = 0.27  # far too sure in the second and third outage
        seen = InnovationSeries(np.full((50, 6), error), sigmas[:, None, None] ** 2 * np.eye(6))
        return seen, seen


def test_a_filter_that_is_too_sure_of_itself_in_some_outages_is_not_chosen_for_its_error():
    turns = [np.arange(50) // 10 == turn for turn in range(5)]
    found = choose(FigureWording(), ExperimentSettings(), turns, np.zeros(50, np.bool_))
    assert found is not None
    assert (found.r, found.q) == (0.1, 1.0)


@pytest.mark.proof
def test_a_drive_whose_r_is_wrong_is_predicted_nearly_as_well_as_can_be(recordings, tmp_path):
    result = Experiment(mission=str(described(tmp_path / "log", recordings / "comma2k19"))).run()
    found = result.identify()
    assert found.recommended
    # The best of a grid of factors on R and Q had 0.79 m, from a start where the settings had 1.62 m. A
    # latency explains a part of this minute, but predicts worse than noise does: its interval is stated only.
    assert found.after.position_error < min(0.79, 0.8 * found.before.position_error)
    assert "latency" not in found.applied
    latency = next(row for row in found.rows if row.parameter == "latency")
    assert latency.words.endswith("not changed")


def test_factors_that_leave_the_bounds_of_a_setting_are_not_tried():
    result, again, turns, dropped = flown(r_scale=1e6)
    found = choose(again, result.experiment, turns, dropped)
    assert found is not None
    assert found.r < 1
    with pytest.raises(SettingError, match="r_scale"):
        scale_noise(result.experiment, 10.0, 1.0)


def test_the_table_says_what_the_filter_assumes_then(wrong):
    result, *_ = wrong
    now = assumed(result)
    found = now._replace(noise=100.0 * now.noise, factors=0.1 * now.factors)
    rows = {row.parameter: row for row in scaled_rows(result, now, found)}
    changed = scale_noise(result.experiment, 0.1, 100.0)
    then = belief(changed.sensors, changed.navigator)
    assert rows["vertical position variance"].after == pytest.approx(then.R[2, 2])
    assert rows["gyro noise density"].after == pytest.approx(np.degrees(np.sqrt(then.noise[0])))
    assert rows["gyro noise density"].words == "chosen as a whole"
    assert rows["latency"].words == "not observable in this flight"


def test_intervals_of_logarithms_of_sigma_are_shown_as_densities_and_as_variances(wrong):
    result, *_ = wrong
    now, interval = assumed(result), (-0.7, 0.4)
    rows = tabulate_parameters(result, now, now, now, {}, {NOISE.start: interval, FIX.start: interval})
    for row, power in ((rows[NOISE.start], 1), (rows[FIX.start], 2)):
        assert (row.low, row.high) == pytest.approx(
            row.before * np.exp(power * np.array(interval)), rel=1e-12
        )
