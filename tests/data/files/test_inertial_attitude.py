"""The attitude from inertial rates, specific force and velocity: that of the curve all of them come from."""

from __future__ import annotations

import numpy as np
import pytest
from flights import circle

from lab.data.files.inertial_attitude import InertialAttitude, inertial_attitude
from lab.missions import Recording, mission
from lab.motion.frames.rotation import euler_from_C_nb
from lab.motion.truth.trajectory import Trajectory

ARM = np.array([1.0, -0.3, -0.5])
"""From the centre of gravity to a pilot's head [m]."""


def reconstructed(
    recording: Recording, arm: np.ndarray | None = None, seconds: float = 1e9, noise: float = 0.0
) -> tuple[InertialAttitude | None, np.ndarray]:
    """Return what is made of a flight at 50 and 4 Hz, and the errors of roll, pitch and heading [°]."""
    curve = Trajectory.from_recording(recording, 50.0)
    imu_time = np.arange(0.0, min(curve.duration, seconds), 0.02)
    rate, force = curve.rates(imu_time)
    if arm is not None:
        # Groves (3.51): what turns feels more than its centre.
        force = (
            force + np.cross(np.gradient(rate, imu_time, axis=0), arm) + np.cross(rate, np.cross(rate, arm))
        )
    time = np.arange(0.0, imu_time[-1], 0.25)
    truth = curve.at(time)
    velocity_n = truth.velocity_n + np.random.default_rng(3).normal(0.0, noise, truth.velocity_n.shape)
    found = inertial_attitude(time, truth.position, velocity_n, imu_time, rate, force)
    if found is None:
        return None, np.empty(0)
    off = np.degrees(np.angle(np.exp(1j * (euler_from_C_nb(found.C_nb) - truth.euler))))
    return found, np.sqrt(np.mean(off**2, axis=0))


@pytest.mark.parametrize("name", ["montreal", "los_angeles"])
def test_it_is_the_attitude_that_was_flown(name):
    found, errors = reconstructed(mission(name).recording)
    assert found is not None
    assert errors.max() < 1e-3
    assert np.degrees(found.heading_uncertainty) < 0.02
    np.testing.assert_allclose(np.linalg.det(found.C_nb), 1.0, atol=1e-9)


@pytest.mark.parametrize("latitude", [-70.0, 0.0, 60.0])
def test_it_holds_at_every_latitude(latitude):
    found, errors = reconstructed(circle(latitude=latitude))
    assert found is not None
    assert errors.max() < 2e-3


def test_a_pilots_head_off_the_centre_of_gravity_costs_little():
    found, errors = reconstructed(mission("montreal").recording, ARM)
    assert found is not None
    assert errors.max() < 0.15
    assert found.residual > 0.01
    # What it says of itself is on the safe side.
    assert np.degrees(found.heading_uncertainty) > errors[2]


def test_straight_flight_does_not_tell_the_heading():
    straight, off = reconstructed(circle(turn=0.0), noise=0.01)
    turning, fine = reconstructed(circle(), noise=0.01)
    assert straight is not None and turning is not None
    assert np.degrees(straight.heading_uncertainty) > 3.0
    # A second of the turn changes the velocity by 2.4 m/s, which is off by 0.024 m/s.
    assert np.degrees(turning.heading_uncertainty) == pytest.approx(np.degrees(0.01), rel=0.2)
    assert fine.max() < 0.1
    assert off[:2].max() < 0.1  # the horizon it does tell
    assert reconstructed(circle(), seconds=5.0)[0] is None
