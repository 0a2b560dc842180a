"""The strapdown's quaternions: the axioms of a group, and SciPy's rotations."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lab.navigation.strapdown import matrix, product, rotation, small_rotation, unit

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

angles = st.floats(-3.0, 3.0, allow_subnormal=False)
vectors = st.tuples(angles, angles, angles)
small = st.floats(-0.28, 0.28, allow_subnormal=False)
small_vectors = st.tuples(small, small, small)
quaternions = vectors.map(rotation)

IDENTITY = (1.0, 0.0, 0.0, 0.0)


def conjugate(q: Quaternion) -> Quaternion:
    w, x, y, z = q
    return w, -x, -y, -z


def close(a: object, b: object, atol: float = 1e-14) -> None:
    np.testing.assert_allclose(a, b, rtol=0, atol=atol)


@given(quaternions, quaternions, quaternions)
def test_product_is_associative(p: Quaternion, q: Quaternion, r: Quaternion) -> None:
    close(product(product(p, q), r), product(p, product(q, r)))


@given(quaternions)
def test_identity_and_inverse(q: Quaternion) -> None:
    close(product(IDENTITY, q), q)
    close(product(q, IDENTITY), q)
    close(product(q, conjugate(q)), IDENTITY)
    close(product(conjugate(q), q), IDENTITY)


@given(quaternions, quaternions)
def test_product_keeps_the_length(p: Quaternion, q: Quaternion) -> None:
    assert np.linalg.norm(product(p, q)) == pytest.approx(1, abs=1e-14)


@given(quaternions, quaternions)
def test_matrix_is_a_homomorphism(p: Quaternion, q: Quaternion) -> None:
    close(matrix(product(p, q)), np.array(matrix(p)) @ np.array(matrix(q)), 1e-13)


@given(quaternions)
def test_matrix_is_a_rotation_whatever_the_sign(q: Quaternion) -> None:
    C = np.array(matrix(q))
    close(C @ C.T, np.eye(3))
    assert np.linalg.det(C) == pytest.approx(1)
    w, x, y, z = q
    close(matrix((-w, -x, -y, -z)), C)


@given(vectors)
def test_rotation_is_the_exponential(v: Vector) -> None:
    close(matrix(rotation(v)), Rotation.from_rotvec(v).as_matrix())
    assert np.linalg.norm(rotation(v)) == pytest.approx(1, abs=1e-14)


@given(vectors)
def test_rotation_back_is_the_inverse(v: Vector) -> None:
    x, y, z = v
    close(product(rotation(v), rotation((-x, -y, -z))), IDENTITY)


@given(vectors, st.floats(0, 1), st.floats(0, 1))
def test_rotations_about_one_axis_add(v: Vector, a: float, b: float) -> None:
    one, other, both = (tuple(s * x for x in v) for s in (a, b, a + b))
    close(matrix(product(rotation(one), rotation(other))), matrix(rotation(both)), 1e-13)


@given(small_vectors)
def test_small_rotation_is_the_rotation(v: Vector) -> None:
    assume(np.linalg.norm(v) < 0.5)
    half, angle = 0.5 * np.linalg.norm(v), np.linalg.norm(v)
    expected = np.append(np.cos(half), np.asarray(v) * (np.sin(half) / angle if angle else 0.5))
    close(small_rotation(v), expected, 1e-15)


@pytest.mark.parametrize("angle", [0.5 - 1e-9, 0.5 + 1e-9])
def test_series_and_closed_form_meet(angle: float) -> None:
    axis = np.array([0.36, -0.48, 0.8])
    expected = np.append(np.cos(angle / 2), axis * np.sin(angle / 2))
    close(rotation(tuple(angle * axis)), expected, 1e-15)


@given(quaternions, st.floats(-1e-6, 1e-6))
def test_unit_puts_the_length_right(q: Quaternion, error: float) -> None:
    stretched = tuple((1 + error) * x for x in q)
    assert np.linalg.norm(unit(stretched)) == pytest.approx(1, abs=2 * error**2 + 1e-15)
    close(unit(stretched), q, 2 * error**2 + 1e-15)
