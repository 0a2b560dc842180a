"""Lines for other programs: units by what each program does with them, limits, and forms."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from pymavlink.mavparm import MAVParmDict

from lab.base.parameters.units import TO_SI
from lab.experiment.filter_programs import PROGRAMS, lines
from lab.experiment.number_table import TERMS, UNITS, Estimate, ImuNumbers, NumberRow

GYRO_N, FORCE_N = 1.2e-4, 2.5e-3
"""White noise [rad/s/√Hz], [m/s²/√Hz]."""
GYRO_K, FORCE_K = 3e-5, 4e-4
"""Random walk of the biases [rad/s/√s], [m/s²/√s]."""
RATE = 200.0


def numbers(
    values: tuple[float, float, float, float] = (GYRO_N, FORCE_N, GYRO_K, FORCE_K), moving: str = "drive"
) -> ImuNumbers:
    rows = []
    for place, value in enumerate(values):
        term, triad = divmod(place, 2)
        unit = UNITS[term][triad]
        used = value / TO_SI[unit]
        known = Estimate(used, 0.9 * used, 1.1 * used) if math.isfinite(used) else Estimate(1.0, 0.0, 2.0)
        rows.append(
            NumberRow(
                ("gyro", "accelerometer")[triad], TERMS[term], unit, known, None, used, 0.0, "", "a test"
            )
        )
    return ImuNumbers("still.csv", moving, RATE, tuple(rows), (0.5, 12.0), None, ())


def words_of(text: str) -> str:
    """Return the text of comments, which are wrapped, in one line."""
    return re.sub(r"\n[#%] ", " ", text)


def values_of(text: str, pattern: str) -> dict[str, float]:
    return {name: float(value) for name, value in re.findall(pattern, text, re.M)}


@pytest.mark.parametrize("program", PROGRAMS)
def test_each_says_its_version_its_source_and_where_the_numbers_are_from(program: str) -> None:
    text = lines(numbers(), program)
    assert PROGRAMS[program].title in text
    assert PROGRAMS[program].link in text
    assert "still.csv and drive" in words_of(text)
    assert "a test" in words_of(text)


@pytest.mark.parametrize("program", PROGRAMS)
def test_a_value_stands_alone_on_its_line_and_comments_are_short(program: str) -> None:
    """Mission Planner skips lines with more than two words; the console of PX4 runs what is beyond 128."""
    sign = PROGRAMS[program].comment
    for line in lines(numbers(moving="a drive with a name of many words " * 8), program).splitlines():
        assert len(line) < 128
        assert line.startswith(sign) or sign not in line


def test_ground_stations_of_ardupilot_read_all_parameters(tmp_path: Path) -> None:
    """Two words on a line, as Mission Planner wants them; pymavlink reads the same."""
    text = lines(numbers((GYRO_N, 0.02, GYRO_K, FORCE_K)), "ardupilot")
    kept = [re.split(r"[ ,\t]+", line) for line in text.splitlines() if not line.startswith("#")]
    assert [len(words) for words in kept] == [2, 2, 2, 2]
    (tmp_path / "noise.param").write_text(text, "utf-8")
    read = MAVParmDict()
    assert read.load(str(tmp_path / "noise.param"))
    assert dict(read) == {name: float(value) for name, value in kept}


def test_kalibr_reads_its_own_units() -> None:
    read = yaml.safe_load(lines(numbers(), "kalibr"))
    assert read == {
        "gyroscope_noise_density": pytest.approx(GYRO_N, rel=1e-3),
        "accelerometer_noise_density": pytest.approx(FORCE_N, rel=1e-3),
        "gyroscope_random_walk": pytest.approx(GYRO_K, rel=1e-3),
        "accelerometer_random_walk": pytest.approx(FORCE_K, rel=1e-3),
        "update_rate": RATE,
    }


@pytest.mark.parametrize(
    ("program", "step", "pattern"),
    [("px4", 0.01, r"^param set (\w+) (\S+)"), ("ardupilot", 0.012, r"^(EK3\w+),(\S+)")],
)
def test_the_autopilots_grow_their_variances_as_the_sensor_does(
    program: str, step: float, pattern: str
) -> None:
    """Both add (Δt p)² to angle, velocity and bias at each step: over 10 s that is N² 10 s and K² 10 s."""
    given = list(values_of(lines(numbers((GYRO_N, 0.02, GYRO_K, FORCE_K)), program), pattern).values())
    steps = 10 / step
    grown = [steps * (step * one) ** 2 for one in given]
    assert grown == pytest.approx([GYRO_N**2 * 10, 0.02**2 * 10, GYRO_K**2 * 10, FORCE_K**2 * 10], rel=2e-3)


def test_a_comment_has_the_factor_for_ardupilots_slower_loops() -> None:
    """EKF3 steps no faster than the loop: 50 Hz in Plane and Rover, where its noise must grow as fast."""
    text = lines(numbers((GYRO_N, 0.02, GYRO_K, FORCE_K)), "ardupilot")
    found = re.search(r"at 50, the default of Plane and Rover, multiply by ([\d.]+)", words_of(text))
    assert found is not None
    given = list(values_of(text, r"^(EK3\w+),(\S+)").values())
    grown = [50 * (0.02 * float(found[1]) * one) ** 2 for one in given]
    assert grown == pytest.approx([GYRO_N**2, 0.02**2, GYRO_K**2, FORCE_K**2], rel=3e-3)


def test_values_outside_the_limits_are_refused_and_not_clipped() -> None:
    text = lines(numbers((1e-6, 5.0, GYRO_K, FORCE_K)), "px4")
    assert "param set EKF2_GYR_NOISE" not in text
    assert "EKF2_GYR_NOISE would be 1e-05 rad/s" in text
    assert "refused; the program accepts 0.0001 to 0.1" in words_of(text)
    assert "EKF2_ACC_NOISE would be 50 m/s^2" in text
    assert "param set EKF2_GYR_B_NOISE" in text


@pytest.mark.parametrize("program", ["kalibr", "px4", "ardupilot", "kf-gins", "matlab"])
def test_a_term_that_is_not_known_gets_no_number(program: str) -> None:
    text = lines(numbers((GYRO_N, FORCE_N, math.nan, math.nan)), program)
    assert "nan" not in text
    assert words_of(text).count("not known from these logs, at most") >= 2
    assert "keep the default" in words_of(text)


def test_kf_gins_has_the_drive_of_a_random_walk() -> None:
    """Its process has 2 σ²/T as the density of the bias's drive, in rad²/s³ and m²/s⁵."""
    (noise,) = yaml.safe_load(lines(numbers(), "kf-gins")).values()
    assert noise["arw"] == pytest.approx([math.degrees(GYRO_N) * 60] * 3, rel=1e-3)
    assert noise["vrw"] == pytest.approx([FORCE_N * 60] * 3, rel=1e-3)
    seconds = noise["corrtime"] * 3600
    gyro, force = math.radians(noise["gbstd"][0]) / 3600, noise["abstd"][0] * 1e-5
    assert 2 * gyro**2 / seconds == pytest.approx(GYRO_K**2, rel=2e-3)
    assert 2 * force**2 / seconds == pytest.approx(FORCE_K**2, rel=2e-3)
    # Without them, a correlation time would only change the processes that the user has.
    text = lines(numbers((GYRO_N, FORCE_N, math.nan, math.nan)), "kf-gins")
    assert set(yaml.safe_load(text)["imunoise"]) == {"arw", "vrw"}


