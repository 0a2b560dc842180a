"""Allan: the deviation against closed forms and allantools, the fitted terms against the known ones."""

from __future__ import annotations

import allantools
import numpy as np
import pytest
from scipy import stats

from lab.analysis import allan
from lab.analysis.allan_covariance import covariance
from lab.sensors import processes

RNG = np.random.default_rng(11)
DT = 0.02


def _white(samples: int, density: float, dt: float, rng: np.random.Generator = RNG) -> np.ndarray:
    """Return the means over each sample interval of white noise of the given density."""
    return density / np.sqrt(dt) * rng.standard_normal((samples, 3))


def _walk(samples: int, K: float, dt: float, rng: np.random.Generator = RNG) -> np.ndarray:
    """Return the means over each sample interval of a random walk, drawn with its exact covariance."""
    ends = np.cumsum(K * np.sqrt(dt) * rng.standard_normal((samples + 1, 3)), axis=0)
    return (ends[1:] + ends[:-1]) / 2 + K * np.sqrt(dt / 12) * rng.standard_normal((samples, 3))


def _flicker(samples: int, B: float, rng: np.random.Generator) -> np.ndarray:
    """Return the means over each sample interval of flicker that is drawn four times as often."""
    fine = processes.flicker(rng.standard_normal((4 * samples, 3)))
    return B * fine.reshape(samples, 4, 3).mean(axis=1)


def _quantised(samples: int, Q: float, dt: float, rng: np.random.Generator) -> np.ndarray:
    """Return the rates of which the integral has white noise of the given σ."""
    return np.diff(Q * rng.standard_normal((samples + 1, 3)), axis=0) / dt


def _ramp(samples: int, R: float, dt: float) -> np.ndarray:
    """Return a rate that grows, the axes in different directions."""
    return R * dt * np.arange(samples)[:, None] * np.array([1.0, -1.0, 1.0])


def _gauss_markov_variance(tau: np.ndarray, sigma: float, correlation_time: float) -> np.ndarray:
    """Return the Allan variance of a first-order Gauss-Markov process (IEEE 952-1997, C.1.7)."""
    r = tau / correlation_time
    return 2 * sigma**2 / r * (1 - (3 - 4 * np.exp(-r) + np.exp(-2 * r)) / (2 * r))


def test_the_deviation_is_that_of_allantools() -> None:
    record = _white(5001, 0.3, DT) + _walk(5001, 0.1, DT) + 7.0
    ours = allan.deviation(record, DT)
    for axis in range(3):
        taus, theirs, _, _ = allantools.oadev(record[:, axis], rate=1 / DT, data_type="freq", taus=ours.tau)
        assert np.allclose(taus, ours.tau, rtol=1e-12)
        assert np.allclose(ours.deviation[:, axis], theirs, rtol=1e-10, atol=0)


def test_increments_and_rates_give_the_same() -> None:
    rates = _white(3000, 0.3, DT)
    by_rate, by_increment = allan.deviation(rates, DT), allan.deviation(rates * DT, DT, increments=True)
    assert np.allclose(by_rate.deviation, by_increment.deviation, rtol=1e-12)


def test_one_axis_is_a_column() -> None:
    rates = _white(3000, 0.3, DT)
    alone = allan.deviation(rates[:, 1], DT).deviation
    assert alone.shape[1] == 1
    assert np.allclose(alone[:, 0], allan.deviation(rates, DT).deviation[:, 1], rtol=1e-12)


def _inside(found: allan.AllanDeviation, truth: np.ndarray) -> float:
    low, high = found.interval(0.95)
    return float(np.mean((low <= truth[:, None]) & (truth[:, None] <= high)))


