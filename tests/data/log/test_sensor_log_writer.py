"""Logs written and read back: every number the same; logs of autopilots as missions that are navigated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sensor_logs import tables, write
from writers import ardupilot, autopilot, ulog

from lab import Experiment
from lab.data.files.sensor_log_writer import write_sensor_log
from lab.data.formats import reader_of
from lab.data.log.auxiliary_data import AuxiliaryData, Comparison, Headings, Magnetometer, Series
from lab.data.log.sensor_log import SensorLog
from lab.missions import LogMission, MissionError, add_log, mission, missions, read_sensor_log
from lab.missions.catalogue import OWN_FOLDER_VARIABLE
from lab.motion.frames import ecef
from lab.motion.frames.rotation import euler_from_quaternion, wrap


@pytest.fixture(scope="module")
def log(tmp_path_factory) -> SensorLog:
    """Return a log with a reference, repeated samples and, unfilled, two gaps."""
    flown = tables(60, 90, lever_arm=(0.5, 0.1, -1.0))
    imu = np.delete(flown.imu, [*range(700, 760), *range(2000, 2150)], axis=0)
    imu[300] = imu[299]
    flown.gnss[5, -1] = flown.gnss[9, 4] = np.nan
    folder = write(
        tmp_path_factory.mktemp("logs") / "drive",
        flown._replace(imu=imu),
        "lever_arm_m = [0.5, 0.1, -1]\nlatency_s = 0.05",
    )
    for name in ("gnss.csv", "ref.csv"):
        text = (folder / name).read_text()
        (folder / name).write_text(text.replace("nan", ""))
    return read_sensor_log(folder)


def assert_same(read: SensorLog, written: SensorLog) -> None:
    np.testing.assert_allclose(read.time, written.time, rtol=0, atol=1e-12)
    for name in ("dtheta", "dvelocity"):
        np.testing.assert_allclose(getattr(read, name), getattr(written, name), rtol=1e-9, atol=1e-18)
    np.testing.assert_allclose(read.gaps, written.gaps, atol=1e-12)
    for name in ("time", "velocity_n", "position_sigma", "velocity_sigma", "lever_arm", "latency"):
        np.testing.assert_array_equal(getattr(read.gnss, name), getattr(written.gnss, name))
    np.testing.assert_allclose(read.gnss.position, written.gnss.position, rtol=4e-16)
    assert (read.reference is None) == (written.reference is None)
    if read.reference is not None:
        np.testing.assert_array_equal(read.reference.velocity_n, written.reference.velocity_n)
        np.testing.assert_allclose(read.reference.euler, written.reference.euler, rtol=4e-16, atol=1e-16)


def test_a_log_reads_back_the_same(log, tmp_path):
    assert len(log.gaps) == 2
    assert log.repairs
    write_sensor_log(tmp_path / "copy", log, title="A copy", description="Of the drive.", tags=["car"])
    found = mission(tmp_path / "copy")
    assert_same(found.log, log)
    assert found.title == "A copy"
    assert found.tags == ("car",)
    assert all(repair in found.description for repair in log.repairs)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["copy"]


def test_the_clock_of_the_recorder_is_kept(log, tmp_path):
    """What is at a time of its file is at the same time of the file that is written."""
    write_sensor_log(tmp_path / "copy", log, title="A copy")
    read = read_sensor_log(tmp_path / "copy")
    assert read.epoch == log.epoch > 1000
    first = np.loadtxt(tmp_path / "copy" / "gnss.csv", delimiter=",", skiprows=1, usecols=0)[0]
    assert first == pytest.approx(log.gnss.time[0] + log.epoch, abs=1e-9)


def test_what_was_recorded_beside_is_kept(log, tmp_path):
    rng = np.random.default_rng(4)
    times = np.arange(0.0, 20.0, 0.5)
    other = Comparison(times, *(rng.uniform(0.1, 1, size=(40, 3)) for _ in range(3)), name='"their" own')
    auxiliary = AuxiliaryData(
        "rotary wing",
        Magnetometer(times, rng.normal(scale=30, size=(40, 3)), -0.2),
        Headings(
            log.gnss.time[3:] - log.gnss.latency,
            rng.uniform(0, 6, len(log.gnss.time) - 3),
            np.full(len(log.gnss.time) - 3, 0.02),
        ),
        Series(times, rng.normal(300, 10, 40)),
        Series(times, rng.normal(10, 1, 40)),
        Series(times, rng.normal(60, 1, 40)),
        (other,),
    )
    breaks = np.array([[log.time[1500], log.time[1800]]])
    rows = np.delete(np.arange(len(log.dtheta)), np.arange(1501, 1800))
    broken = replace(
        log, auxiliary=auxiliary, breaks=breaks, time=np.delete(log.time, np.arange(1501, 1800)),
        dtheta=log.dtheta[rows], dvelocity=log.dvelocity[rows],
    )  # fmt: skip
    broken.dtheta[1500] = broken.dvelocity[1500] = 0.0
    write_sensor_log(tmp_path / "copy", broken, title="A copy")
    read = read_sensor_log(tmp_path / "copy")
    np.testing.assert_allclose(read.breaks, breaks, atol=1e-9)
    np.testing.assert_allclose(read.dtheta, broken.dtheta, rtol=1e-9, atol=1e-18)
    assert read.auxiliary.vehicle == "copter"
    np.testing.assert_array_equal(read.auxiliary.magnetometer.field, auxiliary.magnetometer.field)
    assert read.auxiliary.magnetometer.declination == pytest.approx(-0.2)
    np.testing.assert_allclose(read.auxiliary.headings.heading, auxiliary.headings.heading, rtol=1e-12)
    np.testing.assert_allclose(read.auxiliary.headings.time, auxiliary.headings.time, atol=1e-9)
    for name in ("barometer", "odometer", "airspeed"):
        kept, there = getattr(read.auxiliary, name), getattr(auxiliary, name)
        np.testing.assert_allclose(kept.value, there.value, rtol=1e-9)
        np.testing.assert_allclose(kept.time, there.time, atol=1e-9)
    (own,) = read.auxiliary.comparisons
    assert own.name == other.name
    for name in ("position", "velocity_n", "euler"):
        np.testing.assert_allclose(getattr(own, name), getattr(other, name), rtol=1e-12)


def test_nothing_is_left_of_a_log_that_cannot_be_written(log, tmp_path):
    (tmp_path / "there").mkdir()
    with pytest.raises(MissionError, match="is there already"):
        write_sensor_log(tmp_path / "there", log, title="x")
    with pytest.raises(MissionError, match="cannot be written: No such file"):
        write_sensor_log(tmp_path / "no" / "folder", log, title="x")
    gnss = log.gnss
    high = type(gnss)(**(vars(gnss) | {"position": gnss.position + np.array((0, 0, 2e5))}))
    with pytest.raises(MissionError, match=r"not written: .*log.*gnss\.csv.*alt_m"):
        write_sensor_log(tmp_path / "log", SensorLog(**(vars(log) | {"gnss": high})), title="x")
    assert [path.name for path in tmp_path.iterdir()] == ["there"]


@pytest.fixture
def own(tmp_path, monkeypatch):
    monkeypatch.setenv(OWN_FOLDER_VARIABLE, str(tmp_path))
    return tmp_path


def test_added_logs_are_listed_and_names_are_free_once(log, own):
    added = add_log(log, "drive", title=" To work ", tags=["car", "car"])
    assert isinstance(missions()["drive"], LogMission)
    assert (added.title, added.tags) == ("To work", ("car",))
    assert not [path for path in own.iterdir() if path.name not in {"drive", ".lock"}]
    for name, words in (
        ("drive", "a log has it"),
        ("montreal", "ships with the lab"),
        ("../x", "not accepted|;"),
    ):
        with pytest.raises(MissionError, match=words):
            add_log(log, name, title="Again")
    with pytest.raises(MissionError, match="title"):
        add_log(log, "other", title=" ")
    assert [name for name in missions() if name not in {"montreal", "los_angeles", "pacific"}] == ["drive"]


@pytest.mark.proof
@pytest.mark.parametrize(("writer", "boot"), [(ulog, ulog.BOOT), (ardupilot, ardupilot.BOOT)])
def test_the_log_of_an_autopilot_is_navigated_to_the_flight_it_was_made_of(writer, boot, own):
    recording = mission("montreal").recording
    path = own / "flight.log"
    path.write_bytes(writer.write(recording))
    log = reader_of(path).read_log(path)
    add_log(log, "flown", title="Flown", description=str(path.name))
    experiment = Experiment(mission="flown")
    experiment.update({"sensors": {"gyro": {"bias_sigma": 0.3}, "gps": {"velocity_variance": 0.01}}})
    result = experiment.run()
    late = result.time > 60  # the heading comes from the turn after take-off
    truth = autopilot.trajectory(recording).at(result.time[late] + log.epoch - boot * 1e-6)
    solution = result.solution_arrays
    off = ecef.displacement(truth.position, solution.position[late])
    velocity = solution.velocity_n[late] - truth.velocity_n
    angles = np.degrees(wrap(euler_from_quaternion(solution.q_nb[late]) - truth.euler))
    # Fixes of 0.5 m and 0.1 m/s, 5 times a second.
    assert np.sqrt(np.mean(off**2, axis=0)).max() < 0.3
    assert np.sqrt(np.mean(velocity**2, axis=0)).max() < 0.1
    assert np.sqrt(np.mean(angles**2, axis=0)).max() < 0.6


def test_imu_and_gps_of_a_device_are_kept_when_its_odometer_contradicts_them(log, tmp_path):
    speed = np.hypot(*log.gnss.velocity_n[:, :2].T)
    wrong = AuxiliaryData(odometer=Series(log.gnss.time, 3.6 * np.nan_to_num(speed)))
    write_sensor_log(tmp_path / "copy", replace(log, auxiliary=wrong), title="A copy")
    assert read_sensor_log(tmp_path / "copy").auxiliary.odometer is not None
    toml = (tmp_path / "copy" / "log.toml").read_text()
    (tmp_path / "copy" / "log.toml").write_text(toml.replace("check_sensors = false", ""))
    with pytest.raises(MissionError, match=r"odo.csv, column speed_m_s: .* look like km/h"):
        read_sensor_log(tmp_path / "copy")
