"""Heights without a unit in feet, centimetres or millimetres, beside an IMU."""

from __future__ import annotations

import numpy as np
import pytest
from sensor_logs import tables, write_csv

from lab.data.sheets.sensor_csv import read_logs


@pytest.mark.proof
@pytest.mark.parametrize("start", [0, 30, 90])
@pytest.mark.parametrize(("unit", "metre"), [("m", 1), ("ft", 0.3048), ("cm", 0.01)])
def test_the_accelerometers_show_the_unit_of_heights_in_a_flight(tmp_path, start, unit, metre):
    made = tables(start, start + 60)
    fixes = made.gnss[:, :6].copy()
    fixes[:, 3] /= metre
    log = read_logs(
        [
            write_csv(tmp_path / "imu.csv", ("time", "gx", "gy", "gz", "ax", "ay", "az"), made.imu),
            write_csv(tmp_path / "gps.csv", ("time", "lat", "lon", "alt", "vn", "ve"), fixes),
        ]
    )
    np.testing.assert_allclose(log.gnss.position[:, 2], made.gnss[:, 3], atol=1e-6)
    how = 'assumed; --unit "alt=ft"' if unit == "m" else "guessed: the numbers change"
    assert any(one.startswith(f"Heights: alt, in {unit} ({how}") for one in log.repairs)