def test_closed_forms_lie_within_the_confidence() -> None:
    """White noise N/√τ, random walk K √(τ/3) and Gauss-Markov, over 40 records of 3 axes."""
    samples, sigma, correlation_time = 6000, 0.4, 3.0
    decay = np.exp(-(DT / 20) / correlation_time)
    inside: dict[str, list[float]] = {"white": [], "walk": [], "gauss-markov": []}
    from scipy.signal import lfilter

    for seed in range(40):
        rng = np.random.default_rng(seed)
        white = allan.deviation(_white(samples, 0.3, DT, rng), DT)
        walk = allan.deviation(_walk(samples, 0.1, DT, rng), DT)
        drive = sigma * np.sqrt(1 - decay**2) * rng.standard_normal((samples * 20, 3))
        drive[0] = sigma * rng.standard_normal(3)
        fine = lfilter([1.0], [1.0, -decay], drive, axis=0)
        markov = allan.deviation(fine.reshape(samples, 20, 3).mean(axis=1), DT)
        tau = white.tau
        inside["white"].append(_inside(white, 0.3 / np.sqrt(tau)))
        inside["walk"].append(_inside(walk, 0.1 * np.sqrt(tau / 3)))
        truth = np.sqrt(_gauss_markov_variance(tau, sigma, correlation_time))
        inside["gauss-markov"].append(_inside(markov, truth))
    shares = {name: float(np.mean(values)) for name, values in inside.items()}
    print("closed forms inside the 95 % intervals:", shares)
    for share in shares.values():
        assert 0.92 < share <= 1.0


def test_the_degrees_of_freedom_are_the_fewest_of_four_noises() -> None:
    """Against allantools; its flicker without averaging is not Riley's, and not the fewest."""
    samples, lengths = 4999, np.array([1, 2, 3, 5, 10, 30, 100, 300, 600])
    for m, found in zip(lengths, allan.degrees_of_freedom(samples, lengths), strict=True):
        noises = (2, 0, -2) if m == 1 else (2, 0, -1, -2)
        assert found == pytest.approx(
            min(allantools.edf_simple(samples + 1, m, n) for n in noises), rel=1e-12
        )


def test_the_interval_is_that_of_chi_square() -> None:
    found = allan.AllanDeviation(np.ones(2), np.full((2, 1), 3.0), np.array([4.0, 50.0]), 100)
    low, high = found.interval(0.9)
    for row, degrees in enumerate((4.0, 50.0)):
        ends = stats.chi2(degrees).ppf([0.95, 0.05])
        assert np.allclose([low[row, 0], high[row, 0]], 3 * np.sqrt(degrees / ends), rtol=1e-10)


def test_the_floor_is_the_published_one() -> None:
    assert pytest.approx(0.664, abs=5e-4) == allan.FLOOR


def test_an_exact_curve_gives_back_its_terms() -> None:
    tau = np.logspace(-2, 4, 25)
    N, B, K = 0.2, 0.05, 0.003
    variance = N**2 / tau + 2 * np.log(2) / np.pi * B**2 + K**2 * tau / 3
    terms = allan.fit(allan.AllanDeviation(tau, np.sqrt(variance)[:, None], np.full(25, 100.0), 3 * 10**6))
    assert np.allclose([terms.N[0], terms.B[0], terms.K[0]], [N, B, K], rtol=1e-6)


@pytest.mark.proof
def test_fitted_terms_spread_as_their_uncertainties_say() -> None:
    """All three terms in 120 records: error over σ has the rms 1, known to 6 %, and no preferred sign."""
    true = N, B, K = 0.3, 0.1, 0.02
    scores = []
    for seed in range(40):
        rng = np.random.default_rng(1000 + seed)
        record = _white(8192, N, 1.0, rng) + _flicker(8192, B, rng) + _walk(8192, K, 1.0, rng)
        terms = allan.fit(allan.deviation(record, 1.0))
        fitted, sigmas = (
            np.stack([getattr(terms, f"{name}{of}") for name in "NBK"]) for of in ("", "_sigma")
        )
        scores.append((fitted - np.array(true)[:, None]) / sigmas)
    rms = np.sqrt(np.mean(np.square(scores), axis=(0, 2)))
    middle = np.median(scores, axis=(0, 2))
    print("N, B, K: rms", rms.round(2), "and median", middle.round(2), "of the errors in σ")
    assert np.abs(rms - 1).max() < 0.18
    assert np.abs(middle).max() < 0.3


