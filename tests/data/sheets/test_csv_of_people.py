"""Tables as people have them: other languages, radians, exchanged headings, a unit that changes."""

import re

import numpy as np
import pytest
from sensor_logs import tables

from lab.base.files.mission_error import MissionError
from lab.data.formats import read_raw
from lab.missions.flight_import import prepare_import, read_log

SOURCE = tables(30, 80)


def table(path, head, *, imu=True, change=lambda columns: columns):
    """Write time, latitude, longitude, height, velocities, and the rows of the IMU between them."""
    samples, fixes = SOURCE.imu, SOURCE.gnss[:, 1:7]
    if not imu:
        columns = np.column_stack((SOURCE.gnss[:, 0], fixes))
    else:
        columns = np.full((len(samples), 13), np.nan)
        columns[:, 0], columns[:, 7:] = samples[:, 0], samples[:, 1:]
        at = np.searchsorted(samples[:, 0], SOURCE.gnss[:, 0] - 1e-6)
        columns[at[at < len(samples)], 1:7] = fixes[at < len(samples)]
    columns = change(columns.copy())
    rows = (",".join("" if np.isnan(x) else f"{x:.11g}" for x in row) for row in columns)
    path.write_text("\n".join((head, *rows, "")), "utf-8")
    return path


SENSORS = "gx,gy,gz,ax,ay,az"


@pytest.mark.parametrize(
    "velocities",
    [
        "Geschwindigkeit Nord,Geschwindigkeit Ost,Geschwindigkeit unten",
        "Nordgeschwindigkeit,Ostgeschwindigkeit,Sinkgeschwindigkeit",
        "Vitesse Nord (m/s),Vitesse Est (m/s),Vitesse Bas (m/s)",
        "Velocidad Norte,Velocidad Este,Velocidad Abajo",
        "Velocità Nord,Velocità Est,Velocità Giù",
        "Velocidade Norte [m/s],Velocidade Leste [m/s],Velocidade Baixo [m/s]",
        "North speed,East speed,Down speed",
    ],
)
def test_velocities_of_other_languages_are_read(tmp_path, velocities):
    log = read_log([table(tmp_path / "a.csv", f"time,lat,lon,alt,{velocities},{SENSORS}")])
    expected = SOURCE.gnss[:, 4:7]
    np.testing.assert_allclose(log.gnss.velocity_n, expected[: len(log.gnss.time)], atol=1e-8)


def test_portuguese_names_an_accelerometer(tmp_path):
    head = "tempo,latitude,longitude,altitude,vn,ve,vd,Giroscópio X,Giroscópio Y,Giroscópio Z"
    log = read_log([table(tmp_path / "a.csv", f"{head},Aceleração X,Aceleração Y,Aceleração Z")])
    assert any("Aceleração X" in line for line in log.repairs)


def radians(columns):
    columns[:, 1:3] = np.radians(columns[:, 1:3])
    return columns


@pytest.mark.parametrize("imu", [True, False])
def test_radians_that_the_velocities_show_are_taken(tmp_path, imu):
    head = f"time,lat,lon,alt,vn,ve,vd{f',{SENSORS}' if imu else ''}"
    path = table(tmp_path / "a.csv", head, imu=imu, change=radians)
    if imu:
        position, remarks = read_log([path]).gnss.position[:, :2], read_log([path]).repairs
    else:
        raw = read_raw(path)
        position, remarks = np.column_stack((raw.latitude, raw.longitude)), raw.remarks
    np.testing.assert_allclose(np.degrees(position), SOURCE.gnss[: len(position), 1:3], atol=1e-7)
    assert any("in rad (guessed" in line for line in remarks)


def test_a_flight_near_latitude_and_longitude_0_stays_in_degrees(tmp_path):
    def moved(columns):
        latitude, longitude = columns[:, 1] - 45.0, columns[:, 2] + 73.0
        columns[:, 1], columns[:, 2] = latitude, longitude * np.cos(np.radians(45.5))
        return columns

    raw = read_raw(table(tmp_path / "a.csv", "time,lat,lon,alt,vn,ve,vd", imu=False, change=moved))
    assert abs(np.degrees(raw.latitude).mean() - (SOURCE.gnss[:, 1] - 45.0).mean()) < 1e-3


def test_exchanged_latitudes_and_longitudes_are_named(tmp_path):
    found = prepare_import([table(tmp_path / "a.csv", "time,lon,lat,alt,vn,ve,vd", imu=False)])
    assert found.report.verdict == "implausible"
    assert any("latitude and longitude are exchanged" in one.sentence for one in found.report.findings)
    right = prepare_import([table(tmp_path / "b.csv", "time,lat,lon,alt,vn,ve,vd", imu=False)])
    assert right.report.verdict == "plausible"


def test_a_unit_that_changes_within_a_column_is_refused(tmp_path):
    def changing(columns):
        columns[: len(columns) // 3, 10:] /= 9.80665
        return columns

    head = f"time,lat,lon,alt,vn,ve,vd,{SENSORS}"
    with pytest.raises(MissionError, match=re.escape("changes between g and m/s²")):
        read_log([table(tmp_path / "a.csv", head, change=changing)])
