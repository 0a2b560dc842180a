"""Flight plans: a table of a TOML file becomes a plan, or the reason why not."""

from __future__ import annotations

import copy
import dataclasses
import math
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.base.parameters.toml_file import toml_text
from lab.flying.aircraft import AIRCRAFT
from lab.flying.flight_plan import AirStart, Runway
from lab.flying.manoeuvres import MANOEUVRES, Climb, Descend, Hold, TakeOff, Turn
from lab.flying.motion_commands import MotionCommand, MotionPlan, MotionStart
from lab.flying.plan_table import entries
from lab.flying.waypoints import Waypoint, WaypointPlan
from lab.flying.weather import Air, Gust
from lab.missions import FlightPlan, MissionError

PLAN = {
    "duration_s": 60,
    "seed": 3,
    "runway": {"latitude_deg": -33.9, "longitude_deg": 18.6, "height_m": 75, "heading_deg": 194},
    "air": {"wind_from_deg": 180, "wind_m_s": 2.5, "turbulence_severity": 1, "turbulence_wind_m_s": 3},
    "manoeuvres": [
        {"do": "take_off", "height_m": 25},
        {"do": "climb", "height_m": 200, "seconds": 10},
        {"do": "turn", "heading_deg": 90, "bank_deg": 30, "direction": "left"},
        {"do": "hold", "seconds": 5},
        {"do": "descend", "height_m": 150},
    ],
}


def changed(*keys: str | int, to: object) -> dict:
    plan = copy.deepcopy(PLAN)
    table = plan
    for key in keys[:-1]:
        table = table[key]
    table[keys[-1]] = to
    return plan


def test_a_plan_in_full():
    plan = FlightPlan.from_dict(PLAN)
    assert (plan.duration_s, plan.seed, plan.aircraft) == (60.0, 3, "c172p")
    assert (plan.runway.latitude_deg, plan.runway.heading_deg) == (-33.9, 194.0)
    assert (plan.air.wind_m_s, plan.air.turbulence_severity) == (2.5, 1)
    assert plan.manoeuvres == (
        TakeOff(height_m=25.0),
        Climb(200.0, seconds=10.0),
        Turn(90.0, 30.0, "left"),
        Hold(5.0),
        Descend(150.0),
    )
    assert math.isinf(plan.manoeuvres[4].seconds)


def test_air_and_seed_may_be_left_out():
    plan = FlightPlan.from_dict({key: PLAN[key] for key in ("duration_s", "runway", "manoeuvres")})
    assert plan.air.wind_m_s == 0
    assert plan.air.turbulence_severity == 0


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        (changed("duration", to=3), r"flight: there is no key 'duration'. Did you mean duration_s\?"),
        (changed("duration_s", to="long"), "duration_s = 'long'; accepted is a number from 1 to 14400"),
        (changed("duration_s", to=True), "duration_s = True; accepted is a number"),
        (changed("duration_s", to=math.nan), "duration_s = nan; accepted is a number"),
        (changed("seed", to=1.5), "seed = 1.5; accepted is a whole number"),
        (changed("seed", to=-1), "seed = -1; accepted is a whole number from 0"),
        (changed("aircraft", to="b747"), "aircraft = 'b747'; accepted: c172p"),
        (changed("runway", to=7), "flight.runway: expected a table"),
        (
            changed("runway", "latitude_deg", to=91),
            "flight.runway: latitude_deg = 91; accepted is a number from -85 to 85",
        ),
        (changed("air", "wind_m_s", to=40), "flight.air: wind_m_s = 40; accepted is a number from 0 to 25"),
        (changed("manoeuvres", to=[]), "flight.manoeuvres: expected a list"),
        (changed("manoeuvres", to="up"), "flight.manoeuvres: expected a list"),
        (changed("manoeuvres", 2, to="turn"), "number 3: do = 'turn' is not a manoeuvre"),
        (
            changed("manoeuvres", 2, "do", to="loop"),
            "number 3: do = 'loop' is not a manoeuvre; accepted: take_off, climb",
        ),
        (changed("manoeuvres", 2, "do", to=["turn"]), "number 3: do = .* is not a manoeuvre"),
        (
            changed("manoeuvres", 2, "bank_deg", to=80),
            "number 3: bank_deg = 80; accepted is a number from 5 to 40",
        ),
        (changed("manoeuvres", 2, "direction", to="up"), "direction = 'up'; accepted: shortest, left, right"),
        (changed("manoeuvres", 3, to={"do": "hold"}), "number 4: seconds is missing"),
        (
            changed("manoeuvres", 0, to={"do": "hold", "seconds": 1}),
            "number 1: hold; a flight from a runway begins with take_off",
        ),
        (changed("manoeuvres", 1, to={"do": "take_off"}), "number 2: take_off"),
        (changed("manoeuvres", 4, "height_m", to=250), "number 5: descend from 200 m to 250 m"),
    ],
)
def test_what_is_wrong_is_named_with_what_is_accepted(plan, message):
    with pytest.raises(MissionError, match=message):
        FlightPlan.from_dict(plan)


IN_THE_AIR = {
    "aircraft": "T37",
    "duration_s": 60,
    "air_start": {
        "latitude_deg": 1,
        "longitude_deg": 2,
        "height_m": 500,
        "heading_deg": 3,
        "airspeed_m_s": 90,
    },
    "air": {"gusts": [{"time_s": 3, "speed_m_s": 5}], "temperature_deviation_k": -10},
    "manoeuvres": [
        {"do": "climb", "height_m": 900, "seconds": 20},
        {"do": "level"},
        {"do": "descend", "height_m": 400},
        {"do": "speed", "airspeed_m_s": 160},
        {"do": "turn_by", "angle_deg": 720, "direction": "left"},
        {"do": "s_turns", "turns": 3},
        {"do": "figure_eight", "skid_deg": -2},
    ],
}


