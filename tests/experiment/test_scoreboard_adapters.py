"""Adapters of the scoreboard: each public layout gives the log that was written, and damage has an answer."""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np
import public_sets
import pymap3d
import pytest
from public_sets import WRITTEN, made
from sensor_logs import Tables

from lab.base.files.mission_error import MissionError
from lab.data.log.sensor_log import SensorLog
from lab.experiment.scoreboard.array_files import mat_structure, npy_array
from lab.experiment.scoreboard.comparison import checked_files, read
from lab.experiment.scoreboard.registry import data_set, data_sets
from lab.motion.frames.displacement import displacement


@pytest.fixture(scope="module")
def log() -> Tables:
    return made()


def as_written(found: SensorLog, log: Tables) -> None:
    """Check rates, fixes and reference of a log against the tables."""
    rates, forces = found.rates
    assert np.allclose(rates, log.imu[1 : len(rates) + 1, 1:4], atol=2e-6)
    assert np.allclose(forces, log.imu[1 : len(forces) + 1, 4:7], atol=2e-5)
    gnss = found.gnss
    stamps = gnss.time - gnss.time[0]
    rows = np.searchsorted(log.gnss[:, 0] - log.gnss[0, 0], stamps - 1e-3)
    place = np.column_stack((np.radians(log.gnss[rows, 1:3]), log.gnss[rows, 3]))
    assert np.abs(displacement(place, gnss.position)).max() < 1e-3
    known = ~np.isnan(gnss.velocity_n)
    assert np.allclose(gnss.velocity_n[known], log.gnss[rows, 4:7][known], atol=1e-6)
    assert known[:, :2].all()


@pytest.mark.parametrize(
    "name", ["rtkx_walk", "navego_adis16405", "navego_adis16488", "comma2k19", "vn310_static"]
)
def test_a_set_gives_the_log_that_was_written(tmp_path: Path, log: Tables, name: str) -> None:
    about = data_set(name)
    found = read(about, WRITTEN[name](tmp_path / name, log))
    as_written(found, log)
    # As long after the first sample as it was, but for what the registry takes off the stamps.
    late = log.gnss[0, 0] - log.imu[0, 0] - about.imu_late_s
    assert found.gnss.time[0] == pytest.approx(late, abs=2e-3)
    assert found.gnss.latency == about.latency_s
    assert np.allclose(found.gnss.lever_arm, about.lever_arm_m)


@pytest.mark.parametrize("name", ["navego_adis16405", "comma2k19", "vn310_static"])
def test_the_reference_is_that_of_the_set(tmp_path: Path, log: Tables, name: str) -> None:
    found = read(data_set(name), WRITTEN[name](tmp_path / name, log)).reference
    assert found is not None
    truth = log.reference
    place = np.column_stack((np.radians(truth[:, 1:3]), truth[:, 3]))
    assert np.abs(displacement(place, found.position)).max() < 1e-4
    assert np.allclose(found.velocity_n, truth[:, 4:7], atol=1e-6)
    apart = np.radians(truth[:, 7:10]) - found.euler
    assert np.allclose((apart + np.pi) % (2 * np.pi), np.pi, atol=1e-6)


def test_a_recorded_imu_is_stamped_by_its_time_tag(tmp_path: Path, log: Tables) -> None:
    about = data_set("rtkx_walk")
    plain = read(about, public_sets.gnss_imu(tmp_path / "a", log))
    found = read(about, public_sets.gnss_imu(tmp_path / "b", log, recorded=True))
    count = len(found.dtheta)
    assert count >= len(plain.dtheta) - 1
    assert np.allclose(found.time, plain.time[: count + 1], atol=1e-3)
    assert np.allclose(found.rates[1], plain.rates[1][:count], atol=1e-4)


