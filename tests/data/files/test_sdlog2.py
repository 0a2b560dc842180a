"""PX4's sdlog2 logs, read as an independent decoder reads them, and against the flight they were made of."""

from __future__ import annotations

import numpy as np
import pytest
from pymavlink.DFReader import DFReader_binary
from scipy.spatial.transform import Rotation
from writers import ardupilot as dataflash
from writers import autopilot
from writers import sdlog2 as writer

from lab.data.files import ardupilot, sdlog2
from lab.data.files.dataflash_file import DataFlashFile
from lab.data.formats import reader_of
from lab.missions import MissionError, mission
from lab.motion.frames import ecef


@pytest.fixture(scope="module")
def written() -> bytes:
    return writer.write(mission("montreal").recording)


def truth_at(time: np.ndarray):
    return autopilot.trajectory(mission("montreal").recording).at(time - 1e-6 * writer.BOOT)


def test_an_independent_decoder_reads_the_same_numbers_and_times(written, path_of):
    short = written[: written.index(b"\xa3\x95\x81", 100_000)]
    ours = DataFlashFile.of(short, writer.FORMATS)
    reader = DFReader_binary(str(path_of(short)), zero_time_base=True)
    theirs: dict[str, list] = {name: [] for name in writer.FORMATS}
    while (message := reader.recv_msg()) is not None:
        if message.get_type() in theirs:
            theirs[message.get_type()].append(message)
    for name, messages in theirs.items():
        for key, values in ours.numbers(name).items():
            np.testing.assert_allclose(values, [getattr(one, key) for one in messages], rtol=1e-12)
    flight = sdlog2.read([path_of(short)], {})
    stamps = np.array([one._timestamp for one in theirs["GPOS"]])
    np.testing.assert_allclose(flight.time - flight.time[0], stamps - stamps[0], atol=2e-6)


def test_the_flight_is_the_one_that_was_logged(written, path_of):
    path = path_of(written)
    assert reader_of(path).name == sdlog2.NAME
    assert not ardupilot.recognises(written[:65536])
    flight = sdlog2.read([path], {})
    truth = truth_at(flight.time)
    way = ecef.displacement(
        truth.position, np.column_stack((flight.latitude, flight.longitude, flight.height))
    )
    assert np.abs(way).max() < 0.01
    assert np.abs(flight.velocity_n - truth.velocity_n).max() < 1e-5
    attitude = Rotation.from_euler("ZYX", flight.euler[:, ::-1])
    off = (attitude.inv() * Rotation.from_quat(truth.q_nb, scalar_first=True)).magnitude()
    assert off.max() < 1e-5
    assert flight.vehicle == "fixed wing"


def test_the_sensors_are_those_that_were_logged(written, path_of):
    log = sdlog2.read_log(path_of(written))
    seen = autopilot.sensed(mission("montreal").recording, writer.RATE)
    turn, force = log.rates
    np.testing.assert_allclose(
        np.concatenate((turn, force), axis=1), seen.rates[1 : len(turn) + 1], atol=2e-6
    )
    assert log.gnss.latency == pytest.approx(autopilot.GPS_DELAY)
    late = log.gnss.time + log.epoch - 1e-6 * writer.BOOT - seen.gps_time
    assert (late > -1e-6).all() and (late < 1 / writer.RATE + 1e-6).all()  # written by the loop
    assert np.abs(ecef.displacement(seen.gps_position, log.gnss.position)).max() < 0.012
    np.testing.assert_allclose(log.gnss.velocity_n, seen.gps_velocity, atol=1e-5)


def renamed(data: bytes, old: bytes, new: bytes) -> bytes:
    at = data.index(old.ljust(4, b"\0"))
    return data[:at] + new.ljust(4, b"\0") + data[at + 4 :]


def test_what_a_log_lacks_other_messages_stand_in_for(written, path_of):
    short = written[:600_000]
    by_gps = sdlog2.read([path_of(renamed(short, b"GPOS", b"XXXX"))], {})
    assert np.abs(by_gps.velocity_n - truth_at(by_gps.time).velocity_n).max() < 2.0
    by_angles = sdlog2.read([path_of(short.replace(b"qw,qx,qy,qz", b"aw,ax,ay,az"))], {})
    np.testing.assert_allclose(by_angles.euler, sdlog2.read([path_of(short)], {}).euler, atol=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [(b"GPOS", b"GPOS", "Fix 1 at most"), (b"TIME", b"TIMX", "no message TIME"), (b"IMU", b"XXX", "an IMU")],
)
def test_refusals_name_the_cause(written, path_of, old, new, words):
    data = bytearray(renamed(written[:200_000], old, new))
    if old == new:
        at = 0
        while (at := data.find(b"\xa3\x95\x08", at)) >= 0:
            data[at + 11] = 1
            at += 55
    with pytest.raises(MissionError, match=words):
        sdlog2.read_log(path_of(bytes(data)))


def test_a_clock_message_without_its_time_is_no_clock(written, path_of):
    data = written[:100_000].replace(b"StartTime", b"StartTimX", 1)
    data = data.replace(b"TALT" + bytes(5), b"StartTime", 1)
    with pytest.raises(MissionError, match="no message TIME"):
        sdlog2.read([path_of(data)], {})
    with pytest.raises(MissionError, match="no message TIME"):
        sdlog2.read_log(path_of(data))


def test_a_log_of_ardupilot_is_none_of_px4(path_of):
    head = dataflash.descriptions()
    assert not sdlog2.recognises(head)
    with pytest.raises(MissionError, match="is no PX4 sdlog2"):
        sdlog2.read([path_of(head)], {})
