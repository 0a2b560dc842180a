"""The driver: feedback and feedforward, whole flights and pieces, fixes at any time, slower covariance."""

from __future__ import annotations

import numpy as np
import pytest
from apart import apart
from flown import fly
from motions import NO_FILTER, NO_FIXES

from lab.analysis.errors import position_error
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.experiment.stages import CACHE, start
from lab.navigation.filters.error_models import PHI
from lab.navigation.filters.filter import Filter
from lab.navigation.kernels.driver import driver
from lab.navigation.navigator import Fixes, Imu, Schedule, Solution, Start, advance, navigate
from lab.navigation.strapdown import ACCEL_BIAS, GYRO_BIAS


def inputs(result: Result) -> tuple[Imu, Fixes, Start]:
    """Return what the navigator of an experiment was fed with."""
    fixes = Fixes(result.fixes.time, result.fixes.position, result.fixes.velocity_n)
    imu = Imu(result.ideal.time, result.gyro.increments, result.accelerometer.increments)
    return imu, fixes, start(result.truth_arrays, result.experiment.navigator, result.experiment.seed)


def run(**settings: object) -> Result:
    """Run an experiment on the shorter mission, with settings by path, their dots as double underscores."""
    experiment = Experiment(mission="los_angeles")
    for name, value in settings.items():
        experiment.set(name.replace("__", "."), value)
    return experiment.run()


def assert_same_bits(one: Solution, other: Solution) -> None:
    for name, a, b in zip(Solution._fields, one, other, strict=True):
        np.testing.assert_array_equal(a.view(np.int8), b.view(np.int8), err_msg=name)


GOOD_SENSORS = {
    "sensors__gyro__noise_density": 0.001,
    "sensors__gyro__bias_sigma": 0.001,
    "sensors__accelerometer__noise_density": 35.0,
    "sensors__accelerometer__bias_sigma": 0.02,
    "navigator__attitude_sigma": 0.01,
    "navigator__position_sigma": 0.1,
    "navigator__velocity_sigma": 0.01,
}


DECAYING_BIASES = {
    "sensors__gyro__instability": 3.6,
    "sensors__gyro__correlation_time": 10.0,
    "sensors__accelerometer__instability": 0.2,
    "sensors__accelerometer__correlation_time": 10.0,
}


def feedback_minus_feedforward(scale: float, **others: float) -> float:
    """Return the largest difference of any state, in σ, with good sensors scaled."""
    settings = {name: scale * value for name, value in GOOD_SENSORS.items()} | others
    back, forward = run(**settings), run(**settings, navigator__correction="feedforward")
    one, other = back.solution_arrays, forward.solution_arrays
    np.testing.assert_allclose(other.variance, one.variance, rtol=0.02 * scale)
    return float(apart(back, forward).max())


def test_feedback_equals_feedforward_while_errors_are_small() -> None:
    """What parts them is of second order in the errors, so in units of σ it shrinks with the errors."""
    good, better = feedback_minus_feedforward(1.0), feedback_minus_feedforward(0.1)
    print(f"\nfeedback − feedforward: {good:.1e} σ, with sensors ten times better {better:.1e} σ")
    assert good < 0.1
    assert better < 0.1 * good


def test_feedback_equals_feedforward_with_biases_that_decay() -> None:
    """A bias that was fed back decays as one still in the estimate does."""
    assert feedback_minus_feedforward(1.0, **DECAYING_BIASES) < 0.1


def test_feedforward_leaves_the_navigator_alone() -> None:
    """Its navigator drifts as without fixes, and only what it puts out is corrected."""
    result = run(navigator__correction="feedforward")
    imu, fixes, begin = inputs(result)
    free = navigate(imu, NO_FIXES, begin, NO_FILTER)
    fed = navigate(imu, fixes, begin, result.belief, Schedule(feedback=False))
    difference = position_error(free.position, result.truth_arrays)
    corrected = position_error(fed.position, result.truth_arrays)
    assert np.abs(difference[-1]).max() > 20 * np.abs(corrected[-1]).max()
    # Until the first fix there is nothing to subtract.
    first = fed.fix_sample[0]
    np.testing.assert_array_equal(free.position[:first], fed.position[:first])