def test_the_mounting_and_the_delay_of_a_drive_are_those_of_its_configuration(
    tmp_path: Path, log: Tables
) -> None:
    walk, drive = (data_set(name) for name in ("rtkx_walk", "rtkx_drive"))
    folder = public_sets.gnss_imu(tmp_path / "walk", log)
    table = np.loadtxt(folder / "imu_1730_sf.csv", delimiter=",")
    # The same body, seen by an IMU that is turned by roll 180° and yaw 180°: forward is -x, right is y.
    forward, right = -table[:, [2, 5]], -table[:, [1, 4]]
    table[:, [1, 4]], table[:, [2, 5]] = -forward, right
    np.savetxt(folder / "imu_1730_sf.csv", table, delimiter=",", fmt="%.9f")
    from dataclasses import replace

    turned = replace(walk, imu_rpy_deg=(180.0, 0.0, 180.0), imu_late_s=drive.imu_late_s)
    found = read(turned, folder)
    as_written(found, log)
    assert found.gnss.time[0] == pytest.approx(log.gnss[0, 0] - log.imu[0, 0] + 0.125, abs=2e-3)


def test_nclt_has_its_own_place_and_no_fix_without_a_mode(tmp_path: Path, log: Tables) -> None:
    found = read(data_set("nclt"), public_sets.nclt(tmp_path / "nclt", log))
    assert len(found.gnss.time) == len(log.gnss) - 1
    assert np.allclose(found.rates[1], log.imu[1 : len(found.dtheta) + 1, 4:7], atol=1e-4)
    assert found.reference is not None
    # pymap3d has the ellipsoid where the set has a local line: metres apart only beyond kilometres.
    truth = public_sets.moved(log.reference, log.gnss[0, 1:4])
    place = np.column_stack((np.radians(truth[:, 1:3]), truth[:, 3]))
    north, east, _ = pymap3d.geodetic2ned(*truth[:, 1:4].T, *public_sets.NCLT)
    near = np.hypot(north, east) < 1000
    assert near.sum() > 20
    assert np.abs(displacement(place[near], found.reference.position[near])).max() < 0.3


@pytest.mark.parametrize("name", ["navego_adis16405", "navego_adis16488"])
def test_the_biases_of_a_synthetic_set_are_correlated_as_its_example_makes_them(name: str) -> None:
    """navego_example_synth.m has gb_corr and ab_corr of 100 s, and its biases per hour and in mg."""
    about = data_set(name)
    sensors = about.settings["sensors"]
    assert [sensors[triad]["correlation_time"] for triad in ("gyro", "accelerometer")] == [100.0, 100.0]
    assert any(f"{sensors['accelerometer']['instability']:g} mg over 100 s" in one for one in about.assumed)


def test_a_rover_without_attitude_is_a_log(tmp_path: Path, log: Tables) -> None:
    found = read(data_set("navego_canada"), public_sets.canada(tmp_path / "navego_canada", log))
    as_written(found, log)
    assert found.reference is not None
    assert np.isnan(found.reference.euler).all()


def test_a_phone_drive_is_read_as_any_table(tmp_path: Path, log: Tables) -> None:
    found = read(data_set("oan_drive_short"), public_sets.phone(tmp_path / "oan_drive_short", log))
    rates, forces = found.rates
    assert np.allclose(forces.mean(axis=0), log.imu[:, 4:7].mean(axis=0), atol=0.05)
    assert np.allclose(rates.std(axis=0), log.imu[:, 1:4].std(axis=0), atol=0.01)


def test_kf_gins_text_is_read_as_any_format(tmp_path: Path) -> None:
    found = read(data_set("kf_gins"), public_sets.kf_gins(tmp_path / "kf_gins", 60))
    assert np.allclose(found.gnss.lever_arm, (0.136, -0.301, -0.184))
    assert found.reference is not None