@pytest.mark.parametrize("values", [PLAN, IN_THE_AIR])
def test_a_plan_as_plain_data_gives_the_plan_again(values):
    plan = FlightPlan.from_dict(values)
    assert FlightPlan.from_dict(plan.to_dict()) == plan
    assert FlightPlan.from_dict(tomllib.loads(toml_text(plan.to_dict()))) == plan


def without(values: dict, *keys: str) -> dict:
    return {key: value for key, value in values.items() if key not in keys}


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        (IN_THE_AIR | {"runway": PLAN["runway"]}, "runway and air_start are both given"),
        (
            without(IN_THE_AIR, "air_start") | {"manoeuvres": PLAN["manoeuvres"]},
            "runway is missing; accepted",
        ),
        (
            IN_THE_AIR | {"aircraft": "737"},
            "air_start: airspeed_m_s = 90; accepted is a number from 110 to 240",
        ),
        (
            IN_THE_AIR | {"manoeuvres": [{"do": "speed", "airspeed_m_s": 200}]},
            "number 1: airspeed_m_s = 200; accepted is a number from 75 to 170",
        ),
        (IN_THE_AIR | {"manoeuvres": [{"do": "take_off"}]}, "number 1: take_off; a flight from a runway"),
        (IN_THE_AIR | {"air": {"gusts": 3}}, r"air\.gusts: expected a list"),
        (IN_THE_AIR | {"air": {"gusts": [{}]}}, r"air\.gusts, number 1: time_s is missing"),
        (IN_THE_AIR | {"manoeuvres": [{"do": "descend", "height_m": 700}]}, "descend from 500 m to 700 m"),
    ],
)
def test_what_is_wrong_with_a_start_in_the_air_is_named(plan, message):
    with pytest.raises(MissionError, match=message):
        FlightPlan.from_dict(plan)


UNITS = {
    "deg": "°", "m": "m", "s": "s", "seconds": "s", "k": "K", "m_s": "m/s", "deg_s": "°/s", "m_s2": "m/s²",
    "deg_s2": "°/s²",
}  # fmt: skip
"""What the names of fields end with, and the unit that is shown."""


def unit_of(name: str) -> str:
    """Return the unit that the name of a field ends with; empty without one."""
    words = name.split("_")
    ends = ("_".join(words[first:]) for first in range(len(words)))
    return next((UNITS[end] for end in ends if end in UNITS), "")


@pytest.mark.parametrize(
    "kind",
    [
        *(FlightPlan, Runway, AirStart, Air, Gust, *MANOEUVRES.values()),
        *(Waypoint, WaypointPlan, MotionStart, MotionCommand, MotionPlan),
    ],
)
def test_every_entry_says_what_it_is(kind):
    assert kind.__doc__
    for field in dataclasses.fields(kind):
        if field.name not in {
            "manoeuvres",
            "runway",
            "air_start",
            "air",
            "gusts",
            "waypoints",
            "commands",
            "start",
        }:
            entry = entries(kind)[field.name]
            assert entry.label[0].isupper()
            # A command's angles and speeds have no unit in their names: its type decides what they are.
            assert entry.unit == unit_of(field.name) or kind is MotionCommand
            assert entry.doc.endswith(".")
            assert entry.choices or entry.limits[0] < entry.limits[1]
            if field.default not in {dataclasses.MISSING, None}:
                assert field.default in entry.choices or entry.limits[0] <= field.default <= entry.limits[1]


@pytest.mark.parametrize("aircraft", AIRCRAFT.values(), ids=AIRCRAFT)
def test_the_limits_of_an_aircraft_hold_what_it_does_by_itself(aircraft):
    for name, value in (("airspeed_m_s", aircraft.airspeed), ("rate_m_s", aircraft.rate)):
        low, high = aircraft.limits[name]
        assert low <= value <= high
    assert aircraft.stall_airspeed < aircraft.slowest < aircraft.limits["airspeed_m_s"][0]
    named = {name for kind in MANOEUVRES.values() for name in entries(kind)}
    assert aircraft.limits.keys() <= named


@pytest.mark.parametrize("key", ["duration_s", "runway", "manoeuvres"])
def test_what_is_missing_is_named(key):
    with pytest.raises(MissionError, match=f"{key} is missing"):
        FlightPlan.from_dict({name: value for name, value in PLAN.items() if name != key})


def test_another_seed():
    plan = FlightPlan.from_dict(PLAN)
    assert plan.with_seed(9).seed == 9
    assert plan.with_seed(9).with_seed(3) == plan
    with pytest.raises(MissionError, match="seed = -4"):
        plan.with_seed(-4)


TOML = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=4)
    | st.sampled_from(["turn", "hold"]),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["do", "seconds", "height_m", "runway", "manoeuvres", "x"]), inner, max_size=4
        )
    ),
    max_leaves=12,
)


@given(values=st.dictionaries(st.sampled_from([*PLAN, "aircraft", "other"]), TOML))
def test_anything_a_toml_file_may_hold_is_a_plan_or_an_error(values):
    try:
        FlightPlan.from_dict({**PLAN, **values})
    except MissionError as error:
        assert "flight" in str(error)
