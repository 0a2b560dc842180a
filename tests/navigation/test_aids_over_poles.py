"""Barometer, heading sensor and odometer over a pole: innovations as large as assumed, also close to it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from polar_flights import FLIGHTS, over_the_pole

from lab.experiment.experiment import Experiment
from lab.experiment.stages import CACHE
from lab.motion.recordings.flight_csv import write_flight_csv
from lab.navigation import aids

SEEDS = 6
SENSORS = {
    "trajectory.imu_rate": 50.0,
    "sensors.gyro.noise_density": 0.005,
    "sensors.gyro.bias_sigma": 0.01,
    "sensors.accelerometer.bias_sigma": 0.2,
    "sensors.barometer.fitted": True,
    "sensors.heading.fitted": True,
    "sensors.heading.period": 0.95,
    "sensors.odometer.fitted": True,
    "navigator.mechanization": "wander azimuth",
}
"""Readings between the samples of the IMU too, so that north has turned since."""


@pytest.mark.proof
@pytest.mark.parametrize("model", ["phi", "nonlinear"])
def test_other_sensors_over_a_pole_are_consistent(model: str, tmp_path: Path) -> None:
    """Straight over it, where the heading turns by 180° at once, and about it in a curve."""
    for name in ("straight over the north pole", "in a curve by the south pole"):
        path = tmp_path / "pole.csv"
        write_flight_csv(path, over_the_pole(**FLIGHTS[name], duration=81.0))
        nees, squares, close = [], [], []
        for seed in range(SEEDS):
            experiment = Experiment(mission=str(path), seed=seed)
            experiment.update(SENSORS | {"navigator.model": model})
            result = experiment.run()
            solution, kind = result.solution_arrays, result.aids.kind
            found = solution.aid_innovation**2 / solution.aid_variance
            away = (np.pi / 2 - np.abs(result.truth_arrays.latitude)) * 6.4e6
            near = np.interp(result.aids.time, result.time, away) < 1000
            assert (solution.aid_sample >= 0).all()
            nees.append(float(result.consistency["nees"].mean()) / 18)
            squares.append([found[kind == one].mean() for one in (aids.HEIGHT, aids.FORWARD, aids.HEADING)])
            close.append(found[(kind == aids.HEADING) & near].mean())
        CACHE.clear()
        print(
            f"\n{model}, {name}: NEES {np.mean(nees):.2f}, NIS {np.mean(squares, axis=0).round(2)}, ", end=""
        )
        print(f"of headings within a kilometre {np.mean(close):.2f}")
        # 480 readings of each sensor; 40 within a kilometre.
        np.testing.assert_allclose(np.mean(squares, axis=0), 1, atol=0.25)
        assert 0.5 < np.mean(close) < 1.5
        assert 0.6 < np.mean(nees) < 1.5