@pytest.mark.parametrize("name", sorted(WRITTEN))
def test_each_made_set_is_complete_and_one_without_files_is_refused(
    tmp_path: Path, log: Tables, name: str
) -> None:
    from dataclasses import replace

    folder = WRITTEN[name](tmp_path / name, log)
    unregistered = replace(data_set(name), files={})
    found, checked = checked_files(unregistered, folder)
    assert len(found) >= 2
    assert checked == "nothing"
    assert checked_files(unregistered, folder, found)[1] == "first result"
    (tmp_path / "empty").mkdir()
    with pytest.raises(MissionError, match="holds no file"):
        checked_files(data_set(name), tmp_path / "empty")


@pytest.mark.parametrize("missing", ["imu.csv", "gnss.csv"])
@pytest.mark.parametrize("name", ["vn310_static", "rtkx_walk", "kf_gins"])
def test_half_a_log_is_refused_by_what_is_missing(
    tmp_path: Path, log: Tables, name: str, missing: str
) -> None:
    folder = public_sets.write(tmp_path / name, log)
    (folder / missing).unlink()
    with pytest.raises(MissionError, match=f"{missing} is missing; it is published at github.com"):
        checked_files(data_set(name), folder)


@pytest.mark.parametrize("name", [name for name in sorted(WRITTEN) if name not in ("oan_drive_short",)])
@pytest.mark.parametrize("cut", [0.0, 0.001, 0.5, 0.97])
def test_a_file_that_ends_early_has_an_answer(tmp_path: Path, log: Tables, name: str, cut: float) -> None:
    """Each file in turn is cut: the log is read without the rest, or the message names what is wrong."""
    folder = WRITTEN[name](tmp_path / name, log)
    for path in sorted(one for one in folder.rglob("*") if one.is_file()):
        whole = path.read_bytes()
        path.write_bytes(whole[: int(cut * len(whole))])
        try:
            read(data_set(name), folder)
        except MissionError as error:
            assert str(folder) in str(error)
        path.write_bytes(whole)


@pytest.mark.parametrize("seed", range(20))
def test_damaged_arrays_have_an_answer(tmp_path: Path, log: Tables, seed: int) -> None:
    rng = np.random.default_rng(seed)
    navego = public_sets.navego(tmp_path / "navego", log, compressed=bool(seed % 2))
    comma = public_sets.comma2k19(tmp_path / "comma2k19", log)
    mat, npy = navego / "gnss.mat", comma / "processed_log" / "IMU" / "accelerometer" / "value"
    for path in (mat, npy):
        content = bytearray(path.read_bytes())
        for at in rng.integers(0, min(len(content), 2000), 6):
            content[at] = rng.integers(256)
        path.write_bytes(content)
        try:
            found = mat_structure(mat, "gnss", ("t", "lat")) if path is mat else npy_array(npy)
            assert found is not None
        except MissionError as error:
            assert str(path) in str(error)


def test_an_array_of_objects_is_refused_and_not_unpickled(tmp_path: Path) -> None:
    class Bad:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return Path.touch, (tmp_path / "touched",)  # type: ignore[return-value]

    path = tmp_path / "value"
    with path.open("wb") as file:
        np.save(file, np.array([Bad()], dtype=object), allow_pickle=True)
    with pytest.raises(MissionError, match="real numbers"):
        npy_array(path)
    assert not (tmp_path / "touched").exists()


def test_a_small_file_that_grows_beyond_all_bounds_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("lab.experiment.scoreboard.array_files.MAX_BYTES", 2**20)
    packed = zlib.compress(bytes(2**23))
    head = b"MATLAB 5.0".ljust(124) + b"\x00\x01IM"
    path = tmp_path / "imu1.mat"
    path.write_bytes(head + np.array([15, len(packed)], "<u4").tobytes() + packed)
    with pytest.raises(MissionError, match="1 MB when decompressed"):
        mat_structure(path, "imu1", ("t",))


def test_every_layout_of_the_registry_has_a_reader() -> None:
    from lab.experiment.scoreboard.adapters import ADAPTERS

    assert {one.layout for one in data_sets().values()} <= ADAPTERS.keys() | {"log", "tables", "flight"}
