"""FlightPlan: where a flight starts, in what air, and its manoeuvres: plain data of a mission's TOML file."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, replace
from typing import Any, ClassVar, TypeVar, get_type_hints

from lab.missions.errors import MissionError

Part = TypeVar("Part")

MAX_DURATION = 3600.0
"""Longest flight [s]."""


@dataclass(frozen=True)
class Runway:
    """Where the flight starts, at rest.

    Attributes
    ----------
    latitude_deg, longitude_deg : float
        Geodetic position on WGS-84 [°].
    height_m : float
        Height of the ground above the ellipsoid (not above the sea) [m].
    heading_deg : float
        True heading [°].
    """

    latitude_deg: float
    longitude_deg: float
    height_m: float
    heading_deg: float

    LIMITS: ClassVar = {
        "latitude_deg": (-85, 85),
        "longitude_deg": (-360, 360),
        "height_m": (-500, 5000),
        "heading_deg": (-360, 360),
    }


@dataclass(frozen=True)
class Air:
    """The air the aeroplane flies in.

    Attributes
    ----------
    wind_from_deg : float
        True direction the wind comes from [°].
    wind_m_s : float
        Speed of the wind [m/s].
    turbulence_severity : int
        0 none, 1-2 light, 3-4 moderate, 5-7 severe (MIL-F-8785C probability of exceedance curves): decides
        the turbulence more than 600 m above the ground.
    turbulence_wind_m_s : float
        Wind 20 ft above the ground, which decides the turbulence less than 300 m above the ground [m/s].
    """

    wind_from_deg: float = 0.0
    wind_m_s: float = 0.0
    turbulence_severity: int = 0
    turbulence_wind_m_s: float = 0.0

    LIMITS: ClassVar = {
        "wind_from_deg": (-360, 360),
        "wind_m_s": (0, 12),
        "turbulence_severity": (0, 7),
        "turbulence_wind_m_s": (0, 25),
    }


@dataclass(frozen=True)
class TakeOff:
    """Wait at rest, take off straight ahead, climb; ends at a height above the runway.

    The climb goes on for 60 m more unless the next manoeuvres say otherwise.

    Attributes
    ----------
    wait_s : float
        Time at rest before the throttle opens [s].
    rotation_m_s : float
        Airspeed at which the nose is raised [m/s].
    height_m : float
        Height above the runway at which the manoeuvre ends [m].
    """

    wait_s: float = 3.0
    rotation_m_s: float = 28.3
    height_m: float = 20.0

    LIMITS: ClassVar = {"wait_s": (0, 600), "rotation_m_s": (24, 36), "height_m": (15, 100)}


@dataclass(frozen=True)
class ChangeHeight:
    """Climb or descend; ends at the height, or sooner after `seconds`, and then goes on during what follows.

    Attributes
    ----------
    height_m : float
        Height above the runway to fly to [m].
    rate_m_s : float
        Vertical speed, positive for both climb and descent [m/s].
    airspeed_m_s : float
        Airspeed to hold [m/s].
    seconds : float
        Go on with the next manoeuvre after this time [s]; infinite by default.
    """

    height_m: float
    rate_m_s: float = 3.3
    airspeed_m_s: float = 40.0
    seconds: float = math.inf

    LIMITS: ClassVar = {
        "height_m": (30, 3500),
        "rate_m_s": (0.2, 5),
        "airspeed_m_s": (33, 58),
        "seconds": (0, math.inf),
    }


@dataclass(frozen=True)
class Turn:
    """Turn to a heading; ends when it is reached and the wings are nearly level.

    Attributes
    ----------
    heading_deg : float
        True heading to turn to [°].
    bank_deg : float
        Bank in the turn [°].
    direction : str
        ``"left"``, ``"right"`` or ``"shortest"``.
    """

    heading_deg: float
    bank_deg: float = 25.0
    direction: str = "shortest"

    LIMITS: ClassVar = {"heading_deg": (-360, 360), "bank_deg": (5, 40)}
    CHOICES: ClassVar = {"direction": ("shortest", "left", "right")}


@dataclass(frozen=True)
class Hold:
    """Keep heading and height for a time.

    Attributes
    ----------
    seconds : float
        How long [s].
    """

    seconds: float

    LIMITS: ClassVar = {"seconds": (0, MAX_DURATION)}


Manoeuvre = TakeOff | ChangeHeight | Turn | Hold

_MANOEUVRES: dict[str, type[Manoeuvre]] = {
    "take_off": TakeOff,
    "climb": ChangeHeight,
    "descend": ChangeHeight,
    "turn": Turn,
    "hold": Hold,
}


@dataclass(frozen=True)
class FlightPlan:
    """A flight as plain data.

    Attributes
    ----------
    duration_s : float
        Time from rest to the end [s].
    runway : Runway
        Where it starts.
    manoeuvres : tuple of manoeuvres
        In order; the first is a `TakeOff`.
    air : Air
        Wind and turbulence.
    seed : int
        Seed of the turbulence.
    aircraft : str
        JSBSim's name of the aircraft; the pilot is trained on the ``c172p`` only.
    """

    duration_s: float
    runway: Runway
    manoeuvres: tuple[Manoeuvre, ...]
    air: Air = Air()
    seed: int = 1
    aircraft: str = "c172p"

    LIMITS: ClassVar = {"duration_s": (1, MAX_DURATION), "seed": (0, 2**31 - 1)}
    CHOICES: ClassVar = {"aircraft": ("c172p",)}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], where: str = "flight") -> FlightPlan:
        """Return the plan in a mapping, such as the ``[flight]`` table of a mission's TOML file.

        Parameters
        ----------
        values
            Keys as the attributes of `FlightPlan`; each manoeuvre has a key ``do``: ``take_off``, ``climb``,
            ``descend``, ``turn`` or ``hold``.
        where
            What to call the mapping in messages.

        Raises
        ------
        MissionError
            If a key is unknown or missing, or a value is not accepted.
        """
        values = dict(values)
        parts: dict[str, Any] = {}
        if "runway" in values:
            parts["runway"] = _part(Runway, values.pop("runway"), f"{where}.runway")
        if "air" in values:
            parts["air"] = _part(Air, values.pop("air"), f"{where}.air")
        if "manoeuvres" in values:
            parts["manoeuvres"] = _manoeuvres(values.pop("manoeuvres"), f"{where}.manoeuvres")
        return _part(cls, values, where, parts)

    def with_seed(self, seed: int) -> FlightPlan:
        """Return the same plan with another seed.

        Raises
        ------
        MissionError
            If the seed is not accepted.
        """
        return replace(self, seed=_accept(FlightPlan, "seed", int, seed, "flight"))


def _manoeuvres(entries: Any, where: str) -> tuple[Manoeuvre, ...]:
    if not isinstance(entries, Sequence) or isinstance(entries, str) or not entries:
        raise MissionError(f"{where}: expected a list of manoeuvres, each one of {', '.join(_MANOEUVRES)}")
    manoeuvres: list[Manoeuvre] = []
    height = 0.0
    for number, entry in enumerate(entries, 1):
        here = f"{where}, number {number}"
        word = entry.get("do") if isinstance(entry, Mapping) else entry
        if not isinstance(entry, Mapping) or not isinstance(word, str) or word not in _MANOEUVRES:
            raise MissionError(
                f"{here}: do = {word!r} is not a manoeuvre; accepted: {', '.join(_MANOEUVRES)}"
            )
        manoeuvre = _part(_MANOEUVRES[word], {k: v for k, v in entry.items() if k != "do"}, here)
        if (word == "take_off") != (number == 1):
            raise MissionError(f"{here}: {word}; a flight begins with take_off, and takes off once")
        if isinstance(manoeuvre, ChangeHeight) and (manoeuvre.height_m > height) != (word == "climb"):
            raise MissionError(
                f"{here}: {word} from {height:g} m to {manoeuvre.height_m:g} m is the wrong word"
            )
        height = getattr(manoeuvre, "height_m", height)
        manoeuvres.append(manoeuvre)
    return tuple(manoeuvres)


def _part(kind: type[Part], values: Any, where: str, parts: Mapping[str, Any] | None = None) -> Part:
    if not isinstance(values, Mapping):
        raise MissionError(f"{where}: expected a table of values, got {values!r}")
    parts = parts or {}
    declared = {field.name: field for field in fields(kind)}  # type: ignore[arg-type]
    for key in values:
        if key not in declared:
            close = difflib.get_close_matches(str(key), declared, n=1)
            hint = f" Did you mean {close[0]}?" if close else ""
            raise MissionError(f"{where}: there is no key {key!r}.{hint} Accepted: {', '.join(declared)}")
    for name, field in declared.items():
        if field.default is MISSING and name not in values and name not in parts:
            raise MissionError(f"{where}: {name} is missing. Accepted: {', '.join(declared)}")
    hints = get_type_hints(kind)
    accepted = {key: _accept(kind, key, hints[key], value, where) for key, value in values.items()}
    return kind(**accepted, **parts)


def _accept(kind: Any, key: str, hint: type, value: Any, where: str) -> Any:
    if hint is str:
        if value not in kind.CHOICES[key]:
            raise MissionError(f"{where}: {key} = {value!r}; accepted: {', '.join(kind.CHOICES[key])}")
        return value
    low, high = kind.LIMITS[key]
    noun = "a whole number" if hint is int else "a number"
    number = not isinstance(value, bool) and isinstance(value, int if hint is int else int | float)
    if not number or not low <= value <= high:
        raise MissionError(f"{where}: {key} = {value!r}; accepted is {noun} from {low:g} to {high:g}")
    return hint(value)
