"""ArduPilot logs, read as an independent decoder reads them, and against the flight they were made of."""

from __future__ import annotations

import tempfile

import numpy as np
import pytest
from pymavlink.DFReader import DFReader_binary
from scipy.spatial.transform import Rotation
from writers import ardupilot as writer
from writers import autopilot

from lab.data.files import ardupilot
from lab.data.files.dataflash_file import DataFlashFile
from lab.data.formats import reader_of
from lab.data.log.vehicle import vehicle_of
from lab.missions import MissionError, mission
from lab.motion.frames import ecef

SENSORS = ("ATT", "XKF1", "POS", "IMU", "GPS", "GPA", "PARM")


@pytest.fixture(scope="module")
def written() -> bytes:
    return writer.write(mission("montreal").recording)


def test_an_independent_decoder_reads_the_same_numbers(written, path_of):
    short = written[: written.index(writer.MARKS, 200_000)]
    ours = DataFlashFile.of(short, SENSORS)
    theirs: dict[str, list] = {name: [] for name in SENSORS}
    reader = DFReader_binary(str(path_of(short)))
    while (message := reader.recv_msg()) is not None:
        if message.get_type() in theirs:
            theirs[message.get_type()].append(message)
    for name in SENSORS:
        for key, values in ours.numbers(name).items():
            np.testing.assert_allclose(
                values, [getattr(one, key) for one in theirs[name]], rtol=1e-12, err_msg=key
            )
    assert ours.texts("PARM", "Name") == [one.Name for one in theirs["PARM"]]
    assert ours.lost_bytes == 0


def test_the_flight_is_the_one_that_was_logged(written, path_of):
    path = path_of(written)
    assert reader_of(path).name == ardupilot.NAME
    flight = ardupilot.read([path], {})
    time = flight.time - writer.BOOT * 1e-6
    truth = autopilot.trajectory(mission("montreal").recording).at(time)
    position = np.column_stack((flight.latitude, flight.longitude, flight.height))
    assert np.abs(ecef.displacement(truth.position, position)).max() < 0.01
    assert np.abs(flight.velocity_n - truth.velocity_n).max() < 1e-4
    attitude = Rotation.from_euler("ZYX", flight.euler[:, ::-1])
    off = (attitude.inv() * Rotation.from_quat(truth.q_nb, scalar_first=True)).magnitude()
    assert off.max() < np.radians(0.009)  # three angles rounded to 0.01°
    assert flight.vehicle == "fixed wing"
    assert not flight.dropped
    assert len(time) == flight.rows_read == 5126


def test_the_sensors_are_those_that_were_logged(written, path_of):
    log = ardupilot.read_log(path_of(written))
    seen = autopilot.sensed(mission("montreal").recording, writer.IMU_RATE)
    turn, force = log.rates
    np.testing.assert_allclose(np.concatenate((turn, force), axis=1), seen.rates[1:], atol=2e-6)
    assert log.gnss.latency == pytest.approx(autopilot.GPS_DELAY)
    np.testing.assert_allclose(log.gnss.lever_arm, autopilot.LEVER_ARM, atol=1e-6)
    np.testing.assert_allclose(log.gnss.time + log.epoch - writer.BOOT * 1e-6, seen.gps_time, atol=1e-6)
    assert np.abs(ecef.displacement(seen.gps_position, log.gnss.position)).max() < 0.012
    # A course in single precision is good to 1.5e-5°, at 60 m/s.
    np.testing.assert_allclose(log.gnss.velocity_n, seen.gps_velocity, atol=2e-5)
    assert np.unique(log.gnss.velocity_sigma) == pytest.approx([autopilot.GPS_SIGMA[1]])


def renamed(data: bytes, old: str, new: str) -> bytes:
    """Return a log in which messages are called something else."""
    number, _, _ = writer.FORMATS[old]
    at = data.index(bytes((0xA3, 0x95, 128, number))) + 5
    return data[:at] + new.encode().ljust(4, b"\0") + data[at + 4 :]


def test_what_a_log_lacks_other_messages_stand_in_for(written, path_of):
    flight = ardupilot.read([path_of(renamed(written, "XKF1", "NKF1"))], {})
    assert len(flight.time) == 5126
    by_gps = ardupilot.read([path_of(renamed(written, "XKF1", "XXXX"))], {})
    at = autopilot.trajectory(mission("montreal").recording).at(by_gps.time - writer.BOOT * 1e-6)
    assert np.abs(by_gps.velocity_n - at.velocity_n).max() < 2.0  # noise, and 0.11 s of a turning aeroplane
    assert ardupilot.read([path_of(renamed(written, "ATT", "XXX"))], {}).euler is None
    without_geoid = ardupilot.read([path_of(renamed(written, "GPA", "XXX"))], {})
    np.testing.assert_allclose(without_geoid.height - flight.height, -writer.GEOID, atol=1e-4)
    assert "above sea level" in without_geoid.remarks[1]


