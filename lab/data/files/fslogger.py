"""fsLogger: the ``Data.csv`` of fsLogger for Microsoft Flight Simulator and FSX (SimConnect).

Columns are SimConnect's variables as the user lists them in ``fsVar.xml``. The csv does not name their
units: those of the ``fsVar.xml`` that comes with fsLogger are assumed. SimConnect's body axes are X right,
Y up, Z forward, its angles of pitch and bank are the negatives of ours, and its rates follow them: p = -Z,
q = -X, r = +Y; checked on a recorded flight, where the derivatives of the angles give these signs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from lab.data.files.fields import SEA_LEVEL, Field, one_file, raw_flight, read_columns, recognised
from lab.data.rebuild.raw_flight import RawFlight

NAME = "MSFS/FSX fsLogger csv"

_GUESSED = "guessed"


def _field(key: str, name: str, quantity: str, unit: str) -> Field:
    return Field(key, (name,), quantity, unit, _GUESSED)


FIELDS = (
    Field("time", ("time",), "time", "s"),
    _field("latitude", "planelatitude", "angle", "°"),
    _field("longitude", "planelongitude", "angle", "°"),
    _field("height", "planealtitude", "length", "ft"),
    _field("pitch", "planepitchdegrees", "angle", "°"),
    _field("bank", "planebankdegrees", "angle", "°"),
    _field("heading", "planeheadingdegreestrue", "angle", "°"),
    _field("airspeed", "airspeedtrue", "speed", "kt"),
    _field("alpha", "incidencealpha", "angle", "°"),
    _field("beta", "incidencebeta", "angle", "°"),
    _field("east", "velocityworldx", "speed", "ft/s"),
    _field("up", "velocityworldy", "speed", "ft/s"),
    _field("north", "velocityworldz", "speed", "ft/s"),
    _field("rate right", "rotationvelocitybodyx", "angular rate", "°/s"),
    _field("rate up", "rotationvelocitybodyy", "angular rate", "°/s"),
    _field("rate forward", "rotationvelocitybodyz", "angular rate", "°/s"),
    _field("acceleration right", "accelerationbodyx", "acceleration", "g"),
    _field("acceleration up", "accelerationbodyy", "acceleration", "g"),
    _field("acceleration forward", "accelerationbodyz", "acceleration", "g"),
)
"""SimConnect's variables a flight is made of, with the units of fsLogger's own ``fsVar.xml``."""

REQUIRED = (
    ("time",),
    ("planelatitude", "planeheadingdegreestrue"),
    ("planelongitude", "airspeedtrue"),
)


def recognises(head: bytes) -> bool:
    """Return whether a file begins with fsLogger's header."""
    return recognised(head, REQUIRED)


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read the ``Data.csv`` of fsLogger.

    Raises
    ------
    MissionError
        For whatever is wrong with the file.
    """
    path = one_file(paths, NAME)
    columns = read_columns(path, FIELDS, units, REQUIRED)
    remarks = [
        "The file does not name its units: they are taken from the fsVar.xml that comes with fsLogger. If "
        "yours was changed, give the units of those columns."
    ]
    if columns.get("height") is not None:
        remarks.append(SEA_LEVEL)
    return raw_flight(
        NAME,
        columns,
        velocity_n=columns.vector("north", "east", "-up"),
        euler=columns.vector("-bank", "-pitch", "heading"),
        body_rate=columns.vector("-rate forward", "-rate right", "rate up"),
        acceleration_b=columns.vector("acceleration forward", "acceleration right", "-acceleration up"),
        remarks=remarks,
    )
