"""PX4 logs, read as PX4's own decoder reads them, and against the flight they were made of."""

from __future__ import annotations

import io
import struct

import numpy as np
import pytest
from pyulog import ULog
from scipy.spatial.transform import Rotation
from writers import autopilot
from writers import ulog as writer

from lab.data.files import ulog
from lab.data.files.streams import TIME
from lab.data.files.ulog_file import ULogFile
from lab.data.formats import reader_of
from lab.missions import MissionError, mission
from lab.motion.frames import ecef


@pytest.fixture(scope="module")
def written() -> bytes:
    return writer.write(mission("montreal").recording)


def angle_between(first: np.ndarray, second: np.ndarray) -> float:
    """Return the largest angle between attitudes given as Euler angles and as quaternions [rad]."""
    a = Rotation.from_euler("ZYX", first[:, ::-1])
    return float((a.inv() * Rotation.from_quat(second, scalar_first=True)).magnitude().max())


def test_the_decoder_of_px4_reads_the_same_numbers(written):
    ours = ULogFile.of(written, tuple(writer.FORMATS))
    theirs = ULog(io.BytesIO(written))
    assert not theirs.file_corruption
    assert ours.names == [one.name for one in theirs.data_list]
    for one in theirs.data_list:
        messages = ours.topic(one.name)
        assert len(messages) == len(one.data["timestamp"])
        for name, values in one.data.items():
            plain, _, place = name.partition("[")
            if "." in name:  # inside a nested type, of which no topic of ours has anything
                continue
            mine = messages[plain]
            np.testing.assert_array_equal(mine[:, int(place[:-1])] if place else mine, values)
    assert ours.parameters == pytest.approx(theirs.initial_parameters)
    assert (ours.dropouts, ours.dropped_seconds, ours.lost_bytes) == (1, 0.03, 0)


def test_the_flight_is_the_one_that_was_logged(written, path_of):
    path = path_of(written)
    assert reader_of(path).name == ulog.NAME
    flight = ulog.read([path], {})
    time = flight.time - writer.BOOT * 1e-6
    truth = autopilot.trajectory(mission("montreal").recording).at(time)
    # Attitude 50 times a second is the base; velocity 10 times a second is splined between.
    np.testing.assert_allclose(time, np.arange(len(time)) / 50, atol=1e-6)
    way = ecef.displacement(
        truth.position, np.column_stack((flight.latitude, flight.longitude, flight.height))
    )
    assert np.abs(way).max() < 5e-3
    assert np.abs(flight.velocity_n - truth.velocity_n).max() < 0.05
    assert angle_between(flight.euler, truth.q_nb) < 1e-6
    assert flight.vehicle == "fixed wing"
    assert [(drop.count, drop.first_row) for drop in flight.dropped] == [(1, 10252)]
    assert flight.rows_read == 10252


def test_the_sensors_are_those_that_were_logged(written, path_of):
    log = ulog.read_log(path_of(written))
    seen = autopilot.sensed(mission("montreal").recording)
    turn, force = log.rates
    np.testing.assert_allclose(np.concatenate((turn, force), axis=1), seen.rates[1:], atol=2e-5)
    assert log.gnss.latency == pytest.approx(autopilot.GPS_DELAY)
    np.testing.assert_allclose(log.gnss.lever_arm, autopilot.LEVER_ARM, atol=1e-6)
    np.testing.assert_allclose(log.gnss.time + log.epoch - writer.BOOT * 1e-6, seen.gps_time, atol=1e-6)
    assert np.abs(ecef.displacement(seen.gps_position, log.gnss.position)).max() < 0.01
    np.testing.assert_allclose(log.gnss.velocity_n, seen.gps_velocity, atol=1e-5)
    assert np.unique(log.gnss.position_sigma) == pytest.approx([autopilot.GPS_SIGMA[0]])


@pytest.mark.parametrize(
    ("old", "new", "names"),
    [
        (b"vehicle_global_position", b"vehicle_glabal_position", "local position"),
        (b"vehicle_local_position", b"vehicle_lacal_position!", "GPS velocity"),
        (b"vehicle_attitude", b"vehicle_altitude", None),
    ],
)
def test_what_a_log_lacks_other_topics_stand_in_for(written, path_of, old, new, names):
    flight = ulog.read([path_of(written.replace(old, new[: len(old)]))], {})
    truth = autopilot.trajectory(mission("montreal").recording)
    if names is None:
        assert flight.euler is None
        return
    at = truth.at(flight.time - writer.BOOT * 1e-6)
    assert angle_between(flight.euler, at.q_nb) < 1e-6
    assert any(names in drop.reason for drop in flight.dropped) or names == "local position"
    # The receiver's noise, and 0.11 s of a turning aeroplane.
    assert np.abs(flight.velocity_n - at.velocity_n).max() < (0.05 if names == "local position" else 2.0)


