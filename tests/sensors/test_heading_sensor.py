"""The heading sensor: where a magnetic field does not show a heading, it is refused with the reason."""

from __future__ import annotations

import numpy as np
import pytest

from lab.base.parameters.setting_error import SettingError
from lab.motion.frames.magnetic_field import magnetic_field
from lab.motion.truth.trajectory import Trajectory
from lab.sensors.heading_sensor import MAGNETOMETER, HeadingErrors, check_field
from lab.sensors.readings import Readings
from tests.flights import circle


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


def test_a_magnetometer_without_errors_reads_the_field_in_the_axes_of_the_imu() -> None:
    """A banked circle: the field of the model, turned by matrices of yaw, pitch and roll."""
    trajectory = Trajectory.from_recording(circle())
    time = np.linspace(5.0, 90.0, 18)
    true = trajectory.at(time)
    found = HeadingErrors(source=MAGNETOMETER).shown(trajectory, Readings(time, true.euler[:, 2]))
    field = magnetic_field(trajectory.at(np.zeros(1)).position[0])
    for (roll, pitch, yaw), read, declination in zip(true.euler, found.field, found.value, strict=True):
        cr, sr, cp, sp, cy, sy = np.array([f(a) for a in (roll, pitch, yaw) for f in (np.cos, np.sin)])
        about_z = np.array([[cy, sy, 0.0], [-sy, cy, 0.0], [0.0, 0.0, 1.0]])
        about_y = np.array([[cp, 0.0, -sp], [0.0, 1.0, 0.0], [sp, 0.0, cp]])
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, sr], [0.0, -sr, cr]])
        expected = about_x @ about_y @ about_z @ field / np.linalg.norm(field)
        np.testing.assert_allclose(read, expected, atol=1e-12)
        assert declination == pytest.approx(np.arctan2(field[1], field[0]), abs=1e-12)