@pytest.mark.proof
@pytest.mark.parametrize(
    "schedule",
    [
        Schedule(),
        Schedule(feedback=False),
        Schedule(correction_period=3.0),
        Schedule(stride=6),
        Schedule(feedback=False, stride=6),
    ],
    ids=lambda s: f"feedback={s.feedback} period={s.correction_period:g} stride={s.stride}",
)
@pytest.mark.parametrize("size", [1, 13, 1000])
def test_a_flight_in_pieces_gives_the_same_bits(schedule: Schedule, size: int) -> None:
    """Grown as a live navigator's arrays grow, or handed over whole."""
    result = run()
    imu, fixes, begin = inputs(result)
    samples = 3000 if size == 1 else imu.dtheta.shape[0]
    imu = Imu(imu.time[: samples + 1], imu.dtheta[:samples], imu.dvelocity[:samples])
    whole = navigate(imu, fixes, begin, result.belief, schedule)
    pieces = Solution.empty(imu.time.size, fixes.time.size)
    state = Filter.begin(begin, result.belief, imu.time[0])
    for first in range(0, samples, size):
        last = min(first + size, samples)
        known = np.searchsorted(fixes.time, imu.time[last], side="right")
        part = Imu(imu.time[: last + 1], imu.dtheta[:last], imu.dvelocity[:last])
        so_far = Fixes(*(array[:known] for array in fixes))
        advance(state, part, so_far, pieces, first, schedule)
    assert_same_bits(whole, pieces)


def test_the_same_settings_and_seed_give_the_same_bits() -> None:
    one = run(seed=5).solution_arrays
    CACHE.clear()
    assert_same_bits(one, run(seed=5).solution_arrays)
    assert (run(seed=6).solution_arrays.position != one.position).any()


@pytest.mark.parametrize(("rate", "percent"), [(50.0, 0.05), (20.0, 0.12)])
@pytest.mark.parametrize("mission", ["montreal", "los_angeles"])
def test_covariance_at_a_lower_rate(mission: str, rate: float, percent: float) -> None:
    every = run(mission=mission).solution_arrays
    slower = run(mission=mission, navigator__filter_rate=rate).solution_arrays
    fixes = every.fix_sample
    difference = 100 * (np.sqrt(slower.variance[fixes] / every.variance[fixes]) - 1)
    position = np.sqrt(np.mean(difference[:, :3] ** 2, axis=0)).max()
    worst = np.abs(difference).max()
    print(f"\n{mission}, P at {rate:g} Hz: position σ {position:.3f} % rms off 200 Hz, any σ {worst:.3f} %")
    assert 0 < position <= percent
    assert worst <= 5 * percent


def test_a_fix_updates_at_its_own_time() -> None:
    """Perfect sensors, perfect fixes anywhere between the samples: nothing to correct, to a millimetre."""
    flight = fly("montreal")
    times = np.sort(np.random.default_rng(2).uniform(20, 200, 150))
    true = flight.trajectory.at(times)
    fixes = Fixes(times, np.stack((true.latitude, true.longitude, true.height), axis=-1), true.velocity_n)
    belief = NO_FILTER._replace(P0=np.eye(15))
    start = Start.off(flight.truth, *np.zeros((3, 3)))
    solution = navigate(flight.imu, fixes, start, belief)
    assert (np.diff(solution.fix_sample) >= 0).all()
    np.testing.assert_array_equal(solution.fix_sample, np.searchsorted(flight.imu.time, times))
    # Linear interpolation over 5 ms at 10 m/s² and a jerk of 100 m/s³.
    np.testing.assert_allclose(solution.innovation[:, :3], 0, atol=1e-3)
    np.testing.assert_allclose(solution.innovation[:, 3:], 0, atol=5e-3)


