"""Verdict on causes: errors of the inertial sensors are named, and never blamed on the GPS."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lab.analysis.verdicts.pattern import BINS, bin_squares, channel, stretch
from lab.analysis.verdicts.selection import select_causes
from lab.analysis.verdicts.sums import Fit, Squares
from lab.analysis.verdicts.true_motion import Reference, exact
from lab.analysis.verdicts.verdict import judge
from lab.classroom.gallery.faults import FAULTS
from lab.classroom.gallery.faulty_experiment import FaultyExperiment
from lab.classroom.lessons.catalogue import gallery_lessons
from lab.experiment.experiment import Experiment
from lab.motion.truth.trajectory import Truth
from lab.navigation.aids import NAMES
from lab.sensors.cards import card

RNG = np.random.default_rng(11)

SENSOR_FAULTS = {
    "gyro scale factor": {"sensors.gyro.scale_factor": 3.0},
    "gyro misalignment": {"sensors.gyro.misalignment": [2.0, -2.0] * 3},
    "gyro bandwidth": {"sensors.gyro.bandwidth": 3.0},
    "gyro temperature": {
        "sensors.temperature.profile": "warm_up",
        "sensors.temperature.warm_up_time": 60.0,
        "sensors.gyro.bias_temperature": 0.02,
    },
    "accelerometer scale factor": {"sensors.accelerometer.scale_factor": 2.0},
    "accelerometer bandwidth": {"sensors.accelerometer.bandwidth": 2.0},
    "Q accelerometer": {"sensors.accelerometer.vibration_density": 2000.0},
    "gyro range": {"sensors.gyro.range": 4.0},
}


@pytest.mark.proof
@pytest.mark.parametrize("mission", ["montreal", "los_angeles"])
@pytest.mark.parametrize("name", SENSOR_FAULTS)
def test_errors_of_the_sensors_are_named_and_never_blamed_on_the_gps(name, mission):
    """The filter keeps what it assumed before the error was there, so that it is not told."""
    experiment = Experiment(mission=mission, seed=4)
    assumed = experiment.run().belief
    experiment.set("navigator.q", assumed.noise.tolist())
    for path, value in SENSOR_FAULTS[name].items():
        experiment.set(path, value)
    result = experiment.run()
    assert [finding.quantity for finding in result.verdict.findings] == [name]
    for finding in result.innovation_verdict.findings:
        assert not finding.quantity.startswith(("GPS latency", "GPS lever", "GPS corr", "GPS out", "R "))


def test_errors_of_the_sensors_are_not_blamed_on_what_other_sensors_measure():
    """Misaligned accelerometers move the navigator off the height of a right barometer; alone, R is wrong."""
    right = Experiment(seed=4).run().evidence
    number = np.full(len(NAMES), 200.0)
    large = Squares(4.0 * number, number)
    experiment = Experiment(seed=4)
    experiment.set("navigator.q", experiment.run().belief.noise.tolist())
    experiment.set("sensors.gyro.misalignment", [2.0, -2.0] * 3)
    wrong = experiment.run().evidence
    assert "R height" in [one.quantity for one in judge(replace(right, aids=large)).findings]
    assert [one.quantity for one in judge(replace(wrong, aids=large)).findings] == ["gyro misalignment"]
    precise = replace(wrong, aids=Squares(0.25 * number, number))
    assert "R height" in [one.quantity for one in judge(precise).findings]


@pytest.mark.parametrize(("rows", "name"), [(slice(6, 9), "gyro"), (slice(9, 12), "accelerometer")])
def test_a_wrong_bias_drive_is_named(rows, name):
    """Biases that wander, with a drive in Q that is 10,000 times too small."""
    experiment = Experiment(seed=2)
    experiment.set("sensors.gyro.rate_random_walk", 1000)
    experiment.set("sensors.accelerometer.rate_random_walk", 20)
    noise = experiment.run().belief.noise.copy()
    noise[rows] *= 1e-4
    experiment.set("navigator.q", noise.tolist())
    (finding,) = experiment.run().verdict.findings
    assert (finding.quantity, finding.direction) == (f"Q {name} bias", "too small")


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_bias_drive_that_is_too_large_is_named(seed):
    experiment = Experiment(seed=seed)
    experiment.set("sensors.gyro.instability", 30.0)
    noise = experiment.run().belief.noise.copy()
    noise[6:9] *= 1e3
    experiment.set("navigator.q", noise.tolist())
    (finding,) = experiment.run().verdict.findings
    assert (finding.quantity, finding.direction) == ("Q gyro bias", "too large")


@pytest.mark.proof
@pytest.mark.parametrize("name", ["ADIS16470", "VN-100", "KVH P-1775", "HG4930"])
def test_what_stands_for_flicker_is_not_called_too_large(name):
    """By what the sensor adds alone a third of the drive would do; the estimates need it."""
    experiment = Experiment(seed=1)
    card(name, assumed=False).load(experiment)
    assert experiment.run().verdict.consistent
    noise = experiment.run().belief.noise.copy()
    noise[6:12] *= 1e5
    experiment.set("navigator.q", noise.tolist())
    directions = {(f.quantity, f.direction) for f in experiment.run().verdict.findings}
    assert ("Q gyro bias", "too large") in directions


def test_a_g_sensitive_gyro_is_no_wrong_p0():
    experiment = Experiment(seed=1)
    card("MPU-6000", assumed=False).load(experiment)
    experiment.set("navigator.estimate_g_sensitivity", False)
    (finding,) = experiment.run().verdict.findings
    assert finding.quantity == "gyro g-sensitivity"


@pytest.mark.proof
@pytest.mark.parametrize("mission", ["montreal", "los_angeles"])
def test_a_rate_of_the_earth_that_is_left_out_is_named_alone(mission):
    """Gyros that err by C_bn ω_ie, accelerometers by 2 C_bn (ω_ie × v): no misalignment, and no noise."""
    for seed in range(1001, 1004):
        settings = {**gallery_lessons()[0].settings, "mission": mission, "seed": seed}
        verdict = FaultyExperiment(FAULTS["earth_rate"]).update(settings).run().verdict
        (finding,) = verdict.findings
        assert finding.quantity == "Earth rate"
        assert finding.factor == pytest.approx(1, abs=0.1)


def test_what_the_rate_of_the_earth_adds_is_that_of_its_equation():
    """Level and northwards at 45°: ω_ie (cos φ, 0, −sin φ), and 2 ω_ie × v = (0, −2 Ω v sin φ, 0)."""
    time = np.arange(1001) * 0.01
    level = np.tile([1.0, 0.0, 0.0, 0.0], (time.size, 1))
    truth = Truth(
        time, np.full(time.size, np.pi / 4), np.zeros(time.size), np.zeros(time.size),
        np.tile([100.0, 0.0, 0.0], (time.size, 1)), level, np.zeros((time.size, 3)),
    )  # fmt: skip
    still = np.zeros((time.size - 1, 3))
    found = exact(Reference(truth, np.zeros((time.size, 6)), still, still), time)
    omega, half = 7.292115e-5, np.sqrt(0.5)
    expected = [omega * half, 0.0, -omega * half, 0.0, -2 * omega * half * 100, 0.0]
    np.testing.assert_allclose(found.earth, np.tile(expected, (10, 1)), rtol=1e-6, atol=1e-15)


@pytest.mark.parametrize("seed", [4, 5])
def test_products_of_attitude_errors_at_the_start_are_beyond_the_linear_model(seed):
    """Poor accelerometers and a start that is wrong by degrees: all that the filter assumes is right."""
    experiment = Experiment(mission="los_angeles", seed=seed)
    experiment.set("sensors.accelerometer.bias_sigma", 20.0)
    experiment.set("navigator.attitude_sigma", (2.0, 2.0, 10.0))
    experiment.set("navigator.alignment", 30.0)
    result = experiment.run()
    (finding,) = result.verdict.findings
    assert (finding.quantity, finding.direction) == ("linear model", "not modelled")
    (change,) = finding.changes
    assert change.path == "navigator.model"
    other = experiment.copy().update({change.path: change.value}).run()
    assert other.consistency.nees.mean() < 0.5 * result.consistency.nees.mean()
    small = experiment.copy().update({"navigator.attitude_sigma": (0.5, 0.5, 2.0)})
    assert small.run().verdict.consistent


def test_a_model_that_cures_too_little_is_not_named():
    """As above, but the nonlinear model leaves half of the excess: NEES of 142 where 15 is right."""
    experiment = Experiment(mission="los_angeles", seed=7)
    experiment.set("sensors.accelerometer.bias_sigma", 20.0)
    experiment.set("navigator.attitude_sigma", (2.0, 2.0, 10.0))
    experiment.set("navigator.alignment", 30.0)
    verdict = experiment.run().verdict
    assert verdict.consistent is False
    assert [finding.quantity for finding in verdict.findings] == ["NEES"]


def test_scale_times_bias_is_no_noise_to_a_filter_with_scale_states():
    experiment = Experiment(seed=1)
    experiment.set("navigator.states", 21)
    experiment.set("sensors.gyro.scale_factor_sigma", 1.0)
    experiment.set("sensors.accelerometer.scale_factor_sigma", 1.0)
    experiment.set("sensors.gyro.noise_density", 0.001)
    experiment.set("sensors.gyro.bias_sigma", 1.0)
    found = [finding.quantity for finding in experiment.run().verdict.findings]
    assert not [quantity for quantity in found if quantity.startswith("Q")]


def test_a_stretch_is_found_and_a_single_fix_is_none():
    values, times = RNG.normal(0, 1, (400, 6)), np.arange(400.0)
    assert stretch(bin_squares(values, times, (0.0, 400.0)), 0) is None
    values[200, :3] = 30.0
    assert stretch(bin_squares(values, times, (0.0, 400.0)), 0) is None
    values[100:140, :3] *= 3
    found = stretch(bin_squares(values, times, (0.0, 400.0)), 0)
    assert (found.first * 400 / BINS, found.last * 400 / BINS) == (100, 140)
    assert float(found.squares.mean) == pytest.approx(9, rel=0.3)
    assert stretch(bin_squares(values, times, (0.0, 400.0)), 1) is None


def test_a_channel_is_named_only_if_the_others_are_right():
    number = np.full(3, 200.0)
    assert channel(Squares(np.array([200.0, 200.0, 200.0]), number)) is None
    assert channel(Squares(np.array([200.0, 1000.0, 190.0]), number)) == 1
    assert channel(Squares(np.array([900.0, 1000.0, 190.0]), number)) is None


def test_selection_takes_the_true_cause_of_two_that_resemble_each_other():
    """Two regressors with a correlation of 0.9; values follow the second, and noise."""
    one = RNG.normal(0, 1, 500)
    other = 0.9 * one + np.sqrt(1 - 0.81) * RNG.normal(0, 1, 500)
    values = 0.8 * other + RNG.normal(0, 1, 500)
    A = np.stack((one, other), axis=1)
    fit = Fit((A.T @ A)[None], (A.T @ values)[None], np.array(values @ values))
    (found,) = select_causes(fit, {"one": [0], "other": [1]}, 10.0)
    assert found.name == "other"
    assert found.estimate[0, 0] == pytest.approx(0.8, abs=5 * found.sigma[0, 0])
    nothing = Fit(fit.matrix, (A.T @ RNG.normal(0, 1, 500))[None], fit.squares)
    assert select_causes(nothing, {"one": [0], "other": [1]}, 10.0) == []


@pytest.mark.parametrize("name", ["ADIS16488", "OpenIMU300ZA"])
def test_a_card_as_loaded_hears_nothing_of_what_its_filter_cannot_show(name):
    """Flicker faster than fixes show, and a lag of 3 ms: errors are as large as the filter says."""
    for seed in range(1001, 1004):
        experiment = Experiment(mission="los_angeles", seed=seed)
        card(name).load(experiment)
        assert not experiment.run().verdict.findings
