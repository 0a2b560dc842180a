"""Blocks: the further error states that a filter may have, each declared once.

Every filter has the nine errors of position, velocity and attitude and the six biases. Scale factors and the
blocks below follow if they are wanted, always in the order of `BLOCKS`. A block is added here, with its place
in the state of the navigator; `belief` gives its uncertainty, and `observation` or `aiding` its elements of
H.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch.
14.2.5.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from lab.frames.earth import STANDARD_GRAVITY
from lab.navigation import strapdown
from lab.sensors.imu_errors import OFF_DIAGONAL

CORE = 15
"""States of every filter: position, velocity, attitude and two biases."""


class Block(NamedTuple):
    """Error states that belong together.

    Attributes
    ----------
    names : tuple of str
        Name of each state, as it is shown.
    place : int
        Where their estimates begin in the state of the navigator.
    unit : str
        SI unit.
    shown_unit : str
        Unit on pages and in tables.
    shown_scale : float
        Shown value of one SI unit.
    """

    names: tuple[str, ...]
    place: int
    unit: str
    shown_unit: str
    shown_scale: float

    @property
    def size(self) -> int:
        """Number of states."""
        return len(self.names)


GYRO_SCALE, ACCEL_SCALE = "gyro scale", "accelerometer scale"
GYRO_MISALIGNMENT, ACCEL_MISALIGNMENT = "gyro misalignment", "accelerometer misalignment"
GYRO_DRIFT, ACCEL_DRIFT = "gyro drift", "accelerometer drift"
GPS_DRIFT, BAROMETER_BIAS, HEADING_BIAS = "GPS drift", "barometer bias", "heading sensor bias"
LEVER_ARM, LATENCY, ODOMETER_SCALE = "lever arm", "latency", "odometer scale"
WIND, AIRSPEED_SCALE = "wind", "airspeed scale"

OF_AIDS = frozenset({BAROMETER_BIAS, HEADING_BIAS, ODOMETER_SCALE, WIND, AIRSPEED_SCALE})
"""Blocks of the errors of other sensors than IMU and GPS."""

BLOCKS: dict[str, Block] = {
    GYRO_SCALE: Block(tuple(f"{GYRO_SCALE} {axis}" for axis in "xyz"), strapdown.GYRO_SCALE, "", "%", 100.0),
    ACCEL_SCALE: Block(
        tuple(f"{ACCEL_SCALE} {axis}" for axis in "xyz"), strapdown.ACCEL_SCALE, "", "%", 100.0
    ),
    GYRO_MISALIGNMENT: Block(
        tuple(f"{GYRO_MISALIGNMENT} {pair}" for pair in OFF_DIAGONAL),
        strapdown.GYRO_MISALIGNMENT,
        "rad",
        "°",
        math.degrees(1.0),
    ),
    ACCEL_MISALIGNMENT: Block(
        tuple(f"{ACCEL_MISALIGNMENT} {pair}" for pair in OFF_DIAGONAL),
        strapdown.ACCEL_MISALIGNMENT,
        "rad",
        "°",
        math.degrees(1.0),
    ),
    GYRO_DRIFT: Block(
        tuple(f"{GYRO_DRIFT} {axis}" for axis in "xyz"),
        strapdown.GYRO_DRIFT,
        "rad/s",
        "°/s",
        math.degrees(1.0),
    ),
    ACCEL_DRIFT: Block(
        tuple(f"{ACCEL_DRIFT} {axis}" for axis in "xyz"),
        strapdown.ACCEL_DRIFT,
        "m/s²",
        "mg",
        1e3 / STANDARD_GRAVITY,
    ),
    GPS_DRIFT: Block(
        tuple(f"{GPS_DRIFT} {axis}" for axis in ("north", "east", "down")),
        strapdown.GPS_DRIFT,
        "m",
        "m",
        1.0,
    ),
    BAROMETER_BIAS: Block((BAROMETER_BIAS,), strapdown.BAROMETER_BIAS, "m", "m", 1.0),
    HEADING_BIAS: Block((HEADING_BIAS,), strapdown.HEADING_BIAS, "rad", "°", math.degrees(1.0)),
    LEVER_ARM: Block(
        tuple(f"{LEVER_ARM} {axis}" for axis in ("forward", "right", "down")),
        strapdown.LEVER_ARM,
        "m",
        "m",
        1.0,
    ),
    LATENCY: Block((LATENCY,), strapdown.LATENCY, "s", "s", 1.0),
    ODOMETER_SCALE: Block((ODOMETER_SCALE,), strapdown.ODOMETER_SCALE, "", "%", 100.0),
    WIND: Block(tuple(f"{WIND} {axis}" for axis in ("north", "east")), strapdown.WIND, "m/s", "m/s", 1.0),
    AIRSPEED_SCALE: Block((AIRSPEED_SCALE,), strapdown.AIRSPEED_SCALE, "", "%", 100.0),
}
"""The further blocks by name, in the order of the states of a filter."""
SCALES = (GYRO_SCALE, ACCEL_SCALE)
"""The blocks of a filter with 21 states."""
MISALIGNMENTS = (GYRO_MISALIGNMENT, ACCEL_MISALIGNMENT)
"""The blocks of a filter that estimates misalignments: they act on attitude and velocity, as scales do."""
DRIFTS = (GYRO_DRIFT, ACCEL_DRIFT)
"""The blocks of a filter with two bias states for each axis: a constant, and this Gauss-Markov process."""

OWN: dict[str, Block] = {}
"""The blocks that a user declared (`own_states`), which follow all others. Names are unique for ever."""


def block(name: str) -> Block:
    """Return a further block, by its name."""
    return BLOCKS[name] if name in BLOCKS else OWN[name]


def in_order(names: Sequence[str]) -> tuple[str, ...]:
    """Return names of blocks in the order of the states."""
    return tuple(name for name in (*BLOCKS, *OWN) if name in names)


IMU_DENSITIES = 12
"""Process noise densities of every filter: of white noise and biases of the IMU. Those of blocks follow."""


def count(names: Sequence[str]) -> int:
    """Return the number of states of a filter with some further blocks."""
    return CORE + sum(block(name).size for name in names)


def first_state(names: Sequence[str], name: str) -> int:
    """Return the first state of a block in a filter with some further blocks; −1 if it has no such block."""
    if name not in names:
        return -1
    at = CORE
    for other in in_order(names):
        if other == name:
            break
        at += block(other).size
    return at


def states_of(names: Sequence[str], name: str) -> slice:
    """Return the states of a block in a filter that has it."""
    first = first_state(names, name)
    return slice(first, first + block(name).size)


def own_states(names: Sequence[str]) -> slice:
    """Return the states of the blocks that a user declared, the last ones; none if there are none."""
    size = sum(OWN[name].size for name in names if name in OWN)
    return slice(count(names) - size, count(names))


def shown_states(names: Sequence[str]) -> tuple[list[str], list[str], list[float]]:
    """Return names, shown units and scales from SI units of the states after the scale factors."""
    found = [block(name) for name in in_order(names) if name not in SCALES]
    return (
        [state for one in found for state in one.names],
        [one.shown_unit for one in found for _ in one.names],
        [one.shown_scale for one in found for _ in one.names],
    )


def places(names: Sequence[str]) -> tuple[int, ...]:
    """Return where the estimates of all states from the biases on are in the state of the navigator."""
    found = list(range(strapdown.GYRO_BIAS, strapdown.GYRO_BIAS + 6))
    for name in in_order(names):
        found += range(block(name).place, block(name).place + block(name).size)
    return tuple(found)
