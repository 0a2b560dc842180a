"""MAVLink telemetry logs, read as pymavlink's own log reader reads them, and against the flight they hold."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from live_streams import decoded
from pymavlink import mavutil
from scipy.spatial.transform import Rotation
from writers import autopilot
from writers import mavlink as writer

from lab.data.formats import reader_of
from lab.data.log.vehicle import vehicle_of
from lab.data.protocols import mavlink_file as mavlink
from lab.data.protocols.catalogue import make_decoder
from lab.missions import MissionError, mission
from lab.motion.frames import ecef

UNIX = writer.START.timestamp()


@pytest.fixture(scope="module")
def written() -> bytes:
    return writer.write(mission("montreal").recording)


def place(fix: np.ndarray) -> np.ndarray:
    """Return latitude, longitude and height of fixes."""
    return np.column_stack([fix[name] for name in ("latitude", "longitude", "height")])


def vehicle(
    system: int = 1, seconds: int = 10, boot: int = 5000, lat: float = 45.0, kind: int = 2
) -> writer.Station:
    """Return what a vehicle sends that goes north at 10 m/s and climbs at 2 m/s, its nose to the east."""
    station = writer.Station(system)
    station.add(0.0, "HEARTBEAT", kind, 3, 81, 0, 4)
    for t in np.arange(0, seconds, 0.2).tolist():
        stamp = boot + round(1e3 * t)
        place = (round(1e7 * (lat + t * 9e-5)), -730_000_000, round(1e3 * (100 + 2 * t)))
        station.add(t, "GLOBAL_POSITION_INT", stamp, *place, 0, 1000, 0, -200, 9000)
        station.add(t, "ATTITUDE", stamp, 0.0, 0.0, np.pi / 2, 0.0, 0.0, 0.0)
    return station


def fixes(station: writer.Station, seconds: int = 10, kind: int = 3, stamp: float = 5.0) -> None:
    """Add the fixes of a receiver that goes east at 10 m/s and climbs at 2 m/s, 40 m above the ellipsoid."""
    for t in np.arange(0, seconds, 0.2).tolist():
        place = (450_000_000, round(1e7 * (-73 + t * 1.27e-4)), round(1e3 * (100 + 2 * t)))
        numbers = (*place, 70, 110, 1000, 9000, 12)
        clock = max(0, round(1e6 * (stamp + t)))
        station.add(t, "GPS_RAW_INT", clock, kind, *numbers, alt_ellipsoid=place[2] + 40_000)


def test_an_independent_reader_finds_the_same_numbers(written, path_of):
    path = path_of(written)
    flight = mavlink.read([path], {})
    link = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    theirs = []
    while (message := link.recv_match(type="LOCAL_POSITION_NED")) is not None:
        theirs.append((message.time_boot_ms, message.vx, message.vy, message.vz))
    theirs = np.array(theirs)[: len(flight.time)]
    np.testing.assert_allclose(flight.time, theirs[:, 0] / 1e3, atol=1e-9)
    np.testing.assert_array_equal(flight.velocity_n, theirs[:, 1:])


def test_the_flight_is_the_one_that_was_sent(written, path_of):
    path = path_of(written)
    assert reader_of(path).name == mavlink.NAME
    flight = mavlink.read([path], {})
    time = flight.time - writer.BOOT * 1e-3
    truth = autopilot.trajectory(mission("montreal").recording).at(time)
    way = ecef.displacement(
        truth.position, np.column_stack((flight.latitude, flight.longitude, flight.height))
    )
    assert np.abs(way).max() < 0.02
    assert np.abs(flight.velocity_n - truth.velocity_n).max() < 1e-4
    off = Rotation.from_euler("ZYX", flight.euler[:, ::-1]).inv() * Rotation.from_quat(
        truth.q_nb, scalar_first=True
    )
    assert off.magnitude().max() < 1e-5
    assert flight.vehicle == "fixed wing"
    assert not flight.dropped
    assert len(time) == flight.rows_read == 4101
    assert "2024-05-17 23:58 UTC" in flight.remarks[0]
    assert "geoid's separation of the receiver (-31.4 m)" in flight.remarks[1]


@pytest.mark.proof
@pytest.mark.parametrize(
    ("imu", "turn", "force"),
    [
        # Half of what is rounded to: 1 mrad/s and a thousandth of g.
        ("RAW_IMU", 5.1e-4, 5e-3),
        ("SCALED_IMU", 5.1e-4, 5e-3),
        ("HIGHRES_IMU", 1e-6, 1e-5),
    ],
)
def test_the_sensors_are_those_that_were_sent(path_of, imu, turn, force):
    recording = mission("montreal").recording
    log = mavlink.read_log(path_of(writer.write(recording, imu)))
    seen = autopilot.sensed(recording, writer.IMU_RATE)
    turns, forces = log.rates
    stamps = log.time[1:] + log.epoch - writer.BOOT * 1e-3
    at = np.rint(stamps * writer.IMU_RATE).astype(int) - 1
    np.testing.assert_allclose(turns, seen.rates[at, :3], atol=turn)
    np.testing.assert_allclose(forces, seen.rates[at, 3:], atol=force)
    assert len(at) > 0.97 * len(seen.imu_time)
    assert log.gnss.latency == pytest.approx(autopilot.GPS_DELAY)
    np.testing.assert_allclose(log.gnss.lever_arm, autopilot.LEVER_ARM, atol=1e-6)
    np.testing.assert_allclose(log.gnss.time + log.epoch - writer.BOOT * 1e-3, seen.gps_time, atol=2e-6)
    assert np.abs(ecef.displacement(seen.gps_position, log.gnss.position)).max() < 0.012
    # Speed to 1 cm/s, course to 0.01° at 60 m/s; GPS_RAW_INT has no vertical velocity.
    np.testing.assert_allclose(log.gnss.velocity_n[:, :2], seen.gps_velocity[:, :2], atol=0.012)
    assert np.isnan(log.gnss.velocity_n[:, 2]).all()
    assert np.unique(log.gnss.velocity_sigma) == pytest.approx([autopilot.GPS_SIGMA[1]])
    assert np.unique(log.gnss.position_sigma) == pytest.approx([autopilot.GPS_SIGMA[0]])
    # A stream of the same bytes has the same samples and fixes.
    found = decoded(make_decoder("mavlink"), writer.write(recording, imu), 4096)
    np.testing.assert_allclose(found.imu["time"], log.time + log.epoch, rtol=1e-15)
    np.testing.assert_allclose(found.imu["rate"][1:], turns, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.fix["velocity_n"], log.gnss.velocity_n)
    assert np.abs(ecef.displacement(log.gnss.position, place(found.fix))).max() < 1e-6


def test_headings_and_wheels_are_those_of_a_stream(path_of):
    station = vehicle()
    for k, t in enumerate(np.arange(0, 30, 0.05).tolist()):
        stamp = round(1e6 * (5 + t))
        station.add(t, "RAW_IMU", stamp, 10, 20, -1000 + k % 3, k % 5, k % 4, k % 7, 0, 0, 0)
        station.add(t, "WHEEL_DISTANCE", stamp, 2, [4 * t, 4.2 * t, *[99.0] * 14])
        if k % 4 == 0:
            place = (450_000_000, round(1e7 * (-73 + t * 1.27e-4)), 100_000, 70, 110, 1000, 9000, 12)
            station.add(t, "GPS_RAW_INT", stamp, 3, *place, yaw=(k * 50) % 36_000, hdg_acc=(k % 8) * 10_000)
    data = writer.log(station)
    log, found = mavlink.read_log(path_of(data)), decoded(make_decoder("mavlink"), data)
    headings, odometer = log.auxiliary.headings, log.auxiliary.odometer
    rows = found.reading[np.isfinite(found.reading["heading"])]
    np.testing.assert_allclose(headings.time + log.epoch, rows["time"])
    np.testing.assert_array_equal(headings.heading, rows["heading"])
    np.testing.assert_array_equal(headings.sigma, rows["heading_sigma"])
    rows = found.reading[np.isfinite(found.reading["speed"])]
    np.testing.assert_allclose(odometer.time + log.epoch, rows["time"])
    np.testing.assert_allclose(odometer.value, 4.1)
    np.testing.assert_allclose(rows["speed"], 4.1)


def test_signs_and_units_of_whole_numbers(path_of):
    flight = mavlink.read([path_of(writer.log(vehicle()))], {})
    np.testing.assert_allclose(flight.velocity_n, np.tile([10.0, 0.0, -2.0], (len(flight.time), 1)))
    np.testing.assert_allclose(np.degrees(flight.euler[:, 2]), 90.0)
    np.testing.assert_allclose(np.degrees(flight.longitude), -73.0)
    np.testing.assert_allclose(flight.height, 100 + 2 * (flight.time - 5.0), atol=1e-3)
    assert flight.vehicle == "rotary wing"
    assert "above sea level" in flight.remarks[1]


@pytest.mark.parametrize(("kind", "follows"), [(1, True), (2, False), (20, False)])
def test_what_hovers_does_not_follow_its_nose(path_of, kind, follows):
    """MAV_TYPE 20 takes off like a copter and flies like an aeroplane."""
    flight = mavlink.read([path_of(writer.log(vehicle(kind=kind)))], {})
    assert vehicle_of(flight.vehicle).follows_nose is follows


def test_without_a_solution_the_track_of_the_receiver_is_taken(path_of):
    station = writer.Station()
    fixes(station, 4, kind=1)
    fixes(station, 1, stamp=-10.0)  # stamped zero, as nothing is known yet
    fixes(station, 30, stamp=9.0)
    flight = mavlink.read([path_of(writer.log(station))], {})
    np.testing.assert_allclose(
        flight.velocity_n[:, :2], np.tile([0.0, 10.0], (len(flight.time), 1)), atol=1e-9
    )
    np.testing.assert_allclose(flight.velocity_n[:, 2], -2.0, atol=1e-6)
    np.testing.assert_allclose(flight.height, 140 + 2 * (flight.time - 9.0), atol=1e-3)
    assert flight.time[0] == 9.0
    assert [(one.reason, one.count) for one in flight.dropped] == [
        ("without a fix", 20),
        ("without a time", 5),
    ]
    assert flight.dropped[0].first_row == 1
    assert "track of its GPS" in flight.remarks[0]
    assert flight.euler is None


def test_a_receiver_stamped_by_the_calendar_is_brought_to_the_clock_of_the_autopilot(path_of):
    station = writer.Station()
    for t in range(10):
        station.add(t, "SYSTEM_TIME", round(1e6 * (UNIX + t)), 5000 + 1000 * t)
    fixes(station, 10, stamp=UNIX)
    flight = mavlink.read([path_of(writer.log(station))], {})
    np.testing.assert_allclose(flight.time[[0, -1]], [5.0, 14.8], atol=1e-6)


def test_of_several_vehicles_and_starts_the_one_with_most_positions_is_taken(path_of):
    station = vehicle(seconds=5, boot=900_000)
    station.frames += [(t + 20.0, frame) for t, frame in vehicle(seconds=20, boot=5000, lat=-33.0).frames]
    other = vehicle(7, 6, lat=10.0)
    flight = mavlink.read([path_of(writer.log(station, other))], {})
    assert len(flight.time) == 100
    assert np.degrees(flight.latitude).max() < -32.9
    assert flight.time[0] == 5.0
    # 25 and 30 times two messages and the heartbeats, that of the second start before its first time too.
    assert [(one.count, "another start" in one.reason) for one in flight.dropped] == [(51 + 61 + 1, True)]


def test_a_ground_station_is_no_vehicle(path_of):
    station = writer.Station(255, 190)
    for t in range(20):
        station.add(t, "HEARTBEAT", 6, 8, 192, 0, 4, v1=True)
    with pytest.raises(MissionError, match="no message of a vehicle"):
        mavlink.read([path_of(writer.log(station))], {})


def test_broken_bytes_are_left_out_and_said(written, path_of):
    broken = bytearray(written)
    rng = np.random.default_rng(2)
    for start in (200_000, 400_000, 600_000):
        broken[start : start + 300] = rng.integers(0, 256, 300, dtype=np.uint8).tobytes()
    flight = mavlink.read([path_of(bytes(broken[:800_000]))], {})
    assert any("bytes of the file belong to no sound message" in remark for remark in flight.remarks)
    truth = autopilot.trajectory(mission("montreal").recording).at(flight.time - writer.BOOT * 1e-3)
    assert np.abs(flight.velocity_n - truth.velocity_n).max() < 0.2
    assert len(flight.time) > 3000
    damaged = bytearray(written)
    at = written.index(b"\x21\0\0", 100_000)  # 33, GLOBAL_POSITION_INT
    damaged[at + 10] ^= 1
    # The payload ends in 65,535 and has 28 bytes, in a frame of 40 after a stamp of 8.
    assert "48 bytes of the file" in " ".join(mavlink.read([path_of(bytes(damaged))], {}).remarks)


def test_a_vehicle_without_a_fix_is_refused_with_the_cause(path_of):
    station = writer.Station()
    fixes(station, kind=1)
    for t in range(20):
        station.add(t, "GLOBAL_POSITION_INT", 1000 * t, 0, 0, 0, 0, 0, 0, 0, 0)
    with pytest.raises(MissionError, match=r"none of the 50 messages GPS_RAW_INT .*fix_type 1 at most"):
        mavlink.read([path_of(writer.log(station))], {})
    only = writer.Station()
    only.add(0.0, "ATTITUDE", 5000, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    with pytest.raises(MissionError, match=r"no GPS_RAW_INT was sent.*1 ATTITUDE"):
        mavlink.read([path_of(writer.log(only))], {})
    with pytest.raises(MissionError, match="did not send a GPS"):
        mavlink.read_log(path_of(writer.log(only)))


def test_an_imu_sent_too_seldom_or_in_counts_is_refused(path_of):
    station = writer.Station()
    fixes(station, 30)
    counts = writer.Station()
    fixes(counts, 30)
    for t in np.arange(0, 30, 0.5).tolist():
        stamp = round(1e6 * (5 + t))
        station.add(t, "RAW_IMU", stamp, 10, 20, -1000 + round(t), 1, 2, 3, 0, 0, 0)
        counts.add(t, "RAW_IMU", stamp, 300, 500, -16_384, 30, -50, 7, 0, 0, 0)
    with pytest.raises(MissionError, match=r"IMU was sent 2 times a second.*at least 10"):
        mavlink.read_log(path_of(writer.log(station)))
    with pytest.raises(MissionError, match=r"did not send an IMU .*that can be used"):
        mavlink.read_log(path_of(writer.log(counts)))


def test_a_real_log_of_a_submarine_at_the_surface_says_why_it_is_no_flight():
    folder = Path(os.environ.get("INS_LAB_CAPTURES", Path(__file__).parents[4] / "shared" / "captures"))
    path = folder / "mavlink_blueos_head400k.tlog"
    if not path.is_file():
        pytest.skip(f"no captures in {folder}; INS_LAB_CAPTURES names their folder")
    assert reader_of(path).name == mavlink.NAME
    with pytest.raises(MissionError, match=r"none of the 128 messages GPS_RAW_INT.*192 GLOBAL_POSITION_INT"):
        mavlink.read([path], {})
    with pytest.raises(MissionError, match="IMU was sent 2 times a second"):
        mavlink.read_log(path)
