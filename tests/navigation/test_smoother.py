"""The smoother: against one least-squares adjustment of a whole short flight, and over seeds."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
import pytest
from flown import fly
from motions import NO_FIXES
from numpy.typing import NDArray

from lab import earth
from lab.analysis.consistency import chi_square_interval, normalised_squares
from lab.analysis.errors import attitude_error, error_state
from lab.experiment import CACHE, Experiment
from lab.navigation import strapdown
from lab.navigation.error_models import PHI, with_states
from lab.navigation.navigator import navigate
from lab.navigation.smoother import smooth
from lab.navigation.solution import Belief, Fixes, Imu, Schedule, Solution, Start
from lab.result import Result
from lab.rotation import wrap

FloatArray = NDArray[np.float64]

SEEDS = 100


def apart(one: Solution, other: Solution) -> FloatArray:
    """Return one minus the other, all states."""
    sine = np.sin(other.position[:, 0])
    meridian, transverse = earth.radii(sine)
    difference = one.position - other.position
    north = difference[:, 0] * (meridian + other.position[:, 2])
    east = wrap(difference[:, 1]) * (transverse + other.position[:, 2]) * np.sqrt(1 - sine**2)
    return np.concatenate(
        (
            np.stack((north, east, -difference[:, 2]), axis=-1),
            one.velocity_n - other.velocity_n,
            attitude_error(one.q_nb, other.q_nb),
            one.bias - other.bias,
            one.scale - other.scale,
        ),
        axis=1,
    )


def short_flight(
    bias_decay: float = 0.0, rate: int = 20, states: int = 15
) -> tuple[Imu, Fixes, Start, Belief]:
    """Return three seconds of a turn, small errors, a fix each 0.4 s and once two after the same sample."""
    flight, rng = fly("los_angeles", float(rate)), np.random.default_rng(8)
    part = slice(40 * rate, 43 * rate)
    time = flight.imu.time[40 * rate : 43 * rate + 1]
    imu = Imu(time, flight.imu.dtheta[part] + 2e-5 / rate, flight.imu.dvelocity[part] - 2e-4 / rate)
    spacing = rate * 2 // 5
    times = np.sort(np.r_[time[spacing::spacing], time[2 * spacing] - 1e-9])
    true = flight.trajectory.at(times)
    position = np.stack((true.latitude, true.longitude, true.height), axis=-1)
    fixes = Fixes(
        times,
        position + rng.normal(size=(times.size, 3)) * (1e-10, 1e-10, 1e-3),
        true.velocity_n + rng.normal(0, 1e-4, (times.size, 3)),
    )
    belief = Belief(
        # Small scale factors: F along the free navigator, with none, is that along the smoothed one.
        P0=np.diag(np.repeat([1e-6, 1e-8, 1e-10, 1e-10, 1e-8, 1e-10, 1e-10], 3)[:states]),
        R=np.diag(np.repeat([1e-6, 1e-8], 3)),
        noise=np.repeat([1e-12, 1e-9, 1e-13, 1e-10], 3),
        bias_decay=np.repeat([1.0, 2.0], 3) * bias_decay,
    )
    begin = Start.off(flight.trajectory.at(time[:1]), *rng.normal(size=(3, 3)) * ((1e-3,), (1e-4,), (1e-5,)))
    return imu, fixes, begin, belief


def adjusted(imu: Imu, fixes: Fixes, free: Solution, belief: Belief) -> tuple[FloatArray, FloatArray]:
    """Return the errors (n, states) of a free navigator and their variances, of all fixes at once.

    The errors of all samples are one normal vector; given the fixes it is normal again, with the mean that
    least squares over all initial errors, noises and fixes has.
    """
    n, states = imu.time.size, free.states
    joint = np.zeros((n, states, n, states))
    joint[0, :, 0] = belief.P0
    state, F = np.zeros(strapdown.LENGTH), np.zeros((states, states))
    for k, dt in enumerate(np.diff(imu.time)):
        strapdown.set_position(state, *free.position[k])
        state[strapdown.VELOCITY : strapdown.VELOCITY + 3] = free.velocity_n[k]
        state[strapdown.Q_NB : strapdown.Q_NB + 4] = free.q_nb[k]
        strapdown.step(state, tuple(imu.dtheta[k]), tuple(imu.dvelocity[k]), dt)
        with_states(PHI, states).write(state, F)
        fading = np.r_[np.zeros(9), belief.bias_decay, np.zeros(states - 15)]
        Phi = np.eye(states) + dt * F - dt * np.diag(fading)
        C_nb = state[strapdown.C_NB : strapdown.C_NB + 9].reshape(3, 3)
        Q = np.zeros((states, states))
        Q[6:9, 6:9] = C_nb @ np.diag(belief.noise[:3]) @ C_nb.T
        Q[3:6, 3:6] = C_nb @ np.diag(belief.noise[3:6]) @ C_nb.T
        Q[9:15, 9:15] = np.diag(belief.noise[6:])
        joint[k + 1, :, : k + 1] = np.einsum("ab,bkc->akc", Phi, joint[k, :, : k + 1])
        joint[: k + 1, :, k + 1] = joint[k + 1, :, : k + 1].transpose(1, 2, 0)
        joint[k + 1, :, k + 1] = Phi @ joint[k, :, k] @ Phi.T + dt * Q
    C = joint.reshape(states * n, states * n)
    sample = np.searchsorted(imu.time, fixes.time)
    seen = (states * sample[:, None] + np.arange(6)).ravel()
    there = free._replace(
        position=free.position[sample],
        velocity_n=free.velocity_n[sample],
        q_nb=free.q_nb[sample],
        bias=free.bias[sample],
        scale=free.scale[sample],
    )
    z = apart(there, there._replace(position=fixes.position, velocity_n=fixes.velocity_n))[:, :6].ravel()
    S = C[np.ix_(seen, seen)] + np.kron(np.eye(sample.size), belief.R)
    gain = np.linalg.solve(S, C[seen]).T
    P = C - gain @ C[seen]
    return (gain @ z).reshape(n, states), np.diag(P).reshape(n, states)


class Comparison(NamedTuple):
    """Largest differences between a smoothed flight and least squares: of states, in σ, and of σ."""

    states: float
    sigma: float


def compare(imu: Imu, fixes: Fixes, begin: Start, belief: Belief, schedule: Schedule) -> Comparison:
    """Compare a smoothed flight with least squares."""
    model = with_states(PHI, belief.P0.shape[0])
    free = navigate(imu, NO_FIXES, begin, belief, model=model)
    x, variance = adjusted(imu, fixes, free, belief)
    filtered = navigate(imu, fixes, begin, belief, schedule, model)
    assert len(set(filtered.fix_sample)) == fixes.time.size - 1
    smoothed = smooth(imu, filtered, belief)
    sigma = np.sqrt(variance)
    states = np.abs((apart(free, smoothed) - x) / sigma).max()
    deviation = np.abs(np.sqrt(smoothed.variance) / sigma - 1).max()
    correction = np.abs(apart(filtered, smoothed) / sigma).max()
    print(f"\nsmoothed beside least squares: states {states:.1e} σ, σ {deviation:.1e}, ", end="")
    print(f"while it moves the filtered ones by up to {correction:.1f} σ")
    assert correction > 1
    at_fixes = np.sqrt(np.diagonal(smoothed.fix_covariance, axis1=1, axis2=2))
    np.testing.assert_allclose(at_fixes, sigma[filtered.fix_sample], rtol=1e-4)
    return Comparison(float(states), float(deviation))


@pytest.mark.parametrize(("bias_decay", "states"), [(0.0, 15), (0.1, 15), (0.1, 21)])
def test_a_short_flight_against_least_squares(bias_decay: float, states: int) -> None:
    """The navigator runs free, so that both start from the same."""
    found = compare(*short_flight(bias_decay, states=states), Schedule(feedback=False))
    # Roundoff of a latitude is 1e-6 of the position's σ here; linearisation does the rest.
    assert found.states < 1e-3
    assert found.sigma < 1e-4


def test_with_feedback_it_tends_to_least_squares() -> None:
    """A correction goes through the strapdown's step, least squares through I + F dt: first order in dt."""
    coarse, fine = (compare(*short_flight(rate=rate), Schedule()) for rate in (20, 40))
    assert fine.states < 0.02
    assert fine.states < 0.6 * coarse.states
    assert max(coarse.sigma, fine.sigma) < 1e-4


