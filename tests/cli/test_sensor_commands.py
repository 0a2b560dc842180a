"""``ins-lab cards`` and ``ins-lab allan``."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from asking import ask, refused


def test_cards_are_a_table_from_consumer_to_navigation_grade() -> None:
    from lab import cards

    header, *rows, empty, foot = ask("cards").stdout.splitlines()
    assert header.split()[:2] == ["name", "grade"]
    assert [row.split("  ")[0] for row in rows] == list(cards())
    assert empty == ""
    assert foot.startswith("* assumed")
    bmi088 = next(row for row in rows if row.startswith("BMI088"))
    assert bmi088.split()[3] == "4.6*"
    bare = ask("cards", "--no-assumed").stdout.splitlines()
    assert len(bare) == 1 + len(cards())
    assert next(row for row in bare if row.startswith("BMI088")).split()[3] == "–"
    stim300 = next(row for row in rows if row.startswith("STIM300"))
    assert stim300.split()[1:] == ["tactical", "0.0025", "0.5", "119", "0.05"]


def test_cards_as_json_hold_sources_settings_and_what_is_missing() -> None:
    entries = {entry["name"]: entry for entry in json.loads(ask("cards", "--json").stdout)}
    stim300 = entries["STIM300"]
    assert stim300 == json.loads(ask("cards", "stim300", "--json").stdout)
    assert stim300["gyro"]["noise_density"]["value"] == 0.15
    assert "TS1524" in stim300["sources"][stim300["gyro"]["noise_density"]["source"]]
    assert stim300["settings"]["gyro"]["noise_density"] == 0.0025
    assert "Bandwidth" in stim300["missing"]["gyro"]


def test_one_card_is_shown_with_sources_and_what_is_missing() -> None:
    answer = ask("cards", "HG9900").stdout
    assert answer.startswith("HG9900: Honeywell, navigation grade")
    given, assumed = answer.split("Assumed, since the card has no source")
    assert "0.002  °/√h" in given
    assert "brochure N61-1638-000-000" in given
    assert "20  µg/√Hz, two-sided" in assumed
    assert "No source, off when loaded: accelerometer: Range; Bandwidth" in assumed
    bare = ask("cards", "HG9900", "--no-assumed").stdout
    assert "No source, off when loaded: accelerometer: White noise" in bare
    assert "Assumed" not in bare
    assert "0.0028  °/s/√Hz, one-sided" in ask("cards", "ICM-42688-P").stdout


@pytest.mark.proof
def test_what_is_assumed_is_said_with_every_answer_and_can_be_left_out() -> None:
    """In the result, the comparison and the budget; without it a card is what its sheet says."""
    flight = ("los_angeles", "--card", "LN-200S")
    run = ask("run", *flight).stdout
    assert "Assumed as typical of the grade" in run
    assert "gyro white noise" in run
    bare = ask("run", *flight, "--no-assumed").stdout
    assert "Assumed" not in bare
    assert "The card has no number for gyro" in bare
    assert "no number" not in run
    assert "Assumed" not in ask("run", "los_angeles").stdout
    settings = json.loads(ask("run", *flight, "--json").stdout)["settings"]
    assert settings["navigator"]["states"] == 21
    assert "gyro.flicker=0.65" in settings["sensors"]["assumed"]
    chosen = ask("run", *flight, "--set", "navigator.states=15", "--json").stdout
    assert json.loads(chosen)["settings"]["navigator"]["states"] == 15
    assert "Assumed" in ask("compare", *flight, "--models", "phi").stdout
    (row,) = json.loads(ask("compare", *flight, "--models", "phi", "--json").stdout)
    assert "noise_density" in row["assumed"]["gyro"]
    assert "Assumed" in ask("budget", *flight).stdout
    for command in (("compare", *flight, "--models", "phi"), ("budget", *flight)):
        assert "The card has no number for gyro" in ask(*command, "--no-assumed").stdout
    refused(ask("run", "los_angeles", "--no-assumed"), "--no-assumed", "--card")


def _log(path: Path) -> Path:
    rng = np.random.default_rng(3)
    columns = np.column_stack(
        (
            0.01 * np.arange(5000),
            np.radians(0.1) * rng.standard_normal((5000, 3)),
            0.01 * rng.standard_normal((5000, 3)) - (0, 0, 9.8),
        )
    )
    header = "t_s,gx_rad_s,gy_rad_s,gz_rad_s,fx_m_s2,fy_m_s2,fz_m_s2"
    np.savetxt(path, columns, delimiter=",", header=header, comments="", fmt="%.9g")
    return path


def test_a_log_at_rest_becomes_a_table_and_a_card_that_runs(tmp_path: Path) -> None:
    log, out = _log(tmp_path / "imu.csv"), tmp_path / "mine.toml"
    answer = ask("allan", str(log), "--card", str(out))
    assert answer.exit_code == 0, answer.stderr
    header, *rows = answer.stdout.splitlines()
    assert header.split() == ["group", "axis", "term", "fitted", "σ", "unit"]
    assert sum("Quantisation noise" in row for row in rows) == sum("Rate ramp" in row for row in rows) == 6
    assert "degrees of freedom" in answer.stdout
    assert "- Gyros: gx_rad_s, gy_rad_s, gz_rad_s, in rad/s." in rows
    assert "do not explain" not in answer.stdout
    white = [row for row in rows if "White noise" in row]
    assert [row.split()[:2] for row in white] == [
        [triad, axis] for triad in ("gyro", "accelerometer") for axis in "xyz"
    ]
    assert all(float(row.split()[4]) == pytest.approx(0.01, rel=0.05) for row in white[:3])
    refused(ask("allan", str(log), "--card", str(out)), "exists already", "--force")
    assert ask("allan", str(log), "--card", str(out), "--force").exit_code == 0
    assert ask("cards", str(out)).stdout.startswith("mine: own grade")
    assert ask("run", "los_angeles", "--card", str(out)).exit_code == 0


def test_a_person_says_what_the_columns_are(tmp_path: Path) -> None:
    """Gyros alone, in °/s, in columns that nobody would know."""
    log = _log(tmp_path / "imu.csv")
    log.write_text(
        log.read_text().replace("t_s,gx_rad_s,gy_rad_s,gz_rad_s,fx_m_s2,fy_m_s2,fz_m_s2", "t,p,q,r,a,b,c")
    )
    named = ("t=time[s]", "p=rate_x[rad/s]", "q=rate_y[rad/s]", "r=rate_z[rad/s]")
    answer = ask("allan", str(log), *(part for one in named for part in ("--column", one)), "--json")
    found = json.loads(answer.stdout)
    assert set(found) == {"record", "remarks", "gyro"}
    assert found["gyro"]["terms"]["noise_density"]["value"] == pytest.approx([0.01] * 3, rel=0.05)
    refused(ask("allan", "STIM300", "--unit", "p=rad/s"), "--unit")


def test_an_allan_deviation_as_json_holds_the_curve(tmp_path: Path) -> None:
    answer = json.loads(ask("allan", str(_log(tmp_path / "imu.csv")), "--json").stdout)
    gyro = answer["gyro"]
    assert gyro["dt_s"] == pytest.approx(0.01)
    assert gyro["unit"] == "rad/s"
    curve = np.array(gyro["deviation"])
    assert curve.shape == (len(gyro["tau_s"]), 3)
    assert (np.array(gyro["low"]) < curve).all()
    assert (curve < np.array(gyro["high"])).all()
    assert curve[0] == pytest.approx(np.radians(0.1), rel=0.05)
    assert gyro["terms"]["noise_density"]["unit"] == "°/s/√Hz"
    assert gyro["terms"]["rate_ramp"]["unit"] == "°/h²"
    assert len(gyro["fit"]["chi_square"]) == len(gyro["fit"]["degrees_of_freedom"]) == 3
    assert all(0.001 < p_value <= 1 for p_value in gyro["fit"]["p_value"])


def test_a_card_simulated_at_rest_stands_beside_its_own_values() -> None:
    answer = ask("allan", "STIM300", "--seed", "2")
    header, *rows = answer.stdout.splitlines()
    assert header.split()[-1] == "card"
    for row in rows:
        if "White noise" in row:
            fitted, _, _, own = row.split()[4:]
            assert float(fitted) == pytest.approx(float(own), rel=0.05)
    assert ask("allan", "STIM300", "--seed", "3").stdout != answer.stdout
    assert ask("allan", "STIM300", "--seed", "2").stdout == answer.stdout
