"""The smoother: against one least-squares adjustment of a whole short flight, and over seeds."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
import pytest
from flown import fly
from motions import NO_FIXES
from sized_models import with_states

from lab.analysis.consistency import chi_square_interval, normalised_squares
from lab.analysis.errors import attitude_error, error_state
from lab.base.arrays import FloatArray
from lab.base.parameters.setting_error import SettingError
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.experiment.stages import CACHE
from lab.motion.frames import earth
from lab.motion.frames.rotation import wrap
from lab.navigation import strapdown
from lab.navigation.belief import schedule_filter
from lab.navigation.filters import smoother
from lab.navigation.filters.error_models import PHI
from lab.navigation.filters.schedule import Schedule
from lab.navigation.model_choice import chosen_model
from lab.navigation.navigator import navigate
from lab.navigation.solution import Belief, Fixes, Imu, Solution, Start
from lab.navigation.standstill import at_rest

SEEDS = 100
RATE = 50.0
"""IMU rate of whole flights [Hz]: smoothing takes longer the more samples there are, and NEES is
taken at the fixes, which are as many at any rate."""


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


def short_flight(decay: float = 0.0, rate: int = 20, states: int = 15) -> tuple[Imu, Fixes, Start, Belief]:
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
        decay=np.repeat([1.0, 2.0], 3) * decay,
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
        fading = np.r_[np.zeros(9), belief.decay, np.zeros(states - 15)]
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
    schedule = schedule._replace(hold_heading=False)
    filtered = navigate(imu, fixes, begin, belief, schedule, model)
    assert len(set(filtered.fix_sample)) == fixes.time.size - 1
    smoothed = smoother.navigate(imu, fixes, begin, belief, schedule, model)
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


@pytest.mark.proof
@pytest.mark.parametrize(("decay", "states"), [(0.0, 15), (0.1, 15), (0.1, 21)])
def test_a_short_flight_against_least_squares(decay: float, states: int) -> None:
    """The navigator runs free, so that both start from the same."""
    found = compare(*short_flight(decay, states=states), Schedule(feedback=False))
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
    smoothed = smoother.navigate(imu, NO_FIXES, begin, belief)
    np.testing.assert_allclose(apart(smoothed, filtered), 0, atol=1e-12)
    np.testing.assert_allclose(smoothed.variance, filtered.variance, rtol=1e-9)


def flights(seed: int, mission: str = "montreal", **settings: object) -> tuple[Result, Result]:
    """Return an experiment filtered and smoothed."""
    experiment = Experiment(mission=mission, seed=seed)
    experiment.set("trajectory.imu_rate", RATE)
    for name, value in settings.items():
        experiment.set(name.replace("__", "."), value)
    filtered = experiment.run()
    experiment.set("navigator.smoother", True)
    return filtered, experiment.run()


def continued(result: Result) -> Solution:
    """Return the filtered solution that a smoothed run without held headings continues."""
    imu = Imu(result.time, result.gyro.increments, result.accelerometer.increments)
    fixes = Fixes(result.fix_validity, result.fixes.position, result.fixes.velocity_n)
    navigator = result.experiment.navigator
    assert result.aligned is not None
    return navigate(
        imu._replace(rest=at_rest(imu, fixes, result.belief)),
        fixes,
        result.aligned.start,
        result.belief,
        schedule_filter(navigator, imu.step, imu.dtheta.shape[0]),
        chosen_model(navigator, result.experiment.sensors),
    )


def test_an_outage_is_bridged_from_both_sides() -> None:
    """With a bias nobody doubts: its covariance has no inverse."""
    plain = {"navigator__hold_heading": False, "sensors__gyro__bias_sigma": (0.0, 0.3, 0.3)}
    result, after = flights(3, sensors__gps__outages=[(90, 120)], **plain)
    filtered, smoothed = continued(after), after.solution_arrays
    assert (smoothed.variance <= filtered.variance * (1 + 1e-9)).all()
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


@pytest.mark.proof
def test_smoothed_errors_are_smaller_and_the_smoother_tells_the_truth() -> None:
    def one(seed: int) -> tuple[FloatArray, FloatArray]:
        result, after = flights(seed)
        filtered, smoothed = result.solution_arrays, after.solution_arrays
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


COMBINATIONS = {
    "feedforward": {"navigator__correction": "feedforward"},
    "corrected every 10 s": {"navigator__correction_period": 10.0},
    "psi": {"navigator__model": "psi"},
    "invariant": {"navigator__model": "invariant"},
    "wander azimuth": {"navigator__mechanization": "wander azimuth"},
    "gate, lever arm, latency": {
        "navigator__gate": 0.9,
        "sensors__gps__lever_arm": (3.0, 1.0, -1.0),
        "sensors__gps__latency": 0.2,
    },
    "student-t": {"navigator__robust": "student-t", "sensors__gps__outlier_rate": 0.05},
}


@pytest.mark.proof
@pytest.mark.parametrize("settings", COMBINATIONS.values(), ids=COMBINATIONS)
def test_what_the_filter_did_is_undone_exactly(settings: dict[str, object]) -> None:
    """The smoothed σ is never above the filtered one and never below zero, with the default sensor, too."""
    _, after = flights(2, navigator__hold_heading=False, **settings)
    filtered, smoothed = continued(after), after.solution_arrays
    assert np.isfinite(smoothed.variance).all()
    assert (smoothed.variance > 0).all()
    assert (smoothed.variance <= filtered.variance * (1 + 1e-9)).all()
    np.testing.assert_allclose(smoothed.variance[-1], filtered.variance[-1], rtol=1e-9)
    np.testing.assert_allclose(apart(smoothed, filtered)[-1], 0, atol=1e-8)


@pytest.mark.proof
@pytest.mark.parametrize(
    "settings",
    [{"navigator__correction_period": 10.0}, {"navigator__model": "invariant"}, {"navigator__states": 21}],
    ids=["corrected every 10 s", "invariant", "21 states"],
)
def test_smoothed_nees_holds_in_combination(settings: dict[str, object]) -> None:
    seeds = 20

    def one(seed: int) -> FloatArray:
        _, after = flights(seed, "los_angeles", sensors__gyro__bias_sigma=0.02, **settings)
        smoothed, late = after.solution_arrays, after.fixes.time > 20
        x = error_state(
            smoothed,
            smoothed.fix_sample[late],
            after.known_truth("errors"),
            after.true_bias,
            after.true_scale,
        )
        return normalised_squares(x[:, :15], smoothed.fix_covariance[late][:, :15, :15])

    nees = np.mean([one(seed) for seed in range(1, seeds + 1)])
    CACHE.clear()
    print(f"\nsmoothed NEES of 15 states over {seeds} seeds: {nees:.2f}")
    # A flight smoothed is about four independent epochs.
    low, high = chi_square_interval(15, 4 * seeds, 0.999)
    assert low < nees < high


def test_a_smoothed_navigator_that_runs_free_too_far_is_named() -> None:
    """It starts 2° off, as the filter did, although the smoothed flight starts close to the truth."""
    off = (1.0, 1.0, 5.0)
    _, after = flights(
        1,
        sensors__gyro__noise_density=1e-3,
        sensors__gyro__bias_sigma=1e-4,
        navigator__correction="feedforward",
        navigator__attitude_sigma=off,
        navigator__attitude_error=off,
    )
    wrong = attitude_error(after.aligned.start.q_nb[None], after.flown.q_nb[:1])
    at_start, drift = np.degrees(np.linalg.norm(wrong)), np.degrees(after.free_run.drift)
    print(f"\nattitude error of the free navigator: {drift:.2f}°, at the start {at_start:.2f}°")
    assert at_start > 1
    assert drift == pytest.approx(at_start, abs=0.2)
    assert any("navigator.correction" in remark for remark in after.remarks)


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ({"filter_rate": 1.0}, r"filter_rate = 1 Hz"),
        ({"model": "nonlinear"}, "nonlinear"),
        ({"engine": "filterpy"}, "filterpy"),
    ],
    ids=["filter rate", "nonlinear", "filterpy"],
)
def test_what_cannot_be_smoothed_is_refused(settings: dict[str, object], named: str) -> None:
    experiment = Experiment(mission="montreal")
    experiment.update({"navigator": {**settings, "smoother": True}})
    with pytest.raises(SettingError, match=rf"navigator\.smoother: .*{named}.*accepted"):
        experiment.run()
