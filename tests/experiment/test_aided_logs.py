"""Logs with a barometer, an odometer and headings: what they add to the navigation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from sensor_logs import (
    ATTITUDE,
    EPOCH,
    IMU,
    POSITION,
    SIGMA,
    VELOCITY,
    changed,
    tables,
    trajectory,
    write_csv,
)

from lab import Experiment, ResultError
from lab.data.log.log_section import cut_section
from lab.experiment.log_run import OF_FURTHER_STATES, has_effect
from lab.missions import MissionError, read_sensor_log
from lab.missions.library import delete_mission
from lab.motion.frames.magnetic_field import magnetic_field
from lab.navigation.log_navigation import navigate_log

OUTAGE = (EPOCH + 90.0, EPOCH + 150.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a log of a flight with readings of other sensors and a reference."""
    folder = tmp_path_factory.mktemp("aided")
    flown = tables(0.0, 200.0)
    write_csv(folder / "imu.csv", IMU, flown.imu)
    write_csv(folder / "gnss.csv", (*POSITION, *VELOCITY, *SIGMA), flown.gnss)
    write_csv(folder / "ref.csv", (*POSITION, *VELOCITY, *ATTITUDE), flown.reference)
    rng, times = np.random.default_rng(3), np.arange(1.0, 199.0, 0.5)
    truth = trajectory().at(times)
    height = truth.height + 7.0 + rng.normal(0, 0.3, times.size)
    write_csv(folder / "baro.csv", ("t_s", "height_m"), np.column_stack((times + EPOCH, height)))
    forward = np.einsum("nij,ni->nj", rotations(truth), truth.velocity_n)[:, 0]
    speed = 1.01 * forward + rng.normal(0, 0.1, times.size)
    write_csv(folder / "odo.csv", ("t_s", "speed_m_s"), np.column_stack((times + EPOCH, speed)))
    through_air = truth.velocity_n - (4.0, -3.0, 0.0)
    airspeed = np.linalg.norm(through_air, axis=1) + rng.normal(0, 0.5, times.size)
    write_csv(folder / "air.csv", ("t_s", "airspeed_m_s"), np.column_stack((times + EPOCH, airspeed)))
    return folder


def rotations(truth: object) -> np.ndarray:
    """Return C_nb (n, 3, 3)."""
    from sensor_logs import rotation_matrices

    return rotation_matrices(truth)  # type: ignore[arg-type]


def drive(folder: Path, **fitted: bool) -> Experiment:
    """Return an experiment with an outage of a minute, and some sensors fitted."""
    made = Experiment(mission=str(folder))
    made.set("sensors.gps.outages", [OUTAGE])
    for name, value in fitted.items():
        made.set(f"sensors.{name}.fitted", value)
    return made


def test_a_barometer_holds_the_height_over_an_outage(folder: Path) -> None:
    alone, aided = drive(folder).run(), drive(folder, barometer=True).run()
    end = int(np.searchsorted(alone.time, 149.0))
    assert aided.solution_arrays.variance[end, 2] < 0.05 * alone.solution_arrays.variance[end, 2]
    error = abs(float(aided.errors["position"].values[end, 2]))
    assert error < 4 * np.sqrt(aided.solution_arrays.variance[end, 2])
    # The bias is that of the simulation, within its σ.
    found = aided.further_states
    estimate, sigma = (float(found[name].sel(state="barometer bias")[-1]) for name in ("estimate", "sigma"))
    assert abs(estimate - 7.0) < 4 * sigma
    assert "truth" not in found
    nis = aided.solution_arrays.aid_innovation**2 / aided.solution_arrays.aid_variance
    assert nis.mean() == pytest.approx(1, abs=4 * np.sqrt(2 / nis.size))


@pytest.mark.proof
def test_what_a_log_does_not_show_is_refused_with_its_other_sensors_too(folder: Path) -> None:
    for aided in (drive(folder), drive(folder, barometer=True), drive(folder, odometer=True, airspeed=True)):
        with pytest.raises(ResultError, match="sensor log"):
            _ = aided.run().consistency


