"""Fast accuracy: a covariance at the fast rate changes outages and NEES by less than 2 %."""

from __future__ import annotations

import pytest

from tests.benchmarks.fast_accuracy import change_of


@pytest.mark.proof
@pytest.mark.parametrize("name", ["BMI270", "ADIS16470", "HG9900"])
def test_the_fast_rate_changes_little(name: str) -> None:
    """A card of the lowest, of a middle and of the highest grade; the same seeds at both rates."""
    found = change_of(name, range(1, 9), imu_rate=100.0)
    assert found.most[0] != found.most[1]
    assert found.is_small, found
