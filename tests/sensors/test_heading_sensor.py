"""The heading sensor: where a magnetic field does not show a heading, it is refused with the reason."""

from __future__ import annotations

import numpy as np
import pytest

from lab.base.parameters.setting_error import SettingError
from lab.sensors.heading_sensor import check_field


def along(first: tuple[float, float], last: tuple[float, float]) -> np.ndarray:
    """Return positions from one place to another [°], in equal steps of latitude and longitude."""
    degrees = np.linspace(first, last, 50)
    return np.column_stack((np.radians(degrees), np.full(50, 1000.0)))


@pytest.mark.parametrize(
    ("way", "why"),
    [
        # WMM2025: the north magnetic pole at 85.8° N, 139.3° E, the south one at 63.9° S, 135.1° E.
        (along((84.0, 139.3), (85.8, 139.3)), "0.0 µT .*blackout zones"),
        (along((-62.0, 135.1), (-63.9, 135.1)), "0.[01] µT .*blackout zones"),
        (along((89.0, 0.0), (90.0, 0.0)), "1.8 µT .*blackout zones"),
        # At the geographic south pole, the field is strong, and north turns about.
        (along((-89.9, 0.0), (-89.9, 170.0)), "declination changes by 170°"),
    ],
    ids=["north magnetic pole", "south magnetic pole", "north pole", "south pole"],
)
def test_a_magnetometer_is_refused_where_it_shows_no_heading(way: np.ndarray, why: str) -> None:
    with pytest.raises(
        SettingError, match=f"sensors.heading.source: .*{why}.*accepted here is source = heading"
    ):
        check_field(way)


@pytest.mark.parametrize("way", [along((69.0, 18.0), (70.0, 20.0)), along((45.0, -74.0), (46.0, -73.0))])
def test_elsewhere_it_is_not(way: np.ndarray) -> None:
    check_field(way)
