"""Bytes of devices that other programs saved: they are replayed by the times in them."""

from __future__ import annotations

import numpy as np
import pytest
from live_streams import RATE, fixes, motion
from writers import WRITERS

from lab.data.protocols.catalogue import ENCODERS
from lab.data.streams.capture import holds_samples, iterate_records
from lab.data.streams.raw_recording import DATA, RecordingError
from lab.data.streams.recorded_log import device_log, log_of_recording, recorded_samples
from lab.data.streams.transport import TransportError
from lab.live import open as open_source
from lab.missions import Recording, mission

COUNT = 3000
"""Samples of the IMU: half a minute."""
WITH_CLOCK = ["vectornav", "xsens", "mip", "ublox", "mavlink", "phone", "text"]
"""Protocols whose samples have a time."""


def part() -> Recording:
    """Return 20 s of montreal."""
    flight = mission("montreal").recording
    rows = slice(0, int(np.searchsorted(flight.time, 20.0)))
    names = ("time", "latitude", "longitude", "height", "velocity_n", "euler")
    return Recording(**{name: getattr(flight, name)[rows] for name in names})


@pytest.fixture
def capture(tmp_path):
    """Return a function that writes what a device sent into a file."""

    def write(protocol: str, count: int = COUNT):
        path = tmp_path / f"{protocol}.bin"
        path.write_bytes(ENCODERS[protocol]().encode(motion(count), fixes(count // 100)))
        return path

    return write


@pytest.mark.proof
@pytest.mark.parametrize("protocol", WITH_CLOCK)
def test_samples_come_at_the_times_that_are_in_them(capture, protocol):
    found = recorded_samples(capture(protocol))
    assert found.reception.detector.protocol == protocol
    assert len(found.imu) > 0.99 * COUNT
    steps = np.diff(found.imu["time"])
    assert np.median(steps) == pytest.approx(1 / RATE, rel=1e-3)
    assert steps.max() < 1.5 / RATE
    assert found.reception.loss.jumps == 0


@pytest.mark.proof
@pytest.mark.parametrize("protocol", ["vectornav", "xsens", "mip", "ublox"])
def test_a_capture_becomes_a_log(capture, protocol):
    log = log_of_recording(capture(protocol))
    assert log.duration == pytest.approx(COUNT / RATE, abs=2.0)
    assert len(log.gnss.time) >= COUNT / 100 - 3
    # Fixes are a second apart, and so are the positions in them.
    north = np.degrees(np.diff(log.gnss.position[:, 0]) / np.diff(log.gnss.time))
    np.testing.assert_allclose(north, np.degrees(1e-6), rtol=0.15)


@pytest.mark.parametrize("protocol", ["ublox", "nmea"])
def test_a_receiver_without_an_imu_gives_its_fixes(tmp_path, protocol):
    path = tmp_path / "gps.bin"
    path.write_bytes(ENCODERS[protocol]().encode(motion(0), fixes(60)))
    found = recorded_samples(path)
    assert len(found.imu) == 0
    np.testing.assert_allclose(np.diff(found.fix["time"]), 1.0, rtol=0, atol=0.02)


def test_a_pause_in_the_capture_stays_one(tmp_path):
    imu = motion(COUNT)
    imu["time"][COUNT // 2 :] += 12.0
    path = tmp_path / "pause.bin"
    path.write_bytes(ENCODERS["vectornav"]().encode(imu, fixes(0)))
    time = recorded_samples(path).imu["time"]
    assert np.diff(time).max() == pytest.approx(12.0, abs=0.05)


def test_a_clock_that_was_set_back_goes_on(tmp_path):
    imu = motion(COUNT)
    imu["time"][COUNT // 2 :] -= 5.0
    path = tmp_path / "set.bin"
    path.write_bytes(ENCODERS["vectornav"]().encode(imu, fixes(0)))
    found = recorded_samples(path)
    assert found.reception.loss.jumps == 1
    assert (np.diff(found.imu["time"]) > 0).all()
    assert np.ptp(found.imu["time"]) == pytest.approx(COUNT / RATE, abs=0.5)


def test_no_byte_is_lost(capture):
    path = capture("vectornav")
    path.write_bytes(b"noise before" + path.read_bytes() + b"noise behind")
    found = list(iterate_records(path))
    assert b"".join(chunk.data for _, chunk in found) == path.read_bytes()
    assert {kind for kind, _ in found} == {DATA}
    assert (np.diff([chunk.arrival for _, chunk in found]) >= 0).all()


def test_it_is_a_source_like_any_recording(capture):
    path = capture("mip")
    with open_source(f"replay:{path}?speed=max") as source:
        while not source.ended:
            source.wait(source.end, 1.0)
        found = source.since(None)
    assert found.imu.tobytes() == recorded_samples(path).imu.tobytes()


def test_a_device_without_a_clock_needs_its_rate(tmp_path):
    path = tmp_path / "arduino.txt"
    rows = motion(600)
    lines = ["{:.4f},{:.4f},{:.4f},{:.3f},{:.3f},{:.3f}".format(*row["rate"], *row["force"]) for row in rows]
    path.write_text("\n".join(lines) + "\n")
    columns = "rate_x[rad/s],rate_y[rad/s],rate_z[rad/s],force_x[m/s²],force_y[m/s²],force_z[m/s²]"
    with pytest.raises(RecordingError, match=r"nothing in it has a time, .* with --rate 100, or rate=100"):
        recorded_samples(path, columns=columns)
    with open_source(f"replay:{path}?speed=max", columns=columns) as source:
        while not source.ended:
            source.wait(source.end, 1.0)
    assert "nothing in it has a time" in source.status.sentence
    for rate in ("fast", "nan", "-1", "1e9"):
        with pytest.raises(TransportError, match=r"accepted are 0.1 to 10000 Hz"):
            recorded_samples(path, columns=columns, rate=rate)
        with pytest.raises(TransportError, match=r"accepted are 0.1 to 10000 Hz"):
            open_source(f"replay:{path}", columns=columns, rate=rate)
    found = recorded_samples(path, columns=columns, rate="50")
    np.testing.assert_allclose(np.diff(found.imu["time"]), 0.02, rtol=0, atol=1e-9)


@pytest.mark.parametrize("data", [b"# notes\nof a day at sea\n" * 50, bytes(5000)])
def test_what_no_device_sends_is_refused(tmp_path, data):
    path = tmp_path / "notes.txt"
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=r"no protocol is recognised in it; accepted are .* vectornav"):
        recorded_samples(path)
    with pytest.raises(TransportError, match="no protocol is recognised"):
        open_source(f"replay:{path}")


def test_an_empty_file_is_called_empty(tmp_path):
    path = tmp_path / "nothing.ubx"
    path.touch()
    with pytest.raises(RecordingError, match="the file is empty"):
        recorded_samples(path)
    with pytest.raises(TransportError, match="the file is empty"):
        open_source(f"replay:{path}")


def test_a_damaged_recording_is_no_capture(tmp_path, capture):
    path = tmp_path / "damaged.inslab"
    path.write_bytes(b"X" + capture("vectornav").read_bytes())
    with pytest.raises(RecordingError, match="no raw recording"):
        recorded_samples(path)


def test_a_folder_and_a_missing_file_are_refused(tmp_path):
    for path in (tmp_path, tmp_path / "nothing.bin"):
        with pytest.raises(RecordingError, match="cannot be read"):
            recorded_samples(path)


def test_what_a_reader_of_logs_reads_is_no_capture(tmp_path):
    """A telemetry log is full of frames that the live decoder reads as well; its reader may refuse it."""
    pytest.importorskip("pymavlink")
    path = tmp_path / "link.tlog"
    path.write_bytes(WRITERS["MAVLink tlog"](part()))
    assert holds_samples(path)
    assert device_log(path) is None
