"""Rest: it is found, it shows the biases of the gyros, and nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from lab.analysis.errors import error_state
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.motion.frames import earth
from lab.navigation import standstill, strapdown
from lab.navigation.kernels.generation import interpret_kernel
from lab.navigation.solution import Belief, Fixes, Imu
from lab.navigation.standstill import SHORTEST, at_rest, standing_still

HEADER = (
    "time_s,latitude_deg,longitude_deg,height_m,velocity_north_m_s,velocity_east_m_s,velocity_down_m_s,"
    "roll_deg,pitch_deg,yaw_deg\n"
)


@pytest.fixture(scope="module")
def standing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a flight that stands still for 15 minutes."""
    path = tmp_path_factory.mktemp("rest") / "standing.csv"
    path.write_text(HEADER + "".join(f"{t},45,7,300,0,0,0,1,2,30\n" for t in range(901)))
    return path


def run(mission: Path | str, seed: int, **settings: object) -> Result:
    experiment = Experiment(mission=str(mission), seed=seed)
    experiment.set("trajectory.imu_rate", 50.0)
    for name, value in settings.items():
        experiment.set(name.replace("__", "."), value)
    return experiment.run()


def last_errors(result: Result) -> tuple[np.ndarray, np.ndarray]:
    """Return the error state at the end, and its σ."""
    solution, end = result.solution_arrays, np.array([result.time.size - 1])
    x = error_state(solution, end, result.known_truth("errors"), result.true_bias)
    return x[0], np.sqrt(solution.variance[-1])


@pytest.mark.proof
@pytest.mark.parametrize("sigma", [2.0, 15.0])
def test_fifteen_minutes_at_rest_teach_no_heading(standing: Path, sigma: float) -> None:
    """The Earth's rate is far below the biases of these gyros: σ of the heading stays, and is right."""
    found = [
        last_errors(run(standing, seed, navigator__attitude_sigma=(0.5, 0.5, sigma))) for seed in range(1, 21)
    ]
    x, P = (np.array(values) for values in zip(*found, strict=True))
    ratio = np.sqrt(np.mean((x / P) ** 2, axis=0))
    print(f"\nheading: error / σ {ratio[8]:.2f} rms, σ {np.degrees(P[:, 8]).mean():.1f}°", end="; ")
    print(f"gyro biases {ratio[9:12].round(2)}")
    assert ratio[8] < 1.2
    assert np.degrees(P[:, 8]).mean() > 0.5 * sigma
    assert (ratio[9:12] < 1.3).all()
    assert (np.degrees(P[:, 9:12]) < 0.01).all()


def test_without_the_updates_the_heading_drifts(standing: Path) -> None:
    """The test above notices what it is about."""
    off = [
        np.degrees(last_errors(run(standing, seed, navigator__rest_updates=False))[0][8])
        for seed in range(1, 4)
    ]
    assert np.max(np.abs(off)) > 20


def test_a_flight_is_no_rest() -> None:
    for mission in ("montreal", "los_angeles", "pacific"):
        result = run(mission, 1)
        moving = np.linalg.norm(result.known_truth("errors").velocity_n, axis=1) > 0.5
        assert not result.solution_arrays.rest[moving].any()
    assert SHORTEST == 10


@pytest.mark.parametrize("model", ["phi", "psi", "invariant", "nonlinear"])
def test_all_models_use_the_rest_alike(standing: Path, model: str) -> None:
    result = run(standing, 1, navigator__model=model)
    x, sigma = last_errors(result)
    assert result.solution_arrays.rest.sum() > 800
    assert np.abs(x[9:12] / sigma[9:12]).max() < 4
    assert np.degrees(sigma[9:12]).max() < 0.01


def test_an_alignment_leaves_the_noise_of_its_mean() -> None:
    """A factory offset of 20 °/s is nobody's turn-on bias: 30 s at rest leave N / √30."""
    errors = []
    for seed in range(1, 21):
        result = run(
            "los_angeles",
            seed,
            sensors__gyro__bias_sigma=20.0,
            sensors__gyro__instability=0.0,
            navigator__alignment=30.0,
        )
        first = error_state(
            result.solution_arrays, np.array([0]), result.known_truth("errors"), result.true_bias
        )
        errors.append(first[0, 9:12] / np.sqrt(result.solution_arrays.variance[0, 9:12]))
        density = np.array(result.experiment.sensors.gyro.noise_density)
        # And the Earth's rate, as far as the attitude of 0.5, 0.5, 2° is not known.
        earth_seen = earth.RATE * np.sqrt(2 * 0.5**2 + 2.0**2)
        left = np.degrees(np.sqrt(result.solution_arrays.variance[0, 9:12]))
        assert (left >= density / np.sqrt(30)).all()
        assert (left <= np.hypot(density / np.sqrt(30), earth_seen)).all()
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1, abs=0.3)


