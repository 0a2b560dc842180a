"""Rest: it is found, it shows the biases of the gyros, and nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lab.analysis.errors import error_state
from lab.experiment import Experiment
from lab.navigation.standstill import SHORTEST
from lab.result import Result

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
        np.testing.assert_allclose(
            np.degrees(np.sqrt(result.solution_arrays.variance[0, 9:12])), density / np.sqrt(30), rtol=1e-9
        )
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1, abs=0.3)
