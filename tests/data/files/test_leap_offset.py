"""One table of a log counts GPS time and the other UTC, 18 s apart, in a log of a minute."""

from __future__ import annotations

import numpy as np
import pytest
from sensor_logs import tables, write_csv

from lab.data.sheets.sensor_csv import read_logs
from lab.missions import MissionError

LEAP = 18.0


def read(folder, imu, gnss):
    """Read two tables whose headings give no unit."""
    return read_logs(
        [
            write_csv(folder / "imu.csv", ("time", "gx", "gy", "gz", "ax", "ay", "az"), imu),
            write_csv(folder / "gps.csv", ("time", "lat", "lon", "alt", "vn", "ve"), gnss[:, :6]),
        ]
    )


def later(table, seconds):
    return table + np.append(seconds, np.zeros(table.shape[1] - 1))


@pytest.mark.proof
@pytest.mark.parametrize(
    ("start", "late", "words"), [(0, LEAP, "earlier .* 18 s late"), (60, -LEAP, "later .* 18 s early")]
)
def test_a_minute_whose_motion_shows_it_is_refused(tmp_path, start, late, words):
    """Each direction in one minute of the motion: a log of a minute takes 6 s of a processor to judge."""
    log = tables(start, start + 60)
    assert not any("leap seconds" in remark for remark in read(tmp_path, log.imu, log.gnss).repairs)
    with pytest.raises(
        MissionError, match=rf"With the fixes 18 s {words} .*accepted are stamps of one clock"
    ):
        read(tmp_path, log.imu, later(log.gnss, late))


@pytest.mark.parametrize(("late", "told"), [(LEAP, True), (-LEAP, True), (12.0, False), (0.0, False)])
def test_a_minute_at_rest_does_not_show_it_and_is_told(tmp_path, late, told):
    rng, time, at = np.random.default_rng(3), np.arange(0, 60, 0.01), np.arange(0, 60, 0.5)
    imu = np.column_stack((time, rng.normal(scale=[1e-3] * 3 + [0.02] * 3, size=(time.size, 6))))
    imu[:, 6] -= 9.80665
    fixes = np.array([45.5, -73.7, 30, 0, 0]) + rng.normal(
        scale=[5e-6, 5e-6, 0.5, 0.05, 0.05], size=(at.size, 5)
    )
    log = read(tmp_path, imu, later(np.column_stack((at, fixes)), late))
    assert any("18 leap seconds apart: the motion does not show it" in one for one in log.repairs) == told
