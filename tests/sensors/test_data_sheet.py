"""Data sheet: numbers as makers write them, the card they make, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab import SettingError
from lab.sensors import cards
from lab.sensors.data_sheet import BEYOND, DataSheet, asked_terms, find_term, sheet_number, usual_range
from lab.sensors.datum import ONE_SIDED, TWO_SIDED, WORDS
from lab.sensors.suite import TRIADS, SensorSuite

G = 9.80665


def sheet(grade: str = "own") -> DataSheet:
    """Return an empty sheet."""
    return DataSheet("Mine", "Me", grade, "sheet, rev. 1")


def in_setting(triad: str, word: str, text: str) -> object:
    """Return a number of a sheet in the unit of its setting."""
    setting = find_term(triad, word)
    return sheet_number(triad, setting, text, "sheet").datum.in_unit(
        SensorSuite().groups()[triad].param[setting].unit
    )


@pytest.mark.parametrize(
    ("triad", "word", "text", "value"),
    [
        ("gyro", "noise density", "3.8 mdps/sqrt(Hz)", 0.0038 / math.sqrt(2)),
        ("gyro", "Noise-Density", "0.0038 °/s/√Hz two-sided", 0.0038),
        ("gyro", "ARW", "0.15 deg/√h", 0.15 / 60),
        ("gyro", "angle random walk", "< 0.3 deg/rt(hr) typ", 0.3 / 60),
        ("gyro", "noise", "0.05 dps rms in 100 Hz", 0.005 / math.sqrt(2)),
        ("gyro", "rms noise", "0.05 °/s-rms @ 100 Hz bandwidth", 0.005 / math.sqrt(2)),
        ("gyro", "in-run bias stability", "8 deg/hr", 8.0),
        ("gyro", "zero-rate level", "±1 dps (1σ)", 1.0),
        ("gyro", "repeatability", "20 deg/h", 20 / 3600),
        ("gyro", "offset", "4 LSB at 16.4 LSB/dps", 4 / 16.4),
        ("gyro", "offset", "4 digits at 0.061 dps/digit", 4 * 0.061),
        ("gyro", "offset", "0.1 % FS at 2000 dps", 2.0),
        ("gyro", "nonlinearity", "0.1 %FS", 0.1),
        ("gyro", "scale factor accuracy", "300 ppm", 0.03),
        ("gyro", "cross-axis sensitivity", "±1 %", math.degrees(0.01)),
        ("gyro", "misalignment", "0.5 mrad", math.degrees(0.5e-3)),
        ("gyro", "linear acceleration effect", "0.1 dps/g", 0.1),
        ("gyro", "bias temperature coefficient", "15 mdps/°C", 0.015),
        ("gyro", "scale temperature", "50 ppm/K", 0.005),
        ("gyro", "full-scale range", "±2000 °/s", 2000.0),
        ("gyro", "bandwidth", "0.1 kHz", 100.0),
        ("accelerometer", "noise", "1.2 mg rms in 100 Hz", 120 / math.sqrt(2)),
        ("accelerometer", "VRW", "0.06 m/s/√hr", 0.06 / 60 / G * 1e6),
        ("accelerometer", "noise density", "160, 160, 190 ug/rtHz", np.array([160, 160, 190]) / math.sqrt(2)),
        ("accelerometer", "bias instability", "125 µm/s²", 125e-6 / G * 1e3),
        ("accelerometer", "zero-g offset", "400 LSB at 0.061 mg/LSB", 24.4),
    ],
)
def test_words_and_units_of_sheets_are_read(triad: str, word: str, text: str, value: object) -> None:
    assert in_setting(triad, word, text) == pytest.approx(value, rel=1e-9)


def test_a_published_sheet_agrees_with_itself() -> None:
    """MPU-6000, PS-MPU-6000A-00, section 6.1: 0.005 °/s/√Hz, and 0.05 °/s rms with a low-pass of 100 Hz."""
    assert in_setting("gyro", "noise", "0.005 dps/√Hz") == pytest.approx(
        in_setting("gyro", "noise", "0.05 dps rms in 100 Hz")
    )


def test_rms_in_a_band_is_what_white_noise_has_there() -> None:
    """White noise of the two-sided density N, sampled at f, has the variance N² f, all below f / 2."""
    density, rate = in_setting("gyro", "noise", "0.05 dps rms in 100 Hz"), 200.0
    samples = np.random.default_rng(1).normal(scale=density * math.sqrt(rate), size=400_000)
    assert samples.std() == pytest.approx(0.05, rel=0.01)  # a band of 100 Hz is all of the noise at 200 Hz


@pytest.mark.parametrize(
    ("triad", "word", "text", "words"),
    [
        ("gyro", "nose", "1 dps", ["there is no 'nose'", "Did you mean noise?", "noise_density"]),
        ("accelerometer", "g_sensitivity", "1 mg/g", ["there is no 'g_sensitivity'"]),
        ("gyro", "noise", "3.8 dps/√Hz", ["is too large for a sensor", "Is the unit right?"]),
        ("gyro", "flicker", "8 dps", ["is too large", "°/h"]),
        ("accelerometer", "noise", "0.07 ng/√Hz", ["is too small"]),
        ("gyro", "noise", "0 dps/√Hz", ["is too small"]),
        ("gyro", "noise", "0.05 dps rms", ["needs its bandwidth", "rms in 100 Hz"]),
        ("gyro", "noise", "0.05 dps rms in 100 dps", ["needs its bandwidth"]),
        ("gyro", "noise", "0.05 dps", ["unit of something else", "°/s/√Hz"]),
        ("gyro", "noise", "5 ug/√Hz", ["unit of something else"]),
        ("gyro", "noise", "3,8 mdps/√Hz", ["point before decimals"]),
        ("gyro", "noise", "3.8", ["the unit is missing"]),
        ("gyro", "noise", "low", ["accepted is a number with its unit", "3.8 mdps/√Hz"]),
        ("gyro", "noise", "nan dps/√Hz", ["a number with its unit"]),
        ("gyro", "noise", "1e999 dps/√Hz", ["sizes from 0 on"]),
        ("gyro", "noise", "-1 dps/√Hz", ["sizes from 0 on"]),
        ("gyro", "noise", "0.2 °/√h one-sided", ["two-sided by definition"]),
        ("gyro", "offset", "1 dps two-sided", ["densities of noise"]),
        ("gyro", "offset", "1 dps rms", ["rms is a size of noise"]),
        ("gyro", "offset", "4 LSB", ["needs the sensitivity"]),
        ("gyro", "offset", "4 LSB at 0 LSB/dps", ["needs the sensitivity"]),
        ("gyro", "offset", "1 % FS", ["needs the range"]),
        ("gyro", "offset", "1 dps at 25 °C", ["leave it out here"]),
        ("gyro", "offset", "1 furlong", ["'furlong' is no unit"]),
        ("gyro", "offset", "1" * 201, ["longer than 200"]),
    ],
)
def test_what_is_not_accepted_is_said(triad: str, word: str, text: str, words: list[str]) -> None:
    with pytest.raises(SettingError) as error:
        sheet().take(triad, word, text)
    for one in [triad, *words]:
        assert one in str(error.value)


def test_a_range_given_before_makes_parts_of_it_a_number() -> None:
    mine = sheet()
    mine.take("gyro", "range", "500 dps")
    found = mine.take("gyro", "offset", "0.2 % FS")
    assert found.datum.value == pytest.approx(1.0)
    assert found.datum.unit == "°/s"
    with pytest.raises(SettingError, match="is given already"):
        mine.take("gyro", "zero-rate level", "1 dps")


@pytest.mark.parametrize("name", [name for name in cards.cards() if name != cards.CLASSIC])
def test_every_card_can_be_told_as_a_data_sheet(name: str) -> None:
    """The numbers of the catalogue, spoken in their units, give the settings of the card."""
    card = cards.card(name)
    mine = DataSheet(card.name, card.maker, card.grade, "sheet")
    for triad in TRIADS:
        for setting, datum in card.terms.get(triad, {}).items():
            values = datum.value if isinstance(datum.value, tuple) else (datum.value,)
            mine.take(triad, setting, f"{', '.join(map(str, values))} {datum.unit} {datum.density}")
    made = mine.card()
    assert made.settings() == card.settings()


@pytest.mark.parametrize("grade", cards.GRADES)
def test_what_the_sheet_lacks_is_assumed_or_missing(grade: str, tmp_path) -> None:
    mine = sheet(grade)
    mine.take("gyro", "noise", "3.8 mdps/√Hz")
    made = mine.card()
    path = tmp_path / "mine.toml"
    path.write_text(made.to_toml(), encoding="utf-8")
    assert cards.card(path) == made
    assert "3.8 mdps/√Hz" in made.note
    assert made.terms["gyro"]["noise_density"].density == ONE_SIDED
    assert bool(made.assumed) is (grade != "own")
    lacking = made.missing()["accelerometer"]
    assert ("White noise" in lacking) is (grade == "own")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("", "", "own", "s"), "needs its name"),
        (("n", "", "own", " "), "needs its source"),
        (("n", "", "best", "s"), "accepted is one of consumer"),
        (("n" * 201, "", "own", "s"), "name: accepted are up to 200"),
        (("n", "\x1b[2J", "own", "s"), "maker: accepted"),
        (("n", "", "own", "a\nb"), "source: accepted"),
    ],
)
def test_what_a_card_needs_is_asked(arguments: tuple[str, str, str, str], words: str) -> None:
    with pytest.raises(SettingError, match=words):
        DataSheet(*arguments)
    with pytest.raises(SettingError, match="at least one number"):
        sheet().card()
    with pytest.raises(SettingError, match="accepted are gyro and accelerometer"):
        sheet().take("magnetometer", "noise", "1 dps")


def test_sane_limits_leave_every_card_in_and_every_wrong_prefix_out() -> None:
    for triad in TRIADS:
        for term in asked_terms(triad):
            least, largest = usual_range(triad, term.setting)
            assert 0 < least <= largest
            assert SensorSuite().groups()[triad].param[term.setting].bounds[1] >= largest
    assert BEYOND**2 < 1000
    assert set(WORDS.values()) <= {term.setting for triad in TRIADS for term in asked_terms(triad)}
    assert {ONE_SIDED, TWO_SIDED} == {"one-sided", "two-sided"}


@given(st.text(max_size=80), st.sampled_from(["range", "noise_density", "bias_sigma", "misalignment"]))
def test_any_text_is_read_or_refused_in_words(text: str, setting: str) -> None:
    try:
        found = sheet_number("gyro", setting, text, "sheet")
    except SettingError as error:
        assert "accepted" in str(error) or ":" in str(error)
        return
    assert np.all(np.isfinite(found.datum.value))


@given(st.text(alphabet="0123456789.,; eE+-±<%°/√µLSBFdpsrmghzinat@()", max_size=60))
def test_texts_like_numbers_are_read_or_refused(text: str) -> None:
    try:
        sheet_number("accelerometer", "noise_density", text, "sheet")
    except SettingError:
        return
