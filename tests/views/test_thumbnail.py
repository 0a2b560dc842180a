"""The picture of a flight: north up, to scale in both directions, thinned, with the range of its height."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import numpy as np
import pymap3d
import pytest
from flights import circle

from lab.views.thumbnail import HEIGHT, WIDTH, thumbnail

TIME = np.linspace(0, 100, 1001)


def on_a_plane(latitude: float, longitude: float, east, north, up=0.0) -> np.ndarray:
    """Return geodetic positions of points on a plane that touches the Earth (pymap3d)."""
    east, north, up = np.broadcast_arrays(np.asarray(east, float), north, up)
    at = pymap3d.enu2geodetic(east, north, up, latitude, longitude, 0.0)
    return np.column_stack((np.radians(at[0]), np.radians(at[1]), at[2]))


def line(picture: str, kind: str) -> np.ndarray:
    """Return the points of a line of a picture."""
    (found,) = [one for one in ElementTree.fromstring(picture).iter("polyline") if one.get("class") == kind]
    return np.array([[float(x) for x in point.split(",")] for point in found.get("points").split()])


def bar(picture: str) -> tuple[float, float]:
    """Return the length of the scale bar on the picture [px] and on the Earth [m]."""
    drawing = ElementTree.fromstring(picture)
    (path,) = drawing.iter("path")
    start, end = (float(re.search(rf"{letter}([\d.]+)", path.get("d"))[1]) for letter in "MH")
    text = next(found.text for found in drawing.iter("text") if "Height" not in found.text)
    number, unit = text.split()
    return end - start, float(number) * {"m": 1, "km": 1000}[unit]


@pytest.mark.parametrize(
    ("latitude", "longitude"), [(0, 0), (45, 8), (-50, 179.999), (70, -180), (-85, 30), (89.999, 0), (-90, 0)]
)
@pytest.mark.parametrize("size", [3.0, 400.0, 25_000.0])
def test_shape_and_scale_are_those_of_the_earth(latitude, longitude, size):
    # Close to a pole, up is north of the start, which here is on the meridian of the plane's own north.
    angle = np.linspace(0, 2 * np.pi, 1001) - np.copysign(np.pi / 2, latitude)
    picture = thumbnail(TIME, on_a_plane(latitude, longitude, 2 * size * np.cos(angle), size * np.sin(angle)))
    across, high = np.ptp(line(picture, "track"), axis=0)
    assert high == pytest.approx(across / 2, abs=1.5)
    pixels, metres = bar(picture)
    assert 30 <= pixels <= 91
    assert across / (4 * size) == pytest.approx(pixels / metres, rel=0.02)


def test_north_is_up_and_east_is_right():
    for east, north, way in ((0, 1000, (0, -1)), (1000, 0, (1, 0)), (-700, -700, (-1, 1))):
        share = np.linspace(0, 1, 1001)
        track = line(thumbnail(TIME, on_a_plane(45, 8, east * share, north * share)), "track")
        assert np.sign(np.round(track[-1] - track[0])).tolist() == list(way)


def test_everything_is_in_the_picture_and_little_of_it():
    rng = np.random.default_rng(1)
    walk = np.cumsum(rng.normal(size=(3, 300_000)), axis=1)
    picture = thumbnail(np.arange(300_000.0), on_a_plane(45, 8, walk[0], walk[1], 500 + walk[2] / 5))
    for kind in ("track", "height"):
        points = line(picture, kind)
        assert (points >= 0).all()
        assert (points <= (WIDTH, HEIGHT)).all()
    assert len(picture) < 16_000


def test_a_spike_of_the_height_is_seen():
    position = on_a_plane(45, 8, np.linspace(0, 5000, 1001), 0)
    position[:, 2] = 100
    position[500, 2] = 400
    picture = thumbnail(TIME, position)
    assert "Height 100 to 400 m" in picture
    height = line(picture, "height")
    assert np.ptp(height[:, 1]) == pytest.approx(32, abs=0.2)
    assert height[np.argmin(height[:, 1]), 0] == pytest.approx(WIDTH / 2, abs=3)


def test_rest_is_a_point():
    track = line(thumbnail(TIME, np.tile((0.8, 0.1, 20.0), (1001, 1))), "track")
    assert len(track) == 1


def test_the_circle_of_a_recording_is_one():
    flight = circle(turn=360)
    picture = thumbnail(flight.time, np.stack((flight.latitude, flight.longitude, flight.height), axis=-1))
    across, high = np.ptp(line(picture, "track"), axis=0)
    assert across == pytest.approx(high, abs=1)
