"""Noise as the variance of a sample: against simulated samples, in files and on the command line."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.base.parameters.setting_error import SettingError
from lab.experiment.experiment import Experiment

UNITS = {"gyro": np.radians(1) ** 2, "accelerometer": 1.0}
"""(°/s)² and (m/s²)² in SI units."""


@pytest.mark.parametrize("rate", [50, 200])
def test_samples_have_the_variance_that_was_given(rate: int) -> None:
    """White noise alone: increments over the interval, minus the true ones, are that variance."""
    experiment = Experiment(mission="los_angeles")
    experiment.set("trajectory.imu_rate", rate)
    given_variance = {"gyro": (0.1, 0.4, 0.2), "accelerometer": (0.01, 0.02, 0.03)}
    for triad, variance in given_variance.items():
        experiment.set(f"sensors.{triad}.noise_variance", variance)
        experiment.set(f"sensors.{triad}.bias_sigma", 0)
    result = experiment.run()
    for triad, true in (("gyro", result.ideal.dtheta), ("accelerometer", result.ideal.dvelocity)):
        noise = (getattr(result, triad).increments - true) / result.ideal.dt
        found = noise.var(axis=0) / UNITS[triad]
        # The variance of n samples is known to √(2 / n).
        assert found == pytest.approx(given_variance[triad], rel=5 * np.sqrt(2 / len(noise)))


@pytest.mark.proof
@given(
    variance=st.tuples(*[st.floats(1e-8, 0.09)] * 3),
    rate=st.floats(10, 2000),
    triad=st.sampled_from(sorted(UNITS)),
)
def test_what_is_given_is_shown_and_the_density_alone_is_kept(
    variance: tuple[float, ...], rate: float, triad: str
) -> None:
    toml = f"[sensors.{triad}]\nnoise_variance = {list(variance)}\n[trajectory]\nimu_rate = {rate}\n"
    experiment = Experiment.from_toml(toml)
    assert experiment.get(f"sensors.{triad}.noise_variance") == pytest.approx(variance, rel=1e-12)
    again = Experiment.from_toml(experiment.to_toml())
    assert again.to_dict() == experiment.to_dict()
    assert "noise_variance" not in experiment.to_toml()
    by_assignments = Experiment()
    by_assignments.set_texts(
        [f"sensors.{triad}.noise_variance={list(variance)}", f"trajectory.imu_rate={rate}"]
    )
    assert by_assignments.to_dict() == experiment.to_dict()


def test_another_rate_changes_the_variance_and_not_the_density() -> None:
    experiment = Experiment()
    density, before = experiment.sensors.gyro.noise_density, experiment.get("sensors.gyro.noise_variance")
    assert before == pytest.approx((0.05**2 * 200,) * 3)
    experiment.set("trajectory.imu_rate", 100)
    assert experiment.get("sensors.gyro.noise_variance") == pytest.approx(np.array(before) / 2)
    assert experiment.sensors.gyro.noise_density == density


@pytest.mark.parametrize("path", Experiment.OTHER_FORMS)
def test_both_ends_of_the_bounds_are_accepted(path: str) -> None:
    experiment = Experiment()
    for rate in (10.0, 33.3, 200.0, 2000.0):
        experiment.set("trajectory.imu_rate", rate)
        for end in experiment.derived(path).declaration.bounds:
            experiment.set(path, end)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (-1.0, r"accepted is one number, or 3 \(x, y, z\), each from 0 to 20000 \(°/s\)²"),
        (1e9, "is not from 0 to 20000"),
        ("much", "got 'much'"),
        ([1, 2], "needs one number, or 3"),
        (float("nan"), "not a finite number"),
        (True, "needs one number|not a finite number"),
        (None, "needs one number"),
    ],
)
def test_nonsense_is_refused_with_what_is_accepted(value: Any, words: str) -> None:
    experiment = Experiment()
    with pytest.raises(SettingError, match=r"sensors\.gyro\.noise_variance = .*" + words):
        experiment.set("sensors.gyro.noise_variance", value)
    assert experiment.to_dict() == Experiment().to_dict()


def test_both_forms_at_once_are_refused() -> None:
    with pytest.raises(SettingError, match="noise_variance and noise_density are two forms of one setting"):
        Experiment.from_toml("[sensors.gyro]\nnoise_variance = 0.1\nnoise_density = 0.1\n")