def test_of_a_novatel_receiver_the_undulation_has_the_other_sign(written, path_of, monkeypatch):
    monkeypatch.setitem(writer.PARAMETERS, "GPS1_TYPE", 15.0)
    novatel = writer.write(mission("montreal").recording, undulation=writer.GEOID)
    np.testing.assert_array_equal(
        ardupilot.read([path_of(novatel)], {}).height, ardupilot.read([path_of(written)], {}).height
    )
    np.testing.assert_array_equal(
        ardupilot.read_log(path_of(novatel)).gnss.position, ardupilot.read_log(path_of(written)).gnss.position
    )


def test_of_several_cores_and_instances_the_first_is_taken(written, path_of):
    data, number = bytearray(written), writer.FORMATS["XKF1"][0]
    size, at, count = writer.packer("XKF1").size, 0, 0
    while (at := data.find(bytes((0xA3, 0x95, number)), at)) >= 0:
        if count % 2:
            data[at + 11] = 1  # the core, after header and time
        count += 1
        at += size
    flight = ardupilot.read([path_of(renamed(bytes(data), "ATT", "XXX"))], {})
    assert len(flight.time) == pytest.approx(5126 / 2, abs=1)


def test_messages_without_a_time_are_not_used(written, path_of):
    at = written.index(b"TimeUS,I,Status")
    without = written[:at] + b"TimeXX" + written[at + 6 :]
    with pytest.raises(MissionError, match="does not have a GPS"):
        ardupilot.read_log(path_of(without))
    assert len(ardupilot.read([path_of(without)], {}).time) == 5126


@pytest.fixture(scope="module", params=[2012, 2013, 2014])
def old(request) -> tuple[int, bytes]:
    return request.param, writer.write_old(mission("montreal").recording, request.param)


@pytest.mark.proof
def test_old_logs_with_times_in_milliseconds_or_of_the_week_are_read(old, path_of):
    year, data = old
    flight = ardupilot.read([path_of(data)], {})
    # 2012 has no clock but that of the GPS week, on which a message is where its fix was, not when written.
    since = 1e-3 * writer.WEEK_MS if year == 2012 else 1e-6 * writer.BOOT
    late = 0.0 if year == 2012 else writer.BUS_DELAY
    truth = autopilot.trajectory(mission("montreal").recording).at(
        np.clip(flight.time - since - late - autopilot.GPS_DELAY, 0, None)
    )
    place = np.column_stack((flight.latitude, flight.longitude, flight.height + writer.GEOID))
    assert np.sqrt(np.mean(ecef.displacement(truth.position, place) ** 2)) < 1.5  # noise 0.5 m, arm 1 m
    assert len(flight.time) > 5000
    assert (flight.made == ("vertical velocity",)) == (year < 2014)
    at = autopilot.trajectory(mission("montreal").recording).at(
        np.clip(flight.time - since + (writer.BUS_DELAY if year == 2012 else 0.0), 0, None)
    )
    off = Rotation.from_euler("ZYX", flight.euler[:, ::-1]).inv() * Rotation.from_quat(
        at.q_nb, scalar_first=True
    )
    assert np.degrees(np.sqrt(np.mean(off.magnitude() ** 2))) < (1.0 if year == 2012 else 0.05)


def test_the_sensors_of_old_logs_are_read(old, path_of):
    year, data = old
    log = ardupilot.read_log(path_of(data))
    seen = autopilot.sensed(mission("montreal").recording, writer.IMU_RATE)
    turn, force = log.rates
    start = 0
    if year == 2012:  # what is written before the first fix has no time
        start = int(np.searchsorted(seen.imu_time, seen.gps_time[0] + writer.BUS_DELAY))
    assert len(turn) > len(seen.rates) - start - 40
    if year > 2012:
        np.testing.assert_allclose(np.concatenate((turn, force), axis=1), seen.rates[1:], atol=2e-6)
    else:
        assert "IMU have no time" in log.repairs[-1]
    assert len(log.gnss.time) == len(seen.gps_time)
    # How late the fixes are against the IMU: by the receiver, and where T stamps them by the bus.
    first = seen.imu_time[start]
    late = log.gnss.time - (seen.gps_time - first)
    np.testing.assert_allclose(late, writer.BUS_DELAY, atol=0.03)
    np.testing.assert_allclose(log.gnss.velocity_n[:, :2], seen.gps_velocity[:, :2], atol=0.02)
    assert np.isnan(log.gnss.velocity_n[:, 2]).all() == (year < 2014)


