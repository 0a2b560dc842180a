"""Faults of the gallery: each is what it says, only there, and gives itself away."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from dashboards.ensembles import ensemble
from lab.base.parameters.setting_error import SettingError
from lab.classroom.gallery import faults
from lab.classroom.gallery.faults import FAULTS
from lab.classroom.gallery.faulty_experiment import NOTE, FaultyExperiment
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from tests.benchmarks.gallery_matrix import MATCHED, Signature, run, shared, signature

EARTH_RATE = 2 * np.pi / 86164.0905
"""Rate of the Earth from the length of the sidereal day [rad/s]."""
PERFECT: Mapping[str, Any] = {
    "mission": "los_angeles",
    "trajectory": {"imu_rate": 50},
    "sensors": {
        "gyro": {"noise_density": 0.0, "bias_sigma": 0.0, "instability": 0.0},
        "accelerometer": {"noise_density": 0.0, "bias_sigma": 0.0, "instability": 0.0},
        "gps": {"outages": [[0, 1000]]},
    },
    "navigator": {"position_sigma": 1e-6, "velocity_sigma": 1e-6, "attitude_sigma": 1e-6},
}
"""Perfect sensors, a perfect start and no fix: a fault alone acts on the navigator."""


def pair(fault: str, settings: Mapping[str, Any]) -> tuple[Result, Result]:
    """Return a run without and with a fault."""
    return Experiment().update(settings).run(), FaultyExperiment(FAULTS[fault]).update(settings).run()


def test_a_navigator_that_subtracts_gravity_rises_with_twice_of_it() -> None:
    _, faulty = pair("gravity", PERFECT)
    height = faulty.errors.position.sel(axis="up").values
    second = int(np.searchsorted(faulty.time, 1.0))
    assert height[second] == pytest.approx(9.797, abs=0.02)  # 2 g t² / 2, g at 34° of latitude


def test_a_navigator_without_the_rate_of_the_earth_turns_with_it() -> None:
    clean, faulty = pair("earth_rate", PERFECT)
    at = int(np.searchsorted(faulty.time, 30.0))
    q, p = clean.solution_arrays.q_nb[at], faulty.solution_arrays.q_nb[at]
    angle = 2 * np.arccos(min(abs(float(q @ p)), 1.0))
    assert angle == pytest.approx(EARTH_RATE * 30.0, rel=0.02)


FIXES: Mapping[str, Any] = {"mission": "los_angeles", "trajectory": {"imu_rate": 50}}


def test_the_fixes_of_a_forgotten_lever_arm_are_those_of_the_antenna() -> None:
    clean, faulty = pair("lever_arm", FIXES)
    off = faulty.fixes.position_error - clean.fixes.position_error
    assert np.linalg.norm(off, axis=1) == pytest.approx(np.linalg.norm(faults.LEVER_ARM), rel=1e-4)
    assert not faulty.belief.lever_arm.any()


def test_late_fixes_lie_behind_by_the_speed_times_the_latency() -> None:
    clean, faulty = pair("latency", FIXES)
    off = np.linalg.norm(faulty.fixes.position_error - clean.fixes.position_error, axis=1)
    speed = np.linalg.norm(clean.truth.velocity.sel(time=clean.fixes.time, method="nearest").values, axis=1)
    assert off == pytest.approx(speed * faults.LATE, abs=0.1)
    assert faulty.latency == 0.0


def test_r_noise_stamps_and_rates_are_changed_as_they_say() -> None:
    clean, faulty = pair("r", FIXES)
    assert np.allclose(10 * faulty.belief.R, clean.belief.R, rtol=1e-12, atol=0)
    assert np.array_equal(faulty.fixes.position, clean.fixes.position)
    _, faulty = pair("coloured", FIXES)
    off = faulty.fixes.position_error - clean.fixes.position_error
    assert off.std() == pytest.approx(faults.COLOURED, rel=0.5)
    assert np.corrcoef(off[:-1, 0], off[1:, 0])[0, 1] > 0.9
    _, faulty = pair("jitter", FIXES)
    assert sorted(map(tuple, faulty.fixes.position)) == sorted(map(tuple, clean.fixes.position))
    assert np.all(np.diff(faulty.fixes.time) >= 0)
    assert np.std(faulty.fixes.time - clean.fixes.time) == pytest.approx(faults.JITTER, rel=0.2)
    gyros = clean.gyro.increments
    quiet = {**FIXES, "sensors": {"gyro": {"noise_density": 0.0, "bias_sigma": 0.0}}}
    still, scaled = pair("scale", quiet)
    assert scaled.gyro.increments == pytest.approx(1.01 * still.gyro.increments)
    _, faulty = pair("degrees", FIXES)
    assert faulty.gyro.increments == pytest.approx(gyros * 57.29577951308232)
    _, faulty = pair("axes", FIXES)
    assert np.array_equal(faulty.gyro.increments[:, [1, 0, 2]], gyros)


def test_a_fault_is_hidden_and_only_where_it_was_put() -> None:
    experiment = FaultyExperiment(FAULTS["scale"]).update(FIXES)
    clean = Experiment().update(FIXES)
    assert experiment.to_dict() == clean.to_dict()
    assert experiment.to_toml() == f"# {NOTE}\n{clean.to_toml()}".replace("seed = 1\n", "")
    twin = experiment.copy()
    twin.set("navigator.states", 21)
    faulty = twin.run()
    assert NOTE in faulty.remarks
    assert NOTE in repr(faulty)
    assert isinstance(faulty.experiment.copy(), FaultyExperiment)
    plain = Experiment().update(faulty.experiment.to_dict()).run()
    assert NOTE not in plain.remarks
    assert not np.array_equal(plain.gyro.increments, faulty.gyro.increments)
    assert not np.array_equal(plain.solution_arrays.position, faulty.solution_arrays.position)
    again = Experiment().update(faulty.experiment.to_dict()).run()
    assert np.array_equal(plain.solution_arrays.position, again.solution_arrays.position)


def test_many_runs_have_the_fault_too_and_are_kept_apart() -> None:
    clean, faulty = pair("scale", FIXES)
    one, other = (ensemble(result, 2, lambda *_: None) for result in (clean, faulty))
    assert float(np.mean(other.mean_nees)) > 1.05 * float(np.mean(one.mean_nees))


def test_no_setting_and_no_log_gives_a_fault() -> None:
    paths = [path for path, *_ in Experiment().leaves()]
    assert not [path for path in paths if "fault" in path or "hidden" in path or "gallery" in path]
    with pytest.raises(SettingError):
        Experiment().update({"fault": "gravity"})
    with pytest.raises(SettingError):
        Experiment().set("hidden", "gravity")


@pytest.fixture(scope="module")
def seen() -> dict[str, Signature]:
    """Return the signature of one run of each fault, and of none."""
    return {name: signature(run(name, "los_angeles", 1)) for name in (MATCHED, *FAULTS)}


@pytest.mark.proof
def test_each_fault_has_a_signature_that_differs_from_all_others(seen: dict[str, Signature]) -> None:
    assert len(set(seen.values())) == len(FAULTS) + 1
    assert seen[MATCHED] == Signature("-", "=", "=", "=", "=")
    assert shared({name: Counter([one]) for name, one in seen.items()}, verdict=True) == []


CAUSES = {
    "lever_arm": "GPS lever arm",
    "latency": "GPS latency",
    "coloured": "GPS correlation",
    "scale": "gyro scale factor",
    "degrees": "gyro scale factor",
    "jitter": "R position",
}
"""What the verdict names of the faults that it has a word for."""


@pytest.mark.parametrize("fault", CAUSES)
def test_the_verdict_names_what_it_has_a_word_for(seen: dict[str, Signature], fault: str) -> None:
    assert seen[fault].verdict == CAUSES[fault]