SIZES = {"Q": 0.5, "N": 0.3, "B": 0.1, "K": 0.02, "R": 0.0005}
"""Of each term, so that in 8192 samples of a second none hides another wholly."""


def _record(terms: str, samples: int, rng: np.random.Generator) -> np.ndarray:
    """Return the rates of a sensor that has these terms."""
    kinds = {
        "Q": lambda: _quantised(samples, SIZES["Q"], 1.0, rng),
        "N": lambda: _white(samples, SIZES["N"], 1.0, rng),
        "B": lambda: _flicker(samples, SIZES["B"], rng),
        "K": lambda: _walk(samples, SIZES["K"], 1.0, rng),
        "R": lambda: _ramp(samples, SIZES["R"], 1.0),
    }
    return np.asarray(sum(kinds[letter]() for letter in terms))


@pytest.mark.proof
@pytest.mark.parametrize(
    "present", ["N", "QN", "NB", "NK", "NR", "QK", "QNB", "NBK", "QNR", "NQK", "QNBK", "NBKR", "QNBKR"]
)
def test_each_term_errs_by_its_sigma_whichever_others_are_there(present: str) -> None:
    """90 axes: the error over σ of a term that is there has the rms 1, known to 8 %, and no preferred sign.

    A ramp is the exception, on the safe side: without a random walk, which it can hardly be told from, its
    error is smaller than its σ. Terms that are absent are rarely taken for present.
    """
    scores: dict[str, list[float]] = {letter: [] for letter in SIZES}
    p_values = []
    for seed in range(30):
        rng = np.random.default_rng(3000 + seed)
        terms = allan.fit(allan.deviation(_record(present, 8192, rng), 1.0))
        p_values += list(terms.p_value)
        for letter, size in SIZES.items():
            error = getattr(terms, letter) - (size if letter in present else 0.0)
            scores[letter] += list(error / getattr(terms, f"{letter}_sigma"))
    rms = {letter: float(np.sqrt(np.mean(np.square(values)))) for letter, values in scores.items()}
    small = float(np.mean(np.less(p_values, 0.05)))
    print(
        f"{present}: rms {[f'{letter} {value:.2f}' for letter, value in rms.items()]}, p < 0.05: {small:.0%}"
    )
    for letter in SIZES:
        if letter not in present:
            assert np.mean(np.array(scores[letter]) > 2) < 0.07, letter
        elif letter == "R":
            assert 0.3 < rms[letter] < 1.25
        else:
            assert 0.75 < rms[letter] < 1.25, letter
            assert abs(np.median(scores[letter])) < 0.35, letter
    assert small < 0.13
    assert 0.2 < np.mean(np.less(p_values, 0.5)) < 0.7


def test_quantisation_of_an_angle_is_told_from_white_noise() -> None:
    """Angles rounded to a step q have noise of q/√12: found as Q, and N keeps to its σ."""
    errors = []
    step = 2.0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        angle = np.cumsum(_white(8192, 0.3, 1.0, rng), axis=0) + 0.37 * np.arange(8192)[:, None]
        terms = allan.fit(allan.deviation(np.diff(step * np.round(angle / step), axis=0), 1.0))
        assert np.allclose(terms.Q, step / np.sqrt(12), rtol=0.05)
        errors.append((terms.N - 0.3) / terms.N_sigma)
    assert np.sqrt(np.mean(np.square(errors))) < 1.3


def test_a_ramp_alone_is_exact() -> None:
    terms = allan.fit(allan.deviation(_ramp(4000, 0.01, 0.5), 0.5))
    assert np.allclose(terms.R, 0.01, rtol=1e-6)
    assert (terms.N < 1e-6).all()


