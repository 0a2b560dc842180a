"""Column names: what the columns of a csv of unknown origin are, by their headings: quantity, axis and unit.

A heading such as ``linear_acceleration.x``, ``AccX``, ``accel_x_g`` or ``Gyroscope y (rad/s)`` is cut into
words, an axis and a unit; the words name the quantity. A column that a heading does not name is not read.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from lab.base.files.mission_error import MissionError
from lab.data.files.unit_names import UNITS, unit_of
from lab.data.sheets.column_words import (
    FIELD_WORDS,
    GLUED,
    GLUED_FIELD,
    LEADING,
    MIDDLE,
    NAMES,
    PATTERNS,
    SENSORS,
    STAMPS,
    WORSE,
    in_english,
    names_field,
)
from lab.data.sheets.sheet_cells import UNIT

VECTORS = {
    "rate": "angular rate", "force": "acceleration", "gravity": "acceleration", "field": "magnetic field",
}  # fmt: skip
"""Quantities with three axes, and the kind of their unit."""
SCALARS = {
    "time": "time", "seconds": "time", "fraction": "time", "date": "", "clock": "",
    "year": "", "month": "", "day": "", "hour": "", "minute": "", "second": "",
    "latitude": "angle", "longitude": "angle", "height": "length", "speed": "speed", "course": "angle",
    "north": "speed", "east": "speed", "down": "speed", "up": "speed", "place": "angle", "side": "",
    "instance": "", "craft": "",
    "north_sigma": "length", "east_sigma": "length",
    "horizontal_sigma": "length", "vertical_sigma": "length", "speed_sigma": "speed",
    "north_speed_sigma": "speed", "east_speed_sigma": "speed", "down_speed_sigma": "speed",
    "pressure": "pressure",
    "roll": "angle", "pitch": "angle", "yaw": "angle", "q0": "", "q1": "", "q2": "", "q3": "",
    "position_resets": "", "velocity_resets": "", "attitude_resets": "",
}  # fmt: skip
"""Quantities with one column, and the kind of their unit. A time stamp may be two columns, whole seconds and
their fraction, a date and a clock, or a column for each part. A place is latitude and longitude in one cell,
a side is N, S, E or W, an instance is the number of one of several sensors, a craft the name of one of
several vehicles. q0 is the scalar part of a quaternion; resets are counters of an estimator."""
QUANTITIES = (*(f"{name}_{axis}" for name in VECTORS for axis in "xyz"), *SCALARS)
"""What a column may be."""
_VECTORS_OF_FLIGHTS = {
    "velocity": "speed", "velocity_rate": "acceleration", "acceleration": "acceleration", "ecef": "length",
    "local": "length", "local_velocity": "speed",
}  # fmt: skip
_SCALARS_OF_FLIGHTS = {
    "own_time": "time", "mission_time": "time", "elapsed_time": "time", "real_time": "time",
    "zone": "", "fix": "",
    "geocentric_latitude": "angle", "geodetic_height": "length", "depth": "length", "airspeed": "speed",
    "alpha": "angle", "beta": "angle", "variation": "angle",
}  # fmt: skip
"""What profiles of simulators and of flight decks name besides. x, y, z are forward, right, down, except in
local frames; velocities, their derivatives and accelerations are over the Earth."""
QUANTITIES_OF_FLIGHTS = (
    *QUANTITIES, *_SCALARS_OF_FLIGHTS, *(f"{name}_{axis}" for name in _VECTORS_OF_FLIGHTS for axis in "xyz"),
)  # fmt: skip
"""What a column of such a profile may be."""
_KINDS = {**SCALARS, **_SCALARS_OF_FLIGHTS, **_VECTORS_OF_FLIGHTS, **VECTORS}
GIVEN = "given"
"""Sensor of the columns that a person names."""
IGNORED = "-"
"""Stands for a column that is not read."""

_CALIBRATED = re.compile(r"(?i)_cal$")
_RAW = re.compile(r"(?i)^raw[\s_.]*(?=[a-z])|(?<=[a-z])[\s_.]*\(?raw\)?$")
"""The word raw before or behind a heading, such as ``ax_raw``."""
_BRACKETS = re.compile(r"[(\[]\s*([^()\[\]]*?)\s*[)\]]")
_BRACES = str.maketrans("{<>}", "[[]]")
_UNIT_BEHIND = re.compile(r"(.+?)(?:,\s*|\s/\s*|[\s_]in[\s_])([^,()\[\]]{1,24})")
"""A unit behind a comma, a fraction bar or the word "in"."""
_DATUM = re.compile(r"(?i)(?<=\S)\s+(?:a?msl|asl|true)$|(?i:(?<=deg)|(?<=degrees)|(?<=°))\s*T$")
"""What may follow a unit: above what, or from which north."""
_AXIS = re.compile(r"(?i)[\s_.:/-]*(?:axis[\s_.-]*)?(?<![a-z])([xyz])(?:[\s_.-]*axis)?\s*$")
_CAMEL_AXIS = re.compile(r"(?<=[a-z])([XYZ])$")
_CAMEL_UNIT = re.compile(
    r"(?<=[a-zXYZ])(Degrees|Deg|Radians|Meters|Metres|Feet|Mps2|Mps|Kmh|Kph|Mph|Knots|Millis|Micros|Nanos|"
    r"MicroT|RadPerSec|DegPerSec|HPa|Hpa|Dps|DPS|E[67])$"
)
"""A unit as the last word of a heading in capitals, such as ``LatitudeDegrees``."""
_INDEX = re.compile(r"\[([012])\](?=(?:\s*[(\[][^)\]\d]*[)\]])?$)|[_.]([012])$")
_QUANTITY_OF_UNIT = {"acceleration": "force", "angular rate": "rate", "magnetic field": "field"}
_CAMEL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
_WORD = re.compile(r"[a-zµμ]+|%|\d+")


@dataclass(frozen=True)
class Heading:
    """What a column is.

    Attributes
    ----------
    text : str
        Its heading, as in the file.
    quantity : str
        One of `SCALARS` or `VECTORS`.
    axis : str
        "x", "y" or "z" of a vector.
    sensor : str
        The words that columns of one sensor have in common.
    unit : str
        The unit that the heading names; empty if it names none.
    rank : int
        The lowest is the best of several columns of one quantity.
    sign : int
        -1 for a column that is to be negated.
    source : str
        How its unit is known, if it has one.
    other : str
        Its other unit, if a profile leaves it to the numbers; empty else.
    written : str
        Its unit as the line above the headings writes it; empty if there is none.
    """

    text: str
    quantity: str
    axis: str = ""
    sensor: str = ""
    unit: str = ""
    rank: int = 0
    sign: int = 1
    source: str = "named in the heading"
    other: str = ""
    written: str = ""

    @property
    def kind(self) -> str:
        """Kind of its unit, a key of `UNITS`."""
        return _KINDS[self.quantity]

    @property
    def key(self) -> str:
        """Its quantity with its axis, as a person writes it."""
        return f"{self.quantity}_{self.axis}" if self.axis else self.quantity


_QUATERNION = re.compile(
    r"(?i)^(?P<of>(?:.*[\s_./:])?(?:q|quat|quaternion|orientation|attitude))[\s_./:-]*(?:q[\s_.]?)?"
    r"(?:\[(?P<place>[0-3])\]|[\s_.]?(?P<part>[0-3wxyzrijk]))$"
)
_PARTS = "0123wxyzrijk"
"""Names of the parts of a quaternion, in fours, the scalar first; after numbers it may be the last."""
NUMBERED = "numbered"
"""Begin of the sensor of a quaternion whose parts have numbers."""
_RESETS = {
    "velocity_resets": {"vel", "velocity", "vxy", "vz", "vd", "speed"},
    "attitude_resets": {"quat", "q", "quaternion", "heading", "yaw", "attitude", "att", "hdg"},
}
"""What an estimator's counter of resets counts by its other words; those of positions by none of them."""