def test_matlab_has_variances_of_a_sample_for_its_measurements() -> None:
    given = values_of(lines(numbers(), "matlab"), r"^([\w.]+) = ([-\d.e]+);")
    assert given["gyroCovariance"] == pytest.approx(GYRO_N**2 * RATE, rel=1e-3)
    assert given["accelCovariance"] == pytest.approx(FORCE_N**2 * RATE, rel=1e-3)
    assert given["filter.GyroscopeBiasNoise"] == pytest.approx(GYRO_K**2, rel=1e-3)


def test_robot_localization_has_a_matrix_of_fifteen_states() -> None:
    text = lines(numbers(), "robot_localization")
    matrix = yaml.safe_load(text)["process_noise_covariance"]
    assert {type(one) for one in matrix} == {float}  # ROS 2 takes no integer among them
    matrix = np.array(matrix).reshape(15, 15)
    assert (matrix == matrix.T).all()
    assert np.diag(matrix)[9:12] == pytest.approx([0.5] * 3)
    assert np.diag(matrix)[12:] == pytest.approx([12.0] * 3)
    assert f"angular_velocity_covariance diagonal: {GYRO_N**2 * RATE:.4g}" in text
    assert "not known without a drive" in words_of(lines(numbers(moving=""), "robot_localization"))


def test_the_table_is_plain_data() -> None:
    facts = json.loads(json.dumps(numbers((GYRO_N, FORCE_N, math.nan, FORCE_K)).to_dict(), allow_nan=False))
    assert facts["rows"][0]["one_sided"] == pytest.approx(math.sqrt(2) * facts["rows"][0]["used"])
    assert facts["rows"][2]["used"] is None