def test_without_fixes_nothing_changes() -> None:
    imu, _, begin, belief = short_flight()
    filtered = navigate(imu, NO_FIXES, begin, belief)
    smoothed = smooth(imu, filtered, belief)
    np.testing.assert_allclose(apart(smoothed, filtered), 0, atol=1e-12)
    np.testing.assert_allclose(smoothed.variance, filtered.variance, rtol=1e-9)


def flight(seed: int, **settings: object) -> tuple[Result, Imu]:
    """Return an experiment on montreal and the increments it navigated with."""
    experiment = Experiment(mission="montreal", seed=seed)
    for name, value in settings.items():
        experiment.set(name.replace("__", "."), value)
    result = experiment.run()
    return result, Imu(result.ideal.time, result.gyro.increments, result.accelerometer.increments)


def test_an_outage_is_bridged_from_both_sides() -> None:
    """With a bias nobody doubts: its covariance has no inverse."""
    result, imu = flight(3, sensors__gps__outages=[(90, 120)], sensors__gyro__bias_sigma=(0.0, 0.3, 0.3))
    filtered = result.solution_arrays
    smoothed = smooth(imu, filtered, result.belief)
    # P is computed anew, along the solution: after the last fix the two agree to that.
    assert (smoothed.variance <= filtered.variance * (1 + 1e-6)).all()
    assert (np.delete(smoothed.variance, 9, axis=1) > 0).all()
    # The last sample has nothing later to learn from.
    np.testing.assert_allclose(smoothed.variance[-1], filtered.variance[-1], rtol=1e-6)
    np.testing.assert_allclose(apart(smoothed, filtered)[-1], 0, atol=1e-9)
    outage = (result.time > 110) & (result.time < 119)
    everywhere = np.arange(result.time.size)
    errors = [
        np.abs(error_state(s, everywhere, result.truth_arrays, result.true_bias))[outage, :2].max()
        for s in (filtered, smoothed)
    ]
    print(f"\nlast part of an outage of 30 s: filtered {errors[0]:.1f} m, smoothed {errors[1]:.1f} m")
    assert errors[1] < 0.5 * errors[0]