def _of_estimator(text: str, words: Sequence[str]) -> Heading | None:
    """Return a part of a quaternion or a counter of resets; None for another column."""
    if found := _QUATERNION.match(text.strip().strip("\"'")):
        part = found["place"] or found["part"].lower()
        numbered = f"{NUMBERED} " if part.isdigit() else ""
        rank = sum(WORSE.get(word, 0) for word in words)
        return Heading(
            text, f"q{_PARTS.index(part) % 4}", sensor=f"{numbered}{found['of'].lower()}", rank=rank
        )
    given = set(words)
    if given & {"reset", "resets"} and not given & {"time", "delta", "reason", "since"}:
        quantity = next((name for name, theirs in _RESETS.items() if given & theirs), "position_resets")
        return Heading(text, quantity)
    return None


def kind_of(quantity: str) -> str:
    """Return the kind of the unit of a quantity, a key of `UNITS`; empty for one without a unit."""
    return _KINDS.get(quantity, "")


def heading_of(text: str, file: str = "") -> Heading | None:
    """Return what a column is by its heading; None for one that names nothing that is read.

    Parameters
    ----------
    text
        The heading.
    file
        Name of the file, which names the sensor where headings are x, y and z.
    """
    measured = _RAW.sub("", text)
    found = _meant_by(measured, file) if measured != text else None
    return replace(found, text=text, rank=found.rank + WORSE["raw"]) if found else _meant_by(text, file)