def test_fixes_outside_the_imu_times_are_left_alone() -> None:
    result = run()
    imu, fixes, begin = inputs(result)
    late = Imu(imu.time[4000:], imu.dtheta[4000:], imu.dvelocity[4000:])
    there = fly("los_angeles").trajectory.at(late.time)
    begin = Start.off(there, *np.zeros((3, 3)))
    solution = navigate(late, fixes, begin, result.belief)
    before, within = fixes.time < 19.99, fixes.time > 20.01
    assert (solution.fix_sample[before] == -1).all()
    assert np.isnan(solution.innovation[before]).all()
    assert (solution.fix_sample[within] > 0).all()
    error = position_error(solution.position, there)
    assert np.abs(error).max() < 3


def test_correction_period_spaces_the_corrections() -> None:
    """The biases that the navigator itself takes off its increments change at corrections only."""
    result = run()
    imu, fixes, begin = inputs(result)
    out = Solution.empty(imu.time.size, fixes.time.size)
    state = Filter.begin(begin, result.belief, 0.0)
    corrected: list[float] = []
    for first in range(imu.dtheta.shape[0]):
        before = state.state[GYRO_BIAS : ACCEL_BIAS + 3].copy()
        part = Imu(imu.time[: first + 2], imu.dtheta[: first + 1], imu.dvelocity[: first + 1])
        advance(state, part, fixes, out, first, Schedule(correction_period=4.0))
        if (state.state[GYRO_BIAS : ACCEL_BIAS + 3] != before).any():
            corrected.append(imu.time[first + 1])
    np.testing.assert_allclose(np.diff(corrected), 4.0)
    assert corrected[0] == pytest.approx(4.0)


def test_two_fixes_between_two_samples_are_used_one_after_the_other() -> None:
    """The second fix sees the navigator as the first one left it, also where it interpolates."""
    flight = fly("los_angeles", 10.0)
    times = np.array([40.02, 40.04, 40.06, 40.08])
    true = flight.trajectory.at(times)
    fixes = Fixes(times, np.stack((true.latitude, true.longitude, true.height), axis=-1), true.velocity_n)
    P0 = np.diag(np.repeat([1.0, 1.0, 1e-4, 1e-8, 1e-4], 3))
    belief = NO_FILTER._replace(P0=P0, R=0.01 * np.eye(6))
    begin = Start.off(flight.truth, np.zeros(3), np.array([0.02, -0.02, 0.01]), np.zeros(3))
    back, forward = (
        navigate(flight.imu, fixes, begin, belief, Schedule(feedback=feedback)) for feedback in (True, False)
    )
    assert len(set(back.fix_sample)) == 1
    assert np.abs(back.innovation[0, 3:]).max() > 0.01
    np.testing.assert_allclose(back.innovation[:, 3:], forward.innovation[:, 3:], rtol=0, atol=1e-6)
    # The filter takes the position error at the fix for that at the sample, 0.08 s at 0.03 m/s away.
    np.testing.assert_allclose(back.innovation[:, :3], forward.innovation[:, :3], rtol=0, atol=2.5e-3)


def test_a_kernel_is_compiled_once_whatever_may_be_written_to() -> None:
    """A compilation takes 20 s; simulated increments may be written to, those of a log may not."""
    imu, fixes, begin = inputs(run())
    belief = run().belief
    free = Imu(*(values.copy() for values in imu.until(400))), Fixes(*(values[:3].copy() for values in fixes))
    locked = Imu(*(values.copy() for values in free[0])), Fixes(*(values.copy() for values in free[1]))
    for values in (*locked[0], *locked[1]):
        values.flags.writeable = False
    spaced = Imu(*(np.repeat(values, 2, axis=0)[::2] for values in free[0]))
    solutions = [navigate(*given, begin, belief) for given in (free, locked, (spaced, free[1]))]
    for solution in solutions[1:]:
        assert_same_bits(solutions[0], solution)
    assert len(driver(PHI, summed=False).signatures) == 1
    assert free[0].dtheta.flags.writeable  # what was given is left as it was
