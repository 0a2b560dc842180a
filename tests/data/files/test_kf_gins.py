"""KF-GINS text: three kinds of files without a header, known by their numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from writers.kf_gins import START, write

from lab.data.formats import read_raw, reader_of
from lab.data.sheets import sensor_csv
from lab.missions import MissionError, mission
from lab.missions.flight_import import read_log
from lab.motion.truth.trajectory import Trajectory


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("kf_gins")
    for name, data in write(mission("montreal").recording).items():
        (folder / name).write_bytes(data)
    return folder


def test_increments_and_positions_are_a_log(drive):
    log = read_log([drive / "IMU.txt", drive / "GNSS-RTK.txt"])
    table = np.loadtxt(drive / "IMU.txt")
    assert log.epoch == table[0, 0] == START + 0.01
    # The increments of each interval, to the last bit.
    np.testing.assert_array_equal(log.dtheta, table[1:, 1:4])
    np.testing.assert_array_equal(log.dvelocity, table[1:, 4:])
    fixes = np.loadtxt(drive / "GNSS-RTK.txt")
    np.testing.assert_allclose(log.gnss.time + log.epoch, fixes[:, 0], atol=1e-6)
    np.testing.assert_allclose(np.degrees(log.gnss.position[:, :2]), fixes[:, 1:3], atol=1e-12)
    np.testing.assert_array_equal(log.gnss.position_sigma, fixes[:, 4:])
    assert np.isnan(log.gnss.velocity_n).all()


def test_a_folder_has_the_solution_as_reference(drive):
    log = read_log([drive], vehicle="aeroplane")
    table = np.loadtxt(drive / "truth.nav")
    np.testing.assert_allclose(np.degrees(log.reference.euler), table[:, 8:], atol=1e-12)
    assert log.auxiliary.vehicle == "aeroplane"


def test_the_solution_is_a_flight(drive):
    flight = read_raw(drive / "truth.nav")
    truth = Trajectory.from_recording(mission("montreal").recording, 100.0).at(flight.time - START)
    np.testing.assert_allclose(flight.latitude, truth.latitude, atol=1e-12)
    np.testing.assert_allclose(flight.velocity_n, truth.velocity_n, atol=1e-6)
    np.testing.assert_allclose(np.angle(np.exp(1j * (flight.euler - truth.euler))), 0, atol=1e-7)
    together = read_raw([drive / "GNSS-RTK.txt", drive / "truth.nav"])
    assert together.euler is not None
    assert "positions are not used" in " ".join(together.remarks)
    places = read_raw(drive / "GNSS-RTK.txt")
    assert places.euler is None
    assert len(places.time) == len(np.loadtxt(drive / "GNSS-RTK.txt"))


@pytest.mark.parametrize("unit", [1.0, np.pi / 180])
def test_velocities_show_the_unit_of_the_angles(drive, tmp_path, unit):
    table = np.loadtxt(drive / "truth.nav")[::20]
    sigma = np.tile((0.01, 0.01, 0.02), (len(table), 1))
    fixes = np.column_stack(
        (table[:, 1], table[:, 2:4] * unit, table[:, 4], sigma, table[:, 5:8], 10 * sigma)
    )
    np.savetxt(tmp_path / "GNSS-POSVEL.txt", fixes, fmt="%.12f")
    log = read_log([tmp_path / "GNSS-POSVEL.txt", drive / "IMU.txt"])
    np.testing.assert_allclose(np.degrees(log.gnss.position[:, :2]), table[:, 2:4], atol=1e-9)
    np.testing.assert_allclose(log.gnss.velocity_n, table[:, 5:8], atol=1e-9)
    np.testing.assert_allclose(log.gnss.velocity_sigma, 10 * sigma, atol=1e-12)


def test_eight_bytes_a_number_are_the_same(drive, tmp_path):
    np.loadtxt(drive / "IMU.txt").astype("<f8").tofile(tmp_path / "IMU.bin")
    log = read_log([tmp_path / "IMU.bin", drive / "GNSS-RTK.txt"])
    np.testing.assert_array_equal(log.dtheta, read_log([drive / "IMU.txt", drive / "GNSS-RTK.txt"]).dtheta)


def test_a_week_ends(tmp_path):
    for name, data in write(mission("montreal").recording, 604_800 - 60.0).items():
        (tmp_path / name).write_bytes(data)
    log = read_log([tmp_path / "IMU.txt", tmp_path / "GNSS-RTK.txt"])
    assert log.duration > 200
    assert np.diff(log.gnss.time).max() < 1.001
    assert np.ptp(read_raw(tmp_path / "truth.nav").time) > 200


def test_wrong_axes_are_named(drive, tmp_path):
    table = np.loadtxt(drive / "IMU.txt")
    table[:, (2, 5)] *= -1
    np.savetxt(tmp_path / "IMU.txt", table, fmt="%.12f")
    with pytest.raises(MissionError, match="axis called minus right"):
        read_log([tmp_path / "IMU.txt", drive / "GNSS-RTK.txt"], vehicle="aeroplane")
    table[:, (2, 5)] *= -1
    # Right, forward, up.
    np.savetxt(tmp_path / "IMU.txt", table[:, (0, 2, 1, 3, 5, 4, 6)] * (1, 1, 1, -1, 1, 1, -1), fmt="%.15f")
    log = read_log([tmp_path / "IMU.txt", drive / "GNSS-RTK.txt"], axes=("y", "x", "-z"))
    np.testing.assert_allclose(
        log.dtheta, read_log([drive / "IMU.txt", drive / "GNSS-RTK.txt"]).dtheta, atol=1e-14
    )


def test_damaged_rows_are_counted(drive, tmp_path):
    lines = (drive / "truth.nav").read_bytes().splitlines()
    lines[500], lines[600], lines[700] = b"2017 4562", lines[600].replace(b".", b"x"), b"nan " * 11
    (tmp_path / "truth.nav").write_bytes(b"\n" + b"\r\n".join(lines[:-1]) + b"\r\n" + lines[-1][:40])
    flight = read_raw(tmp_path / "truth.nav")
    assert [(drop.count, drop.first_row) for drop in flight.dropped] == [(4, 502)]
    assert flight.rows_read == len(lines)


@pytest.mark.parametrize(
    "rows",
    [
        # A pose in a room, with angles: metres have three decimals.
        "%.2f %.3f %.3f %.3f %.3f %.3f %.3f",
        # Rates and accelerations are no increments.
        "%.2f %.9f %.9f %.9f %.4f %.4f 9.81",
    ],
)
def test_other_numbers_are_not_taken(tmp_path, rows):
    rng = np.random.default_rng(1)
    count = rows.count("%")
    table = np.column_stack((0.1 * np.arange(100), rng.uniform(0.1, 3, (100, count - 1))))
    (tmp_path / "other.txt").write_text("".join(rows % tuple(row) + "\n" for row in table.tolist()))
    with pytest.raises(MissionError, match="format is unknown"):
        reader_of(tmp_path / "other.txt")


@pytest.mark.parametrize("head", ["time lat lon alt hacc vacc speed", "# time lat lon alt hacc vacc speed"])
def test_headings_say_more_than_numbers(drive, tmp_path, head):
    (tmp_path / "fixes.txt").write_bytes(head.encode() + b"\n" + (drive / "GNSS-RTK.txt").read_bytes())
    assert reader_of(tmp_path / "fixes.txt").name == sensor_csv.NAME


def test_what_a_person_says_of_columns_comes_first(drive):
    assert reader_of(drive / "IMU.txt").name == "KF-GINS text"
    assert reader_of(drive / "IMU.txt", {"1": "time[s]"}).name == sensor_csv.NAME


def test_what_is_missing_is_named(drive):
    with pytest.raises(MissionError, match="the positions file is missing"):
        read_log([drive / "IMU.txt"])
    with pytest.raises(MissionError, match="has no positions"):
        read_raw(drive / "IMU.txt")
    with pytest.raises(MissionError, match="is a second IMU file"):
        read_raw([drive / "IMU.txt", drive / "IMU.txt"])
    with pytest.raises(MissionError, match="fixes its units"):
        read_raw(drive / "truth.nav", {"2": "rad"})


def test_an_imu_alone_has_rates(tmp_path):
    from lab.data.files import kf_gins

    (tmp_path / "IMU.txt").write_bytes(write(mission("montreal").recording)["IMU.txt"])
    imu = kf_gins.read_imu(tmp_path / "IMU.txt")
    rates = Trajectory.from_recording(mission("montreal").recording, 100.0).rates(imu.time - START - 0.005)
    np.testing.assert_allclose(imu.values[10:-10, :3], rates[0][10:-10], atol=2e-3)
    np.testing.assert_allclose(imu.values[10:-10, 3:], rates[1][10:-10], atol=2e-2)


def test_an_allan_deviation_takes_the_increments(tmp_path):
    """At rest, white noise of a known density gives its angle random walk."""
    from lab.analysis import rest_recording

    rate, density, rng = 100.0, 1e-4, np.random.default_rng(3)
    count = 60_000
    noise = rng.normal(scale=density * np.sqrt(rate), size=(count, 3)) / rate
    push = rng.normal(scale=1e-3 * np.sqrt(rate), size=(count, 3)) / rate - [0, 0, 9.8 / rate]
    table = np.column_stack((1000 + np.arange(count) / rate, noise, push))
    np.savetxt(tmp_path / "IMU.txt", table, fmt="%.15f")
    gyro = rest_recording.read_log(tmp_path / "IMU.txt")["gyro"]
    assert gyro.dt == pytest.approx(1 / rate)
    assert np.std(gyro.rates, axis=0) == pytest.approx(density * np.sqrt(rate), rel=0.02)
