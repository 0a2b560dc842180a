"""Messages on files that are refused print options of the command line, which work when they are pasted."""

from __future__ import annotations

import re
import shlex

import numpy as np
import pytest
from foreign_tables import table
from sensor_logs import tables

from lab.data.formats import read_raw
from lab.missions import MissionError
from lab.missions.flight_import import read_log

GIVEN = [f"{kind}_{axis}" for kind in ("gyro", "acc") for axis in "xyz"]


def options(message):
    """Return what the options in a message say of columns."""
    texts = re.findall(r'--(?:column|unit) ("[^"]*"|\S+)', message)
    return dict(shlex.split(text)[0].rpartition("=")[::2] for text in texts)


@pytest.mark.parametrize(
    ("unit", "signs"),
    [("rad/s", (1, 1, -1, 1, 1, 1)), ("°/s", (1, -1, 1, 1, -1, 1))],
    ids=["yaw", "mirrored"],
)
def test_the_remedy_for_wrong_axes_is_a_command(tmp_path, unit, signs):
    made = tables(30, 120)
    imu = made.imu.copy()
    imu[:, 1:] *= signs
    imu[:, 1:4] *= np.degrees(1) if unit == "°/s" else 1
    header = ",".join(("time", *(f"my {name} [{unit}]" for name in GIVEN[:3]),
                       *(f"my {name} [m/s²]" for name in GIVEN[3:])))  # fmt: skip
    paths = [
        table(tmp_path / "imu.csv", header, imu),
        table(tmp_path / "gps.csv", "time,lat,lon,alt,vn,ve,vd", made.gnss[:, :7]),
    ]
    with pytest.raises(MissionError, match="These options do it") as refused:
        read_log(paths)
    said = options(str(refused.value).partition("These options do it")[2].partition(". ")[0])
    assert said
    log = read_log(paths, units=said)
    expected = read_log([table(tmp_path / "right.csv", "time,gx,gy,gz,ax,ay,az", made.imu), paths[1]])
    np.testing.assert_allclose(np.column_stack(log.rates), np.column_stack(expected.rates), atol=1e-9)


def test_raw_counts_of_accelerometers_are_told_as_options(tmp_path):
    made = tables(30, 120)
    imu = made.imu.copy()
    imu[:, 4:] *= 16384 / 9.80665
    paths = [
        table(tmp_path / "imu.csv", "time,gx [rad/s],gy [rad/s],gz [rad/s],ax,ay,az", imu),
        table(tmp_path / "gps.csv", "time,lat,lon,alt,vn,ve,vd", made.gnss[:, :7]),
    ]
    with pytest.raises(MissionError, match="near 16384 counts") as refused:
        read_log(paths)
    assert options(str(refused.value)) == {"ax": "g/16384", "ay": "g/16384", "az": "g/16384"}
    log = read_log(paths, units=options(str(refused.value)))
    np.testing.assert_allclose(log.rates[1], made.imu[-len(log.dtheta) :, 4:], atol=1e-6)


def test_a_place_in_one_cell_may_stand_in_brackets(tmp_path):
    gnss = tables(30, 120).gnss
    rows = [[g[0], f"[{g[1]:.9f}, {g[2]:.9f}]", g[3]] for g in gnss]
    flight = read_raw(table(tmp_path / "ride.csv", "time;latlng;altitude", rows, ";"))
    np.testing.assert_allclose(np.degrees(flight.latitude), gnss[:, 1], atol=1e-8)
