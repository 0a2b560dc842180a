"""Settings: what is accepted, what is refused and with which words, and the way through TOML and back."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable
from typing import Any

import numpy as np
import param
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.base.parameters.setting_error import SettingError
from lab.base.parameters.setting_kinds import (
    AxisQuantity,
    Intervals,
    MatrixOrNone,
    Quantity,
    QuantityOrNone,
    describe,
)
from lab.base.parameters.settings import Settings, group
from lab.base.parameters.toml_file import toml_text
from lab.experiment.experiment import Experiment


class Engine(Settings):
    """A group, as a test subject."""

    power = Quantity(100.0, unit="kW", bounds=(0, 150), doc="Shaft power.")
    cylinders = param.Integer(default=4, bounds=(1, 12))
    fuel = param.Selector(default="avgas", objects=["avgas", "diesel"])


class Aircraft(Settings):
    """Groups and parameters of every kind."""

    name_of_type = param.String(default="C172")
    retractable = param.Boolean(default=False)
    engine = group(Engine, "Engine.")
    arm = AxisQuantity((0.1, 0.2, 0.3), unit="m", bounds=(-5, 5))
    flights = Intervals(default=[])
    inertia = MatrixOrNone(size=2)
    variances = MatrixOrNone(size=2, diagonal_only=True)


@pytest.fixture
def aircraft() -> Aircraft:
    return Aircraft()


@pytest.mark.parametrize("value", [0, 150, 12.5, np.float32(3), np.int64(7)])
def test_a_quantity_takes_any_real_number_within_its_bounds(aircraft: Aircraft, value: Any) -> None:
    aircraft.set("engine.power", value)
    assert aircraft.engine.power == value
    assert type(aircraft.to_dict()["engine"]["power"]) in {int, float}


@pytest.mark.parametrize("value", [-0.001, 150.001, math.nan, math.inf, True, "ten", None, [1], 1j, 10**400])
def test_a_quantity_refuses_the_rest_and_says_what_it_takes(aircraft: Aircraft, value: Any) -> None:
    reason = r" \(true and false are not numbers\)" if value is True else ""
    words = rf"engine\.power = .*accepted is a number from 0 to 150 kW\.{reason}$"
    with pytest.raises(SettingError, match=words):
        aircraft.set("engine.power", value)
    assert aircraft.engine.power == 100.0


def test_one_number_sets_every_axis(aircraft: Aircraft) -> None:
    for value in (2, 2.0, np.float32(2), np.int16(2), [2, 2, 2], (2.0, 2.0, 2.0), np.full(3, 2.0)):
        aircraft.arm = value
        assert aircraft.arm == (2.0, 2.0, 2.0)
        assert all(type(number) is float for number in aircraft.arm)


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ([1, 2], r"needs one number, or 3 \(x, y, z\)"),
        ([1, 2, 6], "z: 6 is not from -5 to 5 m"),
        (-7, "x: -7 is not from -5 to 5 m"),
        ([1, math.nan, 2], "y: nan is not a finite number"),
        ([1, True, 2], "y: True is not a finite number"),
        (10**400, "x: 10+ is not a finite number"),
        ("abc", "got 'abc'"),
        (None, "got None"),
        ({"x": 1}, "got {'x': 1}"),
        (np.ones((3, 3)), "not a finite number"),
    ],
)
def test_axes_refuse_with_the_axis_and_the_reason(aircraft: Aircraft, value: Any, reason: str) -> None:
    with pytest.raises(SettingError, match=reason):
        aircraft.set("arm", value)
    with pytest.raises(ValueError, match=reason):
        aircraft.arm = value
    assert aircraft.arm == (0.1, 0.2, 0.3)


def test_intervals_are_pairs_of_times(aircraft: Aircraft) -> None:
    aircraft.set("flights", [[0, 1.5], (2, 3)])
    assert aircraft.flights == [(0, 1.5), (2, 3)]


@pytest.mark.parametrize(
    "value",
    [5, [1, 2], [[2, 1]], [[-1, 1]], [[1, 1]], [[1]], [[1, math.inf]], [["a", "b"]], ["ab"], [[False, 1]]],
)
def test_intervals_refuse_what_is_not_a_span_of_time(aircraft: Aircraft, value: Any) -> None:
    with pytest.raises(SettingError, match=r"flights = .*accepted is a list of \[start, end\] pairs"):
        aircraft.set("flights", value)
    assert aircraft.flights == []


def test_a_covariance_is_unset_a_diagonal_or_a_matrix(aircraft: Aircraft) -> None:
    assert aircraft.inertia is None
    aircraft.inertia = [4, 9]
    assert aircraft.inertia == (4.0, 9.0)
    aircraft.inertia = np.array([[4, 5.9], [5.9, 9]])
    assert aircraft.inertia == ((4.0, 5.9), (5.9, 9.0))
    aircraft.inertia = None
    assert aircraft.inertia is None


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ([1, 2, 3], "has shape"),
        (3, "has shape"),
        ([[1, 2], [3]], "rows of different lengths"),
        (["1", "2"], "not numbers"),
        ([True, False], "not numbers"),
        ([1, math.nan], "not finite"),
        ([1, -1], "negative variance at row 2"),
        ([[1, 0.5], [0.4, 1]], "not symmetric"),
        ([[4, 6.1], [6.1, 9]], "not positive semidefinite"),
    ],
)
def test_what_is_no_covariance_is_refused(aircraft: Aircraft, value: Any, reason: str) -> None:
    with pytest.raises(SettingError, match=reason):
        aircraft.set("inertia", value)
    assert aircraft.inertia is None


def test_a_diagonal_takes_a_matrix_only_without_off_diagonal_elements(aircraft: Aircraft) -> None:
    aircraft.variances = [[1, 0], [0, 2]]
    with pytest.raises(ValueError, match="off-diagonal"):
        aircraft.variances = [[1, 0.1], [0.1, 2]]


@given(st.integers(0, 2**32 - 1), st.integers(-8, 8))
def test_every_gram_matrix_is_a_covariance_whatever_its_units(seed: int, exponent: int) -> None:
    # B Bᵀ is positive semidefinite for any B, of full rank or not; the units stretch rows and columns.
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(6, rng.integers(1, 7))) * 10.0 ** (exponent * rng.random((6, 1)))
    parameter = MatrixOrNone(size=6)
    parameter._check(factor @ factor.T)


def test_paths_reach_settings_and_groups(aircraft: Aircraft) -> None:
    aircraft.set("engine", {"power": 80, "fuel": "diesel"})
    assert aircraft.get("engine.power") == 80
    assert aircraft.get("engine") is aircraft.engine
    paths = [path for path, _, _ in aircraft.leaves()]
    assert paths[:4] == ["name_of_type", "retractable", "engine.power", "engine.cylinders"]
    assert len(paths) == len(set(paths)) == 9


@pytest.mark.parametrize(
    ("path", "words"),
    [
        (
            "engine.pwoer",
            r"engine\.pwoer: there is no setting 'pwoer' in engine\. Did you mean engine\.power\?",
        ),
        ("engin.power", r"no setting 'engin' at the top level\. Did you mean engine\?"),
        ("power", r"no setting 'power' at the top level\. Did you mean engine\.power\?"),
        ("type", r"Did you mean name_of_type\?"),
        ("wing", r"Accepted: name_of_type, retractable, engine, arm, flights, inertia, variances"),
        ("engine.power.x", r"engine\.power is a single setting"),
        ("", r"no setting ''"),
        ("name", r"no setting 'name'"),
    ],
)
def test_an_unknown_path_is_answered_with_the_known_ones(aircraft: Aircraft, path: str, words: str) -> None:
    with pytest.raises(SettingError, match=words):
        aircraft.set(path, 1)
    with pytest.raises(SettingError, match=words):
        aircraft.get(path)


def test_a_misspelt_attribute_is_refused(aircraft: Aircraft) -> None:
    with pytest.raises(SettingError, match=r"Did you mean power\?"):
        aircraft.engine.powr = 3


def test_a_group_is_not_a_value(aircraft: Aircraft) -> None:
    with pytest.raises(SettingError, match=r"engine: is a group of settings \(power, cylinders, fuel\)"):
        aircraft.set("engine", 3)


def test_the_groups_of_two_instances_are_apart(aircraft: Aircraft) -> None:
    aircraft.engine.power = 1
    assert Aircraft().engine.power == 100.0


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("engine.power=80", 80),
        (" engine.power = 8e1 ", 80.0),
        ("engine.fuel=diesel", "diesel"),
        ("engine.fuel='diesel'", "diesel"),
        ("engine.cylinders=6.0", 6),
        ("arm=[1, 2, 3]", (1.0, 2.0, 3.0)),
        ("flights=[[1, 2], [3, 4]]", [(1, 2), (3, 4)]),
        ("inertia=[1, 2]", (1.0, 2.0)),
        ("retractable=true", True),
        ("retractable=True", True),
        ("retractable=False", False),
        ("name_of_type=True", "True"),
        ("name_of_type=172", "172"),
        ("name_of_type=2026-01-01", "2026-01-01"),
        ("name_of_type=a=b", "a=b"),
    ],
)
def test_text_is_read_by_declaration_and_strings_need_no_quotes(
    aircraft: Aircraft, text: str, value: Any
) -> None:
    aircraft.set_texts([text])
    assert aircraft.get(text.partition("=")[0].strip()) == value


@pytest.mark.parametrize(
    "text", ["engine.power", "=3", "", "engine.power=", "engine.cylinders=1.5", "engine.power=true"]
)
def test_text_that_sets_nothing_is_refused(aircraft: Aircraft, text: str) -> None:
    with pytest.raises(SettingError):
        aircraft.set_texts([text])
    assert aircraft.to_dict() == Aircraft().to_dict()


def test_an_update_is_all_or_nothing(aircraft: Aircraft) -> None:
    for bad in ({"engine": {"power": 80, "fuel": "coal"}}, {"arm": 1, "engine": {"oil": 1}}):
        with pytest.raises(SettingError):
            aircraft.update(bad)
        assert aircraft.to_dict() == Aircraft().to_dict()
    assert aircraft.update({"arm": 1, "engine": {"power": 80}}) is aircraft
    assert aircraft.get("engine.power") == 80
    assert aircraft.get("engine.cylinders") == 4


def test_an_update_tells_watchers_only_what_changed(aircraft: Aircraft) -> None:
    told: list[str] = []
    aircraft.engine.param.watch(lambda event: told.append(event.name), ["power", "cylinders", "fuel"])
    aircraft.update({"engine": {"power": 80, "cylinders": 4}})
    assert told == ["power"]


def test_a_copy_is_equal_and_independent(aircraft: Aircraft) -> None:
    aircraft.update({"arm": 1, "engine": {"power": 80}, "inertia": [1, 2], "flights": [[1, 2]]})
    twin = aircraft.copy()
    assert twin.to_dict() == aircraft.to_dict()
    twin.set("engine.power", 3)
    twin.flights.append((3, 4))
    assert aircraft.engine.power == 80
    assert aircraft.flights == [(1, 2)]


def test_what_is_given_at_construction_passes_the_same_checks() -> None:
    assert Aircraft(engine={"power": 80}, arm=2).get("engine.power") == 80
    with pytest.raises(SettingError, match=r"engine\.power = 200"):
        Aircraft(engine={"power": 200})
    with pytest.raises(SettingError, match="no setting 'wing'"):
        Aircraft(wing=1)


def test_descriptions_are_words_for_people() -> None:
    words = {path: describe(owner.param[name]) for path, owner, name in Aircraft().leaves()}
    assert words == {
        "name_of_type": "text",
        "retractable": "true or false",
        "engine.power": "a number from 0 to 150 kW",
        "engine.cylinders": "a whole number from 1 to 12",
        "engine.fuel": "one of avgas, diesel",
        "arm": "one number, or 3 (x, y, z), each from -5 to 5 m",
        "flights": "a list of [start, end] pairs in seconds, such as [[60, 75]]",
        "inertia": "2 variances, or a symmetric positive semidefinite 2 × 2 matrix",
        "variances": "2 variances",
    }


def _components(parameter: AxisQuantity) -> st.SearchStrategy[Any]:
    component = st.floats(*parameter.bounds)
    return component | st.lists(component, min_size=len(parameter.axes), max_size=len(parameter.axes))


def _spans() -> st.SearchStrategy[Any]:
    span = st.tuples(st.floats(0, 1e4), st.floats(0, 1e4)).map(sorted).filter(lambda pair: pair[0] < pair[1])
    return st.lists(span, max_size=3)


VALUES: dict[type, Callable[[Any], st.SearchStrategy[Any]]] = {
    param.Boolean: lambda p: st.booleans(),
    param.Selector: lambda p: st.sampled_from(list(p.objects)),
    param.String: lambda p: st.text(max_size=20),
    param.Integer: lambda p: st.integers(*p.bounds),
    Intervals: lambda p: _spans(),
    Quantity: lambda p: st.floats(*p.bounds),
    AxisQuantity: _components,
    QuantityOrNone: lambda p: st.none() | (_components(p) if p.axes else st.floats(*p.bounds)),
    MatrixOrNone: lambda p: (
        st.none()
        | st.sampled_from(p.sizes).flatmap(lambda n: st.lists(st.floats(0, 1e6), min_size=n, max_size=n))
    ),
}


@pytest.mark.proof
@given(st.data())
def test_any_experiment_comes_back_from_toml_as_it_was(data: st.DataObject) -> None:
    experiment = Experiment()
    leaves = list(experiment.leaves())
    for path, owner, name in data.draw(st.lists(st.sampled_from(leaves), max_size=8)):
        experiment.set(path, data.draw(VALUES[type(owner.param[name])](owner.param[name])))
    text = toml_text(experiment.to_dict())
    again = Experiment().update(tomllib.loads(text))
    assert again.to_dict() == experiment.to_dict()
    assert [getattr(owner, name) for _, owner, name in again.leaves()] == [
        getattr(owner, name) for _, owner, name in experiment.leaves()
    ]


def test_every_setting_of_an_experiment_is_documented_and_labelled() -> None:
    for path, owner, name in Experiment().leaves():
        parameter = owner.param[name]
        assert parameter.doc, path
        assert parameter.label, path
        assert describe(parameter) != parameter.doc, f"{path}: no words for {type(parameter).__name__}"


@given(st.text(max_size=40))
def test_no_assignment_whatsoever_raises_anything_but_a_setting_error(text: str) -> None:
    for prefix in ("", "engine.power=", "arm=", "flights=", "inertia=", "engine."):
        try:
            Aircraft().set_texts([prefix + text])
        except SettingError as error:
            assert str(error)


def test_settings_show_value_unit_and_meaning_in_jupyter(aircraft: Aircraft) -> None:
    aircraft.update({"engine": {"power": 80}, "arm": 2, "name_of_type": "<b>"})
    page = aircraft._repr_html_().replace("<wbr>", "")  # the words as they are read
    for words in ("engine.power", "80 kW", "Shaft power.", "2 m", "&lt;b&gt;"):
        assert words in page
    assert "<b>" not in page
