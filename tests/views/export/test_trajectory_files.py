"""Trajectories for other programs, read back as their formats are published, by readers that are not ours."""

from __future__ import annotations

import csv
import struct
import sys

import numpy as np
import pymap3d
import pytest
from scipy.spatial.transform import Rotation
from sensor_logs import tables, write

from lab import Experiment, Result, export_track
from lab.missions import MissionError, mission
from lab.motion.frames import earth
from lab.views.export.trajectory_files import Trajectory, pos, sbet, tum


@pytest.fixture(scope="module")
def result() -> Result:
    return Experiment(mission="montreal", seed=3).run()


def turning(latitude: float = 0.6, speed: float = 50.0, radius: float = 1000.0) -> Trajectory:
    """Return a level circle with the bank of a coordinated turn."""
    time = np.arange(0.0, 60.0, 0.01)
    turn = speed / radius
    meridian, transverse = earth.radii(np.sin(latitude))
    heading = turn * time
    north, east = radius * np.sin(heading), radius * (1 - np.cos(heading))
    position = np.column_stack((
        latitude + north / meridian, 0.3 + east / (transverse * np.cos(latitude)), np.zeros(time.size),
    ))  # fmt: skip
    velocity = speed * np.column_stack((np.cos(heading), np.sin(heading), 0 * heading))
    bank = np.arctan(speed * turn / 9.81)
    euler = np.column_stack((np.full(time.size, bank), 0 * heading, heading))
    unknown = np.full((time.size, 9), np.nan)
    return Trajectory(time, position, velocity, euler, position[0], unknown, unknown[:, :3])


def read_tum(text: str) -> np.ndarray:
    """Read as evo documents it: rows of eight numbers between blanks, after lines with #."""
    rows = [line.split(" ") for line in text.splitlines() if not line.startswith("#")]
    assert {len(row) for row in rows} == {8}
    return np.array(rows, dtype=float)


def test_evo_gets_metres_and_quaternions(result, tmp_path):
    export_track(result, tmp_path / "run.tum")
    found = read_tum((tmp_path / "run.tum").read_text())
    np.testing.assert_array_equal(found, np.loadtxt(tmp_path / "run.tum"))
    np.testing.assert_allclose(found[:, 0], result.time, atol=1e-9)
    solution, start = result.solution_arrays, result.truth_arrays.position[0]
    expected = pymap3d.geodetic2enu(*solution.position.T, *start, deg=False)
    np.testing.assert_allclose(found[:, 1:4], np.column_stack(expected), atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(found[:, 4:], axis=1), 1, atol=1e-8)
    # The nose in east, north, up: sines and cosines of heading and pitch, near the origin.
    nose = Rotation.from_quat(found[:, 4:]).apply([1, 0, 0])
    _, pitch, heading = result.euler.T
    there = np.column_stack((np.cos(pitch) * np.sin(heading), np.cos(pitch) * np.cos(heading), np.sin(pitch)))
    far = np.abs(found[:, 1:3]).max() / 6.3e6
    np.testing.assert_allclose(nose, there, atol=2 * far)


def test_a_run_and_its_mission_have_one_origin(result, tmp_path):
    export_track(result, tmp_path / "run.tum")
    export_track(mission("montreal"), tmp_path / "truth.tum")
    run, truth = (np.loadtxt(tmp_path / name) for name in ("run.tum", "truth.tum"))
    at = [np.interp(truth[:, 0], run[:, 0], run[:, axis]) for axis in (1, 2, 3)]
    apart = np.linalg.norm(truth[:, 1:4] - np.column_stack(at), axis=1)
    errors = result.errors.position.values
    inside = truth[:, 0] <= run[-1, 0]
    rms = np.sqrt((errors**2).sum(axis=1).mean())
    assert np.sqrt((apart[inside] ** 2).mean()) == pytest.approx(rms, rel=0.05)