def test_an_odometer_finds_its_scale(folder: Path) -> None:
    """With airspeeds beside, so that this filter is the one of the next test."""
    aided = drive(folder, odometer=True, airspeed=True).run()
    found = aided.further_states.sel(state="odometer scale")
    assert float(found["estimate"][-1]) == pytest.approx(1.0, abs=4 * float(found["sigma"][-1]))


def test_airspeeds_find_the_wind(folder: Path) -> None:
    found = drive(folder, odometer=True, airspeed=True).run().further_states
    for axis, true in (("north", 4.0), ("east", -3.0)):
        at = {"state": f"wind {axis}"}
        sigma = float(found["sigma"].sel(at)[-1])
        assert sigma < 1.0  # from 5.1
        assert float(found["estimate"].sel(at)[-1]) == pytest.approx(true, abs=4 * sigma)


def test_what_is_there_and_not_used_or_wanted_and_not_there_is_told(folder: Path) -> None:
    notes = " ".join(drive(folder, heading=True).run().remarks)
    assert "readings of a barometer that are not used; sensors.barometer.fitted = true uses them" in notes
    assert "The log has no readings for sensors.heading.fitted, which has no effect." in notes


BARO, MAG = "t_s,height_m\n", "t_s,mx_uT,my_uT,mz_uT\n"