RATE = 20
"""Samples a second of a minute at rest."""


def seconds_at_rest(
    *,
    rates: dict[int, float] | None = None,
    forces: dict[int, float] | None = None,
    turning: float = 0.0,
    speeds: dict[int, float] | None = None,
    speed_sigma: float = 0.1,
    noise: float = 0.0,
    silent: range = range(0),
    starts: tuple[int, float] = (60, 0.0),
    changes: Sequence[tuple[int, float]] = (),
    without_fixes: bool = False,
) -> set[int]:
    """Return which seconds of a minute at rest are found to be so.

    Parameters
    ----------
    rates, forces
        Amplitudes by which a rate [°/s] and a force [m/s²] swing from sample to sample, in some seconds.
    turning
        Rate from the 31st second on [°/s].
    speeds
        Speed of the fix in the middle of some seconds [m/s].
    speed_sigma
        Its assumed σ [m/s].
    noise
        Assumed density of the gyros [rad/s/√Hz] and of the accelerometers [m/s²/√Hz].
    silent
        Seconds without a fix.
    starts
        Second from which on the vehicle accelerates forward, and how much [m/s²].
    changes
        Seconds from which on the force forward is larger, and by how much [m/s²].
    without_fixes
        Whether the seconds with zero velocity are returned, also those without fixes.
    """
    second, swing = np.arange(60 * RATE) // RATE, np.tile([1.0, -1.0], 30 * RATE)
    dtheta, dvelocity = np.zeros((60 * RATE, 3)), np.zeros((60 * RATE, 3))
    dvelocity[:, 2] = -9.8 / RATE
    dtheta[second >= 30, 0] += np.radians(turning) / RATE
    for at, size in (rates or {}).items():
        dtheta[second == at, 0] += (np.radians(size) * swing / RATE)[second == at]
    for at, size in (forces or {}).items():
        dvelocity[second == at, 1] += (size * swing / RATE)[second == at]
    for at, size in (starts, *changes):
        dvelocity[second >= at, 0] += size / RATE
    kept = np.array([at for at in range(60) if at not in silent], dtype=np.int64)
    velocity = np.zeros((60, 3))
    for at, speed in (speeds or {}).items():
        velocity[at] = speed * np.array([0.6, 0.0, 0.8])
    imu = Imu(100 + np.arange(60 * RATE + 1) / RATE, dtheta, dvelocity)
    fixes = Fixes(100.5 + kept, np.zeros((kept.size, 3)), velocity[kept])
    belief = Belief(np.eye(15), np.diag([1.0] * 3 + [speed_sigma**2] * 3), np.full(12, noise**2), np.zeros(6))
    rest = at_rest(imu, fixes, belief)
    if without_fixes:
        rest, _ = standing_still(rest, imu, fixes, belief)
    rest = rest.reshape(60, RATE)
    assert (rest.all(axis=1) == rest.any(axis=1)).all()
    return set(np.flatnonzero(rest[:, 0]).tolist())


MINUTE = set(range(60))


def test_a_speed_of_the_gps_ends_a_rest_for_a_second_before_and_after() -> None:
    assert seconds_at_rest() == MINUTE
    assert seconds_at_rest(speeds={30: 1.0}) == MINUTE - {29, 30, 31}
    assert seconds_at_rest(silent=range(20, 40)) == MINUTE - set(range(21, 39))
    # Ten seconds between two are a rest, nine are none.
    assert seconds_at_rest(speeds={12: 1.0, 25: 1.0}) == MINUTE - {11, 12, 13, 24, 25, 26}
    assert seconds_at_rest(speeds={12: 1.0, 24: 1.0}) == MINUTE - set(range(11, 26))


