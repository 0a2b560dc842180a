"""Manoeuvres: the parts of a flight plan, which the pilot flies one after the other."""

from __future__ import annotations

import math
from dataclasses import dataclass

from lab.flying.plan_table import AIRSPEEDS, HEIGHTS, TURNS, choice, number

MAX_DURATION = 14_400.0
"""Longest flight of a plan [s]: four hours. A plain choice."""

_RATES = (0.2, 30)
"""Rates of climb and descent [m/s]; every aircraft has narrower limits."""
_BANKS = (5, 60)
"""Banks of turns [°]: 60° is 2 g."""


@dataclass(frozen=True)
class TakeOff:
    """Wait at rest, take off straight ahead, climb; ends at a height above the runway.

    The climb goes on for 60 m more unless the next manoeuvres say otherwise.
    """

    wait_s: float = number("Wait", "s", (0, 600), "Time at rest before the throttle opens.", default=3.0)
    rotation_m_s: float | None = number(
        "Rotation speed", "m/s", AIRSPEEDS, "Airspeed at which the nose is raised.", default=None
    )
    height_m: float = number(
        "Height", "m", (15, 100), "Height above the runway at which the manoeuvre ends.", default=20.0
    )


@dataclass(frozen=True)
class ChangeHeight:
    """Climb or descend; ends within 5 m of the height, or after `seconds`, and goes on in what follows."""

    height_m: float = number("Height", "m", HEIGHTS, "Height above the ground to fly to.")
    rate_m_s: float | None = number(
        "Rate", "m/s", _RATES, "Vertical speed, positive for both climb and descent.", default=None
    )
    airspeed_m_s: float | None = number(
        "Airspeed", "m/s", AIRSPEEDS, "True airspeed to hold from here on.", default=None
    )
    seconds: float = number(
        "Time limit",
        "s",
        (0, math.inf),
        "Go on with the next manoeuvre after this time, still climbing or descending.",
        default=math.inf,
    )


class Climb(ChangeHeight):
    """Climb; ends within 5 m of the height, or after `seconds`, and goes on in what follows."""


class Descend(ChangeHeight):
    """Descend; ends within 5 m of the height, or after `seconds`, and goes on in what follows."""


@dataclass(frozen=True)
class Level:
    """End a climb or descent at once; ends when the rate of climb is below 0.3 m/s, at the height reached."""


@dataclass(frozen=True)
class ChangeSpeed:
    """Fly faster or slower; ends within 1 m/s of the airspeed, heading and height held."""

    airspeed_m_s: float = number("Airspeed", "m/s", AIRSPEEDS, "True airspeed to hold from here on.")


@dataclass(frozen=True)
class Hold:
    """Keep heading, height and airspeed for a time."""

    seconds: float = number("Time", "s", (0, MAX_DURATION), "Length of this manoeuvre.")


def _bank(default: float = 25.0) -> float:
    return number("Bank", "°", _BANKS, "Bank in the turn.", default=default)  # type: ignore[no-any-return]


def _skid() -> float:
    return number(  # type: ignore[no-any-return]
        "Skid",
        "°",
        (-8, 8),
        "Sideslip held with the rudder: 0 a coordinated turn; positive skids, the nose turned too far into "
        "the turn; negative slips.",
        default=0.0,
    )


@dataclass(frozen=True)
class Turn:
    """Turn to a heading; ends within 2° of it with the wings within 3° of level."""

    heading_deg: float = number("Heading", "°", TURNS, "True heading to turn to.")
    bank_deg: float = _bank()
    direction: str = choice(
        "Direction", ("shortest", "left", "right"), "Which way to turn.", default="shortest"
    )
    skid_deg: float = _skid()


@dataclass(frozen=True)
class TurnBy:
    """Turn by an angle, more than once around where asked; ends as `Turn` does."""

    angle_deg: float = number("Angle", "°", (5, 3600), "Change of heading.")
    bank_deg: float = _bank()
    direction: str = choice("Direction", ("right", "left"), "Which way to turn.", default="right")
    skid_deg: float = _skid()


@dataclass(frozen=True)
class STurns:
    """Turns to one side and back to the other, each by the same angle; ends as the last `Turn` does."""

    turns: int = number("Turns", "", (1, 100), "Number of turns.", default=4, whole=True)
    angle_deg: float = number("Angle", "°", (10, 180), "Change of heading in each.", default=60.0)
    bank_deg: float = _bank()
    direction: str = choice("Direction", ("right", "left"), "Which way the first one goes.", default="right")
    skid_deg: float = _skid()


@dataclass(frozen=True)
class FigureEight:
    """A full circle to one side, then one to the other; ends with the last of them, as `Turn` does."""

    times: int = number("Times", "", (1, 100), "Number of eights.", default=1, whole=True)
    bank_deg: float = _bank()
    direction: str = choice(
        "Direction", ("right", "left"), "Which way the first circle goes.", default="right"
    )
    skid_deg: float = _skid()


Manoeuvre = TakeOff | ChangeHeight | Level | ChangeSpeed | Hold | Turn | TurnBy | STurns | FigureEight

MANOEUVRES: dict[str, type[Manoeuvre]] = {
    "take_off": TakeOff,
    "climb": Climb,
    "descend": Descend,
    "level": Level,
    "speed": ChangeSpeed,
    "hold": Hold,
    "turn": Turn,
    "turn_by": TurnBy,
    "s_turns": STurns,
    "figure_eight": FigureEight,
}
"""Every manoeuvre by the word a plan calls it, its key ``do``."""

WORDS = {kind: word for word, kind in MANOEUVRES.items()}
"""The word of every manoeuvre."""


def split_turns(manoeuvre: Manoeuvre) -> tuple[Manoeuvre, ...]:
    """Return the turns of S-turns and eights, and any other manoeuvre itself."""
    match manoeuvre:
        case STurns():
            count, angle = manoeuvre.turns, manoeuvre.angle_deg
        case FigureEight():
            count, angle = 2 * manoeuvre.times, 360.0
        case _:
            return (manoeuvre,)
    sides = (manoeuvre.direction, "left" if manoeuvre.direction == "right" else "right")
    return tuple(
        TurnBy(angle, manoeuvre.bank_deg, sides[number % 2], manoeuvre.skid_deg) for number in range(count)
    )
