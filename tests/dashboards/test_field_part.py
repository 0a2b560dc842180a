"""The points of a magnetometer in the part Axes of the page Live; the device simulates the field."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dashboards.pages.live.live import AXES
from lab.data.streams.axis_map import AxisMap
from tests.dashboards.test_live_page import Opened, opened

__all__ = ["opened"]


def test_the_field_is_drawn_where_a_magnetometer_streams(opened: Callable[[], Opened]) -> None:
    one = opened()
    field = one.page._axes._field
    one.session.experiment.sensors.heading.update(
        {"fitted": True, "source": "magnetometer", "period": 0.1, "noise": 1.0}
    )
    station = one.connect()
    one.until(lambda: station.newest - station.zero > 2)
    one.page._report()
    assert not field.view.visible  # it is not seen, and nothing is looked at
    one.page._choice.value = AXES
    one.until(lambda: field.view.visible)
    points = np.column_stack(list(field._figures._points.data.values()))
    assert 10 < len(points) < 2000
    assert np.all(np.abs(np.linalg.norm(points, axis=1) - 54) < 3)  # \u00b5T in Montr\u00e9al
    assert "Turn the device" in field._words.object  # it stands still

    station.source.axes = AxisMap.of("y,-x,z")  # what came in other axes is on another sphere
    assert len(field.look(station).fields) < 5
    one.page._toggle()
    assert not field.view.visible
