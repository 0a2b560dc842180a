"""Pieces of a log: between two times of the file's clock, and without a break of the IMU."""

from __future__ import annotations

import numpy as np
import pytest
from sensor_logs import EPOCH, tables, write

from lab.data.log.log_section import cut_section
from lab.missions import MissionError, read_sensor_log
from lab.missions.log_mission import LogMission
from lab.views.mission_card import log_html, read_log_html


@pytest.fixture(scope="module")
def flown():
    return tables(60, 120)


def test_a_whole_log_is_itself(tmp_path, flown):
    log = read_sensor_log(write(tmp_path, flown))
    assert cut_section(log) is log
    assert cut_section(log, log.epoch - 5, log.epoch + 500) is log


def test_between_two_times_of_the_file(tmp_path, flown):
    log = read_sensor_log(write(tmp_path, flown))
    part = cut_section(log, EPOCH + 75, EPOCH + 95)
    assert part.epoch == pytest.approx(EPOCH + 75, abs=0.011)
    assert part.duration == pytest.approx(20, abs=0.011)
    first = np.searchsorted(log.time + log.epoch, part.epoch - 1e-6)
    np.testing.assert_array_equal(part.dtheta, log.dtheta[first : first + len(part.dtheta)])
    np.testing.assert_allclose(part.time + part.epoch, log.time[first : first + len(part.time)] + log.epoch)
    # The same fixes and the same reference at the same times of the file, and the fix before the start.
    rows = np.searchsorted(log.gnss.time + log.epoch, part.gnss.time + part.epoch - 1e-6)
    np.testing.assert_array_equal(part.gnss.position, log.gnss.position[rows])
    assert part.gnss.time[0] < 0 <= part.gnss.time[1]
    np.testing.assert_allclose(part.reference.time + part.epoch, log.reference.time + log.epoch)
    assert "1075 to 1095 s of the file's clock, as requested" in part.repairs[-1]


def test_the_longest_piece_without_a_break(tmp_path, flown):
    times = flown.imu[:, 0] - EPOCH
    rows = ~((times > 70) & (times < 78)) & ~((times > 100) & (times < 111))
    log = read_sensor_log(write(tmp_path, flown._replace(imu=flown.imu[rows])))
    assert len(log.breaks) == 2
    part = cut_section(log)
    assert part.epoch == pytest.approx(EPOCH + 78, abs=0.02)
    assert part.duration == pytest.approx(22, abs=0.03)
    assert not len(part.breaks)
    assert np.diff(part.time).max() < 0.02
    remark = part.repairs[-1]
    assert "2 gaps of more than 2 s, up to 11" in remark
    assert "Other pieces, for --from and --to: 1060 to 1070 s, 1111 to 1120 s" in remark
    other = cut_section(log, EPOCH + 60, EPOCH + 72)
    assert other.epoch == pytest.approx(EPOCH + 60, abs=0.02)
    assert other.duration == pytest.approx(10, abs=0.03)


def test_gaps_are_told_wherever_a_log_is_shown(tmp_path, flown):
    """On its card and beside an import, those that divide it are told, although it is not navigated there."""
    times = flown.imu[:, 0] - EPOCH
    rows = ~((times > 70) & (times < 78)) & ~((times > 100) & (times < 111))
    folder = write(tmp_path, flown._replace(imu=flown.imu[rows]))
    log = read_sensor_log(folder)
    card = log_html(LogMission.at(folder, "halves"))
    assert "2 of more than 2 s" in card
    for shown in (card, read_log_html(log, "")):
        assert "only the longest piece is navigated, 1078 to 1100 s" in shown


@pytest.mark.parametrize(
    ("start", "end", "pattern"),
    [
        (EPOCH + 90, EPOCH + 80, "ends before it begins"),
        (EPOCH + 300, None, r"accepted are times within 1060 to 1120 s of the file's clock"),
        (EPOCH + 80, EPOCH + 82, "no stretch of 5 s in common"),
        (0.0, 60.0, "no stretch of 5 s in common"),
    ],
)
def test_what_cannot_be_had_is_refused(tmp_path, flown, start, end, pattern):
    log = read_sensor_log(write(tmp_path, flown))
    with pytest.raises(MissionError, match=pattern):
        cut_section(log, start, end)