def test_what_five_terms_do_not_explain_is_noticed_and_kept_close_to() -> None:
    """A bias with a correlation time, and an oscillation: of 60 axes none fits, and the curve stays close."""
    from scipy.signal import lfilter

    p_values = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        drive = 0.3 * np.sqrt(1 - np.exp(-2 / 50)) * rng.standard_normal((8192, 3))
        markov = lfilter([1.0], [1.0, -np.exp(-1 / 50)], drive, axis=0)
        wave = 0.15 * np.sin(2 * np.pi * np.arange(8192) / 60)[:, None]
        for other in (markov, wave):
            found = allan.deviation(_white(8192, 0.3, 1.0, rng) + other, 1.0)
            terms = allan.fit(found)
            p_values += list(terms.p_value)
            short = found.tau < 4
            assert np.allclose(terms.deviation(found.tau)[short], found.deviation[short], rtol=0.2)
    assert max(p_values) < 0.01
    assert np.mean(np.less(p_values, allan.FITS)) > 0.95


def test_deviations_vary_together_as_their_covariance_says() -> None:
    """Each random term alone, its squared deviations over 900 records: variances and correlations."""
    samples = 512
    lengths = allan.cluster_lengths(samples)
    W = covariance(samples, tuple(lengths.tolist()))
    kinds = (
        lambda rng: _quantised(samples, 1.0, 1.0, rng),
        lambda rng: _white(samples, 1.0, 1.0, rng),
        lambda rng: _flicker(samples, 1.0, rng),
        lambda rng: _walk(samples, 1.0, 1.0, rng),
        lambda rng: _white(samples, 1.0, 1.0, rng) + _ramp(samples, 0.05, 1.0),
    )
    for term, record in enumerate(kinds):
        rng = np.random.default_rng(term)
        squares = [allan.deviation(record(rng), 1.0).deviation.T ** 2 for _ in range(300)]
        found = np.cov(np.concatenate(squares).T)
        expected = W[term, term] if term < 4 else W[1, 1] + 0.05**2 * (W[1, 4] + W[4, 1])
        scale = np.sqrt(np.diag(expected))
        assert np.abs(np.sqrt(np.diag(found)) / scale - 1).max() < 0.2
        assert np.abs((found - expected) / np.outer(scale, scale)).max() < 0.35


def test_a_term_that_is_not_there_is_rarely_taken_for_one() -> None:
    """Of 120 records without random walk, hardly any shows one beyond twice its σ."""
    beyond = []
    for seed in range(40):
        rng = np.random.default_rng(2000 + seed)
        terms = allan.fit(allan.deviation(_white(4096, 0.3, 1.0, rng) + _flicker(4096, 0.1, rng), 1.0))
        beyond.append(terms.K / terms.K_sigma > 2)
    assert np.mean(beyond) < 0.05


def test_terms_that_are_not_there_are_within_their_uncertainty() -> None:
    terms = allan.fit(allan.deviation(_white(50_000, 0.3, DT), DT))
    assert np.allclose(terms.N, 0.3, rtol=0.02)
    assert (terms.B / terms.B_sigma).max() < 3
    assert (terms.K / terms.K_sigma).max() < 3


def test_a_silent_axis_has_no_noise() -> None:
    record = _white(2000, 0.3, DT) * (1, 0, 1) + 5
    terms = allan.fit(allan.deviation(record, DT))
    assert terms.N[1] == terms.B[1] == terms.K[1] == terms.N_sigma[1] == 0
    assert terms.chi_square[1] == terms.degrees[1] == 0
    assert terms.p_value[1] == 1
    assert np.isfinite(np.stack(terms[:-1])).all()


@pytest.mark.parametrize(
    ("record", "dt", "words"),
    [
        (np.zeros((15, 3)), 0.1, "at least 16"),
        (np.full((100, 3), np.nan), 0.1, "not a finite number"),
        (np.zeros((100, 3)), 0.0, "above zero"),
        (np.zeros((100, 3)), float("nan"), "above zero"),
    ],
)
def test_what_cannot_be_evaluated_is_refused(record: np.ndarray, dt: float, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        allan.deviation(record, dt)
