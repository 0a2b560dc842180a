"""Axis map: every right-handed map, and what is none."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from lab.data.streams.axis_map import AXES, AxisMap
from lab.data.streams.transport import TransportError

MAPS = [
    axes
    for axes in itertools.permutations(AXES, 3)
    if np.isclose(np.linalg.det([AXES[axis] for axis in axes]), 1)
]


def test_there_are_24_right_handed_maps() -> None:
    assert len(MAPS) == 24  # rotations of a cube


@pytest.mark.parametrize("axes", MAPS, ids=",".join)
@pytest.mark.parametrize("inverted", [False, True])
def test_mapping_is_a_rotation_and_its_inverse(axes: tuple[str, str, str], inverted: bool) -> None:
    axis_map = AxisMap(axes, inverted)
    vectors = np.random.default_rng(1).normal(size=(5, 3))
    by_matrix = vectors @ np.array([AXES[axis] for axis in axes]).T
    assert np.array_equal(axis_map.mapped(vectors), by_matrix)
    assert np.array_equal(axis_map.mapped(vectors, force=True), -by_matrix if inverted else by_matrix)
    for force in (False, True):
        assert np.array_equal(axis_map.unmapped(axis_map.mapped(vectors, force=force), force=force), vectors)
    assert AxisMap.of(str(axis_map)) == axis_map


def test_forward_is_the_axis_named_first() -> None:
    axis_map = AxisMap.of("y,-x,z")
    assert axis_map.mapped(np.array([[0.0, 1.0, 0.0]])).tolist() == [[1.0, 0.0, 0.0]]
    assert axis_map.mapped(np.array([[1.0, 0.0, 0.0]])).tolist() == [[0.0, -1.0, 0.0]]


def test_an_axis_that_is_not_known_stays_alone() -> None:
    mapped = AxisMap.of("y,x,-z").mapped(np.array([[np.nan, 2.0, 3.0]]))
    assert np.array_equal(mapped, [[2.0, np.nan, -3.0]], equal_nan=True)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x,y,-z", "mirror image"),
        ("x,x,z", "twice"),
        ("x,y", "accepted are"),
        ("x,y,z,w", "accepted are"),
        ("a,b,c", "accepted are"),
        ("--x,y,z", "accepted are"),
        ("", "accepted are"),
        ("x" * 10_000, "accepted are"),
    ],
)
def test_what_is_no_map_is_refused(text: str, words: str) -> None:
    with pytest.raises(TransportError, match=words):
        AxisMap.of(text)
