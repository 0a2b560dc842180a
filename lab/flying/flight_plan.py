"""FlightPlan: where a flight starts, in what air, and its manoeuvres; and a plan of any kind, by its list.

Plans are plain data of a mission's TOML file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from lab.base.files.mission_error import MissionError
from lab.flying import airports
from lab.flying.aircraft import AIRCRAFT, Aircraft
from lab.flying.manoeuvres import (
    MANOEUVRES,
    MAX_DURATION,
    WORDS,
    ChangeHeight,
    Level,
    Manoeuvre,
    TakeOff,
)
from lab.flying.plan_table import (
    AIRSPEEDS,
    GROUNDS,
    HEIGHTS,
    LATITUDES,
    TURNS,
    accept,
    choice,
    number,
    plain_part,
    read_part,
    read_parts,
)
from lab.flying.weather import CALM, Air, Gust

if TYPE_CHECKING:
    from lab.flying.motion_commands import MotionPlan
    from lab.flying.waypoints import WaypointPlan

KINDS = ("manoeuvres", "waypoints", "commands")
"""The keys of lists, of which a plan has one."""
MAX_GUSTS = 1000
"""Most gusts in one plan."""


@dataclass(frozen=True)
class Runway:
    """Where the flight starts, at rest."""

    latitude_deg: float = number("Latitude", "°", LATITUDES, "Geodetic latitude on WGS-84.")
    longitude_deg: float = number("Longitude", "°", TURNS, "Longitude on WGS-84, east positive.")
    height_m: float = number(
        "Height", "m", GROUNDS, "Height of the ground above the ellipsoid (not above the sea)."
    )
    heading_deg: float = number("Heading", "°", TURNS, "True heading.")


@dataclass(frozen=True)
class AirStart:
    """Where the flight starts in the air: straight and level, trimmed, at full airspeed."""

    latitude_deg: float = number("Latitude", "°", LATITUDES, "Geodetic latitude on WGS-84.")
    longitude_deg: float = number("Longitude", "°", TURNS, "Longitude on WGS-84, east positive.")
    height_m: float = number("Height", "m", HEIGHTS, "Height above the ground.")
    heading_deg: float = number("Heading", "°", TURNS, "True heading.")
    airspeed_m_s: float | None = number("Airspeed", "m/s", AIRSPEEDS, "True airspeed.", default=None)
    ground_m: float = number("Ground", "m", GROUNDS, "Height of the ground above the ellipsoid.", default=0.0)


@dataclass(frozen=True)
class FlightPlan:
    """A flight as plain data.

    It starts on the runway or in the air, one of the two; on the runway, the first manoeuvre is a `TakeOff`.
    Heights of manoeuvres are above the ground at the start. Numbers that are None are the aircraft's own.
    """

    manoeuvres: tuple[Manoeuvre, ...]
    duration_s: float = number("Duration", "s", (1, MAX_DURATION), "Time from the start to the end.")
    runway: Runway | None = None
    air_start: AirStart | None = None
    air: Air = CALM
    seed: int = number("Seed", "", (0, 2**31 - 1), "Seed of the turbulence.", default=1, whole=True)
    aircraft: str = choice("Aircraft", tuple(AIRCRAFT), "JSBSim's name of the aircraft.", default="c172p")

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], where: str = "flight") -> FlightPlan:
        """Return the plan in a mapping, such as the ``[flight]`` table of a mission's TOML file.

        Parameters
        ----------
        values
            Keys as the attributes of `FlightPlan`; each manoeuvre has a key ``do``, one of `MANOEUVRES`. The
            runway may be the name of one, see `lab.flying.airports`.
        where
            Name of the mapping in messages.

        Raises
        ------
        MissionError
            If a key is unknown or missing, or a value is not accepted.
        """
        values = dict(values)
        aircraft = AIRCRAFT[accept(cls, "aircraft", values.get("aircraft", "c172p"), where)]
        parts: dict[str, Any] = {}
        if isinstance(values.get("runway"), str):
            values["runway"] = airports.runway(values["runway"], f"{where}.runway")
        for name, kind in (("runway", Runway), ("air_start", AirStart)):
            if name in values:
                limits = aircraft.limits if kind is AirStart else None
                parts[name] = read_part(kind, values.pop(name), f"{where}.{name}", limits=limits)
        if "air" in values:
            parts["air"] = _air(values.pop("air"), f"{where}.air")
        if "manoeuvres" in values:
            entries = values.pop("manoeuvres")
            parts["manoeuvres"] = _manoeuvres(entries, f"{where}.manoeuvres", aircraft, parts)
        plan = read_part(cls, values, where, parts)
        plan._check_start(where)
        return plan

    def to_dict(self) -> dict[str, Any]:
        """Return the plan as plain data without defaults; `from_dict` restores the plan."""
        values: dict[str, Any] = {"aircraft": self.aircraft, **plain_part(self)}
        for name, part in (("runway", self.runway), ("air_start", self.air_start)):
            if part is not None:
                values[name] = plain_part(part)
        air = plain_part(self.air)
        if self.air.gusts:
            air["gusts"] = [plain_part(gust) for gust in self.air.gusts]
        if air:
            values["air"] = air
        values["manoeuvres"] = [{"do": WORDS[type(one)], **plain_part(one)} for one in self.manoeuvres]
        return values

    @property
    def flown_with(self) -> Aircraft:
        """The aircraft as the pilot knows it."""
        return AIRCRAFT[self.aircraft]

    def with_seed(self, seed: int) -> FlightPlan:
        """Return the same plan with another seed.

        Raises
        ------
        MissionError
            If the seed is not accepted.
        """
        return replace(self, seed=accept(FlightPlan, "seed", seed, "flight"))

    def _check_start(self, where: str) -> None:
        if (self.runway is None) == (self.air_start is None):
            found = "is missing" if self.runway is None else "and air_start are both given"
            raise MissionError(f"{where}: runway {found}; accepted is one of runway and air_start")
        if self.runway is not None and self.flown_with.rotation is None:
            able = ", ".join(name for name, aircraft in AIRCRAFT.items() if aircraft.rotation is not None)
            raise MissionError(
                f"{where}: the pilot cannot take off with the {self.aircraft}; start it in the air "
                f"(air_start), or fly one of {able}"
            )


def _air(values: Any, where: str) -> Air:
    if not isinstance(values, Mapping) or "gusts" not in values:
        return read_part(Air, values, where)
    others = {key: value for key, value in values.items() if key != "gusts"}
    gusts = read_parts(Gust, values["gusts"], f"{where}.gusts", 0, MAX_GUSTS, "gusts")
    return read_part(Air, others, where, {"gusts": gusts})


def _manoeuvres(
    entries: Any, where: str, aircraft: Aircraft, start: Mapping[str, Any]
) -> tuple[Manoeuvre, ...]:
    if not isinstance(entries, Sequence) or isinstance(entries, str) or not entries:
        raise MissionError(f"{where}: expected a list of manoeuvres, each one of {', '.join(MANOEUVRES)}")
    manoeuvres: list[Manoeuvre] = []
    in_the_air = start.get("air_start")
    height: float | None = in_the_air.height_m if in_the_air else 0.0
    for number_, entry in enumerate(entries, 1):
        here = f"{where}, number {number_}"
        word = entry.get("do") if isinstance(entry, Mapping) else entry
        if not isinstance(entry, Mapping) or not isinstance(word, str) or word not in MANOEUVRES:
            raise MissionError(f"{here}: do = {word!r} is not a manoeuvre; accepted: {', '.join(MANOEUVRES)}")
        values = {key: value for key, value in entry.items() if key != "do"}
        kind = MANOEUVRES[word]
        # A take-off ends low; the limits of the aircraft are those of heights to climb to.
        limits = {k: v for k, v in aircraft.limits.items() if (k, kind) != ("height_m", TakeOff)}
        manoeuvre: Manoeuvre = read_part(kind, values, here, limits=limits)
        if (word == "take_off") != (number_ == 1 and not in_the_air):
            raise MissionError(
                f"{here}: {word}; a flight from a runway begins with take_off, and takes off once"
            )
        if (
            isinstance(manoeuvre, ChangeHeight)
            and height is not None
            and (manoeuvre.height_m > height) != (word == "climb")
        ):
            raise MissionError(
                f"{here}: {word} from {height:g} m to {manoeuvre.height_m:g} m is the wrong word"
            )
        # Where a climb is broken off, or levelled off, is only known when it is flown.
        height = None if isinstance(manoeuvre, Level) else getattr(manoeuvre, "height_m", height)
        manoeuvres.append(manoeuvre)
    return tuple(manoeuvres)


if TYPE_CHECKING:
    Plan = FlightPlan | WaypointPlan | MotionPlan


def read_plan(values: Mapping[str, Any], where: str = "flight") -> Plan:
    """Return the plan in a mapping, such as the ``[flight]`` table of a mission's TOML file.

    Raises
    ------
    MissionError
        If a key is unknown or missing, or a value is not accepted.
    """
    listed = [kind for kind in KINDS if kind in values]
    if len(listed) > 1:
        raise MissionError(f"{where}: has {' and '.join(listed)}; accepted is one of {', '.join(KINDS)}")
    if listed == ["waypoints"]:
        from lab.flying.waypoints import WaypointPlan  # noqa: PLC0415 - SciPy, for those who need it

        return WaypointPlan.from_dict(values, where)
    if listed == ["commands"]:
        from lab.flying.motion_commands import MotionPlan  # noqa: PLC0415 - SciPy, for those who need it

        return MotionPlan.from_dict(values, where)
    return FlightPlan.from_dict(values, where)
