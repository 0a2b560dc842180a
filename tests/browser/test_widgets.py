"""Fields of the settings panel: where a value is on its slider, how it is written and read, and refusals."""

from __future__ import annotations

from typing import Any

import param
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dashboards.exchange import query
from dashboards.widgets import NumberField, Scale, TextField, field, parsed, shown
from lab.experiment import Experiment
from lab.settings import AxisQuantity, Quantity, SettingError

LEAVES = {path: owner.param[name] for path, owner, name in Experiment().leaves()}
NUMBERS = {path: p for path, p in LEAVES.items() if isinstance(p, Quantity | AxisQuantity)}


@pytest.mark.parametrize("declaration", NUMBERS.values(), ids=NUMBERS)
def test_a_slider_spans_what_its_declaration_says(declaration: param.Parameter) -> None:
    scale = Scale(declaration)
    low, high = declaration.softbounds
    assert scale.value(scale.start) == pytest.approx(low, rel=1e-3, abs=1e-12)
    assert scale.value(scale.end) == pytest.approx(high, rel=1e-3)
    assert scale.start < scale.end
    assert (scale.end - scale.start) / scale.step >= 20


@given(st.floats(0.01, 100))
def test_a_scale_in_decades_goes_there_and_back(value: float) -> None:
    scale = Scale(LEAVES["navigator.r_scale"])
    assert scale.logarithmic
    assert scale.value(scale.position(value)) == pytest.approx(value, rel=0.005)


def test_one_is_exactly_one() -> None:
    scale = Scale(LEAVES["navigator.q_scale"])
    assert scale.value(scale.position(1.0)) == 1.0


@pytest.mark.parametrize("path", LEAVES)
def test_what_is_shown_reads_back(path: str) -> None:
    asked: list[Any] = []
    declaration = LEAVES[path]
    made = field(declaration, lambda value: asked.append(value) or True)
    made.show(declaration.default)
    if isinstance(made, TextField):
        text = shown(declaration.default)
        assert parsed(declaration, text) == (declaration.default or parsed(declaration, ""))
    assert asked == []


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0.02", (0.02,) * 3),
        ("0,02", (0.02,) * 3),
        ("1, 2, 3", (1, 2, 3)),
        ("1,2,3", (1, 2, 3)),
        ("1 2 3", (1, 2, 3)),
        ("1e-3", (0.001,) * 3),
    ],
)
def test_numbers_as_people_write_them(text: str, value: tuple[float, ...]) -> None:
    asked: list[Any] = []
    made = field(LEAVES["sensors.gyro.noise_density"], lambda value: asked.append(value) or True)
    assert isinstance(made, NumberField)
    made._box.value = text
    assert asked == [value]


@pytest.mark.parametrize("text", ["fast", "-1", "1, 2", "nan", "", "1e9", "inf"])
def test_what_is_refused_leaves_the_old_value(text: str) -> None:
    experiment = Experiment()
    messages: list[str] = []

    def change(value: Any) -> bool:
        try:
            experiment.set("sensors.gyro.noise_density", value)
        except SettingError as error:
            messages.append(str(error))
            return False
        return True

    made = field(LEAVES["sensors.gyro.noise_density"], change)
    assert isinstance(made, NumberField)
    made._box.value = text
    assert made._box.value == "0.05"
    assert "sensors.gyro.noise_density" in messages[0]
    assert "from 0 to 10 °/s/√Hz" in messages[0]


@pytest.mark.parametrize(
    ("text", "value"),
    [("60-75", [(60, 75)]), ("60–75, 120.5-130", [(60, 75), (120.5, 130)]), ("", [])],
)
def test_outages_as_people_write_them(text: str, value: list[tuple[float, float]]) -> None:
    assert parsed(LEAVES["sensors.gps.outages"], text) == value


def test_variances_as_people_write_them() -> None:
    declaration = LEAVES["navigator.r"]
    assert parsed(declaration, "") is None
    assert parsed(declaration, "1 1 1 0.5 0.5 0.5") == (1, 1, 1, 0.5, 0.5, 0.5)
    assert parsed(declaration, " ".join(["1"] * 36)) == ((1,) * 6,) * 6


def test_the_address_holds_what_differs_from_the_defaults() -> None:
    experiment = Experiment()
    assert query(experiment) == ""
    experiment.set("sensors.gyro.noise_density", 0.02)
    experiment.set("navigator.correction", "feedforward")
    text = query(experiment)
    assert "sensors.gyro.noise_density=0.02" in text
    assert "navigator.correction=feedforward" in text
    assert text.count("=") == 2
