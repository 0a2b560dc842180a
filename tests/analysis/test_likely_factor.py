"""Likely factor: the interpolated likelihood against closed forms, and the verdict's R over seeds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from lab import Experiment
from lab.analysis.verdicts.likely_factor import LOSS, likely_factor
from lab.analysis.verdicts.trial import apply_changes
from lab.base.numbers import format_number
from lab.experiment.result import Result

TRIED = 10.0 ** np.arange(-2, 3.5, 0.5)
R = (0.5, 0.5, 0.5, 0.2, 0.2, 0.2)
"""R of the simulated receiver [m²], [(m/s)²]."""
SEEDS = range(1001, 1009)


def gain(factor: np.ndarray, square: float, n: int, other: float = 0.0) -> np.ndarray:
    """Return the log-likelihood of n values with a mean square, whose variance is other + factor."""
    return (
        -n / 2 * (np.log((other + factor) / (other + 1)) + square / (other + factor) - square / (other + 1))
    )


@pytest.mark.parametrize("factor", [0.154, 0.5, 2.04, 4.6, 6.5, 300.0])
@pytest.mark.parametrize("n", [60, 2000])
def test_of_gaussian_values_the_mean_square_is_the_most_likely_factor(factor: float, n: int) -> None:
    found = likely_factor(TRIED, gain(TRIED, factor, n))
    assert found.factor == pytest.approx(factor, rel=2e-3)
    best = float(gain(np.array(factor), factor, n))
    ends = [
        brentq(lambda f: float(gain(np.array(f), factor, n)) - best + LOSS, *between)
        for between in ((factor / 3, factor), (factor, 3 * factor))
    ]
    np.testing.assert_allclose((found.low, found.high), ends, rtol=5e-3)
    assert found.gain == pytest.approx(best, rel=1e-3)


@pytest.mark.parametrize("factor", [0.154, 0.5, 2.04, 4.6, 6.5])
@pytest.mark.parametrize("other", [0.1, 0.3, 1.0])
def test_other_noise_in_the_values_shifts_the_most_likely_factor_by_less_than_its_sigma(
    factor: float, other: float
) -> None:
    n = 600
    found = likely_factor(TRIED, gain(TRIED, other + factor, n, other))
    sigma = np.sqrt(2 / n) * (other + factor) / factor
    assert abs(np.log(found.factor / factor)) < 0.7 * sigma


def test_what_lies_beyond_the_tried_factors_has_an_open_interval() -> None:
    above = likely_factor(TRIED, gain(TRIED, 1e5, 600))
    assert (above.factor, above.high) == (pytest.approx(1e3), np.inf)
    below = likely_factor(TRIED, gain(TRIED, 1e-4, 600))
    assert (below.factor, below.low) == (pytest.approx(1e-2), 0.0)


def test_factors_without_a_likelihood_are_left_out() -> None:
    gains = np.append(gain(TRIED, 4.6, 600), -np.inf)
    assert likely_factor(np.append(TRIED, 1e4), gains) == likely_factor(TRIED, gains[:-1])


def flown(seed: int, ratios: tuple[float, ...]) -> Result:
    """Return a run whose filter assumes variances of the fixes that are too small by some ratios."""
    made = Experiment(mission="los_angeles", seed=seed)
    made.set("trajectory.imu_rate", 50)
    made.navigator.r = (np.array(R) / ratios).tolist()
    return made.run()


@pytest.mark.proof
@pytest.mark.parametrize(
    ("quantity", "factor", "ratios"),
    [
        ("R position", 4.6, (4.6, 4.6, 4.6, 1.0, 1.0, 1.0)),
        ("R position", 0.22, (0.22, 0.22, 0.22, 1.0, 1.0, 1.0)),
        ("R", 6.5, (6.5,) * 6),
        ("R position down", 6.5, (1.0, 1.0, 6.5, 1.0, 1.0, 1.0)),
    ],
)
def test_innovations_state_r_as_precisely_as_they_know_it(
    quantity: str, factor: float, ratios: tuple[float, ...]
) -> None:
    """In its own interval as often as it says, and right for another flight when it is followed."""
    results = [flown(seed, ratios) for seed in SEEDS]
    findings = [result.innovation_verdict.findings[0] for result in results]
    assert {finding.quantity for finding in findings} == {quantity}
    inside = 0
    for finding in findings:
        assert finding.interval is not None
        low, high = finding.interval
        true = factor if finding.direction == "too small" else 1 / factor
        inside += low <= true <= high
        # A half-width of 1.96 σ: one of them beyond 4 σ is no chance.
        assert abs(np.log(finding.factor / true)) < 4 / 1.96 * np.log(high / low) / 2
        assert f"about {format_number(finding.factor)} times too" in finding.sentence
    # Of eight, chance leaves out four or more of 95 % intervals one time in 2,700.
    assert inside >= len(findings) - 3
    other = results[-1].repeated(apply_changes(results[-1], findings[0].changes))
    assert 0.8 < float(other.evidence.innovations.nis.mean) < 1.2
