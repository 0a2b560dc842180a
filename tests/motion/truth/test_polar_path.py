"""The curve in Earth-fixed axes: elsewhere it is the ordinary one, and at a pole it follows the recording."""

from __future__ import annotations

import numpy as np
import pytest

from lab.missions import mission
from lab.motion.frames import earth, ecef, rotation
from lab.motion.recordings.recording import Recording
from lab.motion.truth.flight_paths import PolarPath
from lab.motion.truth.trajectory import Trajectory


def test_elsewhere_it_is_the_ordinary_curve() -> None:
    """Truth and ideal IMU of a shipped mission, by other coordinates and other equations."""
    recording = mission("los_angeles").recording
    usual = Trajectory.from_recording(recording, 200)
    polar = Trajectory(usual.time, PolarPath.through(recording, usual.time), 200)
    one, other = usual.at(usual.time), polar.at(usual.time)
    apart = np.abs(ecef.displacement(one.position, other.position)).max()
    faster = np.abs(one.velocity_n - other.velocity_n).max()
    turned = np.abs(rotation.wrap(one.euler - other.euler)).max()
    a, b = usual.increments(), polar.increments()
    rate, force = (np.abs(x - y).max() / a.dt for x, y in ((a.dtheta, b.dtheta), (a.dvelocity, b.dvelocity)))
    print(f"\n{apart:.1e} m, {faster:.1e} m/s, {turned:.1e} rad; IMU {rate:.1e} rad/s, {force:.1e} m/s²")
    assert apart < 1e-6
    assert faster < 1e-6
    assert turned < 1e-9
    assert rate < 1e-7
    assert force < 1e-5


def standing(latitude: float) -> Recording:
    """Return a recording at rest."""
    t = np.arange(0, 20, 0.1)
    ones = np.ones_like(t)
    euler = np.outer(ones, [0.1, -0.2, 0.7])
    return Recording(t, latitude * ones, 1.0 * ones, 100 * ones, np.zeros((t.size, 3)), euler)


@pytest.mark.parametrize("latitude", [90.0, -90.0, 89.99])
def test_at_rest_on_a_pole_the_imu_feels_gravity_and_the_earths_rate(latitude: float) -> None:
    recording = standing(np.radians(latitude))
    trajectory = Trajectory.from_recording(recording, 100)
    assert isinstance(trajectory.path, PolarPath)
    ideal = trajectory.increments()
    s, c = np.sin(recording.latitude[0]), np.cos(recording.latitude[0])
    C_nb = rotation.C_nb_from_euler(recording.euler[0])
    rate = earth.RATE * C_nb.T @ [c, 0, -s]
    force = C_nb.T @ [0, 0, -earth.gravity(s, 100.0)]
    np.testing.assert_allclose(ideal.dtheta / ideal.dt, np.tile(rate, (len(ideal.dtheta), 1)), atol=1e-12)
    np.testing.assert_allclose(ideal.dvelocity / ideal.dt, np.tile(force, (len(ideal.dtheta), 1)), atol=1e-8)


def test_its_memory_is_counted() -> None:
    trajectory = Trajectory.from_recording(standing(np.pi / 2), 100)
    assert trajectory.nbytes > 8 * 3 * trajectory.time.size