@pytest.mark.proof
@pytest.mark.parametrize(
    ("file", "text", "cause"),
    [
        (
            "baro.csv",
            BARO + "".join(f"{time},300\n" for time in range(1, 199)),
            "The readings of the barometer are of 1 to 198 s, but the IMU recorded 1000.01 to 1200 s: "
            "another clock is likely",
        ),
        ("baro.csv", BARO, "The file of the barometer holds none."),
        ("baro.csv", BARO + "1010,\n1011,\n", "The file of the barometer holds none."),
        ("mag.csv", MAG, "The file of the magnetometer holds none."),
        (
            "mag.csv",
            MAG + "".join(f"{time},0,0,0\n" for time in range(1001, 1199)),
            "The readings of the magnetometer are all zero.",
        ),
        (
            "air.csv",
            "t_s,airspeed_m_s\n" + "".join(f"{time},0\n" for time in range(1001, 1199)),
            "The readings of the airspeed sensor are all below sensors.airspeed.slowest.",
        ),
    ],
    ids=["other clock", "header only", "empty cells", "empty field", "zero field", "too slow"],
)
def test_a_sensor_without_one_usable_reading_counts_as_absent(
    folder: Path, tmp_path: Path, file: str, text: str, cause: str
) -> None:
    for name in ("imu.csv", "gnss.csv", "ref.csv"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    (tmp_path / file).write_text(text)
    told_as_absent(tmp_path, file, cause)


def test_a_sensor_that_reads_before_the_first_fix_only_counts_as_absent(folder: Path, tmp_path: Path) -> None:
    for name in ("imu.csv", "ref.csv"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    rows = (folder / "gnss.csv").read_text().splitlines()
    (tmp_path / "gnss.csv").write_text("\n".join([rows[0], *rows[21:]]))  # from 1010 s on
    (tmp_path / "baro.csv").write_text(BARO + "".join(f"{time},300\n" for time in range(1001, 1009)))
    told_as_absent(
        tmp_path, "baro.csv", "The readings of the barometer are of 1001 to 1008 s, and nothing is"
    )


def told_as_absent(tmp_path: Path, file: str, cause: str) -> None:
    """Assert that the sensor of a file is absent from the filter, and that a remark gives the cause."""
    group = {"baro.csv": "barometer", "mag.csv": "heading", "air.csv": "airspeed"}[file]
    made = drive(tmp_path, **{group: True})
    made.set("sensors.heading.source", "magnetometer")
    result = made.run()
    told = [remark for remark in result.remarks if f"sensors.{group}.fitted" in remark]
    assert len(told) == 1
    assert f"The log has no readings for sensors.{group}.fitted, which has no effect. {cause}" in told[0]
    assert not result.blocks
    assert not result.aids.time.size
    unfitted = drive(tmp_path).run()
    assert not [remark for remark in unfitted.remarks if f"sensors.{group}.fitted" in remark]


def with_headings(folder: Path, tmp_path: Path) -> Path:
    """Return the log with a magnetometer and a file of headings, both 2° off."""
    for name in ("imu.csv", "gnss.csv", "ref.csv"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    rng, times = np.random.default_rng(4), np.arange(0.5, 199.0, 0.1)
    truth = trajectory().at(times)
    off = np.radians(2.0) + np.radians(0.5) * rng.normal(size=times.size)
    heading = np.degrees(truth.euler[:, 2] + off) % 360
    write_csv(tmp_path / "heading.csv", ("t_s", "heading_deg"), np.column_stack((times + EPOCH, heading)))
    field = magnetic_field(truth.position[0])
    C_nb = rotations(truth)
    turned = Rotation.from_rotvec(-off[:, None] * np.array([0.0, 0.0, 1.0])).apply(field)
    seen = np.einsum("nji,nj->ni", C_nb, turned)
    write_csv(
        tmp_path / "mag.csv", ("t_s", "mx_uT", "my_uT", "mz_uT"), np.column_stack((times + EPOCH, seen))
    )
    return tmp_path


@pytest.mark.parametrize("source", ["heading", "magnetometer"])
def test_headings_and_magnetic_fields_of_a_log_are_used(folder: Path, tmp_path: Path, source: str) -> None:
    made = drive(with_headings(folder, tmp_path), heading=True)
    made.set("sensors.heading.source", source)
    made.set("sensors.heading.noise", 0.5)
    made.set("navigator.initial_heading", np.degrees(float(trajectory().at(np.zeros(1)).euler[0, 2])))
    result = made.run()
    found = result.further_states.sel(state="heading sensor bias")
    error, sigma = float(found["estimate"][-1]) - 2.0, float(found["sigma"][-1])
    assert abs(error) < 4 * sigma
    kinds = set(result.aiding.kind.values.tolist())
    assert kinds == {"heading" if source == "heading" else "magnetic heading"}
    # Headings at 10 Hz are all taken, a magnetometer once a second.
    assert result.aids.time.size == pytest.approx(1980 if source == "heading" else 198, abs=10)
    nis = result.solution_arrays.aid_innovation**2 / result.solution_arrays.aid_variance
    assert np.nanmean(nis) == pytest.approx(1, abs=0.3)


def test_a_declination_that_is_given_takes_the_place_of_the_model(folder: Path, tmp_path: Path) -> None:
    made = drive(with_headings(folder, tmp_path), heading=True)
    made.set("sensors.heading.source", "magnetometer")
    made.set("sensors.heading.declination", 10.0)
    np.testing.assert_allclose(made.run().aids.value, np.radians(10.0))
    (tmp_path / "log.toml").write_text("declination_deg = -3.0\n")
    made.set("sensors.heading.declination", None)
    np.testing.assert_allclose(made.run().aids.value, np.radians(-3.0))


def test_headings_in_two_files_are_refused(folder: Path, tmp_path: Path) -> None:
    log = with_headings(folder, tmp_path)
    rows = (log / "gnss.csv").read_text().splitlines()
    (log / "gnss.csv").write_text("\n".join([f"{rows[0]},heading_deg", *(f"{row},10" for row in rows[1:])]))
    with pytest.raises(MissionError, match=r"heading.csv: gnss.csv has headings too .* of one file"):
        read_sensor_log(log)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t_s,speed\n1010,5\n", r"heading.csv.*heading_deg"),
        ("t_s,heading_deg\n1010,5\n1009,6\n", r"heading.csv, column t_s: accepted is time that increases"),
        ("t_s,heading_deg\n1010,500\n", r"heading.csv.*heading_deg.*360"),
        ("t_s,heading_deg,sd_heading_deg\n1010,5,0\n", r"heading.csv.*sd_heading_deg"),
    ],
)
def test_headings_that_cannot_be_read_are_refused(
    folder: Path, tmp_path: Path, text: str, message: str
) -> None:
    log = with_headings(folder, tmp_path)
    (log / "heading.csv").write_text(text)
    with pytest.raises(MissionError, match=message):
        read_sensor_log(log)


def test_a_log_is_deleted_with_the_files_of_all_its_sensors(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("INS_LAB_MISSIONS", str(tmp_path))
    mine = tmp_path / "mine"
    mine.mkdir()
    for file in with_headings(folder, mine).iterdir():
        assert file.exists()
    for name in ("baro.csv", "odo.csv"):
        (mine / name).write_bytes((folder / name).read_bytes())
    delete_mission("mine")
    assert not mine.exists()


def test_time_that_runs_backwards_is_refused(folder: Path, tmp_path: Path) -> None:
    for name in ("imu.csv", "gnss.csv"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    (tmp_path / "baro.csv").write_text("t_s,height_m\n1010,5\n1009,6\n")
    with pytest.raises(MissionError, match=r"baro.csv, column t_s: accepted is time that increases"):
        read_sensor_log(tmp_path)


def test_axes_that_are_not_those_of_the_vehicle_are_told(folder: Path) -> None:
    """An aeroplane slips: its speeds to the right and down are not zero."""
    made = drive(folder)
    made.set("navigator.no_slip", True)
    told = [remark for remark in made.run().remarks if "as large as the filter says" in remark]
    assert any("innovations of speed down" in remark for remark in told)
    assert not [remark for remark in drive(folder, barometer=True).run().remarks if "as large as" in remark]


@pytest.mark.proof
def test_what_the_navigation_depends_on_is_never_taken_from_a_run_with_other_settings(folder: Path) -> None:
    """Every number of sensors and start, one by one, with all states and sensors that this log allows."""
    base = drive(folder, barometer=True, odometer=True, airspeed=True)
    for states in ("misalignments", "g_sensitivity", "bias_drift", "gps_drift", "lever_arm", "latency"):
        base.set(f"navigator.estimate_{states}", True)
    base.update({"navigator": {"states": 21, "model": "nonlinear"}})  # its one kernel has all blocks
    log = cut_section(read_sensor_log(folder), EPOCH + 80.0, EPOCH + 92.0)
    # The receiver's own σ would replace the variances of the settings.
    log.gnss.position_sigma[:], log.gnss.velocity_sigma[:] = np.nan, np.nan

    def end(made: Experiment) -> NDArray[np.float64]:
        solution = navigate_log(log, made.sensors, made.navigator, []).solution
        return np.concatenate((solution.velocity_n[-1], solution.variance[-1]))

    plain, fitted, matters = end(base), ("barometer", "odometer", "airspeed"), set()
    for path, owner, name in base.leaves():
        value = getattr(owner, name)
        numbers = value if isinstance(value, tuple) else (value,)
        wanted = path.startswith("sensors.") or path.endswith(("_sigma", "_error"))
        if not wanted or not all(type(one) is float for one in numbers):
            continue
        other = base.copy()
        other.set(path, changed(value, owner.param[name].bounds))
        if (end(other) != plain).any():
            assert has_effect(path, base.navigator, fitted), path
            matters.add(path)
    assert matters >= set(OF_FURTHER_STATES)


@pytest.mark.parametrize(
    ("path", "states"),
    [
        ("gyro.misalignment", "misalignments"),
        ("gyro.g_sensitivity", "g_sensitivity"),
        ("gps.correlated_sigma", "gps_drift"),
    ],
)
def test_settings_of_further_states_count_with_these_states_alone(
    folder: Path, path: str, states: str
) -> None:
    def sigma(size: float, *, estimated: bool) -> float:
        made = drive(folder)
        made.set(f"sensors.{path}", size)
        made.update({"navigator": {"model": "nonlinear", f"estimate_{states}": estimated}})
        result = made.run()
        said = any(f"sensors.{path} has no effect" in remark for remark in result.remarks)
        assert said is not estimated
        return float(result.solution_arrays.variance[0, 15] ** 0.5) if estimated else 0.0

    sigma(1.0, estimated=False)
    assert sigma(2.0, estimated=True) == pytest.approx(4 * sigma(0.5, estimated=True), rel=1e-6)
