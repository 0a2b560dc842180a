"""Rest: logs of an IMU that stands still, the records simulated at rest, and the card made of them."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from lab.analysis import rest
from lab.missions import MissionError
from lab.sensors import cards
from lab.sensors.suite import SensorSuite

RNG = np.random.default_rng(5)
HEADER = "t_s,gx_rad_s,gy_rad_s,gz_rad_s,fx_m_s2,fy_m_s2,fz_m_s2"
RECORDINGS = Path(os.environ.get("INS_LAB_RECORDINGS", Path(__file__).parents[3] / "shared" / "recordings"))


def _table(samples: int = 400, dt: float = 0.01) -> np.ndarray:
    """Return a log at rest: gyros of 0.01 °/s/√Hz, accelerometers of 100 µg/√Hz, level."""
    gyro = np.radians(0.01) / np.sqrt(dt) * RNG.standard_normal((samples, 3))
    force = 100e-6 * 9.80665 / np.sqrt(dt) * RNG.standard_normal((samples, 3)) - (0, 0, 9.80665)
    return np.column_stack((5 + dt * np.arange(samples), gyro, force))


def _write(path: Path, table: np.ndarray, header: str = HEADER) -> Path:
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.12g")
    return path


def test_a_log_is_read(tmp_path: Path) -> None:
    table = _table()
    records = rest.read_log(_write(tmp_path / "imu.csv", table))
    assert np.allclose(records["gyro"].rates, table[:, 1:4], rtol=1e-10)
    assert np.allclose(records["accelerometer"].rates, table[:, 4:7], rtol=1e-10)
    assert records["gyro"].dt == pytest.approx(0.01, rel=1e-12)
    assert records["gyro"].duration == pytest.approx(4.0, rel=1e-12)


def test_columns_may_stand_in_any_order_beside_others(tmp_path: Path) -> None:
    table = _table()
    order = [3, 0, 5, 1, 6, 2, 4]
    header = "note," + ",".join(HEADER.split(",")[column] for column in order)
    shuffled = np.column_stack((np.zeros(len(table)), table[:, order]))
    assert np.allclose(
        rest.read_log(_write(tmp_path / "imu.csv", shuffled, header))["gyro"].rates, table[:, 1:4]
    )


@pytest.mark.parametrize(
    ("table", "header", "words"),
    [
        (_table(10), HEADER, ["10 samples", "at least 16"]),
        (
            np.delete(_table(), RNG.choice(400, 80, replace=False), axis=0),
            HEADER,
            ["samples are missing", "gaps"],
        ),
        (_table() * ([1.0] * 4 + [1 / 9.80665] * 3), HEADER, ["1 m/s²; this looks like g"]),
        (_table() * ([1.0] * 4 + [3.0] * 3), HEADER, ["29.42 m/s²", "at rest"]),
        (_table() + np.outer(np.linspace(-1, 1, 400), np.eye(7)[4]), HEADER, ["changes by", "at rest"]),
        (
            _table(3000) + np.outer(np.sin(np.arange(3000) / 90), np.eye(7)[1]),
            HEADER,
            ["rates change by", "from second to second"],
        ),
        (_table(), "t_s,gx,gy,gz,fx_m_s2,fy_m_s2,fz_m_s2", ["do not name their unit", "--unit gx="]),
    ],
)
def test_what_is_no_log_at_rest_is_refused(
    table: np.ndarray, header: str, words: list[str], tmp_path: Path
) -> None:
    path = _write(tmp_path / "imu.csv", table, header)
    with pytest.raises(MissionError) as error:
        rest.read_log(path)
    for word in (str(path), *words):
        assert word in str(error.value)


@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00", b"a,b\n1,2\n", HEADER.encode() + b"\n1,2\n"])
def test_what_is_no_csv_is_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "imu.csv"
    path.write_bytes(content)
    with pytest.raises(MissionError, match=r"imu\.csv"):
        rest.read_log(path)


def test_a_simulated_record_holds_every_process_of_the_sensor() -> None:
    """White noise, flicker and random walk set together come back from the fit."""
    wanted = {"noise_density": 0.01, "flicker": 5.0, "rate_random_walk": 20.0}
    suite = SensorSuite(**{f"gyro.{name}": value for name, value in wanted.items()})
    suite.set("gyro.bias", 1.0)
    found = rest.in_setting_units("gyro", rest.noise_terms(rest.simulate(suite, seed=4))["gyro"])
    for name, tolerance in (("noise_density", 0.05), ("flicker", 0.30), ("rate_random_walk", 0.30)):
        assert np.allclose(found[name]["value"], wanted[name], rtol=tolerance), (name, found[name])


def test_samples_are_spaced_as_the_noise_asks_but_never_finer_than_an_imu() -> None:
    """White noise meets the floor at τ = (N / 0.664 B)²: 29.4 s for 0.008 °/s/√Hz and 8 °/h."""
    suite = SensorSuite(**{"gyro.noise_density": 0.008, "gyro.flicker": 8.0})
    record = rest.simulate(suite)["gyro"]
    assert record.dt < 29.4 / 10
    assert record.duration > 29.4 * 500
    suite.set("gyro.flicker", 36000.0)
    assert rest.simulate(suite)["gyro"].dt == pytest.approx(1 / 2000)


def test_the_card_of_a_log_holds_what_the_log_shows(tmp_path: Path) -> None:
    records = rest.read_log(_write(tmp_path / "imu.csv", _table(40_000)))
    card = rest.card_of("my IMU", records, "imu.csv")
    assert np.allclose(card.value("gyro", "noise_density"), 0.01, rtol=0.05)
    assert np.allclose(card.value("accelerometer", "noise_density"), 100, rtol=0.05)
    assert "rate_random_walk" not in card.terms["accelerometer"]
    assert "Range" in card.missing()["gyro"]
    assert card.terms["gyro"]["noise_density"].source == ("Allan deviation of imu.csv: 400 s at rest, 100 Hz")
    path = tmp_path / "mine.toml"
    path.write_text(card.to_toml(), encoding="utf-8")
    assert cards.card(path) == card


def test_terms_that_no_setting_is_have_names_and_units_too() -> None:
    """Angles rounded to 10″ and a ramp of 1 °/h in an hour, logged for two hours at 1 Hz."""
    time = np.arange(7200.0)[:, None] * np.ones(3)
    angle = np.cumsum(np.radians(0.001) * RNG.standard_normal((7200, 3)), axis=0)
    angle += np.radians(1 / 3600**2) * time**2 / 2 + np.radians(0.01) * time
    step = np.radians(10 / 3600)
    gyro = rest.Record(np.diff(step * np.round(angle / step), axis=0), 1.0)
    force = rest.Record(1e-3 * RNG.standard_normal((7199, 3)), 1.0)
    fitted = rest.noise_terms({"gyro": gyro, "accelerometer": force})
    named = rest.in_setting_units("gyro", fitted["gyro"])
    assert named["quantisation_noise"]["unit"] == "″"
    assert np.allclose(named["quantisation_noise"]["value"], 10 / np.sqrt(12), rtol=0.1)
    assert named["rate_ramp"]["unit"] == "°/h²"
    assert (np.abs(named["rate_ramp"]["value"] - 1) < 3 * named["rate_ramp"]["sigma"]).all()
    assert named["noise_density"]["label"] == "White noise"
    card = rest.card_of("mine", {"gyro": gyro, "accelerometer": force}, "imu.csv")
    assert set(card.terms["gyro"]) <= set(rest.TERMS.values())
    assert rest.about_fit(fitted) == card.note == ""


def test_the_card_of_a_log_says_where_the_fit_is_poor_and_that_its_density_is_two_sided() -> None:
    shaken = 0.01 * RNG.standard_normal((20_000, 3))
    shaken[:, 1] += 0.02 * np.sin(np.arange(20_000) / 7)
    still = rest.Record(np.radians(0.01) * RNG.standard_normal((20_000, 3)), 0.01)
    card = rest.card_of("mine", {"gyro": still, "accelerometer": rest.Record(shaken, 0.01)}, "imu.csv")
    assert "do not explain the Allan deviation of accelerometer y (p " in card.note
    assert card.terms["gyro"]["noise_density"].density == "two-sided"


@pytest.mark.skipif(not RECORDINGS.is_dir(), reason=f"no recordings at {RECORDINGS} (INS_LAB_RECORDINGS)")
def test_a_real_log_at_rest_gives_a_card() -> None:
    """Half a minute shows the white noise; lines of vibration leave the gyros without a number."""
    records = rest.read_log(RECORDINGS / "vn310_static" / "imu.csv")
    assert records["gyro"].dt == pytest.approx(0.02, rel=1e-3)
    card = rest.card_of("VN-310", records, "imu.csv")
    assert not card.terms["gyro"]
    assert "do not explain the Allan deviation of gyro" in card.note
    assert (np.array(card.value("accelerometer", "noise_density")) < 140).all()


def test_a_rest_shows_the_unit_of_gyros_whose_bias_none_has_in_radians(tmp_path: Path) -> None:
    """1.5 rad/s at rest would be a bias of 86 °/s; an MPU-6050 has some degrees per second."""
    table = _table()
    table[:, 1:4] += np.array((-1.2, 0.8, 0.5))
    records = rest.read_log(_write(tmp_path / "imu.csv", table, "t_s,gx,gy,gz,fx_m_s2,fy_m_s2,fz_m_s2"))
    np.testing.assert_allclose(records["gyro"].rates, np.radians(table[:, 1:4]), atol=1e-12)
    assert any("in °/s (guessed" in remark for remark in records.remarks)
    table[:, 1:4] = np.rint(131 * table[:, 1:4])  # counts of its converter
    with pytest.raises(MissionError, match="do not name their unit"):
        rest.read_log(_write(tmp_path / "imu.csv", table, "t_s,gx,gy,gz,fx_m_s2,fy_m_s2,fz_m_s2"))


def test_a_table_whose_t_is_a_temperature_has_no_time_stamps(tmp_path: Path) -> None:
    table = np.column_stack((_table(), 27.8 + 0.1 * (RNG.random(400) < 0.3)))
    path = _write(tmp_path / "imu.csv", table, "f,gx,gy,gz,fx_m_s2,fy_m_s2,fz_m_s2,t")
    with pytest.raises(MissionError, match=r"has time stamps.*--column HEADING=time"):
        rest.read_log(path)