def test_a_local_position_is_on_the_map_of_px4():
    # The map's own forward formula (azimuthal equidistant, on a sphere), from a place to x and y and back.
    radius, (lat0, lon0) = 6371000.0, np.radians((-33.0, 151.0))
    lat, lon = np.radians((-33.05, 151.08))
    cos_c = np.sin(lat0) * np.sin(lat) + np.cos(lat0) * np.cos(lat) * np.cos(lon - lon0)
    k = np.arccos(cos_c) / np.sin(np.arccos(cos_c)) * radius
    x = k * (np.cos(lat0) * np.sin(lat) - np.sin(lat0) * np.cos(lat) * np.cos(lon - lon0))
    y = k * np.cos(lat) * np.sin(lon - lon0)
    names = (TIME, "ref_lat", "ref_lon", "ref_alt", "x", "y", "z")
    rows = np.array([(t, -33.0, 151.0, 20.0, x, y, -100.0) for t in range(1, 6)])
    stream = ulog._local_position(dict(zip(names, rows.T, strict=True)))
    np.testing.assert_allclose(stream.values[0], (lat, lon, 120.0), rtol=0, atol=1e-9)


def test_what_is_lost_is_said_of_the_sensors_too(written, path_of):
    assert any("could not keep up once" in one for one in ulog.read_log(path_of(written)).repairs)
    half = len(written) // 2
    log = ulog.read_log(path_of(written[:half] + bytes(1000) + written[half + 1000 :]))
    assert any("could not be decoded" in remark for remark in log.repairs)


def test_broken_bytes_are_left_out_and_said(written, path_of):
    broken = bytearray(written)
    rng = np.random.default_rng(2)
    for start in (700_000, 1_500_000, 2_200_000):
        broken[start : start + 300] = rng.integers(0, 256, 300, dtype=np.uint8).tobytes()
    flight = ulog.read([path_of(bytes(broken[:2_800_000]))], {})
    assert 0.75 * 10252 < len(flight.time) < 10252
    assert any("could not be decoded" in remark for remark in flight.remarks)
    truth = autopilot.trajectory(mission("montreal").recording).at(flight.time - writer.BOOT * 1e-6)
    assert np.abs(flight.velocity_n - truth.velocity_n).max() < 0.5
    position = np.column_stack((flight.latitude, flight.longitude, flight.height))
    assert np.abs(ecef.displacement(truth.position, position)).max() < 2


def test_gaps_of_one_topic_are_not_bridged(path_of):
    data = writer.write(mission("montreal").recording)
    log = ULogFile.of(data, ("vehicle_local_position",))
    topic = next(one for one in log._topics if one.name == "vehicle_local_position")
    silent = bytearray(data)
    for place in list(topic.places)[600:640]:  # four seconds
        silent[place - 3] = ord("L")  # the message becomes one of text
    flight = ulog.read([path_of(bytes(silent))], {})
    lost = [drop for drop in flight.dropped if "local velocity was not logged" in drop.reason]
    assert 195 <= lost[0].count - 1 <= 205
    assert np.diff(flight.time).max() == pytest.approx(4.0, abs=0.2)


def test_the_log_goes_on_behind_what_was_appended(written):
    # As after a crash: the end of the data is somewhere else than the messages say.
    half = written.index(writer.SYNC, 1_000_000) - 3
    cut = written[:half] + b"\x40\x00D\x00\x00 cut off"
    flags = written.index(b"\x28\x00B") + 3
    told = bytes(8) + b"\x01" + bytes(7) + struct.pack("<3Q", len(cut), 0, 0)
    data = cut[:flags] + told + cut[flags + 40 :] + written[half:]
    log = ULogFile.of(data, tuple(writer.FORMATS))
    assert len(log.topic("vehicle_attitude")) == 10252
    assert log.lost_bytes == 0


HEADER = b"ULog\x01\x12\x35\x01" + bytes(8)


@pytest.mark.proof
@pytest.mark.parametrize(
    ("data", "words"),
    [
        (HEADER, "no velocity.*none of the topics"),
        (HEADER + writer.message("B", bytes(8) + b"\x02" + bytes(31)), "newer or encrypted"),
        (HEADER + b"\xff" * 3_000_000, "no velocity"),
        (HEADER + b"\x00" * 300_000, "no velocity"),
    ],
)
def test_what_gives_no_flight_is_refused(path_of, data, words):
    with pytest.raises(MissionError, match=words):
        ulog.read([path_of(data)], {})
    with pytest.raises(MissionError):
        ulog.read_log(path_of(data))


def test_formats_that_grow_without_bound_are_refused_in_no_time():
    bombs = [f"t{i}:" + f"t{i + 1} a;" * 900 for i in range(8)] + ["t8:uint8_t b;"]
    bombs += ["vehicle_attitude:uint64_t timestamp;t0[65535] x;float[4] q;", "me:me[9] again;"]
    data = HEADER + b"".join(writer.message("F", bomb.encode()) for bomb in bombs)
    data += writer.message("A", struct.pack("<BH", 0, 0) + b"vehicle_attitude")
    log = ULogFile.of(data + writer.message("D", bytes(100)), ("vehicle_attitude",))
    assert log.topic("vehicle_attitude") is None


