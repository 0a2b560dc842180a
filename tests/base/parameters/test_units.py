"""Units: every unit a setting may have, against its definition."""

from __future__ import annotations

import numpy as np
import pytest

from lab.base.parameters.units import TO_SI, si
from lab.experiment.datasets.flight import STATE_UNITS
from lab.experiment.experiment import Experiment
from lab.sensors.imu import AccelerometerErrors, GyroErrors

KNOWN = {
    "°": np.pi / 180,
    "°/s": np.pi / 180,
    "(°/s)²": (np.pi / 180) ** 2,
    "°/h": np.pi / 180 / 3600,
    "°/s/√Hz": np.pi / 180,
    "g": 9.80665,
    "mg": 9.80665e-3,
    "µg/√Hz": 9.80665e-6,
    "ppm": 1e-6,
    "°/√h": np.pi / 180 / np.sqrt(3600),
    "°/h/√Hz": np.pi / 180 / 3600,
    "µg": 9.80665e-6,
    "mg/√Hz": 9.80665e-3,
    "m/s/√h": 1 / np.sqrt(3600),
    "ft/s/√h": 0.3048 / np.sqrt(3600),
    "%": 0.01,
    "°/h/√h": np.pi / 180 / 3600 / np.sqrt(3600),
    "mg/√h": 9.80665e-3 / np.sqrt(3600),
    "°/s/g": np.pi / 180 / 9.80665,
    "°/h/g": np.pi / 180 / 3600 / 9.80665,
    "mrad": 1e-3,
    "″": np.pi / 180 / 3600,
    "°/h²": np.pi / 180 / 3600**2,
    "mm/s": 1e-3,
    "mg/h": 9.80665e-3 / 3600,
    "°/s/K": np.pi / 180,
    "mg/K": 9.80665e-3,
    "%/K": 0.01,
    "K/km": 1e-3,
}


@pytest.mark.parametrize("unit", TO_SI)
def test_factor_to_si(unit):
    assert TO_SI[unit] == pytest.approx(KNOWN.get(unit, 1.0), rel=1e-15)


def test_every_unit_of_a_setting_and_of_a_state_is_in_the_table():
    units = {getattr(owner.param[name], "unit", "") for _, owner, name in Experiment().leaves()}
    assert units | set(STATE_UNITS) <= set(TO_SI)
    assert len(units) > 8


def test_settings_become_si():
    assert np.allclose(si(GyroErrors(bias=(1, 2, 3)), "bias"), np.radians((1, 2, 3)), rtol=1e-15)
    assert si(AccelerometerErrors(range=2), "range") == pytest.approx(19.6133)