def test_a_rest_lasts_on_without_fixes_until_the_inertial_sensors_show_motion() -> None:
    quiet = range(20, 60)
    assert seconds_at_rest(silent=quiet) == set(range(21))
    assert seconds_at_rest(silent=quiet, without_fixes=True) == MINUTE
    for motion in ({"rates": {40: 1.0}}, {"forces": {40: 0.5}}, {"starts": (40, 0.1)}):
        assert seconds_at_rest(silent=quiet, without_fixes=True, **motion) == set(range(40)), motion
    # What the inertial sensors cannot tell from rest, and rest that fixes never showed.
    assert seconds_at_rest(silent=quiet, without_fixes=True, starts=(40, 0.02)) == MINUTE
    assert seconds_at_rest(silent=range(60), without_fixes=True) == set()


@pytest.mark.parametrize("speed_sigma", [0.1, 0.45])
def test_a_start_ends_a_rest_before_fixes_show_it(speed_sigma: float) -> None:
    """Fixes of 0.45 m/s show no speed up to 1.8 m/s; those here are zero, and never show it."""
    for acceleration in (0.025, 0.1, 0.5):
        start = {"starts": (30, acceleration), "speed_sigma": speed_sigma}
        assert seconds_at_rest(**start) == MINUTE - {30}, acceleration  # as fixes and steady forces show it
        still = seconds_at_rest(**start, without_fixes=True)
        # Fixes of 0.1 m/s would show 0.02 m/s² after 20 s.
        assert still == set(range(30)) | (set(range(51, 60)) if speed_sigma == 0.1 else set()), acceleration


def test_a_knock_interrupts_a_rest_and_a_push_ends_it() -> None:
    """A force that comes and goes back again leaves no velocity behind."""
    for forces, again in (((0.3, -0.3), 32), ((0.3, 0.0), 60)):
        starts, before = [(30, forces[0]), (31, forces[1] - forces[0]), (32, -forces[1])], set(range(30))
        found = seconds_at_rest(changes=starts, speed_sigma=0.45, without_fixes=True)
        assert found == before | set(range(again + 1, 60)), forces


@pytest.mark.parametrize(("sigma", "used"), [(0.1, 0.1), (0.01, 0.05)])
def test_a_speed_that_noise_explains_is_none(sigma: float, used: float) -> None:
    """Of three components 99.9 %; the receiver is not trusted below 5 cm/s."""
    limit = used * np.sqrt(stats.chi2.ppf(0.999, 3))
    assert seconds_at_rest(speeds={30: 0.99 * limit}, speed_sigma=sigma) == MINUTE
    assert seconds_at_rest(speeds={30: 1.01 * limit}, speed_sigma=sigma) == MINUTE - {29, 30, 31}


def test_an_imu_that_shakes_or_turns_is_not_at_rest() -> None:
    assert seconds_at_rest(rates={30: 0.29}, forces={40: 0.149}) == MINUTE
    assert seconds_at_rest(rates={30: 0.31}) == MINUTE - {30}
    assert seconds_at_rest(forces={40: 0.151}) == MINUTE - {40}
    # A turn at a steady rate shows where it begins.
    assert seconds_at_rest(turning=0.049) == MINUTE
    assert seconds_at_rest(turning=0.051) == MINUTE - {30}
    # Of 20 samples that swing by 0.2°/s the mean is known to 0.2°/s / √20, of which two differ.
    noisy, limit = dict.fromkeys(range(60), 0.2), 0.05 + 5 * 0.2 * np.sqrt(2 / RATE)
    assert seconds_at_rest(rates=noisy, turning=0.99 * limit) == MINUTE
    assert seconds_at_rest(rates=noisy, turning=1.01 * limit) == MINUTE - {30}


def test_an_imu_may_be_as_noisy_as_the_filter_assumes() -> None:
    """Three σ of a sample: at 20 Hz, of a density of 1, √20 each."""
    for noise, size in ((0.01, 3 * 0.01 * np.sqrt(RATE)), (0.05, 3 * 0.05 * np.sqrt(RATE))):
        assert seconds_at_rest(rates={30: 0.99 * np.degrees(size)}, noise=noise) == MINUTE
        assert seconds_at_rest(rates={30: 1.01 * np.degrees(size)}, noise=noise) == MINUTE - {30}
        far = max(size, 0.15)
        assert seconds_at_rest(forces={30: 0.99 * far}, noise=noise) == MINUTE
        assert seconds_at_rest(forces={30: 1.01 * far}, noise=noise) == MINUTE - {30}


EARTH_N = np.array([5e-5, 1e-5, -5e-5])
"""The Earth's rate in a frame that is not turned to the north [rad/s]."""
ATTITUDE = Rotation.from_euler("ZYX", [2.5, -0.2, 0.3])


