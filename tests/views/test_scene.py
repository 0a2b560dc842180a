"""The scene in three dimensions: where things are, how the aircraft lies, how large the ellipsoids are."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import viser

from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.views.quantities import HELD
from lab.views.scene import LENGTH, Scene, aircraft


@pytest.fixture
def server() -> Iterator[viser.ViserServer]:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield server
    server.stop()


def node(server: viser.ViserServer, name: str):
    return server.scene._handle_from_node_name[name]


def rotate(wxyz: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Rotate a vector by a quaternion, by the textbook formula."""
    w, u = wxyz[0], wxyz[1:]
    return 2 * u.dot(vector) * u + (w * w - u.dot(u)) * vector + 2 * w * np.cross(u, vector)


def test_the_aircraft_is_where_the_navigator_was(server: viser.ViserServer, result: Result) -> None:
    scene = Scene(server, result)
    scene.show_time(120.0)
    index = int(np.searchsorted(result.time, 120.0))
    track = result.track
    start = [track[name].values[0, 0] for name in ("easting", "northing", "height")]
    now = [track[name].values[1, index] for name in ("easting", "northing", "height")]
    np.testing.assert_allclose(node(server, "/aircraft").position, np.subtract(now, start) / 1000, atol=1e-9)


def test_the_aircraft_looks_where_it_was_heading(server: viser.ViserServer, result: Result) -> None:
    scene = Scene(server, result)
    scene.show_time(90.0)
    index = int(np.searchsorted(result.time, 90.0))
    roll, pitch, heading = np.radians(result.solution["attitude"].values[index])
    wxyz = np.asarray(node(server, "/aircraft").wxyz)
    nose = [np.sin(heading) * np.cos(pitch), np.cos(heading) * np.cos(pitch), np.sin(pitch)]
    np.testing.assert_allclose(rotate(wxyz, np.array([1.0, 0, 0])), nose, atol=1e-9)
    right_wing = rotate(wxyz, np.array([0, 1.0, 0]))
    assert right_wing[2] == pytest.approx(-np.sin(roll) * np.cos(pitch), abs=1e-9)


def test_heights_are_exaggerated_as_asked(server: viser.ViserServer, result: Result) -> None:
    scene = Scene(server, result)
    scene.show_time(100.0)
    east, north, up = node(server, "/aircraft").position
    scene.exaggeration = 5.0
    scene.show(result, 100.0)
    np.testing.assert_allclose(node(server, "/aircraft").position, (east, north, 5 * up), rtol=1e-9)


def test_ellipsoids_have_the_filters_covariance(server: viser.ViserServer, result: Result) -> None:
    Scene(server, result, ellipsoid_scale=1.0)
    drawn = node(server, "/3σ ellipsoids")
    count = len(drawn.batched_positions)
    assert 0 < count <= 200
    axes = [[rotate(q.astype(float), unit) for unit in np.eye(3)] for q in np.asarray(drawn.batched_wxyzs)]
    R = np.array(axes).transpose(0, 2, 1)
    semi_axes = np.asarray(drawn.batched_scales, dtype=float) * 1000
    P = R @ (np.eye(3) * semi_axes[:, None, :] ** 2) @ R.transpose(0, 2, 1) / 9
    chosen = np.unique(np.linspace(0, len(result.fixes.time) - 1, count).astype(int))
    np.testing.assert_allclose(P, result.position_covariance.values[chosen], atol=2e-5)


def test_one_page_without_a_server(server: viser.ViserServer, result: Result) -> None:
    page = Scene(server, result).as_html()
    assert page.lstrip().lower().startswith("<!doctype html>")
    assert len(page) < 2_000_000


def test_a_new_result_replaces_the_old(server: viser.ViserServer, result: Result) -> None:
    scene = Scene(server, result)
    names = set(server.scene._handle_from_node_name)
    scene.show(result, 10.0)
    assert set(server.scene._handle_from_node_name) == names


def test_held_results_stand_beside_as_thin_paths_and_wire(server: viser.ViserServer, result: Result) -> None:
    other, far = Experiment(seed=2).run(), Experiment(mission="los_angeles").run()
    scene = Scene(server, result)
    names = set(server.scene._handle_from_node_name)
    scene.show(result, 10.0, [far, other])
    assert set(server.scene._handle_from_node_name) - names == {"/B", "/B/path", "/B/3σ ellipsoids"}
    ends = node(server, "/B/path").points
    start = [result.track[name].values[0, 0] for name in ("easting", "northing", "height")]
    last = [other.track.sel(path="estimated")[name].values[-1] for name in ("easting", "northing", "height")]
    np.testing.assert_allclose(ends[-1, 1], np.subtract(last, start) / 1000, atol=1e-5)
    assert 0 < len(node(server, "/B/3σ ellipsoids").batched_positions) <= 40
    assert scene.held == [("B", HELD[1])]
    scene.show(result, 10.0)
    assert set(server.scene._handle_from_node_name) == names
    assert scene.held == []


def test_the_aircraft_is_an_aeroplane() -> None:
    mesh = aircraft()
    low, high = mesh.bounds
    assert high[0] - low[0] == pytest.approx(LENGTH, abs=0.15)
    assert high[1] == pytest.approx(-low[1])
    assert high[1] - low[1] == pytest.approx(11.0)
    fin = mesh.vertices[mesh.vertices[:, 2] < -1]
    assert fin[:, 0].max() < 0


@pytest.mark.parametrize("dark", [True, False])
def test_what_is_drawn_stands_out_from_the_background(
    server: viser.ViserServer, result: Result, monkeypatch: pytest.MonkeyPatch, dark: bool
) -> None:
    chosen: list[bool] = []
    monkeypatch.setattr(server.gui, "configure_theme", lambda dark_mode, **_: chosen.append(dark_mode))
    scene = Scene(server, result, dark=not dark)
    scene.dress(dark)
    scene.show(result)
    assert chosen == [not dark, dark]
    background = 0 if dark else 255
    assert abs(np.mean(node(server, "/aircraft/mesh").color) - background) > 100
    ground = node(server, "/ground")
    lines = (ground.section_color, ground.cell_color)
    sections, cells = (abs(np.mean(colour) - background) for colour in lines)
    assert sections > cells > 30
