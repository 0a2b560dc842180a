"""What filters that are not ours say of themselves is read as their programs document it."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from estimator_logs import FUSED, ekf3, px4, px4_old
from sensor_logs import write_csv

from lab.analysis.verdicts.foreign_verdict import judge_foreign
from lab.base.files.mission_error import MissionError
from lab.data.filter_logs import read_filter_log

ROOT = Path(__file__).parents[2]
TIME = np.arange(100.0, 160.0, 0.5)


@pytest.fixture
def values() -> tuple[np.ndarray, np.ndarray]:
    """Return innovations and variances of EKF2, which a float holds."""
    rng = np.random.default_rng(1)
    variances = rng.uniform(0.5, 2.0, (len(TIME), 11)).astype(np.float32).astype(float)
    innovations = rng.normal(size=variances.shape) * np.sqrt(variances)
    return innovations.astype(np.float32).astype(float), variances


def put(folder: Path, name: str, content: bytes) -> Path:
    path = folder / name
    path.write_bytes(content)
    return path


def test_px4_innovations_are_normalised_by_their_variances(tmp_path, values) -> None:
    innovations, variances = values
    log = read_filter_log(put(tmp_path, "a.ulg", px4(TIME, innovations, variances)))
    found = {one.name: one for one in log.lane.innovations}
    units = {"velocity": "m/s", "position": "m", "height": "m", "barometer": "m", "heading": "rad"}
    assert all(one.unit == units[name.split()[-1]] for name, one in found.items())
    assert set(found) == {"GPS velocity", "GPS vertical velocity", "GPS position", "barometer", "heading"}
    for name, own in (("GPS velocity", slice(0, 2)), ("GPS position", slice(3, 5)), ("heading", slice(7, 8))):
        np.testing.assert_allclose(
            found[name].normalised, innovations[:, own] / np.sqrt(variances[:, own]), rtol=1e-6
        )
        np.testing.assert_allclose(
            found[name].ratio, (innovations[:, own] ** 2 / variances[:, own]).max(axis=1) / 25, rtol=1e-6
        )
    np.testing.assert_allclose(found["heading"].time, TIME)


def test_what_px4_did_not_fuse_is_left_out(tmp_path, values) -> None:
    log = read_filter_log(put(tmp_path, "a.ulg", px4(TIME, *values, fused=FUSED & ~(1 << 2))))
    assert {one.name for one in log.lane.innovations} == {"barometer", "heading"}
    with pytest.raises(MissionError, match="no innovations that EKF2 fused"):
        read_filter_log(put(tmp_path, "b.ulg", px4(TIME, *values, fused=0)))


def test_innovations_that_are_logged_again_count_once(tmp_path, values) -> None:
    innovations, variances = (np.repeat(one[::3], 3, axis=0) for one in values)
    log = read_filter_log(put(tmp_path, "a.ulg", px4(TIME, innovations, variances)))
    assert {len(one.time) for one in log.lane.innovations} == {len(TIME) // 3}


def test_lanes_resets_faults_and_rejections_of_px4_are_events(tmp_path, values) -> None:
    innovations, variances = values
    innovations[40:44, 3] = 9 * np.sqrt(variances[40:44, 3])
    primary = np.where(TIME < 130, 0, 1)
    faults = np.where((TIME >= 150) & (TIME < 152), 1 << 12, 0)
    content = px4(
        TIME,
        innovations,
        variances,
        lanes=2,
        primary=primary,
        resets={"reset_count_pos_ne": 121.0},
        faults=faults,
    )
    log = read_filter_log(put(tmp_path, "a.ulg", content))
    assert [lane.name for lane in log.lanes] == ["instance 0", "instance 1"]
    events = {one.kind: one for one in log.events}
    assert events["lane"].time == pytest.approx(130.0)
    assert "from instance 0 to instance 1" in events["lane"].text
    assert events["reset"].time == pytest.approx(121.0)
    assert "the horizontal position" in events["reset"].text
    assert events["fault"].time == pytest.approx(150.0)
    assert events["rejected"].time == pytest.approx(TIME[40])
    assert "GPS position from 120.0 s to 121.5 s (4 logged innovations" in events["rejected"].text


def test_px4_before_2019_has_its_own_message(tmp_path, values) -> None:
    innovations, variances = (one[:, :6] for one in values)
    log = read_filter_log(put(tmp_path, "a.ulg", px4_old(TIME, innovations, variances)))
    found = {one.name: one for one in log.lane.innovations}
    assert set(found) == {"GPS velocity", "GPS vertical velocity", "GPS position", "height", "heading"}
    expected = innovations[:, 3:5] / np.sqrt(variances[:, 3:5])
    np.testing.assert_allclose(found["GPS position"].normalised, expected, rtol=1e-6)


def test_ekf3_test_ratios_give_the_mean_square(tmp_path) -> None:
    rng = np.random.default_rng(2)
    variances = np.full((len(TIME), 6), 0.49)
    innovations = rng.normal(scale=0.7, size=variances.shape)
    log = read_filter_log(put(tmp_path, "a.bin", ekf3(TIME, innovations, variances, gate=3.0)))
    assert log.filter == "ArduPilot EKF3"
    found = {one.name: one for one in log.lane.innovations}
    assert {name: one.unit for name, one in found.items()} == {
        "GPS velocity": "m/s",
        "GPS position": "m",
        "height": "m",
    }
    for name, own in (("GPS velocity", slice(0, 3)), ("GPS position", slice(3, 5)), ("height", slice(5, 6))):
        expected = np.mean(innovations[:, own] ** 2 / 0.49, axis=1)
        # The root of the ratio is logged in steps of 0.01.
        np.testing.assert_allclose(np.sqrt(found[name].square), np.sqrt(expected), atol=0.016)
        large = expected > 0.2
        assert np.mean(found[name].normalised[large] ** 2) == pytest.approx(
            np.mean(expected[large]), rel=0.05
        )


def test_lanes_resets_and_words_of_ekf3_are_events(tmp_path) -> None:
    rng = np.random.default_rng(3)
    primary, north = np.where(TIME < 120, 0, 1), np.where(TIME < 125, 0.0, 3.5)
    log = read_filter_log(
        put(
            tmp_path,
            "a.bin",
            ekf3(
                TIME,
                rng.normal(size=(len(TIME), 6)),
                np.ones((len(TIME), 6)),
                primary=primary,
                north=north,
                faults=np.where(TIME < 110, 4, 0),
                said=[(119.9, "EKF3 lane switch 1"), (101.0, "Barometer 1 calibration complete")],
            ),
        )
    )
    assert log.lane.name == "core 1"
    events = {one.kind: one for one in log.events}
    assert (events["lane"].time, events["reset"].time) == (pytest.approx(120.0), pytest.approx(125.0))
    assert events["message"].text.endswith("EKF3 lane switch 1")
    assert "badly conditioned fusion of the magnetometer X" in events["fault"].text
    assert sum(one.kind == "message" for one in log.events) == 1


HEADER = ("time [s]", "position east [m]", "position north [m]", "position_sigma east [m]",
          "position_sigma north [m]", "position_ratio", "heading [rad]", "heading_sigma [rad]")  # fmt: skip


def rows(rng: np.random.Generator) -> np.ndarray:
    made = rng.normal(size=(len(TIME), len(HEADER)))
    made[:, 0], made[:, 3:5], made[:, 5], made[:, 7] = TIME, 2.0, 0.1, 0.5
    return made


def test_a_csv_of_anyone_is_read(tmp_path) -> None:
    made = rows(np.random.default_rng(4))
    write_csv(tmp_path / "a.csv", HEADER, made)
    log = read_filter_log(tmp_path / "a.csv")
    position, heading = log.lane.innovations
    assert (position.name, position.axes, position.unit) == ("position", ("east", "north"), "m")
    assert (heading.name, heading.axes, heading.unit) == ("heading", ("",), "rad")
    np.testing.assert_allclose(position.normalised, made[:, 1:3] / 2, rtol=1e-6)
    np.testing.assert_allclose(position.ratio, 0.1)


def test_a_csv_without_innovations_or_with_damage_is_refused(tmp_path) -> None:
    made = rows(np.random.default_rng(5))
    for cut, said in ((slice(0, 4), "accepted are headings such as"), (slice(0, 1), "unknown")):
        write_csv(tmp_path / "a.csv", HEADER[cut], made[:, cut])
        text = (tmp_path / "a.csv").read_text().replace("position_sigma east", "other_sigma east")
        (tmp_path / "a.csv").write_text(text)
        with pytest.raises(MissionError, match=said):
            read_filter_log(tmp_path / "a.csv")
    made[7, 3] = -1.0
    write_csv(tmp_path / "b.csv", HEADER, made)
    with pytest.raises(MissionError, match="row 9, column position_sigma east"):
        read_filter_log(tmp_path / "b.csv")


def test_a_table_with_other_headings_is_told_which_are_accepted(tmp_path) -> None:
    """The advice on columns of a flight, which an import takes, has no place here."""
    put(tmp_path, "kf.csv", b"time,innov_x,innov_y,S_x,S_y\n" + b"1,0.1,0.2,1.0,1.0\n" * 50)
    with pytest.raises(MissionError, match=r"no heading .* accepted: .*position_sigma north \[m\]") as told:
        read_filter_log(tmp_path / "kf.csv")
    assert "--column" not in str(told.value)
    for content in (b"", b"\x89PNG\r\n\x1a\n, , ", bytes(range(256))):
        with pytest.raises(MissionError, match=r"empty|unknown"):
            read_filter_log(put(tmp_path, "other.csv", content))


def test_rows_that_go_back_in_time_are_refused_and_a_few_are_left_out(tmp_path) -> None:
    made = rows(np.random.default_rng(7))
    write_csv(tmp_path / "a.csv", HEADER, made[::-1])
    with pytest.raises(
        MissionError, match=f"{len(made) - 1} of {len(made)} rows are earlier than one before"
    ):
        read_filter_log(tmp_path / "a.csv")
    made[20, 0] = made[10, 0]
    write_csv(tmp_path / "a.csv", HEADER, made)
    kept = read_filter_log(tmp_path / "a.csv").lane.innovations[0].time
    assert len(made) - 2 <= len(kept) < len(made)


@pytest.mark.parametrize("kind", ["ulg", "bin", "csv"])
def test_damaged_files_are_read_or_refused(tmp_path, values, kind) -> None:
    rng = np.random.default_rng(6)
    if kind == "csv":
        write_csv(tmp_path / "a.csv", HEADER, rows(rng))
        content = (tmp_path / "a.csv").read_bytes()
    else:
        content = (
            px4(TIME, *values, lanes=2) if kind == "ulg" else ekf3(TIME, values[0][:, :6], values[1][:, :6])
        )
    for _ in range(60):
        damaged = bytearray(content)
        for at in rng.integers(0, len(content), 40):
            damaged[at] = rng.integers(256)
        path = put(tmp_path, f"d.{kind}", bytes(damaged[: rng.integers(1, len(content))]))
        try:
            log = read_filter_log(path)
        except MissionError:
            continue
        assert log.lanes
        for one in log.lane.innovations:
            assert np.isfinite(one.square).all() or one.name == "magnetometer"


@pytest.mark.parametrize("kind", ["ulg", "bin"])
def test_damaged_bytes_accuse_no_filter(tmp_path, values, kind) -> None:
    rng = np.random.default_rng(7)
    time = np.arange(100.0, 220.0, 0.2)
    innovations, variances = 0.5 * rng.normal(size=(len(time), 11)), np.ones((len(time), 11))
    of_core = innovations[:, :6], variances[:, :6]
    content = px4(time, innovations, variances) if kind == "ulg" else ekf3(time, *of_core)
    accused = judged = 0
    for _ in range(20):
        damaged = bytearray(content)
        for at in rng.integers(len(content) // 10, len(content), 50):
            damaged[at] = rng.integers(256)
        try:
            log = read_filter_log(put(tmp_path, f"d.{kind}", bytes(damaged)))
        except MissionError:  # a flag in the header
            continue
        judged += 1
        accused += bool(judge_foreign(log).verdict.findings)
    assert judged >= 15
    assert accused <= 1


def test_pyulog_reads_the_same_innovations_in_a_real_log() -> None:
    pyulog = pytest.importorskip("pyulog")
    folder = Path(os.environ.get("INS_LAB_LOGS", ROOT.parent / "shared" / "logs"))
    path = folder / "copter_61.ulg"
    if not path.is_file():
        pytest.skip("no real logs here: name their folder in INS_LAB_LOGS")
    data = {one.name: one.data for one in pyulog.ULog(str(path)).data_list if one.multi_id == 0}
    innovation, variance = (data[f"estimator_{name}"] for name in ("innovations", "innovation_variances"))
    log = read_filter_log(path)
    found = {one.name: one for one in log.lane.innovations}["GPS position"]
    expected = np.column_stack(
        [innovation[f"gps_hpos[{axis}]"] / np.sqrt(variance[f"gps_hpos[{axis}]"]) for axis in range(2)]
    )
    np.testing.assert_allclose(found.normalised, expected, rtol=1e-5)
