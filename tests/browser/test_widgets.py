"""Fields of the settings panel: where a value is on its slider, how it is written and read, and refusals."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dashboards.covariance_field import CovarianceField
from dashboards.field_text import parse_field, shown
from dashboards.query import experiment_of_query, query
from dashboards.settings_panel import matched_variances
from dashboards.widgets import NumberField, Scale, TextField, field
from lab.base.parameters.setting_error import SettingError
from lab.base.parameters.setting_kinds import AxisQuantity, Quantity, requirement
from lab.experiment.experiment import Experiment

LEAVES = {path: owner.param[name] for path, owner, name in Experiment().leaves()}
NUMBERS = {path: p for path, p in LEAVES.items() if isinstance(p, Quantity | AxisQuantity)}


def test_a_slider_spans_what_its_declaration_says() -> None:
    for path, declaration in NUMBERS.items():
        scale = Scale(declaration)
        low, high = declaration.softbounds
        assert scale.value(scale.start) == pytest.approx(low, rel=1e-3, abs=1e-12), path
        assert scale.value(scale.end) == pytest.approx(high, rel=1e-3), path
        assert scale.start < scale.end, path
        assert (scale.end - scale.start) / scale.step >= 20, path


@given(st.floats(0.01, 100))
def test_a_scale_in_decades_goes_there_and_back(value: float) -> None:
    scale = Scale(LEAVES["navigator.r_scale"])
    assert scale.logarithmic
    assert scale.value(scale.position(value)) == pytest.approx(value, rel=0.005)


@pytest.mark.parametrize("position", [10**15, -(10**15), 1e308, -1e308])
def test_a_position_beyond_the_slider_is_at_its_end(position: float) -> None:
    """Such as a message made by hand has it: ten to the power of a large whole number is never computed."""
    for path, declaration in NUMBERS.items():
        scale = Scale(declaration)
        assert scale.value(position) == scale.value(scale.end if position > 0 else scale.start), path


@pytest.mark.parametrize("path", ["sensors.gyro.noise_density", "sensors.gps.period", "navigator.r_scale"])
def test_a_slider_that_was_moved_stays_where_it_is(path: str) -> None:
    """The browser may have moved it on meanwhile: a rounded position, sent back, would undo that."""
    made = field(NUMBERS[path], lambda _value: True)
    assert isinstance(made, NumberField)
    scale = Scale(NUMBERS[path])
    moved = scale.start + 0.7891 * (scale.end - scale.start)
    made._slider.value = moved
    assert made._slider.value == moved
    (value, *_) = made.value if isinstance(made.value, tuple) else (made.value,)
    assert value == scale.value(moved)
    made.show(NUMBERS[path].default)
    assert made._slider.value != moved


def test_a_slider_whose_value_is_refused_goes_back() -> None:
    def refuse(_value: Any) -> None:
        raise SettingError("not now")

    made = field(LEAVES["navigator.r_scale"], refuse)
    assert isinstance(made, NumberField)
    before = made._slider.value
    made._slider.value = before + 0.3
    assert made._slider.value == before


def test_the_axes_of_a_number_have_a_slider_each() -> None:
    asked: list[Any] = []
    made = field(LEAVES["sensors.gyro.noise_density"], asked.append)
    assert isinstance(made, NumberField)
    toggle = made.view[2]
    toggle.value = True
    assert [(slider.label, slider.visible) for slider in made._axis_sliders] == [
        (axis, True) for axis in ("x", "y", "z")
    ]
    made._axis_sliders[1].value = 0.3
    assert asked == [(0.05, 0.3, 0.05)]
    toggle.value = False
    assert not made._axis_sliders[1].visible


def test_one_is_exactly_one() -> None:
    scale = Scale(LEAVES["navigator.q_scale"])
    assert scale.value(scale.position(1.0)) == 1.0


def test_what_is_shown_reads_back() -> None:
    asked: list[Any] = []
    for path, declaration in LEAVES.items():
        made = field(declaration, lambda value: asked.append(value) or True)
        made.show(declaration.default)
        if isinstance(made, TextField):
            text = shown(declaration.default)
            assert parse_field(declaration, text) == (declaration.default or parse_field(declaration, "")), (
                path
            )
        assert asked == [], path


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


BETWEEN = "White noise must be between 0 and 10 °/s/√Hz."
COUNT = "White noise needs one number, or 3: x, y, z."


@pytest.mark.parametrize(
    ("text", "sentence"),
    [*((text, BETWEEN) for text in ("fast", "-1", "nan", "1e9", "inf")), ("1, 2", COUNT), ("", COUNT)],
)
def test_what_is_refused_leaves_the_old_value_and_is_answered_below_the_field(
    text: str, sentence: str
) -> None:
    experiment = Experiment()
    path = "sensors.gyro.noise_density"
    made = field(LEAVES[path], lambda value: experiment.set(path, value))
    assert isinstance(made, NumberField)
    made._box.value = text
    assert made._box.value == "0.05"
    assert made._complaint is not None
    assert f">{sentence}<" in made._complaint.object
    made._box.value = "0.06"
    assert experiment.get(path) == (0.06,) * 3
    assert not made._complaint.visible


@pytest.mark.parametrize(
    ("path", "sentence"),
    [
        ("navigator.q_scale", "Q scale must be between 0.000001 and 1,000,000."),
        ("seed", "Seed must be a whole number between 0 and 4,294,967,295."),
        ("sensors.gps.outages", "Outages must be intervals of time in seconds, such as 60–75, 120–130."),
        ("navigator.latency", "Latency the filter assumes must be between -60 and 60 s, or matched."),
        ("navigator.robust", "Robust update must be one of none, huber, student-t."),
    ],
)
def test_a_refused_value_is_answered_with_the_name_and_the_limits_of_the_field(
    path: str, sentence: str
) -> None:
    assert requirement(LEAVES[path], "wrong") == sentence


def test_settings_of_a_link_that_are_wrong_are_ignored_in_plain_words() -> None:
    taken, problems = experiment_of_query("foo.bar=1&navigator.r_scale=-3&seed=7")
    assert problems == [
        "The link has an unknown setting, foo.bar; it was ignored.",
        "navigator.r_scale must be between 0.000001 and 1,000,000. The link has -3, which was ignored.",
    ]
    assert taken.seed == 7


@pytest.mark.parametrize(
    ("text", "value"),
    [("60-75", [(60, 75)]), ("60–75, 120.5-130", [(60, 75), (120.5, 130)]), ("", [])],
)
def test_outages_as_people_write_them(text: str, value: list[tuple[float, float]]) -> None:
    assert parse_field(LEAVES["sensors.gps.outages"], text) == value


def test_variances_as_people_write_them() -> None:
    declaration = LEAVES["navigator.r"]
    assert parse_field(declaration, "") is None
    assert parse_field(declaration, "1 1 1 0.5 0.5 0.5") == (1, 1, 1, 0.5, 0.5, 0.5)
    assert parse_field(declaration, " ".join(["1"] * 36)) == ((1,) * 6,) * 6


def test_the_address_holds_what_differs_from_the_defaults() -> None:
    experiment = Experiment()
    assert query(experiment) == ""
    experiment.set("sensors.gyro.noise_density", 0.02)
    experiment.set("navigator.correction", "feedforward")
    text = query(experiment)
    assert "sensors.gyro.noise_density=0.02" in text
    assert "navigator.correction=feedforward" in text
    assert text.count("=") == 2


def unfolded(path: str, experiment: Experiment) -> tuple[CovarianceField, list[Any]]:
    """Return the field of a covariance, unfolded, that changes an experiment, and its σ boxes."""
    name = path.rpartition(".")[2]

    made = CovarianceField(
        LEAVES[path],
        lambda value: experiment.set(path, value),
        lambda: matched_variances(experiment, name),
    )
    arrived: list[str] = []
    made.view[1].param.watch(lambda event: arrived.extend(box.value for box in event.new), "objects")
    toggle = made.view[0][2]
    toggle.value = True
    boxes = list(made.view[1])
    assert arrived == [box.value for box in boxes]  # a browser drops a value that comes with its box
    return made, boxes


def test_matched_sigmas_are_shown_in_readable_units() -> None:
    experiment = Experiment()
    field, boxes = unfolded("navigator.p0", experiment)
    shown = [box for box in boxes if box.visible]
    assert [box.label for box in shown][::3] == [
        "position north [m]",
        "velocity north [m/s]",
        "attitude north [°]",
        "gyro bias x [°/s]",
        "accelerometer bias x [mg]",
    ]
    assert [float(box.value) for box in shown] == [1, 1, 1, 0.3, 0.3, 0.3, 0.5, 0.5, 2, *[0.1] * 3, *[2] * 3]
    experiment.set("navigator.states", 21)
    field.refresh()
    assert [box.label for box in boxes if box.visible][15::3] == [
        "gyro scale x [%]",
        "accelerometer scale x [%]",
    ]
    _, boxes = unfolded("navigator.q", Experiment())
    assert [float(box.value) for box in boxes[:6]] == [0.05, 0.05, 0.05, 35, 65, 35]
    _, boxes = unfolded("navigator.r", Experiment())
    assert float(boxes[0].value) == pytest.approx(0.5**0.5, rel=1e-3)


def test_one_sigma_is_given_and_the_others_stay_as_they_were_matched() -> None:
    experiment = Experiment()
    _, boxes = unfolded("navigator.r", experiment)
    boxes[2].value = "3"
    assert experiment.get("navigator.r") == pytest.approx((0.5, 0.5, 9, 0.2, 0.2, 0.2))


@pytest.mark.parametrize("text", ["-1", "none", "inf"])
def test_a_sigma_that_is_none_is_refused_and_the_old_one_shown_again(text: str) -> None:
    experiment = Experiment()
    made, boxes = unfolded("navigator.r", experiment)
    before = boxes[0].value
    boxes[0].value = text
    assert experiment.get("navigator.r") is None
    assert boxes[0].value == before
    assert made._widget.helper_text.startswith("R must be 6 variances, or a symmetric")


def test_a_whole_matrix_keeps_its_correlations() -> None:
    experiment = Experiment()
    matrix = [[float(i == j) for j in range(6)] for i in range(6)]
    matrix[0][1] = matrix[1][0] = 0.5
    experiment.set("navigator.r", matrix)
    made, boxes = unfolded("navigator.r", experiment)
    made.show(experiment.get("navigator.r"))
    boxes[0].value = "2"
    given = experiment.get("navigator.r")
    assert given[0][:2] == (4.0, 0.5)
    boxes[0].value = "0.1"
    assert experiment.get("navigator.r") == given
