"""Sheet unit: spellings of units, their factors and dimensions, and what is no unit."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.base.parameters.units import TO_SI
from lab.sensors.datum import ALIKE
from lab.sensors.sheet_unit import sheet_unit

DEGREE = math.pi / 180
G = 9.80665


@pytest.mark.parametrize(
    ("spellings", "factor"),
    [
        (
            ("mdps/√Hz", "mdps/sqrt(Hz)", "mdps/rtHz", "m°/s/√Hz", "mdeg/s/Hz^0.5", "mdps per sqrt(Hz)"),
            1e-3 * DEGREE,
        ),
        (("dps/√Hz", "deg/s/rt-Hz", "(°/s)/√Hz", "deg/(s·√Hz)", "degrees/s/Hz^(1/2)", "°/sec/√(Hz)"), DEGREE),
        (("°/√h", "deg/sqrt(hr)", "deg/rt(hr)", "°/√hr", "deg/h^0.5"), DEGREE / 60),
        (("µg/√Hz", "ug/sqrt(Hz)", "μg/rtHz", "ug/Hz^1/2"), 1e-6 * G),
        (("m/s/√h", "m/s/rt(hr)", "m/sec/√hr"), 1 / 60),
        (("°/h", "deg/hr", "deg/hour", "degrees per hour"), DEGREE / 3600),
        (("m/s²", "m/s^2", "m/s2", "m/s/s"), 1.0),
        (("mg", "mG"), 1e-3 * G),
        (("°/s/g", "dps/g", "deg/s/g"), DEGREE / G),
        (("ppm/°C", "ppm/K", "ppm/degC"), 1e-6),
        (("arcmin", "′"), DEGREE / 60),
        (("kHz",), 1e3),
        (("mrad/s",), 1e-3),
    ],
)
def test_spellings_of_a_unit_are_one(spellings: tuple[str, ...], factor: float) -> None:
    read = [sheet_unit(text) for text in spellings]
    assert [one.factor for one in read] == pytest.approx([factor] * len(read), rel=1e-12)
    assert len({one.dimension for one in read}) == 1


def test_units_of_cards_have_the_factor_of_the_one_table_and_one_dimension_a_kind() -> None:
    for kind in ALIKE:
        read = [sheet_unit(unit) for unit in kind]
        assert [one.factor for one in read] == pytest.approx([TO_SI[unit] for unit in kind], rel=1e-12)
        assert len({one.dimension for one in read}) == 1
    kinds = [sheet_unit(kind[0]).dimension for kind in ALIKE]
    assert len(set(kinds)) == len(kinds)


def test_a_density_per_root_hertz_is_told_from_a_random_walk() -> None:
    for text, density in (
        ("°/s/√Hz", True),
        ("ug/sqrt( Hz )", True),
        ("°/√h", False),
        ("m/s/√s", False),
        ("Hz", False),
    ):
        assert sheet_unit(text).per_root_hertz is density


@pytest.mark.parametrize(
    "text", ["", "furlong", "mg/", "((", "g^9", "/s", "dps)", "1/0", "s^1/0", "°/s/√", "x" * 61, "mLSB", "🙂"]
)
def test_what_is_no_unit_is_refused(text: str) -> None:
    with pytest.raises(ValueError) as error:
        sheet_unit(text)
    assert len(str(error.value)) > len("no unit")


@given(st.text(alphabet="°µ√/()^²½·*. mgudpsradhz%klb0123456789~-", max_size=60))
def test_any_text_is_a_unit_or_refused(text: str) -> None:
    try:
        unit = sheet_unit(text)
    except ValueError:
        return
    assert unit.factor > 0