def _meant_by(text: str, file: str) -> Heading | None:
    """Return what a heading means as it stands."""
    file = in_english(file)
    stem, axis, unit = _split_heading(_FRAME_LAST.sub(r"\2_\1", in_english(text).strip()))
    words = _split_words(stem)
    given = set(words)
    rank = sum(WORSE.get(word, 0) for word in given)
    joined = "".join(words)
    if found := _of_estimator(text, _split_words(text)):
        return found
    if axis and joined in _INDEXED:
        quantity = _INDEXED[joined]["xyz".index(axis)]
        return Heading(text, quantity, unit=unit_of(SCALARS[quantity], unit), rank=rank)
    if not axis and (found := _about_an_axis(text, given, unit, rank)):
        return found
    if axis:
        return _vector(text, axis, unit, words, file, rank)
    if joined in NAMES:
        quantity, named, worse = NAMES[joined]
        return Heading(text, quantity, unit=unit_of(SCALARS[quantity], unit or named), rank=rank + worse)
    return _stamp(text, words, unit, rank) or _scalar(text, words, unit, rank)


def given_heading(text: str, column: str, accepted: Sequence[str] = QUANTITIES) -> Heading | None:
    """Return what a person says that a column is: ``force_x[m/s²]``, ``-rate_z`` or ``-``.

    Parameters
    ----------
    text
        What the person writes.
    column
        The heading of the column.
    accepted
        The quantities; with those of flights, the unit may be one of two, such as ``rad or °``.

    Returns
    -------
    Heading or None
        None for a column that is not to be read.

    Raises
    ------
    MissionError
        If this is no quantity, or no unit of it.
    """
    text = text.strip()
    if text == IGNORED:
        return None
    name, _, inside = text.lstrip("+-").rstrip("]").partition("[")
    name = name.strip()
    if name not in accepted:
        raise MissionError(
            f"column {column}: {name!r} is no quantity; accepted are {', '.join(accepted)}, each with a "
            f"unit in brackets and with a minus before it, and {IGNORED} for a column that is not read"
        )
    vector = name[:-2] if name[:-2] in VECTORS or name[:-2] in _VECTORS_OF_FLIGHTS else ""
    quantity = vector or name
    kind = _KINDS[quantity]
    units = inside.split(" or ") if accepted is QUANTITIES_OF_FLIGHTS else [inside]
    known = [unit_of(kind, unit) if unit else "" for unit in units]
    if wrong := next((unit for unit, found in zip(units, known, strict=True) if unit and not found), ""):
        those = ", ".join(UNITS.get(kind, {})) or "none"
        raise MissionError(f"column {column}: {wrong!r} is no unit of {quantity}; accepted are {those}")
    sign = -1 if text.startswith("-") else 1
    axis = name[-1] if vector else ""
    other = known[-1] if len(known) > 1 else ""
    return Heading(column, quantity, axis, GIVEN, known[0], -100, sign, other=other)


