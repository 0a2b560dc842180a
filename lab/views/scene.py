"""Scene: a result in three dimensions, in viser: paths, fixes, uncertainty, and the aircraft at a time.

In a notebook, it is a page in a frame that needs no server.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from itertools import zip_longest
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import rich
import viser
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.base.notebook_card import HtmlFrame
from lab.motion.frames.east_north_up import NED_TO_ENU
from lab.views.envelope import thin_path
from lab.views.quantities import ESTIMATE, FIXES, HELD, LETTERS, TRUTH

if TYPE_CHECKING:
    import trimesh

    from lab.experiment.result import Result

LENGTH = 8.1
"""Length of the mesh [m], about that of a Cessna 172."""


@cache
def aircraft() -> trimesh.Trimesh:
    """Return the aeroplane in body axes: x forward, y right, z down [m]."""
    import trimesh  # noqa: PLC0415 - a page whose scene is not open does without

    cabin = _rings([(3.0, 0.25, 0.3), (2.4, 0.5, 0.5), (1.2, 0.6, 0.7), (-0.9, 0.6, 0.7)])
    boom = _rings([(-0.9, 0.6, 0.7), (-5.1, 0.1, 0.15)])
    wing = [(1.1, 0), (1.1, 3.0), (0.9, 5.5), (-0.2, 5.5), (-0.5, 3.0), (-0.5, 0)]
    tail = [(-4.0, 0), (-4.3, 1.8), (-5.0, 1.8), (-5.1, 0)]
    fin = [(-3.6, -0.2), (-4.5, -1.7), (-5.1, -1.7), (-5.0, -0.1)]
    propeller = [(0.95 * np.cos(a), 0.95 * np.sin(a)) for a in np.linspace(0, 2 * np.pi, 24, endpoint=False)]
    solids = [
        cabin,
        boom,
        _flat_plate(wing, level=-0.75, thickness=0.15),
        _flat_plate([(x, -y) for x, y in wing], level=-0.75, thickness=0.15),
        _flat_plate(tail, level=-0.1, thickness=0.1),
        _flat_plate([(x, -y) for x, y in tail], level=-0.1, thickness=0.1),
        np.array([(x, side, z) for x, z in fin for side in (-0.06, 0.06)]),
        np.array([(x, y, z) for y, z in propeller for x in (3.02, 3.05)]),
    ]
    mesh = trimesh.util.concatenate([trimesh.convex.convex_hull(points) for points in solids])
    assert isinstance(mesh, trimesh.Trimesh)
    return mesh


def _rings(stations: Sequence[tuple[float, float, float]]) -> np.ndarray:
    """Return points on ellipses across the body: (x, half width, half height) of each."""
    angles = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    return np.array([(x, w * np.cos(a), h * np.sin(a)) for x, w, h in stations for a in angles])


def _flat_plate(outline: Sequence[tuple[float, float]], level: float, thickness: float) -> np.ndarray:
    """Return the corners of a flat plate over an outline in x and y."""
    return np.array([(x, y, level + z) for x, y in outline for z in (-thickness / 2, thickness / 2)])


SEGMENTS = 4000
"""Largest number of drawn segments of a path."""

ELLIPSOIDS = 200
"""Largest number of drawn ellipsoids."""

OUTLINES = 40
"""Largest number of drawn ellipsoids of a held result; they are of wire, which hides nothing."""

SIGMAS = 3.0
"""Semi-axes of an ellipsoid, in standard deviations."""

SHORT = 0.2
"""Extent of a path up to which the ellipsoids are drawn to scale [km]."""

_KILOMETRE = 1e-3
"""Kilometres per metre; the scene is in kilometres."""
_NED_TO_ENU = Rotation.from_matrix(NED_TO_ENU)
"""Rotates north, east, down to east, north, up."""


class Colours(NamedTuple):
    """Colours of what carries no data, each chosen for its background."""

    cells: str
    sections: str
    shadow: str
    aircraft: str


DARK = Colours(cells="#464e5a", sections="#606a78", shadow="#5b6472", aircraft="#f0f3f7")
LIGHT = Colours(cells="#d3d9e1", sections="#b4bdc9", shadow="#98a2b0", aircraft="#5b6472")


class Scene:
    """Draws a result into a viser server; the axes are east, north, up from the start, in kilometres.

    Parameters
    ----------
    server
        Server of the scene.
    result
        Result to draw; None if `show` gets it later.
    ellipsoid_scale
        Factor on the ellipsoids, which would be too small to see at the scale of a flight.
    dark
        Whether the background is dark.

    Attributes
    ----------
    exaggeration : float
        Factor on all heights.
    held : list of tuple of str
        Letter and colour of each held result that is drawn: those far away are not.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        result: Result | None = None,
        *,
        ellipsoid_scale: float = 10.0,
        dark: bool = True,
    ) -> None:
        self._server = server
        self.exaggeration = 1.0
        self.ellipsoid_scale = ellipsoid_scale
        self._result: Result | None = None
        self._mission = ""
        self.held: list[tuple[str, str]] = []
        self._origin: FloatArray = np.zeros(3)
        self._aircraft: viser.FrameHandle | None = None
        server.scene.set_up_direction("+z")
        server.scene.world_axes.visible = False
        # Nothing here casts a shadow; without a graphics card, drawing them took half of the time.
        server.scene.configure_default_lights(cast_shadow=False)
        self.dress(dark)
        server.gui.main_panel.minimize()
        if result is not None:
            self.show(result)

    def dress(self, dark: bool) -> None:
        """Choose a dark or a light background; what is drawn gets its colours when it is drawn again."""
        self._colours = DARK if dark else LIGHT
        self._server.gui.configure_theme(show_logo=False, show_share_button=False, dark_mode=dark)

    def show(self, result: Result, time: float = 0.0, held: Sequence[Result | None] = ()) -> None:
        """Draw a result in place of the previous one, with the aircraft at a time [s].

        Held results stand beside it: a thin path, and 3σ ellipsoids of wire; None leaves a place free. Those
        of another map zone are too far away.
        """
        new_flight = self._mission != result.mission.name
        self._result, self._mission = result, result.mission.name
        if new_flight:
            self._origin = self._enu(result, self._ground(result))[0]
        middle, estimated = self._path(result, self._ground(result)), self._path(result, "estimated")
        self._estimated = estimated
        with self._server.atomic():
            if result.truth_arrays is None:
                self._server.scene.remove_by_name("/true path")
            else:
                self._draw_path("/true path", self._path(result, "true"), TRUTH, 2.0)
            self._draw_path("/estimated path", estimated, ESTIMATE, 3.0)
            self._draw_fixes(result)
            self._draw_ellipsoids("/3σ ellipsoids", result, ESTIMATE, ELLIPSOIDS)
            self._draw_held(result, held)
            self._draw_ground(middle)
            self._draw_aircraft()
        if new_flight:
            self._frame_camera(middle)
        self.show_time(time)

    def show_time(self, time: float) -> None:
        """Put the aircraft at the estimated position and attitude at a time [s]."""
        if self._result is None or self._aircraft is None:
            return
        times = self._result.time
        index = min(int(np.searchsorted(times, time)), len(times) - 1)
        q_nb = self._result.solution_arrays.q_nb[index]
        attitude = _NED_TO_ENU * Rotation.from_quat(q_nb, scalar_first=True)
        with self._server.atomic():
            self._aircraft.position = self._scale_positions(self._result.places(np.array([index])))[0]
            self._aircraft.wxyz = attitude.as_quat(scalar_first=True)

    def release(self) -> None:
        """Refer to no result any more; what is drawn stays."""
        self._result = None

    def as_html(self, dark: bool = False) -> str:
        """Return the scene as one HTML page that needs no server."""
        return self._server.get_scene_serializer().as_html(dark_mode=dark)

    @staticmethod
    def _ground(result: Result) -> str:
        """Return the path to centre the picture on; a reference may have gaps."""
        return "estimated" if result.recorded else "true"

    def _enu(self, result: Result, path: str) -> FloatArray:
        track = result.drawn_track.sel(path=path)
        return np.stack([track[name].values for name in ("easting", "northing", "height")], axis=-1)

    def _scale_positions(self, enu: FloatArray) -> FloatArray:
        scaled: FloatArray = (enu - self._origin) * (_KILOMETRE * np.array([1, 1, self.exaggeration]))
        return scaled

    def _path(self, result: Result, path: str) -> FloatArray:
        return self._scale_positions(self._enu(result, path))

    def _draw_path(self, name: str, points: FloatArray, colour: str, thickness: float) -> None:
        kept = points[thin_path(points, SEGMENTS)].astype(np.float32)
        segments = np.stack([kept[:-1], kept[1:]], axis=1)
        self._server.scene.add_line_segments(
            name, segments, _rgb(colour), thickness=thickness, thickness_units="screen"
        )

    def _draw_fixes(self, result: Result) -> None:
        gps = result.gps
        enu = np.stack([gps[name].values for name in ("easting", "northing", "height")], axis=-1)
        points = self._scale_positions(enu[np.isfinite(enu).all(axis=1)])
        self._server.scene.add_point_cloud(
            "/GPS fixes",
            points.astype(np.float32),
            _rgb(FIXES),
            point_size=self._size * 0.004,
            point_shape="circle",
            precision="float32",
        )

    def _draw_held(self, result: Result, held: Sequence[Result | None]) -> None:
        self.held.clear()
        for letter, colour, one in zip_longest(LETTERS, HELD, held):
            if one is None or one.projection.zone != result.projection.zone:
                self._server.scene.remove_by_name(f"/{letter}")
            else:
                self.held.append((letter, colour))
                self._draw_path(f"/{letter}/path", self._path(one, "estimated"), colour, 1.5)
                self._draw_ellipsoids(f"/{letter}/3σ ellipsoids", one, colour, OUTLINES)

    def _draw_ellipsoids(self, name: str, result: Result, colour: str, most: int) -> None:
        """Draw at most so many ellipsoids; those of a held result are of wire."""
        import trimesh  # noqa: PLC0415 - as above

        times = result.fixes.time
        chosen = np.unique(np.linspace(0, len(times) - 1, min(len(times), most)).astype(int))
        covariance = result.position_covariance.values[chosen]
        usable = np.isfinite(covariance).all(axis=(1, 2))
        chosen, covariance = chosen[usable], covariance[usable]
        if not len(chosen):
            return
        samples = np.minimum(np.searchsorted(result.time, times[chosen]), len(result.time) - 1)
        centres = self._scale_positions(result.places(samples))
        variances, axes = np.linalg.eigh(covariance)
        # Eigenvectors may be a mirror image, which no rotation is.
        axes[np.linalg.det(axes) < 0, :, 0] *= -1
        size = SIGMAS * np.sqrt(np.maximum(variances, 0)) * _KILOMETRE * self.scale
        is_wire = most == OUTLINES
        ball = trimesh.creation.icosphere(subdivisions=1 if is_wire else 2)
        self._server.scene.add_batched_meshes_simple(
            name,
            ball.vertices.astype(np.float32),
            ball.faces.astype(np.uint32),
            batched_wxyzs=Rotation.from_matrix(axes).as_quat(scalar_first=True).astype(np.float32),
            batched_positions=centres.astype(np.float32),
            batched_scales=size.astype(np.float32),
            batched_colors=_rgb(colour),
            wireframe=is_wire,
            opacity=0.4 if is_wire else 0.25,
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
        )

    def _draw_ground(self, path: FloatArray) -> None:
        low, high = np.nanmin(path, axis=0), np.nanmax(path, axis=0)
        shadow = path * (1, 1, 0) + (0, 0, low[2])
        self._draw_path("/track on the ground", shadow, self._colours.shadow, 1.0)
        extent = float(max(high[:2] - low[:2])) or 1.0
        # A power of ten, of which the extent has 4 to 40.
        cell = 10.0 ** np.floor(np.log10(extent / 4))
        self._server.scene.add_grid(
            "/ground",
            width=3 * extent,
            height=3 * extent,
            cell_size=cell,
            section_size=5 * cell,
            cell_color=_rgb(self._colours.cells),
            section_color=_rgb(self._colours.sections),
            cell_thickness=0.6,
            section_thickness=1.0,
            position=(*(low + high)[:2] / 2, low[2] - 0.001),
            shadow_opacity=0.0,
            fade_distance=6 * extent,
        )

    @property
    def scale(self) -> float:
        """Factor on the ellipsoids: 1 for a path hardly longer than they are."""
        return self.ellipsoid_scale if self._size > SHORT else 1.0

    def _draw_aircraft(self) -> None:
        mesh = aircraft()
        scene = self._server.scene
        self._aircraft = scene.add_frame("/aircraft", show_axes=False)
        scene.add_mesh_simple(
            "/aircraft/mesh",
            mesh.vertices.astype(np.float32),
            mesh.faces.astype(np.uint32),
            color=_rgb(self._colours.aircraft),
            flat_shading=True,
            scale=self._size * 0.07 / LENGTH,
            cast_shadow=False,
            receive_shadow=False,
        )

    def _frame_camera(self, path: FloatArray) -> None:
        centre = (np.nanmin(path, axis=0) + np.nanmax(path, axis=0)) / 2
        camera = self._server.initial_camera
        camera.look_at = tuple(centre)
        camera.position = tuple(centre + np.array([-0.3, -0.75, 0.42]) * self._size)
        camera.up = (0.0, 0.0, 1.0)
        camera.near, camera.far = 0.01, 1000.0

    @property
    def _size(self) -> float:
        """Extent of the flight [km]."""
        extent = np.nanmax(self._estimated, axis=0) - np.nanmin(self._estimated, axis=0)
        return float(max(extent.max(), 0.05))


def _rgb(colour: str) -> tuple[int, int, int]:
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red, green, blue


def view3d(result: Result, *, dark: bool = True, height: int = 500) -> HtmlFrame:
    """Return the scene of a result; see `Result.view3d`."""
    with _silence_viser():
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        try:
            page = Scene(server, result, dark=dark).as_html(dark=dark)
        finally:
            server.stop()
    return HtmlFrame(page, f"{result.mission.title or result.mission.name} in three dimensions", height)


@contextmanager
def _silence_viser() -> Iterator[None]:
    """Keep viser from printing its address: nobody needs to look there."""
    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before