def test_the_axes_turn_with_the_earth(tmp_path):
    """A place a thousand kilometres away: its vertical is tilted against that of the origin."""
    there = np.array([[0.0, 1000e3 / 6378137.0, 0.0]])
    one = Trajectory(
        np.zeros(1), there, np.zeros((1, 3)), np.zeros((1, 3)), np.zeros(3), np.full((1, 9), np.nan),
        np.full((1, 3), np.nan),
    )  # fmt: skip
    row = read_tum(b"".join(tum(one, {})).decode())[0]
    angle = 1000e3 / 6378137.0
    np.testing.assert_allclose(
        row[1:4], 6378137.0 * np.array([np.sin(angle), 0, np.cos(angle) - 1]), atol=1e-5
    )
    down = Rotation.from_quat(row[4:]).apply([0, 0, 1])
    np.testing.assert_allclose(down, [-np.sin(angle), 0, -np.cos(angle)], atol=1e-8)


def test_rtklib_gets_a_solution_file(result, tmp_path):
    """Columns as the manual of RTKLIB lists them."""
    export_track(result, tmp_path / "run.pos")
    lines = (tmp_path / "run.pos").read_text().splitlines()
    heads = [line for line in lines if line.startswith("%")]
    names = heads[-1].removeprefix("%").split()
    rows = [line.split() for line in lines if not line.startswith("%")]
    # GPST is week and seconds.
    assert {len(row) for row in rows} == {len(names) + 1}
    table = dict(zip(["week", "seconds", *names[1:]], np.array(rows, dtype=float).T, strict=True))
    solution = result.solution_arrays
    np.testing.assert_allclose(table["week"], 0)
    np.testing.assert_allclose(table["seconds"], result.time, atol=1e-6)
    np.testing.assert_allclose(np.radians(table["latitude(deg)"]), solution.position[:, 0], atol=1e-11)
    np.testing.assert_allclose(table["vu(m/s)"], -solution.velocity_n[:, 2], atol=1e-4)
    assert set(table["Q"]) == {5}
    sigma = result.sigma.position.values
    for number, name in enumerate(("sde(m)", "sdn(m)", "sdu(m)")):
        np.testing.assert_allclose(table[name], sigma[:, number], atol=1e-4)
    # Covariances: the sign times the square of what is written; of the last fix, P is known whole.
    last = result.position_covariance.values[-1]
    at = int(solution.fix_sample[solution.fix_sample >= 0][-1])
    for name, (a, b) in {"sdne(m)": (1, 0), "sdeu(m)": (0, 2), "sdun(m)": (1, 2)}.items():
        written = table[name][at] * abs(table[name][at])
        assert written == pytest.approx(last[a, b], abs=3e-4 * abs(last[a, b]) ** 0.5 + 1e-7)


def test_weeks_go_on_in_a_solution_file():
    one = turning()
    late = Trajectory(
        one.time + 2200 * 604_800 + 604_790, one.position, one.velocity_n, one.euler, one.origin, one.sigma,
        one.covariance,
    )  # fmt: skip
    rows = np.array(
        [line.split() for line in b"".join(pos(late, {})).decode().splitlines() if line[0] != "%"], float
    )
    assert rows[0, :2].tolist() == [2200, 604_790]
    assert rows[-1, 0] == 2201
    np.testing.assert_allclose(604_800 * rows[:, 0] + rows[:, 1] - late.time[0], one.time, atol=1e-6)
    # Unknown σ are zero.
    assert not rows[:, 7:13].any()
    seconds = np.frombuffer(b"".join(sbet(late, {})), "<f8").reshape(-1, 17)[:, 0]
    np.testing.assert_allclose(seconds, 604_790 + one.time, atol=1e-6)


def test_sbet_is_seventeen_doubles():
    """Order of the record as published; the numbers are those of a circle."""
    one = turning()
    data = b"".join(sbet(one, {}))
    record = struct.Struct("<17d")
    assert len(data) == record.size * one.time.size
    rows = np.array(list(record.iter_unpack(data)))
    np.testing.assert_array_equal(rows[:, 0], one.time)
    np.testing.assert_array_equal(rows[:, 1:4], one.position)
    np.testing.assert_array_equal(rows[:, 4:7], one.velocity_n)
    np.testing.assert_array_equal(rows[:, 7:9], one.euler[:, :2])
    # True heading is the platform's less the wander angle.
    np.testing.assert_allclose(np.sin(rows[:, 9] - rows[:, 10] - one.euler[:, 2]), 0, atol=1e-12)
    inner = rows[5:-5]
    speed, radius, bank = 50.0, 1000.0, one.euler[0, 0]
    centripetal = speed**2 / radius
    expected = [0, centripetal * np.cos(bank), -centripetal * np.sin(bank)]
    np.testing.assert_allclose(inner[:, 11:14], np.tile(expected, (len(inner), 1)), atol=2e-3)
    rate = speed / radius
    np.testing.assert_allclose(
        inner[:, 14:], np.tile([0, rate * np.sin(bank), rate * np.cos(bank)], (len(inner), 1)), atol=2e-5
    )


