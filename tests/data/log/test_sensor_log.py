"""Logs of real sensors: what is written is read, what can be repaired is, and is said, the rest refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sensor_logs import EPOCH, IMU, INCREMENTS, POSITION, RATE, described, tables, write, write_csv

from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.files.sensor_log_csv import log_files, read_sensor_log
from lab.data.log.spikes import spikes
from lab.missions import MissionError


@pytest.fixture(scope="module")
def log():
    return tables(60, 72)


def test_numbers_are_read_with_their_units(tmp_path, log):
    read = read_sensor_log(write(tmp_path, log, "lever_arm_m = [1, 2.5, -3]\nlatency_s = 0.125"))
    rates, forces = read.rates
    assert read.epoch == log.imu[0, 0]
    np.testing.assert_allclose(read.time, log.imu[:, 0] - log.imu[0, 0], atol=1e-9)
    np.testing.assert_allclose(rates, log.imu[1:, 1:4], rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(forces, log.imu[1:, 4:], rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(read.gnss.time, log.gnss[:, 0] - read.epoch, atol=1e-9)
    np.testing.assert_allclose(np.degrees(read.gnss.position[:, :2]), log.gnss[:, 1:3], rtol=1e-11)
    np.testing.assert_allclose(read.gnss.position[:, 2], log.gnss[:, 3], rtol=1e-10)
    np.testing.assert_allclose(read.gnss.velocity_n, log.gnss[:, 4:7], rtol=1e-10, atol=1e-12)
    assert (read.gnss.position_sigma == 0.5).all()
    assert (read.gnss.velocity_sigma == 0.1).all()
    np.testing.assert_array_equal(read.gnss.lever_arm, (1, 2.5, -3))
    assert read.gnss.latency == 0.125
    np.testing.assert_allclose(np.degrees(read.reference.euler), log.reference[:, 7:], atol=1e-9)
    assert read.repairs == ()


def test_every_unit_and_kind_of_sample_gives_the_same_log(tmp_path, log):
    expected = read_sensor_log(write(tmp_path / "si", log))
    shown = log.imu.copy()
    shown[:, 1:4] = np.degrees(shown[:, 1:4])
    shown[:, 4:] /= STANDARD_GRAVITY
    names = ("t_s", "gx_deg_s", "gy_deg_s", "gz_deg_s", "fx_g", "fy_g", "fz_g")
    counted = log.imu.copy()
    counted[:, 1:] /= RATE
    for folder, imu, header in (("shown", shown, names), ("counted", counted, INCREMENTS)):
        read = read_sensor_log(write(tmp_path / folder, log._replace(imu=imu), imu_names=header))
        np.testing.assert_allclose(read.dtheta, expected.dtheta, rtol=1e-8, atol=1e-12)
        np.testing.assert_allclose(read.dvelocity, expected.dvelocity, rtol=1e-8, atol=1e-12)


def test_axes_of_the_imu_are_turned_into_forward_right_down(tmp_path, log):
    expected = read_sensor_log(write(tmp_path / "frd", log))
    turned = log.imu.copy()  # an IMU with x right, y forward, z up
    turned[:, 1:4] = log.imu[:, [2, 1, 3]] * (1, 1, -1)
    turned[:, 4:] = log.imu[:, [5, 4, 6]] * (1, 1, -1)
    toml = 'axes = ["y", "x", "-z"]'
    read = read_sensor_log(write(tmp_path / "rfu", log._replace(imu=turned), toml))
    np.testing.assert_array_equal(read.dtheta, expected.dtheta)
    np.testing.assert_array_equal(read.dvelocity, expected.dvelocity)


def test_repeated_samples_are_dropped_and_keep_the_angle(tmp_path, log):
    """A sensor read at 100 Hz that samples at 50 Hz: every value twice; the angle is that of 50 Hz."""
    slow = log.imu[1::2]
    twice = np.repeat(slow, 2, axis=0)
    twice[1::2, 0] += 0.01
    read = read_sensor_log(write(tmp_path, log._replace(imu=twice)))
    assert len(read.dtheta) == len(slow) - 1
    assert f"{len(slow)} IMU samples that repeat" in read.repairs[0]
    np.testing.assert_allclose(read.dtheta, slow[1:, 1:4] / 50, rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize(("times", "dropped"), [(4, True), (5, False)])
def test_up_to_four_equal_values_are_polling_and_more_are_a_sensor_at_rest(tmp_path, log, times, dropped):
    imu = np.delete(log.imu, slice(101, 100 + times), axis=0)
    held = np.repeat(log.imu[100:101], times, axis=0)
    held[:, 0] = log.imu[100 : 100 + times, 0]
    imu = np.concatenate((imu[:100], held, imu[101:]))
    read = read_sensor_log(write(tmp_path, log._replace(imu=imu)))
    assert any(f"{times - 1} IMU samples that repeat" in repair for repair in read.repairs) == dropped


def test_a_resting_sensor_of_coarse_steps_is_not_polled(tmp_path, log):
    still = log.imu.copy()
    still[:, 1:] = (0, 0, 0, 0, 0, -9.8)
    gnss = log.gnss.copy()
    gnss[:, 1:7] = (*gnss[0, 1:4], 0, 0, 0)
    read = read_sensor_log(write(tmp_path, log._replace(imu=still, gnss=gnss)))
    assert read.repairs == ()
    assert len(read.dtheta) == len(still) - 1


@pytest.mark.parametrize("names", [IMU, INCREMENTS])
def test_spikes_leave_a_gap(tmp_path, log, names):
    scale = 1 / RATE if names is INCREMENTS else 1.0
    imu = log.imu * (1, *(6 * (scale,)))
    at = [40, 300, 301, 302, 700]
    imu[at[:-1], 4] = 157 * scale
    imu[at[-1], 3] = -34.9 * scale
    read = read_sensor_log(write(tmp_path, log._replace(imu=imu), imu_names=names))
    assert "5 IMU samples with a spike, far beyond the others near, were dropped." in read.repairs
    np.testing.assert_allclose(read.gaps, [[0.39, 0.41], [2.99, 3.03], [6.99, 7.01]], atol=1e-9)
    rates, forces = read.rates
    np.testing.assert_allclose(rates, log.imu[1:, 1:4], atol=0.02)
    np.testing.assert_allclose(forces, log.imu[1:, 4:], atol=0.5)


def ringing(imu):
    """Hit the IMU with 30 g, which decays in a tenth of a second."""
    after = np.arange(60)
    imu[500:560, 6] += 300 * np.exp(-after / 10) * np.cos(2.5 * after)


def bursts(imu):
    """Write 16 g in four samples together."""
    imu[500:504, 4] = 157


def knocking(imu):
    """Knock by 12 g for one sample, twice in a second."""
    imu[::50, 6] += 120


def rolling(imu):
    """Roll at 1500 °/s for a tenth of a second."""
    imu[500:510, 1] += 26


@pytest.mark.parametrize("motion", [ringing, bursts, knocking, rolling])
def test_violent_motion_is_no_spike(log, motion):
    imu = log.imu.copy()
    motion(imu)
    assert not spikes(imu[:, 1:]).any()


@pytest.mark.parametrize(("first", "triad"), [(1, "gyros"), (4, "accelerometers")])
def test_axes_that_are_constant_in_motion(tmp_path, log, first, triad):
    """Two axes may be missing in a sensor for cars; without a whole triad there is nothing to navigate."""
    imu = log.imu.copy()
    imu[:, first] = 0.0
    said = read_sensor_log(write(tmp_path, log._replace(imu=imu))).repairs
    assert len(said) == 1
    assert said[0].startswith(f"Of the {triad}, forward is constant in all samples")
    imu[:, first + 1] = 0.125
    said = read_sensor_log(write(tmp_path, log._replace(imu=imu))).repairs
    assert said[0].startswith(f"Of the {triad}, forward and right are constant in all samples")
    imu[:, first + 2] = -9.8
    refused(
        write(tmp_path, log._replace(imu=imu)), rf"all three {triad} are constant in all 1201 samples, but"
    )
    imu[:, first : first + 3] = 0.0
    refused(write(tmp_path, log._replace(imu=imu)), rf"all three {triad} are constant zero")


def test_repeated_times_are_dropped(tmp_path, log):
    imu = np.insert(log.imu, [5, 9], log.imu[[4, 8]], axis=0)
    gnss = np.insert(log.gnss, 3, log.gnss[2], axis=0)
    read = read_sensor_log(write(tmp_path, log._replace(imu=imu, gnss=gnss)))
    assert len(read.dtheta) == len(log.imu) - 1
    assert len(read.gnss.time) == len(log.gnss)
    assert read.repairs[0].startswith("2 IMU samples with the time")
    assert read.repairs[1].startswith("1 GPS fix with the time")


def test_zeros_of_a_receiver_without_a_fix_are_dropped(tmp_path, log):
    gnss = log.gnss.copy()
    gnss[:3, 1:7] = 0.0
    read = read_sensor_log(write(tmp_path, log._replace(gnss=gnss)))
    np.testing.assert_allclose(read.gnss.time, log.gnss[3:, 0] - read.epoch, atol=1e-9)
    assert "3 GPS fixes at latitude 0, longitude 0 were dropped." in read.repairs


def test_the_latest_fix_written_again_is_dropped_in_motion(tmp_path, log):
    """A logger writes a row for each of its own steps; a receiver in motion never measures the same twice."""
    gnss = np.repeat(log.gnss, 4, axis=0)
    gnss[:, 0] += np.tile((0.0, 0.1, 0.2, 0.3), len(log.gnss))
    read = read_sensor_log(write(tmp_path / "moving", log._replace(gnss=gnss)))
    np.testing.assert_allclose(read.gnss.time, log.gnss[:, 0] - read.epoch, atol=1e-9)
    assert f"{3 * len(log.gnss)} GPS fixes in motion that repeat" in " ".join(read.repairs)
    gnss[:, 1:7] = (*log.gnss[0, 1:4], 0.0, 0.0, 0.0)
    read = read_sensor_log(write(tmp_path / "holding", log._replace(gnss=gnss)))
    assert len(read.gnss.time) == len(gnss), "a receiver that holds its position"


def test_a_gap_is_filled_where_rates_change_linearly(tmp_path, log):
    imu = log.imu.copy()
    ramp = np.linspace(0, 1, len(imu))[:, None] * (0.1, -0.2, 0.3, 1, 2, 1)
    ramp += (0, 0, 0, 0, 0, -10)
    imu[:, 1:] = ramp + 1e-6 * np.random.default_rng(1).normal(size=ramp.shape)
    cut = np.delete(imu, np.s_[300:490], axis=0)
    read = read_sensor_log(write(tmp_path, log._replace(imu=cut)))
    whole = read_sensor_log(write(tmp_path, log._replace(imu=imu)))
    np.testing.assert_allclose(read.time, whole.time, atol=1e-9)
    np.testing.assert_allclose(read.dvelocity, whole.dvelocity, atol=1e-7)
    np.testing.assert_allclose(read.gaps, [[2.99, 4.90]], atol=1e-9)
    assert "1 gap of the IMU, 1.91 s" in read.repairs[0]


def test_a_gap_beyond_two_seconds_breaks_the_log(tmp_path, log):
    cut = np.delete(log.imu, np.s_[300:520], axis=0)
    read = read_sensor_log(write(tmp_path, log._replace(imu=cut)))
    np.testing.assert_allclose(read.breaks, [[2.99, 5.20]], atol=1e-9)
    assert not len(read.gaps)
    assert len(read.dtheta) == len(cut) - 1
    at = np.searchsorted(read.time, 5.2) - 1
    assert not read.dtheta[at].any()
    assert not read.dvelocity[at].any()


def test_a_file_does_not_ask_for_more_memory_than_it_is_large(tmp_path, log):
    """Samples a nanosecond apart and gaps of two seconds: filled at their spacing they would be billions."""
    times = np.cumsum(np.where(np.arange(len(log.imu)) % 100 == 99, 1.9, 1e-9)) + log.imu[0, 0]
    write(tmp_path, log)
    header = "t_s,gx_rad_s,gy_rad_s,gz_rad_s,fx_m_s2,fy_m_s2,fz_m_s2"
    rows = [",".join(map(repr, row)) for row in np.column_stack((times, log.imu[:, 1:])).tolist()]
    (tmp_path / "imu.csv").write_text("\n".join((header, *rows)))
    refused(tmp_path, r"samples of the IMU are usually \S+ s apart, but \d+ gaps last")


def test_what_the_receiver_lacks_is_said(tmp_path, log):
    write(tmp_path, log)
    write_csv(tmp_path / "gnss.csv", (*POSITION, "vn_m_s", "ve_m_s"), log.gnss[:, :6])
    read = read_sensor_log(tmp_path)
    assert np.isnan(read.gnss.velocity_n[:, 2]).all()
    assert np.isfinite(read.gnss.velocity_n[:, :2]).all()
    assert "no vertical velocity" in read.repairs[0]
    assert "no σ of its position and velocity" in read.repairs[1]
    write_csv(tmp_path / "gnss.csv", POSITION, log.gnss[:, :4])
    assert "no velocity" in read_sensor_log(tmp_path).repairs[0]


def refused(folder, pattern):
    with pytest.raises(MissionError, match=pattern):
        read_sensor_log(folder)


@pytest.mark.parametrize(
    ("toml", "pattern"),
    [
        ('axis = ["x", "y", "z"]', "no key 'axis'. Did you mean axes"),
        ('axes = ["x", "y", "z", "x"]', "axes = .*accepted are three"),
        ('axes = ["x", "y", "-z"]', "not a right-handed set"),
        ('axes = ["x", "x", "z"]', "not a right-handed set"),
        ("lever_arm_m = [1, 2]", "lever_arm_m.*three numbers"),
        ("lever_arm_m = [1, nan, 2]", "lever_arm_m.*three numbers"),
        ("latency_s = '0.2'", "latency_s.*accepted is a number"),
        ("latency_s = 200", "latency_s.*accepted is a number"),
        ('imu = "../imu.csv"', "imu = .*plain name of a file"),
        ("imu = 3", "accepted is text"),
        ('gnss = "gps.csv"', "gps.csv: there is no such file"),
        ("title = ", "is not TOML"),
    ],
)
def test_descriptions_that_are_refused(tmp_path, log, toml, pattern):
    refused(write(tmp_path, log, toml), pattern)


def test_files_that_are_refused(tmp_path, log):
    folder = write(tmp_path, log)
    text = (folder / "imu.csv").read_text()

    def imu(old, new, pattern):
        assert old in text
        (folder / "imu.csv").write_text(text.replace(old, new, 1))
        refused(folder, pattern)

    imu("gx_rad_s", "gx", r"imu\.csv: column gx_rad_s missing")
    imu("fy_m_s2", "fy", r"imu\.csv: column fy_m_s2 missing")
    imu("gx_rad_s,", "gx_deg_s,", r"imu\.csv: gx_rad_s and gx_deg_s are the same in two units")
    imu("gx_rad_s,", "dtheta_x_rad,", r"imu\.csv: has both increments")
    second = text.splitlines()[2]
    imu(second, second.replace(second.split(",")[3], "text"), r"imu\.csv, row 3, column gz_rad_s: 'text'")
    imu(second, second.replace(second.split(",")[0], ""), r"imu\.csv, row 3, column t_s: the cell is empty")
    (folder / "imu.csv").write_text("")
    refused(folder, r"imu\.csv: the file is empty")
    (folder / "imu.csv").unlink()
    refused(folder, r"imu\.csv: there is no such file; a log is a folder")


@pytest.mark.parametrize("name", ["imu.csv", "gnss.csv", "ref.csv"])
@pytest.mark.parametrize("left", [4, -1], ids=["lacks cells", "ends with a sign"])
def test_a_last_line_that_is_cut_is_dropped(tmp_path, log, name, left):
    """A logger that loses its power stops in the middle of a row."""
    folder = write(tmp_path, log)
    *rows, last = (folder / name).read_text().splitlines()
    end = last[:left] if left > 0 else last.rpartition(",")[0] + ",-"
    (folder / name).write_text("\n".join((*rows, end)))
    read = read_sensor_log(folder)
    assert read.repairs == (f"The last line of {name}, row {len(rows) + 1}, is cut and was dropped.",)
    counts = {"imu.csv": len(read.time), "gnss.csv": len(read.gnss.time), "ref.csv": len(read.reference.time)}
    assert counts[name] == len(rows) - 1
    assert log_files(folder).duration == pytest.approx(read.duration)


def test_a_row_of_too_many_or_few_cells_elsewhere_is_a_wrong_file(tmp_path, log):
    folder = write(tmp_path, log)
    text = (folder / "imu.csv").read_text()
    (folder / "imu.csv").write_text(text.removesuffix("\n") + ",7\n")
    refused(folder, rf"imu\.csv, row {len(log.imu) + 1}: 8 cells; accepted are 7")
    row = text.splitlines()[2]
    (folder / "imu.csv").write_text(text.replace(row, row.rpartition(",")[0]))
    refused(folder, r"imu\.csv, row 3: 6 cells; accepted are 7")


def test_empty_cells_of_what_need_not_be_there_are_not_known(tmp_path, log):
    folder = write(tmp_path, log)
    rows = [row.split(",") for row in (folder / "gnss.csv").read_text().splitlines()]
    rows[3][6] = rows[3][9] = rows[5][12] = ""
    rows[4][4:7] = ["nan", "NaN", ""]
    (folder / "gnss.csv").write_text("\n".join(map(",".join, rows)))
    read = read_sensor_log(folder)
    numbers = np.hstack((read.gnss.velocity_n, read.gnss.position_sigma, read.gnss.velocity_sigma))
    empty = [(2, 2), (2, 5), (3, 0), (3, 1), (3, 2), (4, 8)]
    assert sorted(map(tuple, np.argwhere(np.isnan(numbers)))) == empty
    assert len(read.repairs) == 3
    assert f"2 of {len(rows) - 1} fixes have no velocity, or not all of it" in read.repairs[0]
    assert "1 of" in read.repairs[1]
    assert "has no σ of the position" in read.repairs[1]
    assert "has no σ of the velocity" in read.repairs[2]
    rows[3][7] = "text"
    (folder / "gnss.csv").write_text("\n".join(map(",".join, rows)))
    refused(folder, r"gnss\.csv, row 4, column sd_n_m: 'text' is not accepted")


@pytest.mark.parametrize(
    ("change", "pattern"),
    [
        (lambda text: text.replace(",", ";"), r"row 1.*separated by commas, not semicolons"),
        (lambda text: text.replace(",", "\t"), r"row 1.*separated by commas, not tabs"),
        (lambda text: '"t_s","' + text[4:].replace(",", '","'), r"row 1.*without quotation marks"),
        (
            lambda text: text.replace("\n", "\n[s],[rad/s],[rad/s],[rad/s],[m/s2],[m/s2],[m/s2]\n", 1),
            r"row 2, column t_s: '\[s\]' is not accepted.*This row seems to contain units: delete it",
        ),
    ],
    ids=["semicolons", "tabs", "quotes", "units"],
)
def test_another_layout_of_cells_is_named(tmp_path, log, change, pattern):
    path = write(tmp_path, log) / "imu.csv"
    path.write_text(change(path.read_text()))
    refused(tmp_path, rf"imu\.csv, {pattern}")


@pytest.mark.parametrize("names", [IMU, INCREMENTS])
def test_samples_with_empty_cells_leave_a_gap(tmp_path, log, names):
    """Between them the motion is linear, as the fill of a gap is: the log is as if nothing were lost."""
    imu = log.imu.copy()
    imu[:, 1:] = np.linspace(0, 1, len(imu))[:, None] * (0.1, -0.2, 0.3, 1, 2, 1) - (0, 0, 0, 0, 0, 10)
    if names is INCREMENTS:
        imu[:, 1:] /= RATE
    whole = read_sensor_log(write(tmp_path, log._replace(imu=imu), imu_names=names))
    imu[[300, 500, 501], [4, 2, 6]] = np.nan
    read = read_sensor_log(write(tmp_path, log._replace(imu=imu), imu_names=names))
    np.testing.assert_allclose(read.dtheta, whole.dtheta, atol=1e-11)
    np.testing.assert_allclose(read.dvelocity, whole.dvelocity, atol=1e-9)
    np.testing.assert_allclose(read.gaps, [[2.99, 3.01], [4.99, 5.02]], atol=1e-9)
    assert "3 IMU samples with an unknown value were dropped." in read.repairs
    imu[100:260, 3] = np.nan
    refused(
        write(tmp_path, log._replace(imu=imu), imu_names=names),
        r"imu\.csv: 14% of the rows have empty cells, the first in row 102, column .*_?z_rad.*up to 10%",
    )


def test_fixes_without_a_position_are_dropped(tmp_path, log):
    gnss = log.gnss.copy()
    gnss[[3, 7], [1, 3]] = np.nan
    read = read_sensor_log(write(tmp_path, log._replace(gnss=gnss)))
    kept = np.delete(log.gnss, [3, 7], axis=0)
    np.testing.assert_allclose(read.gnss.time, kept[:, 0] - read.epoch, atol=1e-9)
    np.testing.assert_allclose(np.degrees(read.gnss.position[:, 0]), kept[:, 1], rtol=1e-11)
    assert read.repairs == ("2 GPS fixes without a position were dropped.",)
    gnss[:13, 2] = np.nan
    refused(write(tmp_path, log._replace(gnss=gnss)), r"gnss\.csv: 54% .* column lon_deg.*up to 50%")


def test_a_file_too_large_is_refused_unread(tmp_path, log):
    folder = write(tmp_path, log)
    with (folder / "gnss.csv").open("r+b") as file:
        file.truncate(300 * 2**20)  # a hole: it takes no space
    refused(folder, r"gnss\.csv: 300 MB; accepted are files up to 256 MB")


def test_times_that_are_refused(tmp_path, log):
    back = log.imu.copy()
    back[500:, 0] -= 2
    refused(
        write(tmp_path, log._replace(imu=back)), "time of the IMU runs backwards, from 1064.99 s to 1063 s"
    )
    back = log.gnss[::-1]
    refused(write(tmp_path, log._replace(gnss=back)), "time of the GPS runs backwards")
    other = log.gnss.copy()
    other[:, 0] += EPOCH
    refused(write(tmp_path, log._replace(gnss=other)), "less than 5 s in common")
    milliseconds = log.imu.copy()
    milliseconds[:, 0] *= 1e5
    refused(write(tmp_path, log._replace(imu=milliseconds)), "more than 86400 s.*time in seconds")
    refused(write(tmp_path, log._replace(imu=log.imu[:3])), "3 rows; accepted are at least 10")


def test_a_reference_that_runs_backwards_is_refused(tmp_path, log):
    refused(write(tmp_path, log._replace(reference=log.reference[::-1])), r"ref\.csv, column t_s")


@pytest.mark.parametrize(
    ("name", "samples", "said"),
    [
        ("vn310_static", 1611, []),
        ("comma2k19", 6255, ["no vertical velocity", "no σ of its position and velocity"]),
        ("rtkx_walk", 13496, ["6958 IMU samples that repeat"]),
    ],
)
def test_real_recordings(recordings, tmp_path, name, samples, said):
    read = read_sensor_log(described(tmp_path / name, recordings / name))
    assert len(read.dtheta) == samples
    assert len(read.repairs) == len(said)
    assert all(part in repair for part, repair in zip(said, read.repairs, strict=True))


def test_mounting_turns_the_axes_of_the_imu(tmp_path, log):
    """An IMU turned in its vehicle: its rates and forces, turned back by these angles, are the vehicle's."""
    expected = read_sensor_log(write(tmp_path / "straight", log))
    angles = (10.0, -20.0, 135.0)
    in_imu = Rotation.from_euler("ZYX", angles[::-1], degrees=True).inv()
    imu = log.imu.copy()
    imu[:, 1:4], imu[:, 4:] = in_imu.apply(imu[:, 1:4]), in_imu.apply(imu[:, 4:])
    read = read_sensor_log(
        write(tmp_path / "turned", log._replace(imu=imu), f"mounting_deg = {list(angles)}")
    )
    np.testing.assert_allclose(read.dtheta, expected.dtheta, atol=1e-12)
    np.testing.assert_allclose(read.dvelocity, expected.dvelocity, atol=1e-10)
    # Beside axes: x right, y forward, z up, in an IMU that is turned as before.
    swapped = imu.copy()
    swapped[:, 1:] = imu[:, [2, 1, 3, 5, 4, 6]] * (1, 1, -1, 1, 1, -1)
    toml = f'axes = ["y", "x", "-z"]\nmounting_deg = {list(angles)}'
    read = read_sensor_log(write(tmp_path / "both", log._replace(imu=swapped), toml))
    np.testing.assert_allclose(read.dvelocity, expected.dvelocity, atol=1e-10)


