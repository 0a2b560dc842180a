"""Live log: what of timed samples a sensor log gets."""

from __future__ import annotations

import numpy as np

from lab.data.streams.live_log import make_magnetometer


def test_a_device_without_a_magnetometer_has_none() -> None:
    time = np.arange(4.0)
    assert make_magnetometer(time, np.zeros((4, 3))) is None
    assert make_magnetometer(time, np.full((4, 3), np.nan)) is None


def test_the_field_is_taken_where_it_was_measured() -> None:
    time = np.arange(4.0)
    field = np.array([[0.0, 0.0, 0.0], [20e-6, 0.0, 40e-6], [np.nan, 1e-6, 1e-6], [0.0, 0.0, 50e-6]])
    found = make_magnetometer(time, field)
    assert found is not None
    np.testing.assert_array_equal(found.time, [1.0, 3.0])
    np.testing.assert_allclose(found.field, 1e6 * field[[1, 3]])
