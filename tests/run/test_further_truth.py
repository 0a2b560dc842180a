"""Further truth: the errors of other sensors are what they are, whether or not they show in a reading."""

from __future__ import annotations

import numpy as np
import pytest

from lab import Experiment
from lab.sensors.suite import OTHER_SENSORS

SENSORS = OTHER_SENSORS
STATE = {"barometer": "barometer bias", "heading": "heading sensor bias"}
DRIFTING: dict[str, object] = {
    "trajectory.imu_rate": 20.0,
    **{f"sensors.{name}.fitted": True for name in SENSORS},
    "sensors.barometer.drift_sigma": 3.0,
    "sensors.barometer.correlation_time": 20.0,
    "sensors.heading.drift_sigma": 2.0,
    "sensors.heading.correlation_time": 30.0,
}


def of(changes: dict[str, object]) -> Experiment:
    return Experiment(mission="montreal").update(DRIFTING | changes)


@pytest.mark.parametrize("outage", [(40.0, 100.0), (100.0, 1e4), (0.0, 1e4)])
def test_an_outage_of_a_sensor_does_not_change_its_errors(outage: tuple[float, float]) -> None:
    """From its first reading on; before it, there is nothing to interpolate in."""
    whole, part = (
        of({f"sensors.{name}.outages": outages for name in SENSORS}).run() for outages in ([], [outage])
    )
    assert part.aids.time.size < whole.aids.time.size
    np.testing.assert_array_equal(part.true_further(), whole.true_further())
    assert np.ptp(whole.true_further(), axis=0)[:2].min() > 0.01


@pytest.mark.proof
@pytest.mark.parametrize("name", SENSORS)
@pytest.mark.parametrize("outages", [[(0.0, 1e4)], []])
def test_nees_is_known_if_a_sensor_never_reads(name: str, outages: list[tuple[float, float]]) -> None:
    """Not one reading: in an outage, or with a period that is longer than the flight."""
    changes = {f"sensors.{name}.fitted": True, "trajectory.imu_rate": 20.0}
    changes |= {f"sensors.{name}.outages": outages} if outages else {f"sensors.{name}.period": 60.0}
    mission = "montreal" if outages else "los_angeles"
    result = Experiment(mission=mission).update(changes).run()
    assert np.isfinite(result.true_further()).all()
    assert np.isfinite(result.consistency.nees).all()
    assert not any("nan" in finding.sentence for finding in result.verdict.findings)


@pytest.mark.parametrize("name", ["barometer", "heading"])
def test_readings_are_truth_and_bias_and_noise(name: str) -> None:
    """Noise without its σ is a normal variable: 2,000 readings know its size to 5 % (3 σ)."""
    result = of({f"sensors.{name}.period": 0.1, f"sensors.{name}.outages": [(60.0, 90.0)]}).run()
    found, states = result.readings[name], result.further_states.truth
    time, truth = result.time, result.truth_arrays
    bias = np.interp(found.time, time, states.sel(state=STATE[name]))
    true = truth.height if name == "barometer" else np.unwrap(np.degrees(truth.euler[:, 2]), period=360)
    value = found.value if name == "barometer" else np.degrees(found.value)
    off = value - np.interp(found.time, time, true) - bias
    if name == "heading":
        off = (off + 180) % 360 - 180
    assert abs(off.std() / float(getattr(result.experiment.sensors, name).noise) - 1) < 0.06
