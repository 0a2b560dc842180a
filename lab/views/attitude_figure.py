"""Attitude figure: an aircraft over a compass rose, seen from the south and from above."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from bokeh.models.annotations import Title
from bokeh.models.ranges import Range1d
from bokeh.models.sources import ColumnDataSource
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.views.figures import plain_figure
from lab.views.parcel import Parcel
from lab.views.quantities import BLUE, CURSOR, GREEN, ORANGE

ELEVATION = np.radians(30.0)
"""Height from which the viewer looks down: roll, pitch and heading all show."""
GREY = "#808895"
"""Colour of the compass rose, visible on white and on black."""
_LIGHT = np.array([-0.4, 0.3, -0.87])
"""Direction to the light, north, east, down."""
_BOX = 1.25
"""Half the width of what is shown, in half lengths of the vehicle."""


def _aircraft() -> list[tuple[FloatArray, str]]:
    wing = np.array([(0.25, 0, -0.1), (-0.1, 0.95, -0.1), (-0.28, 0.95, -0.1), (-0.2, 0, -0.1)])
    tail = np.array([(-0.7, 0, 0), (-0.85, 0.35, 0), (-0.98, 0.35, 0), (-0.95, 0, 0)])
    fin = np.array([(-0.65, 0, -0.05), (-0.88, 0, -0.42), (-1.0, 0, -0.42), (-0.98, 0, -0.03)])
    mirror = np.array([1.0, -1.0, 1.0])
    nose = np.array([1.0, 0, 0.03])
    ring = np.array([(0.55, 0.11, -0.12), (0.55, 0.11, 0.12), (0.55, -0.11, 0.12), (0.55, -0.11, -0.12)])
    end = np.array([(-1.0, 0.02, -0.05), (-1.0, 0.02, 0), (-1.0, -0.02, 0), (-1.0, -0.02, -0.05)])
    following = (1, 2, 3, 0)
    cone = [np.array([nose, ring[i], ring[following[i]]]) for i in range(4)]
    hull = [np.array([ring[i], ring[following[i]], end[following[i]], end[i]]) for i in range(4)]
    return [
        *((face, BLUE) for face in cone),
        *((face, GREY) for face in hull),
        (wing, GREEN),
        (wing * mirror, CURSOR),
        (tail, GREY),
        (tail * mirror, GREY),
        (fin, ORANGE),
    ]


AIRCRAFT = _aircraft()
"""Faces forward, right, down in half lengths of the vehicle, with their colours. The right wing is green, the
left one red, as its lights are."""


class AttitudeFigure:
    """A vehicle with its attitude.

    Parameters
    ----------
    parcel
        Takes the changes.

    Attributes
    ----------
    figure : figure
        The figure.
    """

    def __init__(self, parcel: Parcel) -> None:
        self._parcel = parcel
        self._title = Title(text="Attitude: unknown")
        self.figure = plain_figure(
            self._title,
            x_range=Range1d(start=-_BOX, end=_BOX),
            y_range=Range1d(start=-_BOX, end=_BOX),
            match_aspect=True,
            aspect_scale=1,
        )
        fig = self.figure
        fig.axis.visible = False
        fig.grid.visible = False
        fig.outline_line_color = None
        fig.min_border = 4
        self._draw_rose()
        nothing: dict[str, list[object]] = {"xs": [], "ys": [], "colour": []}
        self._faces = ColumnDataSource(nothing, name="attitude")
        self._title_number, self._face_number = parcel.number(self._title), parcel.number(self._faces)
        fig.patches(
            "xs", "ys", source=self._faces, fill_color="colour", line_color="colour", line_width=0.5,
            level="overlay",
        )  # fmt: skip

    def _draw_rose(self) -> None:
        """Draw the level plane below the vehicle, with its cardinal points."""
        angles = np.linspace(0, 2 * np.pi, 73)
        ring = np.stack((np.cos(angles), np.sin(angles), np.full_like(angles, 0.35)), axis=-1)
        self.figure.line(*_project_points(ring), color=GREY, alpha=0.6)
        for angle in np.radians(np.arange(0, 360, 30)):
            tick = np.array([(part * np.cos(angle), part * np.sin(angle), 0.35) for part in (0.93, 1.0)])
            self.figure.line(*_project_points(tick), color=GREY, alpha=0.6)
        names = np.array([(1.13, 0, 0.35), (0, 1.13, 0.35), (-1.13, 0, 0.35), (0, -1.13, 0.35)])
        x, y = _project_points(names)
        self.figure.text(
            x, y, ["N", "E", "S", "W"], text_align="center", text_baseline="middle", text_color=GREY,
            text_font_size="12px",
        )  # fmt: skip

    def show(self, euler: FloatArray | None, *, is_relative: bool = False, title: bool = True) -> None:
        """Draw an attitude.

        Parameters
        ----------
        euler : (3,) array or None
            Roll, pitch, heading [rad]; None if unknown.
        is_relative
            Whether the heading is only relative, of which the title gives no number.
        title
            Whether the title is renewed, with which a browser paints the whole figure.
        """
        if euler is None or not np.isfinite(euler).all():
            self._parcel.set(self._title_number, text="Attitude: unknown")
            self._parcel.set(self._face_number, data={"xs": [], "ys": [], "colour": []})
            return
        if title:
            roll, pitch, heading = np.degrees(euler)
            known = "heading relative" if is_relative else f"heading {heading % 360:.1f}°"
            numbers = f"Roll {roll:z.1f}°, pitch {pitch:z.1f}°".replace("-", "\u2212")
            self._parcel.set(self._title_number, text=f"{numbers}, {known}")
        self._parcel.set(self._face_number, data=draw_faces(AIRCRAFT, euler))


def draw_faces(faces: Sequence[tuple[FloatArray, str]], euler: FloatArray) -> dict[str, list[object]]:
    """Return faces as patches, those behind first.

    Parameters
    ----------
    faces
        Corners (n, 3) forward, right, down, and a colour, each.
    euler : (3,) array
        Roll, pitch, heading [rad].
    """
    turn = Rotation.from_euler("ZYX", euler[::-1])
    turned = [(turn.apply(corners), colour) for corners, colour in faces]
    turned.sort(key=lambda face: float(_depth(face[0]).mean()), reverse=True)
    xs, ys, colours = [], [], []
    for corners, colour in turned:
        x, y = _project_points(corners)
        xs.append(np.round(x, 3).tolist())
        ys.append(np.round(y, 3).tolist())
        colours.append(_light_face(colour, corners))
    return {"xs": xs, "ys": ys, "colour": colours}


def _project_points(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return where a viewer in the south sees points north, east, down: to the right, and upwards."""
    north, east, down = points.T
    return east, north * np.sin(ELEVATION) - down * np.cos(ELEVATION)


def _depth(points: FloatArray) -> FloatArray:
    """Return how far points north, east, down are from the viewer."""
    north, _, down = points.T
    return np.asarray(north * np.cos(ELEVATION) + down * np.sin(ELEVATION))


def _light_face(colour: str, corners: FloatArray) -> str:
    """Return the colour of a face in the light."""
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    size = float(np.linalg.norm(normal))
    bright = 0.62 + 0.38 * abs(float(normal @ _LIGHT)) / size if size else 1.0
    parts = (round(int(colour[at : at + 2], 16) * bright) for at in (1, 3, 5))
    return "#" + "".join(f"{part:02x}" for part in parts)
