"""Levelling by the specific force: attitudes without a force across the forward axis."""

from __future__ import annotations

import numpy as np
import pytest

from lab.navigation.alignment.alignment import level

GRAVITY = np.array([0.0, 0.0, -9.81])


@pytest.mark.parametrize(("forward", "pitch"), [(9.81, 90.0), (-9.81, -90.0)])
def test_a_device_that_stands_on_its_end_has_a_pitch(forward: float, pitch: float) -> None:
    # At rest the specific force points up: along the forward axis of a device whose nose is up.
    roll, found = level(np.array([forward, 0.0, 0.0]), GRAVITY, 0.3)
    assert np.isfinite(roll)
    assert np.degrees(found) == pytest.approx(pitch, abs=1e-9)


def test_no_force_at_all_gives_numbers() -> None:
    assert np.isfinite(level(np.zeros(3), GRAVITY, 0.3)).all()