def test_what_else_was_recorded(tmp_path, log):
    folder = write(
        tmp_path, log, 'vehicle = "car"\ndeclination_deg = -12\n[comparisons]\n"their own" = "ekf.csv"'
    )
    times = log.gnss[:, 0]
    write_csv(
        folder / "mag.csv",
        ("t_s", "mx_uT", "my_uT", "mz_uT"),
        np.column_stack((times, *np.eye(3)[:, [0] * len(times)])),
    )
    write_csv(
        folder / "ekf.csv",
        ("t_s", "roll_deg", "pitch_deg", "heading_deg"),
        np.column_stack((times, *[times] * 3)) % 300,
    )
    columns = np.column_stack((log.gnss[:, :4], times % 360, np.full(len(times), 0.5)))
    write_csv(folder / "gnss.csv", (*POSITION, "heading_deg", "sd_heading_deg"), columns)
    read = read_sensor_log(folder)
    auxiliary = read.auxiliary
    assert auxiliary.vehicle == "car"
    np.testing.assert_array_equal(auxiliary.magnetometer.field, np.tile((1.0, 0, 0), (len(times), 1)))
    assert auxiliary.magnetometer.declination == pytest.approx(np.radians(-12))
    np.testing.assert_allclose(auxiliary.headings.heading, np.radians(times % 360))
    np.testing.assert_allclose(auxiliary.headings.time + read.epoch, times)
    (own,) = auxiliary.comparisons
    assert own.name == "their own"
    assert np.isnan(own.position).all()
    np.testing.assert_allclose(own.euler[:, 1], np.radians(times % 300))


