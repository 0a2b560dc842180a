"""Contradiction: faults of a log that look like noise are named, and noise that is there is stated."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from dashboards.verdict_chip import card_html, named
from lab.analysis.identification import contradiction
from lab.analysis.identification.contradiction import shown_noise
from lab.cli.run import verdict_text
from lab.data.log.auxiliary_data import AuxiliaryData, Headings
from lab.data.log.sensor_log import GnssLog, SensorLog, repair_log
from lab.experiment.result import Result
from lab.live.live_verdict import run_batch
from lab.missions import mission
from lab.motion.truth.trajectory import Trajectory
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import Imu
from lab.sensors.suite import SensorSuite
from tests.benchmarks import log_matrix
from tests.benchmarks.log_matrix import SAME, clipped, clock, columns, lost, signs
from tests.sensor_logs import Tables, tables

SPAN = (20.0, 110.0)


def log_of(
    seed: int = 1001, damage=None, headings: float | None = None, made: Tables | None = None
) -> SensorLog:
    """Return a log of a flight with a fault, and headings that are off by an angle [°]."""
    made = tables(*SPAN, seed=seed) if made is None else made
    imu, gnss, reference = made if damage is None else damage(made, np.random.default_rng(seed))
    fixes = GnssLog(
        time=gnss[:, 0],
        position=np.column_stack((np.radians(gnss[:, 1:3]), gnss[:, 3])),
        velocity_n=gnss[:, 4:7],
        position_sigma=gnss[:, 7:10],
        velocity_sigma=gnss[:, 10:],
        lever_arm=np.zeros(3),
        latency=0.0,
    )
    beside = AuxiliaryData()
    if headings is not None:
        measured = np.radians(reference[:, -1] + headings)
        beside = AuxiliaryData(headings=Headings(reference[:, 0], measured, np.full(measured.size, 0.03)))
    return repair_log("flight", imu[:, 0], imu[:, 1:], fixes, auxiliary=beside)


def run(log: SensorLog) -> Result:
    """Return the run of a log with the settings of a start."""
    return run_batch(log, SensorSuite(), NavigatorSettings())


FAULTS = {
    "accelerometer axes": ("forward accelerometer has the wrong sign", columns(SAME, signs(-1, 1, 1))),
    "gyro axes": ("forward gyro has the wrong sign", columns(signs(-1, 1, 1), SAME)),
    "IMU axes": ("left-handed", columns(signs(1, -1, 1), signs(1, -1, 1))),
    "IMU clock": ("slow", clock(-0.005)),
    "gyro range": ("the down one stands at", clipped(0, 2, 0.4)),
}


@pytest.mark.proof
def test_a_sensor_that_stands_at_its_end_most_of_the_time_is_named():
    """On this flight, the noise of the gyros makes the innovations consistent, and no other does."""
    flown = Trajectory.from_recording(mission("los_angeles").recording, 100.0)
    made = tables(5.0, 100.0, seed=1001, flight=flown)
    log = log_of(made=clipped(1, 0, 0.5)(made, np.random.default_rng(1)))
    (finding,) = run(log).innovation_verdict.findings
    assert finding.quantity == "accelerometer range"
    assert "the forward one stands at" in finding.sentence


@pytest.mark.proof
@pytest.mark.parametrize("quantity", FAULTS)
def test_a_fault_of_the_log_is_named_and_not_a_noise_that_covers_it(quantity):
    words, damage = FAULTS[quantity]
    (finding,) = run(log_of(damage=damage)).verdict.findings
    assert finding.quantity == quantity
    assert words in finding.sentence
    assert not finding.changes
    assert "Tried" in finding.advice


@pytest.mark.proof
def test_triads_that_are_turned_against_each_other_may_both_be_wrong():
    """Without a vehicle that follows its nose, nothing tells which of them is right."""
    (finding,) = run(log_of(damage=columns(signs(-1, -1, 1), SAME))).verdict.findings
    assert "The forward and the right gyro have the wrong signs" in finding.sentence
    assert "Or, as likely: The forward and the right" in finding.sentence


def test_a_log_without_a_fault_is_consistent_and_nothing_is_tried(monkeypatch):
    monkeypatch.setattr(contradiction, "Trials", None)
    assert run(log_of()).verdict.consistent


def test_gaps_whose_noise_the_filter_knows_are_no_fault():
    """A third of the samples is lost, some in a row: the filter has large variances there."""
    assert run(log_of(damage=lost(1 / 3, 20))).verdict.consistent


@pytest.mark.proof
def test_a_clock_is_named_where_late_fixes_or_noise_of_the_imu_would_be_as_likely():
    made = clock(0.003)(tables(20.0, 120.0, seed=1004), np.random.default_rng(1004))
    (finding,) = run(log_of(made=made)).verdict.findings
    assert finding.quantity == "IMU clock"
    assert "fast" in finding.sentence


@pytest.mark.proof
def test_a_clock_that_agrees_at_the_end_is_as_fast_as_it_was_made():
    """The search begins where both clocks agree: within its few steps, it must not end on the way."""
    made = clock(0.03, agrees=-1)(tables(20.0, 140.0, seed=1001), np.random.default_rng(1001))
    (finding,) = run(log_of(made=made)).verdict.findings
    assert finding.quantity == "IMU clock"
    assert "runs 3 % fast" in finding.sentence


@pytest.mark.parametrize("longest", [1, 20])
def test_losses_that_the_filter_allows_for_are_named_before_it_is_called_consistent(longest):
    whole = tables(*SPAN, seed=1001)
    kept = lost(1 / 3, longest)(whole, np.random.default_rng(1001))
    verdict = run(log_of(made=kept)).verdict
    assert verdict.consistent
    lost_part, said = verdict.headline.split(" % of the samples of the IMU are lost: ")
    assert float(lost_part) == pytest.approx(100 * (1 - len(kept.imu) / len(whole.imu)), abs=2)
    assert "Consistent: " in said
    assert named(verdict) == "● Consistent, IMU losses"
    assert verdict.note.counsel in repr(verdict)
    assert verdict.note.counsel in verdict_text(verdict)
    assert "where samples are lost" in card_html(verdict, tried=True)


def test_single_lost_samples_are_not_named():
    verdict = run(log_of(damage=lost(0.01))).verdict
    assert verdict.note is None
    assert verdict.headline.startswith("Consistent: ")


def vibrating(times: float):
    """Return what adds white noise to the accelerometers, in their assumed σ."""

    def damage(log: Tables, rng: np.random.Generator) -> Tables:
        imu = log.imu.copy()
        density = float(np.max(SensorSuite().accelerometer.noise_density)) * 9.80665e-6
        imu[:, 4:] += rng.normal(scale=times * density * 10, size=(len(imu), 3))
        return log._replace(imu=imu)

    return damage


@pytest.mark.proof
def test_a_vibrating_aeroplane_gets_the_noise_that_it_needs():
    """60 × the assumed noise is 3,600 × its variance: it shows in the samples, and is stated."""
    (finding,) = run(log_of(damage=vibrating(60.0))).verdict.findings
    assert finding.quantity in ("gain", "Q accelerometer")
    assert 3600 / 3 < finding.factor < 3600 * 3
    assert finding.changes[0].rows == (3, 6)


@pytest.mark.proof
def test_an_unknown_fault_is_a_contradiction_in_its_channel():
    """The gyro about down shows what it showed 6 to 9 s before: no axis, no clock and no noise explains it.

    How much each explains depends on what the filter rejects, and so on rounding. In one of eight cases, a
    stretch of large innovations explains as much, which is true as well.
    """
    delays = 600, 700, 800, 900

    def damaged(samples: int) -> Callable[[Tables, np.random.Generator], Tables]:
        def damage(log: Tables, _rng: np.random.Generator) -> Tables:
            imu = log.imu.copy()
            imu[:, 3] = np.roll(imu[:, 3], samples)
            return log._replace(imu=imu)

        return damage

    named = 0
    for samples in delays:
        (finding,) = run(log_of(damage=damaged(samples))).verdict.findings
        assert finding.quantity in ("contradiction", "GPS or IMU")
        assert not finding.changes
        named += finding.quantity == "contradiction" and "gyro" in finding.sentence
    assert named >= len(delays) - 1


@pytest.mark.proof
def test_headings_that_are_off_by_half_a_turn_are_named():
    assert run(log_of(headings=0.0)).verdict.consistent
    (finding,) = run(log_of(headings=180.0)).verdict.findings
    assert finding.quantity == "headings"
    assert "180°" in finding.sentence


@pytest.mark.parametrize("rate", [50.0, 200.0])
def test_noise_that_the_samples_show_is_their_density(rate):
    """White noise of 0.01 rad/s/√Hz, and a slow turn beside it."""
    count, rng = int(200 * rate), np.random.default_rng(1)
    time = np.arange(count + 1) / rate
    turn = np.sin(time[1:] / 10)[:, None] * 0.5
    noise = 0.01 * rng.normal(size=(count, 3)) * np.sqrt(rate)
    shown = shown_noise(Imu(time, (turn + noise) / rate, np.zeros((count, 3))))
    np.testing.assert_allclose(shown[:3], 1e-4, rtol=0.2)
    assert not shown[3:].any()


GYROS = {name: fault for name, fault in log_matrix.FAULTS.items() if "gyro" in name and "range" not in name}


@pytest.mark.parametrize("name", GYROS)
def test_the_log_matrix_counts_the_sentence_of_no_other_fault_of_the_gyros(name: str) -> None:
    """The refusal by banked turns shows the right axis only: it is the same for two faults."""
    for other, fault in GYROS.items():
        for sentence in fault.said:
            if "nose" not in sentence:
                assert GYROS[name].is_named(f"{sentence} and more") == (name == other)
    nose = log_matrix.NOSE.format("minus forward") + "correlation 0.93), not about right"
    assert not GYROS[name].is_named(nose)