@pytest.mark.parametrize("ending", [".sbet", ".out"])
def test_a_run_is_an_sbet(result, tmp_path, ending):
    export_track(result, tmp_path / f"run{ending}")
    rows = np.fromfile(tmp_path / f"run{ending}", "<f8").reshape(-1, 17)
    np.testing.assert_array_equal(rows[:, 1], result.solution_arrays.position[:, 0])
    assert np.isfinite(rows).all()


def test_tables_name_their_units(result, tmp_path):
    export_track(result, tmp_path / "run.solution.csv")
    with (tmp_path / "run.solution.csv").open(newline="") as file:
        reader = csv.DictReader(line for line in file if not line.startswith("#"))
        rows = list(reader)
    assert reader.fieldnames[:4] == ["time_s", "latitude_deg", "longitude_deg", "height_m"]
    assert len(reader.fieldnames) == 19
    table = {name: np.array([float(row[name]) for row in rows]) for name in reader.fieldnames}
    np.testing.assert_allclose(table["heading_deg"], np.degrees(result.euler[:, 2]), atol=1e-8)
    np.testing.assert_allclose(table["velocity_down_m_s"], result.solution_arrays.velocity_n[:, 2], atol=1e-6)
    sigma = result.sigma
    for number, name in enumerate(("east", "north")):
        np.testing.assert_allclose(table[f"sigma_velocity_{name}_m_s"], sigma.velocity[:, number], rtol=1e-5)
    for number, name in enumerate(("roll", "pitch", "heading")):
        np.testing.assert_allclose(table[f"sigma_{name}_deg"], sigma.attitude[:, number], rtol=1e-5)
    export_track(mission("montreal"), tmp_path / "flight.solution.csv")
    lines = (tmp_path / "flight.solution.csv").read_text().splitlines()
    header = next(line for line in lines if not line.startswith("#"))
    assert "height_m" in header
    assert "sigma" not in header


def test_parquet_needs_its_library(result, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissionError, match=r"pip install 'ins-lab\[parquet\]'"):
        export_track(result, tmp_path / "run.parquet")
    assert not list(tmp_path.iterdir())


def test_parquet_has_the_columns(result, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    export_track(result, tmp_path / "run.parquet")
    table = parquet.read_table(tmp_path / "run.parquet")
    assert table.column_names[0] == "time_s"
    np.testing.assert_array_equal(table["height_m"].to_numpy(), result.solution_arrays.position[:, 2])


def test_a_log_has_its_reference(tmp_path):
    log = mission(write(tmp_path / "drive", tables(60, 75), 'title = "Drive"'))
    export_track(log, tmp_path / "drive.tum")
    rows = np.loadtxt(tmp_path / "drive.tum")
    reference = log.log.reference
    expected = pymap3d.geodetic2enu(*reference.position.T, *reference.position[0], deg=False)
    known = np.isfinite(reference.euler).all(axis=1)
    np.testing.assert_allclose(rows[:, 1:4], np.column_stack(expected)[known], atol=1e-5)
    # The clock is that of the file.
    np.testing.assert_allclose(rows[:, 0], reference.time[known] + log.log.epoch, atol=1e-6)
    run = Experiment(mission=str(tmp_path / "drive")).run()
    export_track(run, tmp_path / "run.tum")
    first = (tmp_path / "run.tum").read_text().splitlines()[0]
    assert first == (tmp_path / "drive.tum").read_text().splitlines()[0]
    (tmp_path / "drive" / "ref.csv").unlink()
    with pytest.raises(MissionError, match="no reference"):
        export_track(mission(tmp_path / "drive"), tmp_path / "other.tum")