def gathered(swing: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a navigator after a second at rest, what was gathered, and the error of its gyro biases.

    Parameters
    ----------
    swing
        Amplitude by which the rates swing from sample to sample [rad/s].
    """
    gather, sums = interpret_kernel(standstill.gather_rest), np.zeros(standstill.ROOM)
    state = np.zeros(strapdown.LENGTH)
    state[strapdown.Q_NB : strapdown.Q_NB + 4] = ATTITUDE.as_quat(scalar_first=True)
    bias, error = np.array([1e-3, -2e-3, 3e-3]), np.array([2e-4, 1e-4, -3e-4])
    state[strapdown.GYRO_BIAS : strapdown.GYRO_BIAS + 3] = bias
    sums[standstill.ATTITUDE :] = ATTITUDE.as_matrix().ravel()
    for sample in range(RATE):
        rate = ATTITUDE.apply(EARTH_N, inverse=True) - error + swing * (-1) ** sample
        state[strapdown.PREVIOUS_DTHETA : strapdown.PREVIOUS_DTHETA + 3] = rate / RATE
        assert gather(state, sums, 1 / RATE) == (sample == RATE - 1)
    return state, sums, error


@pytest.mark.parametrize(
    ("density", "swing"), [((1e-4, 2e-4, 3e-4), 0.0), ((1e-5, 1e-5, 1e-5), 0.01)], ids=["assumed", "shown"]
)
def test_an_update_at_rest_sees_the_error_of_the_bias_about_the_vertical(
    density: tuple[float, ...], swing: float
) -> None:
    """The mean over a second has the noise of the gyros, or what the samples show, over so many of them."""
    state, sums, error = gathered(swing)
    down = ATTITUDE.as_matrix()[2]
    sigma = np.linalg.norm(down * np.maximum(density, swing / np.sqrt(RATE)))
    see, H = interpret_kernel(standstill.predict_rest), np.zeros(6)
    noise = np.append(np.square(density), np.ones(9))
    z = see(state, tuple(EARTH_N), noise, sums.copy(), H)
    assert z * sigma == pytest.approx(-down @ error, rel=1e-6)
    for column, size in enumerate(np.repeat([1e-5, 1e-6], 3)):
        x, better = size * (np.arange(6) == column), state.copy()
        turned = Rotation.from_rotvec(x[:3]) * ATTITUDE  # without the error x
        better[strapdown.Q_NB : strapdown.Q_NB + 4] = turned.as_quat(scalar_first=True)
        better[strapdown.GYRO_BIAS : strapdown.GYRO_BIAS + 3] -= x[3:]
        there = see(better, tuple(EARTH_N), noise, sums.copy(), np.zeros(6))
        assert (z - there) * sigma == pytest.approx(H[column] * sigma * size, rel=1e-4, abs=1e-14)
    see(state, tuple(EARTH_N), noise, sums, H)
    np.testing.assert_array_equal(sums[: standstill.HELD], 0)
    np.testing.assert_array_equal(sums[standstill.ATTITUDE :], ATTITUDE.as_matrix().ravel())


def test_the_attitude_of_the_error_model_is_held_while_a_rest_lasts() -> None:
    hold, sums = interpret_kernel(standstill.hold_attitude), np.ones(standstill.ROOM)
    state = np.zeros(strapdown.LENGTH)
    hold(state, sums, False)
    np.testing.assert_array_equal(sums, 0)
    state[strapdown.PER_STEP] = 100.0
    state[strapdown.PREVIOUS_DVELOCITY : strapdown.PREVIOUS_DVELOCITY + 3] = 0.01, 0.02, -0.098
    for turn in (0.0, 0.3, 0.5):
        later = (Rotation.from_rotvec([0, 0, turn]) * ATTITUDE).as_matrix()
        state[strapdown.C_NB : strapdown.C_NB + 9] = later.ravel()
        hold(state, sums, True)
        held = state[strapdown.C_NB : strapdown.C_NB + 9]
        np.testing.assert_allclose(held, ATTITUDE.as_matrix().ravel(), atol=1e-15)
        force = state[strapdown.FORCE_N : strapdown.FORCE_N + 3]
        np.testing.assert_allclose(force, ATTITUDE.apply([1.0, 2.0, -9.8]), rtol=1e-12)