def test_a_reference_may_know_the_attitude_alone(tmp_path, log):
    write(tmp_path, log)
    attitude = log.reference[:, [0, 7, 8, 9]]
    write_csv(tmp_path / "ref.csv", ("t_s", "roll_deg", "pitch_deg", "heading_deg"), attitude)
    read = read_sensor_log(tmp_path).reference
    np.testing.assert_allclose(read.euler, np.radians(attitude[:, 1:]))
    assert np.isnan(read.position).all()
    assert np.isnan(read.velocity_n).all()
    write_csv(tmp_path / "ref.csv", ("t_s",), attitude[:, :1])
    refused(tmp_path, "contains neither positions nor velocities nor attitudes")


@pytest.mark.parametrize(
    ("toml", "pattern"),
    [
        ('vehicle = "bicycle"', "vehicle = 'bicycle'; accepted are aeroplane, car, boat, copter"),
        ("vehicle = 3", "vehicle = 3; accepted is text"),
        ("mounting_deg = [0, 0]", "mounting_deg = .*three numbers from -360 to 360"),
        ("declination_deg = 200", "declination_deg = 200; accepted is a number from -180 to 180"),
        ('forward_assumed = "yes"', "forward_assumed = 'yes'; accepted are true and false"),
        ("check_sensors = 1", "check_sensors = 1; accepted are true and false"),
        ('comparisons = ["ekf.csv"]', "comparisons = .*a table of up to 8 names"),
        ('[comparisons]\n"x" = "/etc/passwd"', "comparisons = '/etc/passwd'; accepted is the plain name"),
        ('[comparisons]\n"x" = "none.csv"', "none.csv: there is no such file"),
        ('magnetometer = "none.csv"', "none.csv: there is no such file"),
    ],
)
def test_what_the_toml_says_beside_is_checked(tmp_path, log, toml, pattern):
    refused(write(tmp_path, log, toml), pattern)
