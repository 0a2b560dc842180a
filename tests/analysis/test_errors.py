"""Errors: signs, metres and angles against pymap3d, SciPy's rotations and Monte Carlo."""

from __future__ import annotations

import numpy as np
import pymap3d
import pytest
from scipy.spatial.transform import Rotation

from lab.analysis import errors
from lab.motion.frames.east_north_up import NED_TO_ENU, east_north_up
from lab.motion.truth.trajectory import Truth
from lab.navigation.solution import Solution

RNG = np.random.default_rng(11)


def truth(latitude: float, longitude: float, samples: int = 50) -> Truth:
    """Return the truth of a vehicle in one place, in any attitude."""
    attitude = Rotation.random(samples, random_state=RNG)
    return Truth(
        time=np.arange(float(samples)),
        latitude=np.full(samples, np.radians(latitude)),
        longitude=np.full(samples, np.radians(longitude)),
        height=np.full(samples, 500.0),
        velocity_n=RNG.normal(0, 50, (samples, 3)),
        q_nb=attitude.as_quat(scalar_first=True),
        euler=attitude.as_euler("ZYX")[:, ::-1],
    )


def displaced(there: Truth, metres: np.ndarray) -> np.ndarray:
    """Return positions (n, 3) that are metres (n, 3) north, east, down of the truth, by pymap3d."""
    position = pymap3d.ned2geodetic(
        *metres.T, np.degrees(there.latitude), np.degrees(there.longitude), there.height
    )
    return np.stack((np.radians(position[0]), np.radians(position[1]), position[2]), axis=-1)


@pytest.mark.parametrize("latitude", [-70.0, -33.9, 0.0, 45.0, 80.0])
@pytest.mark.parametrize("longitude", [-73.7, 179.99999, -179.99999])
def test_position_error_is_estimate_minus_truth_in_metres(latitude, longitude):
    """Up to the curvature of the parallels, (10 m)² tan L / R: 0.1 mm."""
    there = truth(latitude, longitude)
    metres = RNG.normal(0, 3, (50, 3))
    error = errors.position_error(displaced(there, metres), there)
    assert np.allclose(error, metres, atol=1e-4)


def test_east_north_up():
    assert east_north_up(np.array([(1.0, 2.0, 3.0)])).tolist() == [[2.0, 1.0, -3.0]]
    assert (NED_TO_ENU @ (1.0, 2.0, 3.0)).tolist() == [2.0, 1.0, -3.0]


@pytest.mark.parametrize("size", [1e-12, 1e-6, 0.1, 3.0])
def test_attitude_error_is_the_rotation_of_the_computed_navigation_frame(size):
    """Ĉ_nb = exp(−[φ×]) C_nb, either sign of either quaternion."""
    phi = RNG.normal(0, 1, (200, 3))
    phi *= size / np.linalg.norm(phi, axis=1)[:, None]
    C_nb = Rotation.random(200, random_state=RNG)
    estimate = Rotation.from_rotvec(-phi) * C_nb
    signs = RNG.choice([-1, 1], (2, 200, 1))
    found = errors.attitude_error(
        signs[0] * estimate.as_quat(scalar_first=True), signs[1] * C_nb.as_quat(scalar_first=True)
    )
    assert np.allclose(found, phi, rtol=1e-9, atol=1e-15)


def test_no_attitude_error_is_zero():
    q = Rotation.random(20, random_state=RNG).as_quat(scalar_first=True)
    assert np.abs(errors.attitude_error(q, -q)).max() < 1e-15


def test_error_state_holds_each_error_in_its_place():
    there = truth(-33.9, 151.2)
    x = RNG.normal(0, 1, (50, 15)) * np.repeat((3.0, 1.0, 0.01, 0.001, 0.1), 3)
    bias = RNG.normal(0, 0.1, (50, 6))
    solution = Solution.empty(50, 0)
    solution.position[:] = displaced(there, x[:, 0:3])
    solution.velocity_n[:] = there.velocity_n + x[:, 3:6]
    C_nb = Rotation.from_quat(there.q_nb, scalar_first=True)
    solution.q_nb[:] = (Rotation.from_rotvec(-x[:, 6:9]) * C_nb).as_quat(scalar_first=True)
    solution.bias[:] = bias + x[:, 9:]
    samples = np.array([3, 49, 0])
    assert np.allclose(errors.error_state(solution, samples, there, bias), x[samples], rtol=1e-8, atol=3e-5)


def covariance(samples: int) -> np.ndarray:
    """Return positive definite matrices (samples, 3, 3) about as large as 1e-4 rad squared."""
    A = RNG.normal(0, 1e-4, (samples, 3, 3))
    return A @ np.swapaxes(A, 1, 2)


def test_block_matrices_put_every_element_in_its_place():
    P = covariance(5)
    off = P[:, [0, 0, 1], [1, 2, 2]]
    assert np.array_equal(errors.block_matrices(np.diagonal(P, axis1=1, axis2=2), off), P)


@pytest.mark.parametrize("euler", [(0, 0, 0), (20, 5, -130), (-60, -40, 95), (170, 70, 179)])
def test_sigma_of_the_euler_angles_against_monte_carlo(euler):
    """Rotate the attitude by draws of φ and look at the spread of the angles SciPy reads off."""
    draws = 20_000
    P = covariance(1)
    phi = RNG.multivariate_normal(np.zeros(3), P[0], draws)
    C_nb = Rotation.from_euler("ZYX", euler[::-1], degrees=True)
    angles = (Rotation.from_rotvec(-phi) * C_nb).as_euler("ZYX")[:, ::-1]
    spread = np.std((angles - np.radians(euler) + np.pi) % (2 * np.pi), axis=0)
    variance, off = np.diagonal(P, axis1=1, axis2=2), P[:, [0, 0, 1], [1, 2, 2]]
    sigma = errors.euler_sigma(np.radians([euler]), variance, off)[0]
    assert np.allclose(sigma / spread, 1, atol=5 / np.sqrt(2 * draws))


def test_sigma_of_fully_correlated_angles_is_a_number():
    """A covariance of rank one gives an angle without variance, where roundoff must not make it negative."""
    directions = RNG.normal(0, 1, (1000, 3))
    P = np.einsum("ni,nj->nij", directions, directions)
    euler = np.stack(
        (np.zeros(1000), np.zeros(1000), np.arctan2(directions[:, 1], directions[:, 0])), axis=-1
    )
    sigma = errors.euler_sigma(euler, np.diagonal(P, axis1=1, axis2=2), P[:, [0, 0, 1], [1, 2, 2]])
    assert np.isfinite(sigma).all()
    # φ lies along the heading: the pitch does not feel it.
    assert np.abs(sigma[:, 1]).max() < 1e-7