def as_text(data: bytes) -> bytes:
    """Return a log as text, as an independent decoder writes it."""
    with tempfile.NamedTemporaryFile(suffix=".bin") as binary:
        binary.write(data)
        binary.flush()
        reader, lines = DFReader_binary(binary.name), []
        while (message := reader.recv_msg()) is not None:
            values = [getattr(message, name) for name in message.get_fieldnames()]
            lines.append(", ".join([message.get_type(), *map(str, values)]))
    return "\r\n".join(lines).encode()


@pytest.mark.proof
@pytest.mark.parametrize("year", [2013, 2014])
def test_a_log_as_text_is_the_log(year, path_of):
    data = writer.write_old(mission("montreal").recording, year)
    data = data[: data.index(writer.MARKS, 200_000)]
    by_bytes, by_text = ardupilot.read_log(path_of(data)), ardupilot.read_log(path_of(as_text(data)))
    np.testing.assert_allclose(by_text.dvelocity, by_bytes.dvelocity, atol=1e-7)
    np.testing.assert_allclose(by_text.gnss.position, by_bytes.gnss.position, atol=1e-11)
    flight = ardupilot.read([path_of(as_text(data))], {})
    np.testing.assert_allclose(flight.euler, ardupilot.read([path_of(data)], {}).euler, atol=1e-6)
    broken = as_text(data).replace(b"\nIMU, ", b"\nIMU, , ", 3)
    assert len(ardupilot.read_log(path_of(broken)).dtheta) == len(by_bytes.dtheta) - 3


def test_the_status_of_a_fix_was_2_in_2012_and_none_is_said(path_of):
    recording = mission("montreal").recording
    assert len(ardupilot.read_log(path_of(writer.write_old(recording, 2012, status=2))).gnss.time) > 900
    with pytest.raises(MissionError, match=r"none of the \d+ GPS messages has a fix.*Status 1 at most"):
        ardupilot.read_log(path_of(writer.write_old(recording, 2013, status=1)))


def test_broken_bytes_are_left_out_and_said(written, path_of):
    broken = bytearray(written)
    rng = np.random.default_rng(2)
    for start in (300_000, 600_000, 900_000):
        broken[start : start + 300] = rng.integers(0, 256, 300, dtype=np.uint8).tobytes()
    flight = ardupilot.read([path_of(bytes(broken[:1_200_000]))], {})
    assert 4900 < len(flight.time) < 5126
    assert any("could not be decoded" in remark for remark in flight.remarks)
    truth = autopilot.trajectory(mission("montreal").recording).at(flight.time - writer.BOOT * 1e-6)
    assert np.abs(flight.velocity_n - truth.velocity_n).max() < 0.1


def describe(name: bytes, form: bytes, columns: bytes, length: int = 60) -> bytes:
    return writer.message("FMT", 99, length, name, form, columns)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (writer.descriptions(), "no velocity.*none of the messages"),
        (writer.descriptions() + b"\xa3\x95" * 1_000_000, "no velocity"),
        (describe(b"XKF1", b"Qfff", b"TimeUS,VN,VE") + b"\xa3\x95\x63" + bytes(57), "no velocity"),
        (describe(b"XKF1", b"QQQQ", b"TimeUS,TimeUS,,\xff\xfe") + b"\xa3\x95\x63" + bytes(57), "no velocity"),
        (
            describe(b"XKF1", b"afff", b"TimeUS,VN,VE,VD", 79) + (b"\xa3\x95\x63" + bytes(76)) * 9,
            "no velocity",
        ),
    ],
)
def test_what_gives_no_flight_is_refused(path_of, data, words):
    with pytest.raises(MissionError, match=words):
        ardupilot.read([path_of(data)], {})
    with pytest.raises(MissionError):
        ardupilot.read_log(path_of(data))


@pytest.mark.parametrize("hovers", [True, False])
def test_the_course_of_an_aeroplane_that_hovers_is_not_its_heading(path_of, monkeypatch, hovers):
    monkeypatch.setitem(writer.PARAMETERS, "Q_ENABLE", float(hovers))
    path = path_of(writer.write(mission("montreal").recording))
    for vehicle in (ardupilot.read_log(path).auxiliary.vehicle, ardupilot.read([path], {}).vehicle):
        assert vehicle_of(vehicle).follows_nose is not hovers