def _bracket_unit(stem: str) -> str:
    """Return a heading with its unit in brackets where it stands in braces or behind a comma."""
    stem = stem.translate(_BRACES)
    found = _UNIT_BEHIND.fullmatch(stem)
    is_unit = found is not None and any(unit_of(kind, found[2]) for kind in UNITS)
    return f"{found[1]} [{found[2]}]" if found is not None and is_unit else stem


def _split_heading(text: str) -> tuple[str, str, str]:
    """Cut a heading into words, axis and unit."""
    stem, axis, unit = _bracket_unit(text.strip().strip("\"'\ufeff#% ").strip()), "", ""
    if found := _INDEX.search(stem):
        stem, axis = stem[: found.start()] + stem[found.end() :], "xyz"[int(found[1] or found[2])]
    insides = _BRACKETS.findall(stem)
    stem = _BRACKETS.sub(" \0 ", stem)
    for inside in (_DATUM.sub("", one) for one in insides):
        if re.fullmatch(r"(?i)([xyz])([\s-]*axis)?", inside):
            axis = axis or inside[0].lower()
        elif not unit and any(unit_of(kind, inside) for kind in UNITS):
            unit = inside
        else:
            stem = stem.replace("\0", inside, 1)
            continue
        stem = stem.replace("\0", " ", 1)
    stem = _CALIBRATED.sub("", stem.strip(" :,;/"))
    for _ in range(2):
        if not axis:
            found = _AXIS.search(stem) or _CAMEL_AXIS.search(stem)
            if found:
                stem, axis = stem[: found.start()], found[1].lower()
            elif found := GLUED.search(stem) or GLUED_FIELD.search(stem):
                stem, axis = stem[:-1], stem[-1].lower()
            elif found := LEADING.search(stem):
                stem, axis = stem[found.end(1) :], found[1].lower()
            elif found := MIDDLE.search(stem):
                stem, axis = f"{stem[: found.start(1)]}{stem[found.end(1) :]}", found[1][0].lower()
        if not unit and (found := UNIT.search(stem) or _CAMEL_UNIT.search(stem)):
            stem, unit = stem[: found.start()], found[1]
    return stem.strip(), axis, unit


def _split_words(stem: str) -> list[str]:
    return _WORD.findall(_CAMEL.sub(" ", stem).lower())


def _vector(text: str, axis: str, unit: str, words: Sequence[str], file: str, rank: int) -> Heading | None:
    """Return what a column with an axis is: of a gyro, an accelerometer, or the direction of gravity."""
    names = [word for word in words if not word.isdigit()]
    frames = [frame for frame in _FRAMES if frame in names]
    if len(frames) == 1 and set(names) & _VELOCITY and not set(names) & {"position", "pos"}:
        quantity, sign = _FRAMES[frames[0]]["xyz".index(axis)]
        return Heading(text, quantity, unit=unit_of("speed", unit), rank=rank, sign=sign)
    if not names:
        # Columns x, y and z are of the sensor that their unit or the name of the file names.
        names = _split_words(file.partition(".")[0])
        rank = sum(WORSE.get(word, 0) for word in names)
    given = set(names)
    joined = "".join(names)
    sensor = " ".join(words) or file
    is_field = names_field(frozenset(given), joined)
    if is_field or given & SENSORS["other"]:
        known = unit_of(VECTORS["field"], unit) if unit else ""
        measured = is_field and not given & (SENSORS["other"] - FIELD_WORDS) and (known or not unit)
        # Core Motion removes the iron of the device from the field of its motions.
        better = int("motion" in given)
        return Heading(text, "field", axis, sensor, known, rank - better) if measured else None
    if given & {"gravity", "grav"}:
        sign = -1 if joined in SENSORS["along_gravity"] else 1
        return Heading(text, "gravity", axis, sensor, unit_of("acceleration", unit), rank, sign)
    quantity = _find_sensor(given, joined)
    if not quantity:
        found = next((ours for kind, ours in _QUANTITY_OF_UNIT.items() if unit and unit_of(kind, unit)), "")
        if not found or (words and names[-1] not in SENSORS[f"short_{found}"]):
            return None
        quantity = found
    if quantity == "rate" and unit_of("acceleration", unit) == "g" and joined == "g":
        quantity = "force"
    if joined in {"gf", "gforce"} and not unit:
        unit = "g"
    known = unit_of(VECTORS[quantity], f"{unit}/s" if unit == "rad" else unit) if unit else ""
    if unit and not known:
        return None if unit_of("angle", unit) or unit_of("speed", unit) else Heading(
            text, quantity, axis, sensor, "", rank + 1
        )  # fmt: skip
    return Heading(text, quantity, axis, sensor, known, rank, -1 if joined in SENSORS["along_gravity"] else 1)


