"""ArduPilot logs of several IMUs and receivers, of which the first has little or nothing to say."""

from __future__ import annotations

import numpy as np
import pytest
from writers import ardupilot as writer

from lab.data.files import ardupilot
from lab.missions import mission

INSTANCE, STATUS = 11, 12
"""Places of these in a message: after its header and its time."""
NO_FIX = 1


@pytest.fixture(scope="module")
def written() -> bytes:
    return writer.write(mission("montreal").recording)


@pytest.fixture
def read(tmp_path):
    """Return a function that reads the log in bytes."""

    def log_of(data: bytes):
        path = tmp_path / "log.bin"
        path.write_bytes(data)
        return ardupilot.read_log(path)

    return log_of


def doubled(data: bytes, name: str, change):
    """Return a log with a second instance of each message of a name, the first changed by its number.

    `change` returns the first instance's message, or nothing if it was not written.
    """
    marks, size = bytes((0xA3, 0x95, writer.FORMATS[name][0])), writer.packer(name).size
    parts, end, count = [], 0, 0
    while (at := data.find(marks, end)) >= 0:
        one = data[at : at + size]
        second = bytearray(one)
        second[INSTANCE] = 1
        parts += [data[end:at], change(one, count), bytes(second)]
        end, count = at + size, count + 1
    return b"".join((*parts, data[end:]))


def unfixed(message: bytes) -> bytes:
    changed = bytearray(message)
    changed[STATUS] = NO_FIX
    return bytes(changed)


def same(log, expected):
    np.testing.assert_array_equal(log.gnss.position, expected.gnss.position)
    np.testing.assert_array_equal(log.gnss.position_sigma, expected.gnss.position_sigma)
    np.testing.assert_array_equal(log.dtheta, expected.dtheta)


@pytest.mark.parametrize("fixes", [0, 100], ids=["never has a fix", "loses its fix"])
def test_the_second_receiver_is_used_where_the_first(written, read, fixes):
    data = doubled(written, "GPS", lambda one, number: one if number < fixes else unfixed(one))
    data = doubled(data, "GPA", lambda one, _: one)
    expected = read(written)
    log = read(data)
    same(log, expected)
    count = len(expected.gnss.time)
    assert f"The receiver of instance 1 is used, which has {count} fixes: 0 has {fixes}." in log.repairs


def test_the_antenna_is_that_of_the_receiver_that_is_used(written, read):
    data = doubled(written, "GPS", lambda one, _: unfixed(one))
    np.testing.assert_array_equal(read(data).gnss.lever_arm, 0)  # GPS1_POS_X is of the other
    data = data.replace(b"GPS1_POS_", b"GPS2_POS_").replace(b"GPS1_DELAY", b"GPS2_DELAY")
    log = read(data)
    np.testing.assert_array_equal(log.gnss.lever_arm, read(written).gnss.lever_arm)
    assert log.gnss.latency == read(written).gnss.latency


def test_the_second_imu_is_used_where_the_first_fails(written, read):
    log = read(doubled(written, "IMU", lambda one, number: one if number < 1000 else b""))
    same(log, read(written))
    assert any("The IMU of instance 1 is used" in one and "0 has 1000" in one for one in log.repairs)


def test_the_first_of_about_equal_ones_is_used_without_a_remark(written, read):
    """Its own first fix came later."""
    log = read(doubled(written, "GPS", lambda one, number: unfixed(one) if number < 50 else one))
    assert len(log.gnss.time) == len(read(written).gnss.time) - 50
    assert not any("instance" in one for one in log.repairs)


def test_bytes_that_are_lost_are_reported_of_the_sensors_too(written, read):
    half = len(written) // 2
    log = read(written[:half] + bytes(1000) + written[half + 1000 :])
    assert any("bytes of the file could not be decoded" in one for one in log.repairs)