def test_smoothed_errors_are_smaller_and_the_smoother_tells_the_truth() -> None:
    def one(seed: int) -> tuple[FloatArray, FloatArray]:
        result, imu = flight(seed)
        filtered = result.solution_arrays
        smoothed = smooth(imu, filtered, result.belief)
        late = result.fixes.time > 20
        samples = filtered.fix_sample[late]
        x = [error_state(s, samples, result.truth_arrays, result.true_bias) for s in (filtered, smoothed)]
        return np.mean(np.square(x), axis=1), normalised_squares(x[1], smoothed.fix_covariance[late])

    with ThreadPoolExecutor(2) as pool:
        squares, nees = (np.array(values) for values in zip(*pool.map(one, range(1, SEEDS + 1)), strict=True))
    CACHE.clear()
    filtered, smoothed = np.sqrt(squares.mean(axis=0))
    low, high = chi_square_interval(15, SEEDS)
    mean = nees.mean(axis=0)
    inside = float(np.mean((low < mean) & (mean < high)))
    print(f"\nmontreal, {SEEDS} seeds, smoothed rms errors as parts of the filtered ones:")
    print((smoothed / filtered).round(2))
    print(f"NEES {mean.mean():.2f} on average, inside at {100 * inside:.1f} % of epochs")
    assert (smoothed < 0.9 * filtered).all()
    assert inside >= 0.9