_FRAMES = {
    "enu": (("east", 1), ("north", 1), ("up", 1)),
    "ned": (("north", 1), ("east", 1), ("down", 1)),
    "nwu": (("north", 1), ("east", -1), ("up", 1)),
}
"""Quantity and sign of the components of a velocity in each frame."""
_VELOCITY = {"v", "vel", "velocity", "speed"}
_FRAME_LAST = re.compile(r"(?i)^(.+)[\s_.](enu|ned|nwu)$")


def _find_sensor(given: set[str], joined: str) -> str:
    """Return the quantity that words name; empty if they name none."""
    turning = given & {"angular", "angle"} and given & {"velocity", "rate", "rates", "vel", "speed"}
    if given & SENSORS["gyro"] or turning or {"rotation", "rate"} <= given or joined in SENSORS["short_rate"]:
        return "rate"
    pushing = {"specific", "force"} <= given or {"g", "force"} <= given or "specificforce" in given
    sensed = "angular" not in given and given & SENSORS["accelerometer"]
    return "force" if sensed or pushing or joined in SENSORS["short_force"] else ""


OF_DIRECTIONS = ("roll, pitch and yaw rate", "along the vehicle")
"""Sensors whose headings name directions, and not to which side they are positive."""
_ABOUT = {"roll": "x", "pitch": "y", "yaw": "z"}
"""Axes of angular rates that are named by their angle."""


def _about_an_axis(text: str, given: set[str], unit: str, rank: int) -> Heading | None:
    """Return a rate that is named by its angle, or an acceleration by its direction; None for others."""
    turning = given & {"rate", *SENSORS["gyro"]} or (unit and unit_of("angular rate", unit) and unit != "rad")
    if len(given & set(_ABOUT)) == 1 and turning:
        axis = _ABOUT[next(iter(given & set(_ABOUT)))]
        known = unit_of("angular rate", unit)
        return Heading(text, "rate", axis, OF_DIRECTIONS[0], known, rank + 1)
    towards = given & set(_TOWARDS)
    sensed = given & SENSORS["accelerometer"] or ({"g force"} if {"g", "force"} <= given else set())
    given = given - {"g", "force"} | sensed
    known = unit_of("acceleration", unit)
    # An accuracy has a length for its unit; a receiver's velocities make accelerations without gravity.
    if len(towards) != 1 or len(sensed) != 1 or given != towards | sensed or (unit and not known):
        return None
    axis = _TOWARDS[next(iter(towards))]
    is_named = known or axis != "z" or "acc" not in sensed
    return Heading(text, "force", axis, OF_DIRECTIONS[1], known, rank + 1) if is_named else None


