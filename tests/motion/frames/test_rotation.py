"""Rotation against SciPy's, against finite differences, and against its own algebra."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lab.motion.frames import rotation

angle = st.floats(-np.pi, np.pi)
pitch = st.floats(np.radians(-89.5), np.radians(89.5))
attitude = st.tuples(angle, pitch, angle).map(np.array)


def reference(euler: NDArray[np.float64]) -> Rotation:
    """Return C_nb by SciPy: intrinsic yaw, pitch, roll."""
    return Rotation.from_euler("ZYX", euler[..., ::-1])


def test_right_wing_down_and_nose_up_are_positive() -> None:
    roll_right = rotation.C_nb_from_euler([np.radians(30), 0, 0])
    assert (roll_right @ [0, 1, 0])[2] == pytest.approx(0.5), "the right wing points down"
    nose_up = rotation.C_nb_from_euler([0, np.radians(30), 0])
    assert (nose_up @ [1, 0, 0])[2] == pytest.approx(-0.5), "the nose points up"
    eastbound = rotation.C_nb_from_euler([0, 0, np.radians(90)])
    np.testing.assert_allclose(eastbound @ [1, 0, 0], [0, 1, 0], atol=1e-15)


@given(attitude)
def test_matrix_and_quaternion_are_scipys(euler: NDArray[np.float64]) -> None:
    expected = reference(euler)
    np.testing.assert_allclose(rotation.C_nb_from_euler(euler), expected.as_matrix(), atol=1e-14)
    q_nb = rotation.quaternion_from_euler(euler)
    assert abs(q_nb @ expected.as_quat(scalar_first=True)) == pytest.approx(1, abs=1e-14)


@given(attitude)
def test_euler_angles_return(euler: NDArray[np.float64]) -> None:
    expected = reference(euler)
    for found in (
        rotation.euler_from_C_nb(expected.as_matrix()),
        rotation.euler_from_quaternion(expected.as_quat(scalar_first=True)),
        rotation.euler_from_quaternion(-expected.as_quat(scalar_first=True)),
    ):
        np.testing.assert_allclose(rotation.wrap(found - euler), 0, atol=1e-12)


@given(angle, st.sampled_from([-1.0, 1.0]), angle)
def test_attitude_survives_beside_the_gimbal_pole(roll: float, sign: float, yaw: float) -> None:
    expected = reference(np.array([roll, sign * np.radians(90 - 1e-4), yaw]))
    found = reference(rotation.euler_from_quaternion(expected.as_quat(scalar_first=True)))
    assert (expected.inv() * found).magnitude() < 1e-8


def test_arrays_of_any_shape_keep_their_shape() -> None:
    euler = np.random.default_rng(1).uniform(-1, 1, (4, 5, 3))
    assert rotation.C_nb_from_euler(euler).shape == (4, 5, 3, 3)
    assert rotation.quaternion_from_euler(euler).shape == (4, 5, 4)
    np.testing.assert_allclose(rotation.euler_from_C_nb(rotation.C_nb_from_euler(euler)), euler, atol=1e-14)
    np.testing.assert_array_equal(rotation.euler_jacobian(euler)[2, 3], rotation.euler_jacobian(euler[2, 3]))


@given(st.floats(-50, 50))
def test_wrapped_angles_stay_within_half_a_turn_and_point_the_same_way(value: float) -> None:
    wrapped = rotation.wrap(value)
    assert abs(wrapped) <= np.pi + 1e-15
    assert np.exp(1j * wrapped) == pytest.approx(np.exp(1j * value), abs=1e-13)


@given(st.floats(-3.14, 3.14))
def test_wrapping_a_small_angle_changes_no_bit(value: float) -> None:
    assert rotation.wrap(value) == value


@given(st.tuples(angle, st.floats(-1.4, 1.4), angle).map(np.array))
def test_jacobian_is_the_finite_difference_of_the_definition(euler: NDArray[np.float64]) -> None:
    C_nb = reference(euler)
    step = 1e-6
    for axis in range(3):
        phi = np.zeros(3)
        phi[axis] = step
        # The estimate is (I − [φ×]) C_nb: the true attitude turned by −φ in the navigation frame.
        plus = rotation.euler_from_C_nb((Rotation.from_rotvec(-phi) * C_nb).as_matrix())
        minus = rotation.euler_from_C_nb((Rotation.from_rotvec(phi) * C_nb).as_matrix())
        difference = rotation.wrap(plus - minus) / (2 * step)
        np.testing.assert_allclose(rotation.euler_jacobian(euler)[:, axis], difference, rtol=1e-6, atol=1e-8)


@given(
    st.tuples(angle, st.floats(-1.4, 1.4), angle).map(np.array), st.tuples(angle, angle, angle).map(np.array)
)
def test_body_rate_is_the_finite_rotation_over_time(
    euler: NDArray[np.float64], euler_rate: NDArray[np.float64]
) -> None:
    step = 1e-5
    before, after = reference(euler - step * euler_rate), reference(euler + step * euler_rate)
    expected = (before.inv() * after).as_rotvec() / (2 * step)
    np.testing.assert_allclose(rotation.body_rate(euler, euler_rate), expected, atol=1e-7)


@pytest.mark.parametrize("size", [0.0, 1e-4, 9e-4, 1.1e-3, 0.3, 2.9])
def test_left_jacobian_is_the_finite_difference_of_the_exponential(size: float) -> None:
    phi, step = size * np.array([0.48, -0.6, 0.64]), 1e-6
    found = np.zeros((3, 3))
    for axis in range(3):
        more, less = (Rotation.from_rotvec(phi + sign * step * np.eye(3)[axis]) for sign in (1, -1))
        found[:, axis] = (more * less.inv()).as_rotvec() / (2 * step)
    np.testing.assert_allclose(rotation.left_jacobian(phi), found, atol=1e-9)
