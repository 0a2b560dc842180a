"""Cards: the catalogue, what a card sets, what a file of one's own may hold, and a card's noise."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

import lab
from lab import Experiment, SettingError
from lab.analysis import rest
from lab.base.parameters.toml_file import MAX_BYTES
from lab.base.parameters.units import TO_SI
from lab.sensors import cards
from lab.sensors.datum import ALIKE, ONE_SIDED, TWO_SIDED
from lab.sensors.imu import AccelerometerErrors, GyroErrors
from lab.sensors.suite import SensorSuite

NAMES = tuple(cards.cards())

OWN = """
["Mine"]
maker = "Me"
grade = "own"

["Mine".sources]
sheet = "a sheet, rev. 1"

["Mine".gyro]
noise_density = { value = 0.3, unit = "°/√h", source = "sheet" }
"""


def _write(folder: Path, text: str) -> Path:
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_catalogue_goes_from_consumer_to_navigation_grade() -> None:
    grades = [card.grade for card in cards.cards().values()]
    assert len(grades) >= 20
    assert set(grades) == {"consumer", "industrial", "tactical", "navigation"}
    assert grades == sorted(grades, key=cards.GRADES.index)


def test_every_number_has_a_unit_and_a_source() -> None:
    for card in cards.cards().values():
        for terms in card.terms.values():
            for datum in terms.values():
                assert datum.unit
                assert len(datum.source) > 8
                assert "not recorded" not in datum.source  # of a sheet that nobody opened


def test_at_least_twenty_cards_have_the_noise_of_both_triads() -> None:
    whole = [
        name
        for name, card in cards.cards().items()
        if all("noise_density" in card.terms.get(triad, {}) for triad in cards.TRIADS)
    ]
    assert len(whole) >= 20


SPOKEN = """
[Mine]
grade = "own"
[Mine.sources]
sheet = "sheet"
[Mine.gyro]
{word} = {{ value = {value}, unit = "{unit}", source = "sheet" }}
[Mine.accelerometer]
VRW = {{ value = 0.06, unit = "m/s/√h", source = "sheet" }}
"""
SHEET_WORDS = (
    ("bias_instability", "flicker", 2.0, "°/h"),
    ("in-run stability", "flicker", 2.0, "°/h"),
    ("ARW", "noise_density", 0.15, "°/√h"),
    ("angle_random_walk", "noise_density", 0.15, "°/√h"),
    ("repeatability", "bias_sigma", 0.2, "°/s"),
    ("nonlinearity", "scale_factor_sigma", 100.0, "ppm"),
)


@pytest.mark.parametrize(("word", "name", "value", "unit"), SHEET_WORDS)
def test_words_of_data_sheets_are_the_settings_they_mean(word, name, value, unit, tmp_path) -> None:
    spoken, plain = tmp_path / "spoken.toml", tmp_path / "plain.toml"
    spoken.write_text(SPOKEN.format(word=f'"{word}"', value=value, unit=unit))
    plain.write_text(SPOKEN.format(word=name, value=value, unit=unit))
    assert cards.card(spoken).settings() == cards.card(plain).settings()
    twice = SPOKEN.format(word=f'"{word}"', value=value, unit=unit).replace(
        "[Mine.accelerometer]",
        f'{name} = {{ value = {value}, unit = "{unit}", source = "sheet" }}\n[Mine.accelerometer]',
    )
    spoken.write_text(twice)
    with pytest.raises(SettingError, match="is given already; accepted is one of the two"):
        cards.card(spoken)


def test_what_a_card_lacks_is_said_until_it_is_stated(tmp_path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(SPOKEN.format(word="ARW", value=0.15, unit="°/√h"))
    own, experiment = cards.card(path), Experiment()
    assert "lacking and zero" in repr(own)
    own.load(experiment)
    sensors = experiment.sensors
    triads = {"gyro": ["flicker", "bias_sigma", "scale_factor_sigma", "misalignment", "g_sensitivity"]}
    triads["accelerometer"] = triads["gyro"][:4]
    assert sensors.lacking_terms() == triads
    assert "no number for gyro flicker, turn-on bias, scale factor" in sensors.card_remark()
    assert sensors.card_remark() in sensors.remarks()
    sensors.gyro.bias_sigma = (0.2,) * 3
    assert "bias_sigma" not in sensors.lacking_terms()["gyro"]
    for whole in ("STIM300", cards.CLASSIC):
        cards.card(whole).load(experiment)
        assert experiment.sensors.lacking_terms() == {}
    cards.card("BMI088", assumed=False).load(experiment)
    assert "misalignment" in experiment.sensors.lacking_terms()["gyro"]


def test_what_has_no_source_is_said_to_be_missing() -> None:
    missing = cards.card("HG9900", assumed=False).missing()
    assert "White noise" in missing["accelerometer"]
    assert "White noise" not in missing["gyro"]
    assert "Range" in missing["gyro"]
    assert cards.card("HG9900").missing()["accelerometer"] == ["Range", "Bandwidth"]


def test_the_classic_card_is_the_default_to_the_bit() -> None:
    card = cards.card(cards.CLASSIC)
    assert SensorSuite().update(card.settings()).to_dict() == SensorSuite().to_dict()
    assert card.value("accelerometer", "noise_density") == [35.0, 65.0, 35.0]
    assert card.value("gps", "position_variance") == 0.5


@pytest.mark.parametrize("name", NAMES)
def test_a_card_is_recognised_when_loaded(name: str) -> None:
    suite = SensorSuite(**{"gyro.bias": 3.0, "accelerometer.misalignment": 1.0})
    assert cards.card_in_force(suite) is None
    assert cards.card_in_force(suite.update(cards.card(name).settings())) == name
    assert cards.card_in_force(suite.update(cards.card(name, assumed=False).settings())) == name


def test_a_changed_setting_is_no_card() -> None:
    assert cards.card_in_force(SensorSuite()) == cards.CLASSIC
    assert cards.card_in_force(SensorSuite(**{"gyro.noise_density": (0.05, 0.05, 0.051)})) is None


def test_a_card_leaves_the_receiver_and_the_vehicle_alone() -> None:
    suite = SensorSuite(
        **{"gps.period": 0.2, "gps.position_variance": 4.0, "accelerometer.vibration_density": 50}
    )
    suite.update(cards.card("ADIS16470").settings())
    assert suite.gps.period == 0.2
    assert suite.gps.position_variance == (4.0,) * 3
    assert suite.accelerometer.vibration_density == (50.0,) * 3


def test_terms_without_a_number_are_off_and_nothing_saturates() -> None:
    suite = SensorSuite().update(cards.card("HG9900", assumed=False).settings())
    assert suite.accelerometer.noise_density == (0.0,) * 3
    assert suite.assumed == ""
    assert suite.gyro.range == GyroErrors.param["range"].bounds[1]
    assert suite.accelerometer.range == AccelerometerErrors.param["range"].bounds[1]


@pytest.mark.parametrize(
    ("name", "group", "term", "value"),
    [
        ("STIM300", "gyro", "noise_density", 0.15 / 60),  # °/√h in °/s/√Hz
        ("VN-310", "gyro", "noise_density", 5 / 3600 / 2**0.5),  # one-sided °/h/√Hz in °/s/√Hz
        ("STIM300", "gyro", "g_sensitivity", 1 / 3600),  # °/h/g in °/s/g
        ("STIM300", "gyro", "misalignment", 1e-3 * 180 / np.pi),  # mrad in °
        ("ADIS16488", "gyro", "flicker", 6.5),  # another text has 6.25 °/h
        ("ADIS16448", "accelerometer", "noise_density", 0.11 / 60 / 9.80665 * 1e6),  # m/s/√h in µg/√Hz
        ("HG1700", "accelerometer", "noise_density", 0.065 * 0.3048 / 60 / 9.80665 * 1e6),  # ft/s/√h
        ("VN-100", "accelerometer", "noise_density", 140.0 / 2**0.5),  # one-sided mg/√Hz
        ("KVH P-1775", "accelerometer", "noise_density", 34.0),  # two-sided µg/√Hz
        ("ADIS16470", "accelerometer", "flicker", 0.013),  # µg in mg
        ("HG9900", "gyro", "bias_sigma", 0.0035 / 3600),  # °/h in °/s
        ("HG9900", "gyro", "scale_factor_sigma", 0.0005),  # ppm in %
        ("BMI088", "accelerometer", "flicker", 0.036),  # assumed, µg in mg
    ],
)
def test_datasheet_units_become_those_of_the_settings(name: str, group: str, term: str, value: float) -> None:
    assert cards.card(name).value(group, term) == pytest.approx(value, rel=1e-9)


@pytest.mark.proof
@pytest.mark.parametrize("name", NAMES)
def test_a_card_at_rest_gives_back_its_noise(name: str) -> None:
    """Simulated at rest and fitted: N within 5 % and B within 30 %, on every axis."""
    suite = SensorSuite().update(cards.card(name).settings())
    fitted = rest.noise_terms(rest.simulate(suite))
    for triad, terms in fitted.items():
        found = rest.in_setting_units(triad, terms)
        for term, tolerance in (("noise_density", 0.05), ("flicker", 0.30)):
            wanted = np.array(getattr(suite.groups()[triad], term))
            errors = found[term]["value"][wanted > 0] / wanted[wanted > 0] - 1
            if errors.size:
                print(f"{name}, {triad}, {term}: {np.abs(errors).max():.1%}")
            assert (np.abs(errors) < tolerance).all()


def test_a_card_flies() -> None:
    experiment = Experiment(mission="los_angeles").update({"sensors": lab.card("ADIS16488").settings()})
    errors = experiment.run().summary.set_index("quantity")["rms"]
    assert 0 < errors["position east"] < 5


def test_names_are_found_in_small_letters_too() -> None:
    assert lab.card("adis16470") is cards.card("ADIS16470")
    assert lab.card("adis16470", assumed=False).assumed == {}
    assert set(lab.cards()) == set(NAMES)


def test_an_own_card_is_read(tmp_path: Path) -> None:
    card = cards.card(_write(tmp_path, OWN))
    assert (card.name, card.maker, card.grade) == ("Mine", "Me", "own")
    assert card.value("gyro", "noise_density") == pytest.approx(0.005)
    assert card.terms["gyro"]["noise_density"].source == "a sheet, rev. 1"


def test_a_price_has_a_currency_and_a_source(tmp_path: Path) -> None:
    price = 'price = { value = 12.5, unit = "USD", source = "sheet" }'
    priced = OWN.replace('grade = "own"', f'grade = "own"\n{price}')
    found = cards.card(_write(tmp_path, priced))
    assert found.price is not None
    assert (found.price.value, found.price.unit, found.price.source) == (12.5, "USD", "a sheet, rev. 1")
    assert cards.card(_write(tmp_path, found.to_toml())).price == found.price
    assert cards.card(_write(tmp_path, OWN)).price is None
    for old, new, word in (
        ("12.5", "-1", "above zero"),
        ("12.5", "true", "above zero"),
        ("12.5", "nan", "above zero"),
        ('"USD"', '"$"', "three capital letters"),
        (', source = "sheet" }', " }", "source is missing"),
        ('"USD", source = "sheet" }', '"USD", source = "shop" }', "'shop' is not in the table"),
    ):
        with pytest.raises(SettingError, match=word):
            cards.card(_write(tmp_path, priced.replace(old, new, 1)))


@pytest.mark.parametrize("name", NAMES)
def test_a_card_is_written_as_it_was_read(name: str, tmp_path: Path) -> None:
    card = cards.card(name)
    text = card.to_toml()
    assert list(tomllib.loads(text)) == [name]
    assert cards.card(_write(tmp_path, text)) == card


FIELD = 'noise_density = { value = 0.3, unit = "°/√h", source = "sheet" }'


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("noise_density", "noise_densty", ["Mine, gyro", "Did you mean noise_density?"]),
        ('"°/√h"', '"m/s/√h"', ["noise_density, unit: 'm/s/√h'", "°/s/√Hz or °/h/√Hz or °/√h"]),
        ('unit = "°/√h", ', "", ["noise_density: unit is missing"]),
        ('"sheet" }', '"paper" }', ["'paper' is not in the table sources; accepted: sheet"]),
        ("value = 0.3", "value = 3000", ["noise_density = 50.0", "from 0 to 10 °/s/√Hz"]),
        ("value = 0.3", "value = -1", ["noise_density", "from 0 to 10 °/s/√Hz"]),
        ("value = 0.3", 'value = "low"', ["noise_density, value: 'low'", "one number, or 3 (x, y, z)"]),
        ("value = 0.3", "value = true", ["value: True"]),
        ("value = 0.3", "value = nan", ["not a finite number"]),
        ("value = 0.3", "value = [1, 2]", ["value: [1, 2]", "one number, or 3 (x, y, z)"]),
        (FIELD, "noise_density = 0.3", ["noise_density: 0.3", "{ value = ..., unit = ..., source = ... }"]),
        (FIELD, "", ["Mine: has no numbers", "gyro, accelerometer, gps"]),
        ('"°/√h",', '"°/√h", density = "one-sided",', ["density: 'one-sided'", "in °/√h is two-sided"]),
        ('"°/√h",', '"°/s/√Hz", density = 2,', ["density: 2", "one-sided or two-sided"]),
        ('"°/√h",', '"°/s/√Hz", density = [],', ["density: []", "one-sided or two-sided"]),
        ('source = "sheet" }', "source = [1] }", ["source: [1]", "accepted: sheet"]),
        ("value = 0.3", f"value = 1{'0' * 400}", ["value", "too large"]),
        ("noise_density =", "flicker =", ["flicker, unit", "°/s or °/h"]),
        ('value = 0.3, unit = "°/√h"', "value = 1e999, unit = 3", ["unit: 3"]),
        (OWN, OWN + '["Mine".assumed]\ngyro = 3', ["Mine, assumed.gyro: is not a table"]),
        (OWN, OWN + '["Mine".assumed.gps]\n', ["Mine, assumed: there is no 'gps'"]),
        (
            OWN,
            OWN + '["Mine".assumed.gyro]\nnoise_density = { value = 1, unit = "°/√h", source = "sheet" }',
            ["Mine, assumed.gyro: noise_density is given already"],
        ),
        (OWN, "assumed = 1\n" + OWN, ["assumed: is not a table"]),
        (OWN, OWN.replace('grade = "own"', 'grade = "own"\nassumed = 1'), ["Mine, assumed: is not a table"]),
        ('grade = "own"', 'grade = "best"', ["Mine, grade: 'best'", "consumer, industrial, tactical"]),
        ('grade = "own"', "", ["Mine, grade"]),
        ('maker = "Me"', "maker = 3", ["Mine, maker: 3 is not text"]),
        ('maker = "Me"', 'marker = "Me"', ["there is no 'marker'", "Did you mean maker?"]),
        ('"Mine".gyro', '"Mine".giro', ["there is no 'giro'", "Did you mean gyro?"]),
        ('sheet = "a sheet, rev. 1"', "sheet = 1", ["Mine, sources"]),
        ('["Mine".gyro]', '["Mine".gps]', ["Mine, gps", "there is no 'noise_density'"]),
        (OWN, "", ["holds no card"]),
        (OWN, "Mine = 3", ["Mine: is not a table"]),
        (OWN, "[", ["is not TOML"]),
        (OWN, OWN + OWN.replace("Mine", "Other"), ["holds 2 cards (Mine, Other)"]),
    ],
)
def test_what_is_wrong_in_an_own_card_is_named(old: str, new: str, words: list[str], tmp_path: Path) -> None:
    assert OWN.count(old) >= 1
    path = _write(tmp_path, OWN.replace(old, new))
    with pytest.raises(SettingError) as error:
        cards.card(path)
    assert str(path) in str(error.value)
    for word in words:
        assert word in str(error.value)


def test_what_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(SettingError, match=r"nowhere\.toml: cannot be read"):
        cards.card(tmp_path / "nowhere.toml")
    with pytest.raises(SettingError, match="too large; accepted are TOML files up to 1 MB"):
        cards.card(_write(tmp_path, "#" * (MAX_BYTES + 1)))
    (tmp_path / "mine.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(SettingError, match="is not TOML"):
        cards.card(tmp_path / "mine.toml")


def test_an_unknown_name_is_answered_with_those_there_are() -> None:
    with pytest.raises(SettingError, match=r"Did you mean ADIS16470\? Accepted: .*STIM300"):
        cards.card("ADIS1647")


def test_every_unit_accepted_has_a_factor_and_is_of_one_kind() -> None:
    accepted = [unit for kind in ALIKE for unit in kind]
    assert set(accepted) <= set(TO_SI)
    assert len(accepted) == len(set(accepted))


def test_a_card_says_of_each_density_per_root_hertz_which_convention_it_has() -> None:
    for card in cards.cards().values():
        for triad in cards.TRIADS:
            found = card.datum(triad, "noise_density")
            assert found is not None
            if found.unit.endswith("/√Hz"):
                assert found.density in (ONE_SIDED, TWO_SIDED), (card.name, triad)
            else:
                assert found.density == ""


@pytest.mark.parametrize(
    ("name", "triad", "term", "texts"),
    [
        ("ADIS16488", "gyro", "flicker", (6.25, 6.5)),  # °/h
        ("ISM330DHCX", "gyro", "noise_density", (4e-3 / 2**0.5, 7.1e-3 / 2**0.5)),  # one-sided °/s/√Hz
        ("Xsens MTi-3", "gyro", "flicker", (2, 10)),  # °/h
        ("Xsens MTi-3", "accelerometer", "flicker", (0.015, 0.030)),  # mg
    ],
)
def test_no_assumed_number_is_beyond_what_the_texts_say(
    name: str, triad: str, term: str, texts: tuple[float, float]
) -> None:
    """The texts that the notes name: their numbers differ, and what is used lies between them."""
    value = np.mean(cards.card(name).value(triad, term))
    assert texts[0] <= value <= texts[1]
    assert cards.card(name).is_assumed(triad, term) is (texts[1] > 1.25 * texts[0])


def test_a_number_that_is_missing_is_assumed_and_kept_apart(tmp_path: Path) -> None:
    text = OWN.replace('grade = "own"', 'grade = "tactical"')
    card = cards.card(_write(tmp_path, text))
    assert list(card.terms) == ["gyro"]
    assert list(card.terms["gyro"]) == ["noise_density"]
    assert not card.is_assumed("gyro", "noise_density")
    assert card.is_assumed("gyro", "flicker")
    assert card.value("gyro", "flicker") == 0.65
    assert card.value("accelerometer", "bias_sigma") == 1.0
    assert cards.card(_write(tmp_path, OWN)).assumed == {}  # of an own grade nothing is known


@pytest.mark.parametrize("assumed", [True, False])
def test_what_is_assumed_stays_apart_in_a_file(assumed: bool, tmp_path: Path) -> None:
    """A card without what is assumed stays without it, though its grade would have something to assume."""
    card = cards.card("ICM-42688-P", assumed=assumed)
    text = card.to_toml()
    table = tomllib.loads(text)["ICM-42688-P"]
    assert "flicker" not in table["gyro"]
    assert ("flicker" in table["assumed"].get("gyro", {})) == assumed
    assert cards.card(_write(tmp_path, text)) == card


def test_own_assumptions_are_taken_as_they_are(tmp_path: Path) -> None:
    own = OWN.replace('grade = "own"', 'grade = "tactical"') + (
        '["Mine".assumed.gyro]\nflicker = { value = [1, 2, 3], unit = "°/h", source = "sheet" }\n'
    )
    card = cards.card(_write(tmp_path, own))
    assert card.value("gyro", "flicker") == [1.0, 2.0, 3.0]
    assert card.value("gyro", "bias_sigma") is None
    suite = SensorSuite().update(card.settings())
    assert suite.assumed_terms() == {"gyro": ["flicker"]}
    suite.set("gyro.flicker", (1.0, 2.0, 4.0))
    assert suite.assumed_terms() == {}


def test_no_part_lacks_a_bias_a_noise_or_a_scale_factor() -> None:
    """No error is absent because a sheet is silent; the classic experiment alone is as it was."""
    for name, card in cards.cards().items():
        for triad in cards.TRIADS if name != cards.CLASSIC else ():
            for term in ("noise_density", "bias_sigma", "flicker", "scale_factor_sigma", "misalignment"):
                value = card.value(triad, term)
                assert value is not None, (name, triad, term)
                assert np.all(np.array(value) > 0), (name, triad, term)


def test_a_card_gives_the_filter_states_for_the_errors_that_it_has() -> None:
    experiment = Experiment(mission="los_angeles")
    cards.card("STIM300").load(experiment)
    navigator = experiment.navigator
    assert navigator.states == 21
    assert navigator.estimate_misalignments
    assert navigator.estimate_g_sensitivity
    cards.card("HG9900").load(experiment)  # ring lasers feel no force
    assert navigator.estimate_misalignments
    assert not navigator.estimate_g_sensitivity
    cards.card(cards.CLASSIC).load(experiment)
    assert navigator.to_dict() == Experiment().navigator.to_dict()
    experiment.set("navigator.p0", [1.0] * 15)
    cards.card("STIM300").load(experiment)  # a given P0 is of as many states as it was given for
    assert navigator.states == 15
    assert not navigator.estimate_misalignments


def test_the_result_names_what_is_assumed_and_what_the_filter_has_no_state_for() -> None:
    experiment = Experiment(mission="los_angeles").update({"sensors": cards.card("LN-200S").settings()})
    remarks = " ".join(experiment.run().remarks)
    assert "Assumed" in remarks
    assert "gyro white noise, flicker, scale factor, misalignment; accelerometer flicker" in remarks
    assert "sensors.gyro.scale_factor_sigma" in remarks
    assert "navigator.states 21" in remarks
    experiment.set("navigator.states", 21)
    remarks = " ".join(experiment.run().remarks)
    assert "sensors.gyro.misalignment" in remarks
    assert "scale_factor_sigma" not in remarks
    cards.card("LN-200S", assumed=False).load(experiment)
    alignment, lacking = experiment.run().remarks
    assert alignment.startswith("An alignment of 30 s at rest")
    assert lacking.startswith("The card has no number for gyro")


def test_an_assumed_coefficient_of_temperature_is_no_fault_of_the_user() -> None:
    """Without a profile a coefficient does nothing; who set none is not told so."""
    suite = SensorSuite().update(cards.card("BMI088").settings())
    assert any(suite.gyro.bias_temperature)
    assert not any("temperature profile" in remark for remark in suite.remarks(21))
    suite.set("gyro.bias_temperature", 0.02)
    assert any("temperature profile" in remark for remark in suite.remarks(21))


@pytest.mark.parametrize(
    "text",
    [
        *("gyro.flicker", "gyro.flicker=x", "giro.flicker=1", "gyro.nothing=0", ",=|,."),
        *("gyro.name=1", "gyro.flicker=nan", "gyro.flicker=1e999|0|0", "gyro.bias_sigma=0.1|0.1", "param.=0"),
    ],
)
def test_any_text_may_stand_for_what_is_assumed(text: str) -> None:
    assert SensorSuite(assumed=text).assumed_remark() == ""
