"""Budget, observability, feedforward and smoother over a pole, and alike in both frames elsewhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from polar_flights import FLIGHTS, over_the_pole

from lab.analysis import feedforward
from lab.analysis.budget import error_budget
from lab.analysis.consistency import chi_square_interval
from lab.analysis.observability import observability
from lab.analysis.verdicts import limits
from lab.analysis.verdicts.trial import apply_changes
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.experiment.stages import CACHE
from lab.motion.recordings.flight_csv import write_flight_csv

WANDER = {"navigator.mechanization": "wander azimuth"}
LINEAR = {
    "sensors.gyro.noise_density": 0.0005,
    "sensors.gyro.bias_sigma": 0.001,
    "sensors.accelerometer.noise_density": [0.35, 0.65, 0.35],
    "sensors.accelerometer.bias_sigma": 0.02,
    "sensors.gps.position_variance": 0.00005,
    "sensors.gps.velocity_variance": 0.00002,
    "navigator.position_sigma": 0.01,
    "navigator.velocity_sigma": 0.003,
    "navigator.attitude_sigma": [0.005, 0.005, 0.02],
}
"""The default sensors, a hundred times better, so that the filter is linear."""


def run(mission: str, seed: int = 1, **more: object) -> Result:
    """Return a run at 50 Hz; settings by path, their dots as double underscores."""
    experiment = Experiment(mission=mission, seed=seed)
    settings = {name.replace("__", "."): value for name, value in more.items()}
    for name, value in ({"trajectory.imu_rate": 50.0} | settings).items():
        experiment.set(name, value)
    return experiment.run()


def polar(tmp_path: Path, name: str, duration: float = 60.0) -> str:
    """Return the path of one of the `FLIGHTS`."""
    path = tmp_path / "pole.csv"
    write_flight_csv(path, over_the_pole(**FLIGHTS[name], duration=duration))
    return str(path)


@pytest.mark.proof
@pytest.mark.parametrize("name", ["straight over the north pole", "in a curve by the south pole"])
def test_over_a_pole_all_sources_sum_to_the_covariance_of_a_matched_filter(tmp_path: Path, name: str) -> None:
    """In the north axes of the filter, in which σ of heading and velocity grows close to the pole."""
    found = error_budget(run(polar(tmp_path, name), **WANDER, **LINEAR))
    ratio = found.total / found.believed
    heading = found.total.sel(quantity="heading")
    low, high = float(ratio.min()), float(ratio.max())
    print(f"\n{name}: {low:.4f} to {high:.4f}, σ of the heading up to {float(heading.max()):.3g}°")
    # North at the estimate is not north at the true place: a centimetre, a metre from the pole.
    np.testing.assert_allclose(ratio, 1, atol=1e-2)


@pytest.mark.proof
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("more", [{}, {"sensors.odometer.fitted": True, "sensors.barometer.fitted": True}])
@pytest.mark.parametrize("pole", ["north", "south"])
def test_headings_over_a_pole_do_not_mislead_the_budget(
    tmp_path: Path, pole: str, more: dict[str, bool], seed: int
) -> None:
    """They are measured from the north before the fix of the same sample; by the other, σ is 80 × larger.

    So it is with other measurements of that sample, each of which moves the navigator before the next.
    """
    good = {"sensors.gyro.noise_density": 0.005, "sensors.gyro.bias_sigma": 0.01}
    settings = good | more | {"sensors.heading.fitted": True, "navigator.attitude_sigma": (0.3, 0.3, 0.5)}
    flown = run(polar(tmp_path, f"straight over the {pole} pole"), seed, **settings)
    assert flown.solution_arrays.aid_sample.max() > 0
    found = error_budget(flown)
    ratio = (found.total / found.believed).isel(time=slice(5, None))
    # At the pole, it may be small: the filter takes the curvature of the meridians for noise.
    assert float(ratio.max()) < 1.2
    assert float(ratio[-1].min()) > 0.9


def test_elsewhere_both_frames_have_the_same_budget_and_observability() -> None:
    one, other = (run("los_angeles", **more) for more in ({}, WANDER))
    for analysis, names in ((error_budget, ("total", "sigma")), (observability, ("sigma", "free"))):
        a, b = analysis(one), analysis(other)
        for name in names:
            scale = a[name].max("time")
            assert float((np.abs(b[name] - a[name]) / scale.where(scale > 0)).max()) < 1e-3


def test_over_a_pole_fixes_only_help(tmp_path: Path) -> None:
    found = observability(run(polar(tmp_path, "past the north pole at 40 m"), **WANDER, **LINEAR))
    assert np.isfinite(found.free).all()
    assert (found.sigma <= found.free * 1.02).all()


def test_the_drift_of_a_free_navigator_is_no_turn_of_north(tmp_path: Path) -> None:
    """Free and corrected navigator are metres apart, and north at the pole differs by many degrees there."""
    settings = WANDER | LINEAR | {"navigator.correction": "feedforward"}
    flown = run(polar(tmp_path, "straight over the north pole"), **settings)
    assert 0 < feedforward.largest_attitude_drift(flown) < np.radians(0.2)
    assert np.isfinite(error_budget(flown).total).all()


SEEDS = 20


@pytest.mark.proof
def test_a_small_drift_is_the_cause_where_no_other_explains_the_errors(tmp_path: Path) -> None:
    """With quiet gyros, less than a degree makes NEES 3 × too large; feedback is right."""
    quiet = {
        "sensors.gyro.noise_density": 0.002,
        "sensors.gyro.bias_sigma": 0.001,
        "sensors.accelerometer.bias_sigma": 0.2,
    }
    mission = polar(tmp_path, "straight over the north pole", duration=160.0)
    for seed in (11, 12, 15):
        free = run(mission, seed, **WANDER, **quiet, navigator__correction="feedforward")
        assert free.free_run.drift < limits.VERDICT.free_attitude
        (finding,) = free.verdict.findings
        assert finding.quantity == "feedforward"
        followed = free.repeated(apply_changes(free, finding.changes))
        assert isinstance(followed, Result)
        assert followed.verdict.consistent


def test_a_smoother_over_a_pole_tells_the_truth_about_itself(tmp_path: Path) -> None:
    path = polar(tmp_path, "straight over the north pole", 90.0)
    # With the default gyros, the heading of this straight flight is beyond a linear filter at any latitude.
    gyros = {"sensors.gyro.noise_density": 0.005, "sensors.gyro.bias_sigma": 0.01}
    settings = WANDER | gyros | {"sensors.accelerometer.bias_sigma": 0.2, "navigator.smoother": True}
    nees = np.mean(
        [run(path, seed, **settings).consistency.nees.values for seed in range(1, SEEDS + 1)], axis=0
    )
    CACHE.clear()
    low, high = chi_square_interval(15, SEEDS)
    inside = float(np.mean((low < nees) & (nees < high)))
    print(f"\nsmoothed NEES over the pole: {nees.mean() / 15:.2f} per state, inside at {100 * inside:.0f} %")
    # A flight smoothed is about two independent epochs.
    low, high = chi_square_interval(15, 2 * SEEDS, 0.999)
    assert low < nees.mean() < high
