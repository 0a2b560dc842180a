"""The right answers of the exercises, computed from closed forms or from runs of the lab."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from lab import Estimate, Experiment, MissionError, allan, earth, mission, run_ensemble
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.classroom.exercises.exercise import EXERCISES, Number
from lab.experiment.result import Result
from lab.missions import prepare_import, write_flight_csv
from lab.navigation import strapdown
from lab.navigation.filters.error_models import PHI
from lab.navigation.solution import Fixes, Imu, Start
from lab.sensors import imu
from lab.sensors.datum import Datum

G = STANDARD_GRAVITY


def expect(number: str, answer: float | str) -> None:
    """Check that an exercise accepts a computed answer."""
    outcome = EXERCISES[number].check(answer)
    assert outcome.right, f"{number}: {answer} is refused: {outcome}"


@cache
def run(*settings: tuple[str, object]) -> Result:
    """Return a short run with settings."""
    experiment = Experiment(mission="los_angeles", seed=1)
    experiment.trajectory.imu_rate = 20
    experiment.navigator.rest_updates = False
    for path, value in settings:
        experiment.set(path, value)
    return experiment.run()


def nis(result: Result) -> float:
    return float(result.innovations.nis.mean())


def at_rest(seconds: int, accelerometer: float) -> np.ndarray:
    """Return the error north [m] of a navigator at rest at 45° with a known height, and a bias [m/s²]."""
    latitude, state, north = math.radians(45), np.zeros(strapdown.LENGTH), np.zeros(seconds + 1)
    strapdown.set_position(state, latitude, 0.0, 0.0)
    state[strapdown.Q_NB] = 1
    turn = (earth.RATE * math.cos(latitude), 0.0, -earth.RATE * math.sin(latitude))
    gain = (accelerometer, 0.0, -earth.gravity(math.sin(latitude), 0.0))
    for second in range(seconds):
        strapdown.step(state, turn, gain, 1.0)
        state[strapdown.HEIGHT], state[strapdown.VELOCITY + 2] = 0, 0
        north[second + 1] = (state[0] - latitude) * earth.radii(math.sin(latitude))[0]
    return north


def test_drift_and_schuler() -> None:
    north = at_rest(6500, 1e-3 * G)
    expect("02.1", north[60])
    minute = (3600 + int(np.argmin(north[3600:]))) / 60
    expect("02.2", minute)
    expect("02.2", 2 * math.pi * math.sqrt(earth.radii(math.sin(math.pi / 4))[0] / G) / 60)


def test_the_height_error_grows_exponentially() -> None:
    # e-fold in √(R/2g): the ratio over equal times stays the same, and is that of the exponential.
    state = np.zeros(strapdown.LENGTH)
    strapdown.set_position(state, 0.0, 0.0, 1.0)
    state[strapdown.Q_NB] = 1
    heights = []
    for second in range(4001):
        heights.append(state[strapdown.HEIGHT])
        if second < 4000:
            strapdown.step(state, (earth.RATE, 0.0, 0.0), (0.0, 0.0, -earth.gravity(0.0, 0.0)), 1.0)
    growth = heights[4000] / heights[3000], heights[3000] / heights[2000]
    assert growth[0] == pytest.approx(growth[1], rel=0.02)
    assert growth[0] == pytest.approx(math.exp(1000 / math.sqrt(earth.SEMI_MAJOR_AXIS / 2 / G)), rel=0.02)
    expect("02.3", "exponentially")


def test_coning_at_two_samples_in_a_period() -> None:
    # The samples of x and y lie on one line and cancel, so only z turns the attitude: the drift is ω_z.
    expect("02.4", math.degrees(2 * math.pi * 10 * (1 - math.cos(math.radians(1)))))


def test_tuning() -> None:
    expect("05.1", nis(run()))
    expect("05.4", nis(run(*((f"navigator.{name}_scale", 4) for name in ("r", "q", "p0")))))
    tenth = run(("navigator.r_scale", 0.1))
    innovations = np.sqrt(nis(tenth) / nis(run()))
    assert innovations == pytest.approx(3.2, abs=0.2)
    expect("05.2", round(innovations, 1) ** 2)


def test_a_q_that_is_too_small_shows_in_the_correlation() -> None:
    small, matched = run(("navigator.q_scale", 0.01)), run()
    assert nis(small) < 1.5 * nis(matched)
    lag = [float(result.autocorrelation.velocity.sel(lag=1)[:2].mean()) for result in (small, matched)]
    assert lag[0] > lag[1] + float(small.autocorrelation.attrs["band"])
    expect("05.3", "correlation")


@pytest.mark.parametrize("number", EXERCISES)
def test_a_number_is_not_as_wide_as_its_mistakes(number: str) -> None:
    exercise = EXERCISES[number]
    if isinstance(exercise, Number):
        assert all(abs(mistake - exercise.right) > 2 * exercise.tolerance for mistake in exercise.mistakes)


@cache
def montreal(*settings: tuple[str, object]) -> Result:
    """Return a flight with turns, with settings."""
    experiment = Experiment(mission="montreal", seed=1)
    experiment.trajectory.imu_rate = 20
    for path, value in settings:
        experiment.set(path, value)
    return experiment.run()


def test_a_tilt_and_a_walking_tilt() -> None:
    expect("07.1", float(0.5 * G * np.radians(0.15) * 60**2))
    # The position is white noise integrated three times: the variance is the sum of its squared responses.
    responses = [np.sum((np.arange(seconds * 100) / 200) ** 4) for seconds in (30, 60)]
    expect("07.2", float(np.sqrt(responses[1] / responses[0])))


def test_the_gyros_limit_an_outage() -> None:
    outage = ("sensors.gps.outages", ((100.5, 160.5),))
    better = {
        "gyros": (("sensors.gyro.noise_density", 0.025), ("sensors.gyro.bias_sigma", 0.05)),
        "accelerometers": (
            ("sensors.accelerometer.noise_density", 17),
            ("sensors.accelerometer.bias_sigma", 1),
        ),
        "GPS receiver": (
            ("sensors.gps.position_variance", 0.125),
            ("sensors.gps.velocity_variance", 0.05),
        ),
        "IMU rate": (("trajectory.imu_rate", 40),),
    }
    sigma = {
        name: float(montreal(outage, *settings).sigma.position.sel(time=160, method="nearest")[0])
        for name, settings in better.items()
    }
    expect("07.3", min(sigma, key=lambda name: sigma[name]))


def test_turns_show_the_heading() -> None:
    share = montreal().observability.share.sel(quantity="heading").to_series()
    turns = share[["turn" in name for name in share.index]].sum()
    assert turns > 90
    expect("07.4", "a turn")


def test_many_runs() -> None:
    expect("10.1", float(stats.chi2.ppf(0.975, 20 * 15) / 20))
    expect("10.2", 20 * (0.15 / 0.05) ** 2)


def test_the_same_seeds_give_the_smaller_error_bar() -> None:
    experiment = Experiment(mission="los_angeles", seed=1)
    experiment.trajectory.imu_rate = 20
    matched = run_ensemble(experiment, 12).rms[:, 0]
    experiment.navigator.q_scale = 3
    large = run_ensemble(experiment, 12).rms[:, 0]
    assert (large - matched).std() < 0.5 * np.hypot(large.std(), matched.std())
    expect("10.3", "the luck cancels")


def test_sensor_errors() -> None:
    # What the lab makes of the unit of a card, and what its simulated gyros do.
    expect("03.1", Datum(0.3, "°/√h", "a sheet").in_unit("°/s/√Hz"))
    errors = imu.GyroErrors(noise_density=0.05, bias_sigma=0)
    draws = imu.ImuDraws.of(1, "gyro", 300_000, instability=False, flicker=False, walk=False)
    increments = imu.measure(np.zeros((300_000, 3)), 1.0, errors, draws).increments
    angles = np.degrees(increments.reshape(-1, 100, 3).sum(axis=1))
    assert angles.std() == pytest.approx(0.5, rel=0.02)
    expect("03.2", round(float(angles.std()), 2))


def test_the_allan_deviation_shows_a_walk_and_no_scale() -> None:
    errors = imu.GyroErrors(noise_density=0, bias_sigma=0, rate_random_walk=10)
    draws = imu.ImuDraws.of(1, "gyro", 2**14, instability=False, flicker=False, walk=True)
    walking = imu.measure(np.zeros((2**14, 3)), 1.0, errors, draws).increments
    found = allan.deviation(walking, 1.0)
    slope = np.polyfit(np.log(found.tau[3:20]), np.log(found.deviation[3:20].mean(axis=1)), 1)[0]
    assert slope == pytest.approx(0.5, abs=0.1)
    expect("03.3", "random walk of the bias")
    # At rest, a scale factor changes the output by a constant, which the deviation does not see.
    gravity = np.random.default_rng(1).normal(-G, 1e-3, (4096, 1))
    scaled = allan.deviation(gravity - 0.01 * G, 1.0).deviation
    assert np.allclose(scaled, allan.deviation(gravity, 1.0).deviation)
    expect("03.4", "scale factor")


def test_phi_and_psi_are_the_same_error_in_other_coordinates() -> None:
    heading = {
        model: run(("navigator.model", model)).errors.attitude.values for model in ("phi", "psi", "invariant")
    }
    assert np.allclose(heading["phi"], heading["psi"], atol=1e-5)
    assert not np.allclose(heading["phi"], heading["invariant"], atol=1e-3)
    expect("06.1", "phi and psi")


def test_a_wrong_heading_and_a_free_navigator() -> None:
    turned = Rotation.from_euler("z", 60, degrees=True).apply([1.0, 0, 0])
    expect("06.2", float(np.linalg.norm(turned - [1, 0, 0])))
    errors = {
        correction: float((run(("navigator.correction", correction)).errors.position ** 2).mean())
        for correction in ("feedback", "feedforward")
    }
    assert errors["feedforward"] > 10 * errors["feedback"]
    expect("06.3", min(errors, key=lambda correction: errors[correction]))


def test_a_file_in_knots_and_a_coordinated_turn(tmp_path: Path) -> None:
    recording = mission("los_angeles").recording
    write_flight_csv(tmp_path / "knots.csv", replace(recording, velocity_n=recording.velocity_n / 0.5144))
    with pytest.raises(MissionError, match=r"knots.*position changes 0\.514 times"):
        prepare_import(tmp_path / "knots.csv")
    expect("08.1", "position")
    # The lift balances gravity and the centripetal acceleration.
    lift = np.array([45.0 * math.radians(6), G])
    expect("08.2", math.degrees(math.atan2(*lift)))


class _Held:
    """Holds each fix; optionally with a covariance."""

    def __init__(self, *, covariance: bool) -> None:
        self.covariance = covariance

    def navigate(self, imu: Imu, fixes: Fixes, start: Start) -> Estimate:
        last = np.maximum(np.searchsorted(fixes.time, imu.time + 1e-6) - 1, 0)
        sigma = np.ones((imu.time.size, 9))
        q_nb = np.tile(start.q_nb, (imu.time.size, 1))
        P = np.tile(np.eye(9), (fixes.time.size, 1, 1)) if self.covariance else None
        return Estimate(fixes.position[last], fixes.velocity_n[last], q_nb, sigma, covariance=P)


def test_an_algorithm_that_holds_the_last_fix() -> None:
    age = np.arange(0, 1, 1e-4)
    expect("09.1", float(np.sqrt(np.mean((45 * age) ** 2))))
    nees = {}
    for covariance in (False, True):
        result = run().experiment.copy()
        assert isinstance(result, Experiment)
        nees[covariance] = result.run(algorithm=_Held(covariance=covariance)).consistency.nees
    assert nees[True].notnull().any()
    assert not nees[False].notnull().any()
    expect("09.2", "covariance")


def test_what_is_not_moved_is_not_observed() -> None:
    sigma, manoeuvres = montreal().sigma.attitude, montreal().observability
    turn = float(manoeuvres.start.sel(segment="first right turn"))
    fallen = sigma.sel(time=turn, method="nearest") / sigma[0]
    expect("01.1", str(fallen.angle.values[int(np.argmax(fallen.values))]))
    assert float(fallen.max()) > 0.9
    # Twice the time, by integrating a constant twice.
    error = np.cumsum(np.cumsum(np.ones(60_000)))
    expect("01.2", float(error[-1] / error[29_999]))


def test_the_blocks_of_the_system_matrix() -> None:
    expect("04.1", G * math.sin(math.radians(1)))
    state, F = np.zeros(strapdown.LENGTH), np.zeros((15, 15))
    strapdown.set_position(state, 0.8, 0.0, 100.0)
    state[strapdown.Q_NB] = 1
    strapdown.step(state, (0.0, 0.0, 0.0), (0.0, 0.0, -0.01 * G), 0.01)
    PHI.write(state, F)
    blocks = {
        "position from velocity": (slice(0, 3), slice(3, 6)),
        "velocity from tilt": (slice(3, 6), slice(6, 9)),
        "velocity from accelerometer": (slice(3, 6), slice(12, 15)),
        "tilt from gyro": (slice(6, 9), slice(9, 12)),
    }
    blind = []
    for name, block in blocks.items():
        masked = F.copy()
        masked[block] = 0
        # GPS measures the first six states; what they show of a tilt comes through powers of F.
        seen = [np.linalg.matrix_power(masked, power)[:6, 6:9] for power in range(1, 5)]
        if np.abs(seen).max() < 1e-6:
            blind.append(name)
    assert len(blind) == 1
    expect("04.2", blind[0])


def test_clocks() -> None:
    expect("11.2", 1e3 * 20e-6 * 3600)
    # A busy moment delays bytes: the least delay of each second does not see it, the mean does.
    delay = np.random.default_rng(1).exponential(0.002, (60, 100))
    delay[20:40] += np.random.default_rng(2).exponential(0.02, (20, 100))
    assert np.ptp(delay.min(axis=1)) < 0.1 * np.ptp(delay.mean(axis=1))
    expect("11.1", "bytes are never early")