class Topics:
    """A log of topics given as rows, each of its fields."""

    def __init__(self, **topics: tuple[list[tuple], list[tuple]]) -> None:
        self.parameters = {"EKF2_GPS_DELAY": 110.0}
        self._topics = {name: np.array(rows, dtype=kinds) for name, (rows, kinds) in topics.items()}

    def topic(self, name: str) -> np.ndarray | None:
        """Return a topic, if the log has it."""
        return self._topics.get(name)


def test_the_receiver_of_newer_versions_has_degrees_and_its_own_time():
    names = ("latitude_deg", "longitude_deg", "altitude_msl_m", "altitude_ellipsoid_m")
    kinds = [("timestamp", "<u8"), ("timestamp_sample", "<u8"), *((name, "<f8") for name in names)]
    rows = [(10**6 * t + 150_000, 10**6 * t, -33.0, 151.0, 50.0, 72.0) for t in range(1, 9)]
    log = Topics(sensor_gps=(rows, kinds))
    gnss = ulog._gnss(log, ulog._gps(log))
    np.testing.assert_allclose(gnss.time, np.arange(1.0, 9.0))
    np.testing.assert_allclose(gnss.position[0], (*np.radians((-33.0, 151.0)), 72.0))
    assert gnss.latency == 0.0  # the time of the sample has it in
    without = Topics(sensor_gps=([(row[0], 0, *row[2:]) for row in rows], kinds))
    assert ulog._gnss(without, ulog._gps(without)).latency == pytest.approx(0.11)


@pytest.mark.parametrize(
    ("is_vtol", "kinds", "parameter", "vehicle"),
    [
        (1, (2, 1, 2), 0.0, "vtol"),  # hovered, and was switched off in forward flight
        (0, (1, 1, 2), 0.0, "fixed wing"),
        (0, (0, 0, 0), 22.0, "vtol"),
        (None, None, 2.0, "rotary wing"),  # versions from before 2018
        (None, None, float("nan"), ""),
        (None, (1, 1, 1), 22.0, "vtol"),
    ],
)
def test_the_vehicle_is_that_of_the_whole_flight(is_vtol, kinds, parameter, vehicle):
    columns = {"timestamp": ("<u8", (1, 2, 3))}
    if kinds is not None:
        columns["vehicle_type"] = ("u1", kinds)
    if is_vtol is not None:
        columns["is_vtol"] = ("u1", (0, is_vtol, is_vtol))
    rows = list(zip(*(values for _, values in columns.values()), strict=True))
    log = Topics(vehicle_status=(rows, [(name, kind) for name, (kind, _) in columns.items()]))
    log.parameters = {"MAV_TYPE": parameter}
    assert ulog._vehicle(log) == vehicle


def test_an_imu_that_is_logged_as_integrals_gives_rates():
    kinds = [
        ("timestamp", "<u8"), ("delta_angle", "<f4", (3,)), ("delta_velocity", "<f4", (3,)),
        ("delta_angle_dt", "<u4"), ("delta_velocity_dt", "<u4"),
    ]  # fmt: skip
    rows = [(5000 * t, (0.001, 0.0, -0.002), (0.0, 0.0, -0.049), 5000, 5000) for t in range(1, 40)]
    rows[7] = (*rows[7][:3], 0, 5000)
    imu = ulog._imu(Topics(vehicle_imu=(rows, kinds)))
    np.testing.assert_allclose(imu.values[0], (0.2, 0, -0.4, 0, 0, -9.8), rtol=1e-6)
    assert (imu.read, len(imu.time), imu.first_lost) == (39, 38, 8)
    combined = [("timestamp", "<u8"), ("gyro_rad", "<f4", (3,)), ("accelerometer_m_s2", "<f4", (3,))]
    seldom = [(100_000 * t, (0.0, 0.0, 1.0), (0.0, 0.0, -9.8)) for t in range(1, 9)]
    both = Topics(vehicle_imu=(rows, kinds), sensor_combined=(seldom, combined))
    assert len(ulog._imu(both).time) == 38


def test_a_log_without_a_fix_is_refused(written, path_of):
    log = ULogFile.of(written, ("vehicle_gps_position",))
    topic = next(one for one in log._topics if one.name == "vehicle_gps_position")
    nowhere = bytearray(written)
    for place in topic.places:
        nowhere[place + topic.layout.fields["fix_type"][1]] = 0
    with pytest.raises(
        MissionError,
        match=r"no fix of a receiver; accepted are both.*None of the \d+ GPS messages has a fix",
    ):
        ulog.read_log(path_of(bytes(nowhere)))