_TOWARDS = {
    "inline": "x", "longitudinal": "x", "long": "x", "lateral": "y", "lat": "y", "vertical": "z", "vert": "z",
}  # fmt: skip
"""Axes of accelerations that data loggers of cars name by their direction."""
_INDEXED = {
    "lla": ("latitude", "longitude", "height"),
    "gpscoord": ("latitude", "longitude", "height"),
}
"""What columns with an index instead of an axis are."""


def _stamp(text: str, words: Sequence[str], unit: str, rank: int) -> Heading | None:
    """Return a time stamp, or a part of one."""
    given = set(words)
    joined = "".join(words)
    if "header" in given or "stamp" in given:
        whole = given & {"secs", "sec"} or unit_of("time", unit) == "s"
        part = given & {"nsecs", "nanosec", "nsec", "nanosecs"} or unit_of("time", unit) == "ns"
        if whole or part:
            return Heading(text, "seconds" if whole else "fraction", unit="s" if whole else "ns")
    if joined in STAMPS:
        quantity, known, worse = STAMPS[joined]
        return Heading(text, quantity, unit=unit_of("time", unit) or known, rank=worse)
    kinds = () if not unit or unit_of("time", unit) else ("angle", "speed", "acceleration", "angular rate")
    if any(unit_of(kind, unit) for kind in kinds):
        return None
    since = "since" in given
    if (not given & SENSORS["time"] | given & {"seconds"} and joined not in {"ms", "us"}) or (
        given & SENSORS["no_time"] and not since
    ):
        return None
    if since and "start" not in given:
        return Heading(text, "time", unit=unit_of("time", unit), rank=8)  # of one sensor, since reboot
    if not unit:
        last = next((word for word in reversed(words) if unit_of("time", word)), "")
        unit = {"millis": "ms", "micros": "us"}.get(joined, last if last not in {"h", "min"} else "")
    # A receiver's own time differs from the logger's clock, by leap seconds at least.
    worse = 3 * bool(given & (SENSORS["receiver"] | {"utc", "gmt"})) + bool(given & {"elapsed", "seconds"})
    # A message of ROS has the time of the measurement in its header; the recorder adds that of its arrival.
    device = -1 if given & {"device", "header"} else 0
    return Heading(text, "time", unit=unit_of("time", unit) if unit else "", rank=2 + worse + rank + device)


_PLANES = {"2d", "3d"}
_SAY_NOTHING = {"field", "msg", "data", "imu", "of", "over", *"0123456789"}


def _scalar(text: str, words: Sequence[str], unit: str, rank: int) -> Heading | None:
    # The D of 2D and 3D is no down.
    words = [word for before, word in zip(["", *words], words, strict=False) if before + word not in _PLANES]
    kept = [word for word in words if word not in _SAY_NOTHING]
    joined = "".join(kept)
    if joined in ("north", "east", "down", "up") and unit_of("speed", unit):
        return Heading(text, joined, unit=unit_of("speed", unit), rank=rank)
    for quantity, pattern in PATTERNS:
        if not pattern.fullmatch(joined):
            continue
        known = unit_of(SCALARS[quantity], unit) if unit else ""
        if (
            quantity == "course"
            and not (set(words) & SENSORS["receiver"])
            and set(words) & {"heading", "hdg"}
        ):
            rank += 3  # a compass has a heading too
        if quantity == "course" and "orientation" in words and not set(words) & SENSORS["receiver"]:
            return None
        if set(words) & SENSORS["receiver"]:
            rank -= 2
        reversed_ = {"longitude": {"west"}, "east": {"west", "w"}, "north": {"south"}}
        if set(words) & reversed_.get(quantity, set()):
            return Heading(text, quantity, unit=known, rank=rank, sign=-1)
        others: tuple[str, ...] = (
            "acceleration", "angular rate", "speed" if quantity != "speed" else "length",
        )  # fmt: skip
        if quantity.endswith("_sigma"):
            others = ("acceleration", "angle", "speed" if SCALARS[quantity] != "speed" else "length")
        if unit and not known and any(unit_of(other, unit) for other in others):
            return None
        return Heading(text, quantity, unit=known, rank=rank)
    return None
