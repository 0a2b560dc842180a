"""Blocks: the further error states that a filter may have, each declared once.

Every filter has the nine errors of position, velocity and attitude and the six biases. Scale factors and the
blocks below follow if they are wanted, always in the order of `BLOCKS`. A block is added here, with its place
in the state of the navigator, the setting that adds it, and the process that the filter takes it for;
`observation` or `aids` give its elements of H.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch.
14.2.5.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from lab.base.aid_table import AIDS, FURTHER
from lab.base.arrays import FloatArray
from lab.base.parameters.units import STANDARD_GRAVITY, si
from lab.motion.frames.east_north_up import east_north_up_sizes
from lab.navigation import strapdown
from lab.navigation.settings import NavigatorSettings
from lab.sensors.imu import AccelerometerErrors, GyroErrors
from lab.sensors.imu_errors import OFF_DIAGONAL
from lab.sensors.suite import SensorSuite

CORE = 15
"""States of every filter: position, velocity, attitude and two biases."""


class Process(NamedTuple):
    """What a filter takes states for: first-order Gauss-Markov processes and constants.

    Attributes
    ----------
    variance, drive, decay : (k,) arrays
        Variances at the start, drive densities, and decay rates [1/s].
    """

    variance: FloatArray
    drive: FloatArray
    decay: FloatArray


ProcessOf = Callable[[SensorSuite, NavigatorSettings], Process]


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
    setting : str
        The setting that adds the block to a filter; empty for those that are added by their names.
    process : function or None
        What the filter takes them for, by sensors and filter; None for scale factors, whose variance is a
        part of `belief.constant_errors`.
    constant : bool
        Whether they are constants whatever the settings: neither decay nor process noise.
    """

    names: tuple[str, ...]
    place: int
    unit: str
    shown_unit: str
    shown_scale: float
    setting: str = ""
    process: ProcessOf | None = None
    constant: bool = False

    @property
    def size(self) -> int:
        """Number of states."""
        return len(self.names)


SMALLEST = 1e-12
"""Smallest variance of a drift of the receiver that a filter estimates [m²]: none would make P singular."""


def gauss_markov(constant: FloatArray, drift: FloatArray, correlation_time: float) -> Process:
    """Return the process of a constant plus a drift, given by their variances.

    With the variances C and σ², it begins with C + σ² and grows by 2 σ² / τ, which keeps C + σ² in the mean.
    """
    constant, drift = np.atleast_1d(constant), np.atleast_1d(drift)
    total = constant + drift
    growth = 2 * drift / correlation_time
    decay = np.divide(growth, 2 * total, out=np.zeros_like(total), where=total > 0)
    return Process(total, growth, decay)


def _constants(variance: FloatArray) -> Process:
    """Return the process of constants."""
    return Process(np.atleast_1d(variance), *np.zeros((2, np.size(variance))))


def _misalignment(triad: str) -> ProcessOf:
    return lambda sensors, _: _constants(si(sensors.groups()[triad], "misalignment") ** 2)


def _g_sensitivity(sensors: SensorSuite, _: NavigatorSettings) -> Process:
    return _constants(si(sensors.gyro, "g_sensitivity") ** 2)


def _instability(triad: str) -> ProcessOf:
    """Return the process of the instability of a triad."""

    def process(sensors: SensorSuite, _: NavigatorSettings) -> Process:
        errors = sensors.groups()[triad]
        assert isinstance(errors, GyroErrors | AccelerometerErrors)
        variance, time = si(errors, "instability") ** 2, float(si(errors, "correlation_time"))
        return gauss_markov(np.zeros(3), variance, time)

    return process


def _receiver_drift(sensors: SensorSuite, _: NavigatorSettings) -> Process:
    drift = east_north_up_sizes(si(sensors.gps, "correlated_sigma") ** 2)
    return gauss_markov(np.zeros(3), np.maximum(drift, SMALLEST), sensors.gps.correlation_time)


def _aid_error(name: str, place: int) -> Block:
    """Return the block of the bias or the scale factor of a sensor besides IMU and GPS."""
    aid = next(one for one in AIDS if one.name == name)

    def process(sensors: SensorSuite, _: NavigatorSettings) -> Process:
        errors = sensors.aids()[name]
        constant = si(errors, aid.sigma) ** 2
        if aid.is_scale:
            return _constants(constant)
        return gauss_markov(constant, si(errors, "drift_sigma") ** 2, float(si(errors, "correlation_time")))

    shown = ("", "%", 100.0) if aid.is_scale else (aid.unit, aid.shown_unit, aid.shown_scale)
    return Block((aid.state,), place, *shown, f"sensors.{name}.fitted", process, constant=aid.is_scale)


def _wind(sensors: SensorSuite, _: NavigatorSettings) -> Process:
    errors = sensors.airspeed
    constant, drift = (np.full(2, si(errors, f"wind_{part}") ** 2) for part in ("sigma", "drift_sigma"))
    return gauss_markov(constant, drift, errors.correlation_time)


def _process_of_setting(name: str) -> ProcessOf:
    """Return the process of what a setting of the navigator gives the σ of."""
    return lambda _, navigator: _constants(si(navigator, f"{name}_sigma") ** 2)


GYRO_SCALE, ACCEL_SCALE = "gyro scale", "accelerometer scale"
GYRO_MISALIGNMENT, ACCEL_MISALIGNMENT = "gyro misalignment", "accelerometer misalignment"
GYRO_G = "gyro g-sensitivity"
GYRO_DRIFT, ACCEL_DRIFT = "gyro drift", "accelerometer drift"
GPS_DRIFT, BAROMETER_BIAS, HEADING_BIAS = "GPS drift", "barometer bias", "heading sensor bias"
LEVER_ARM, LATENCY, ODOMETER_SCALE = "lever arm", "latency", "odometer scale"
WIND, AIRSPEED_SCALE = "wind", "airspeed scale"

OF_AIDS = frozenset({*(aid.state for aid in AIDS), WIND})
"""Blocks of the errors of other sensors than IMU and GPS."""

_DEGREES, _MILLI_G = math.degrees(1.0), 1e3 / STANDARD_GRAVITY
"""One radian in °, and one m/s² in mg."""


def _name_states(name: str, parts: Sequence[str]) -> tuple[str, ...]:
    return tuple(f"{name} {part}" for part in parts)


_PART, _ANGLE, _TIME = ("", "%", 100.0), ("rad", "°", _DEGREES), ("s", "s", 1.0)
"""SI unit, shown unit, and shown value of one SI unit: of parts, angles and times;"""
_LENGTH, _SPEED = ("m", "m", 1.0), ("m/s", "m/s", 1.0)
"""of lengths and speeds;"""
_RATE, _FORCE = ("rad/s", "°/s", _DEGREES), ("m/s²", "mg", _MILLI_G)
"""of angular rates and specific forces;"""
_PER_G = ("rad/s/(m/s²)", "°/s/g", _DEGREES * STANDARD_GRAVITY)
"""of the g-sensitivity."""
_ON = "navigator.estimate_"
"""Begin of the settings that add blocks."""

BLOCKS: dict[str, Block] = {
    GYRO_SCALE: Block(_name_states(GYRO_SCALE, "xyz"), strapdown.GYRO_SCALE, *_PART, constant=True),
    ACCEL_SCALE: Block(_name_states(ACCEL_SCALE, "xyz"), strapdown.ACCEL_SCALE, *_PART, constant=True),
    GYRO_MISALIGNMENT: Block(
        _name_states(GYRO_MISALIGNMENT, OFF_DIAGONAL), strapdown.GYRO_MISALIGNMENT, *_ANGLE,
        f"{_ON}misalignments", _misalignment("gyro"), constant=True,
    ),
    ACCEL_MISALIGNMENT: Block(
        _name_states(ACCEL_MISALIGNMENT, OFF_DIAGONAL), strapdown.ACCEL_MISALIGNMENT, *_ANGLE,
        f"{_ON}misalignments", _misalignment("accelerometer"), constant=True,
    ),
    GYRO_G: Block(
        _name_states(GYRO_G, "xyz"), strapdown.GYRO_G, *_PER_G, f"{_ON}g_sensitivity", _g_sensitivity,
        constant=True,
    ),
    GYRO_DRIFT: Block(
        _name_states(GYRO_DRIFT, "xyz"), strapdown.GYRO_DRIFT, *_RATE, f"{_ON}bias_drift",
        _instability("gyro"),
    ),
    ACCEL_DRIFT: Block(
        _name_states(ACCEL_DRIFT, "xyz"), strapdown.ACCEL_DRIFT, *_FORCE, f"{_ON}bias_drift",
        _instability("accelerometer"),
    ),
    GPS_DRIFT: Block(
        _name_states(GPS_DRIFT, ("north", "east", "down")), strapdown.GPS_DRIFT, *_LENGTH, f"{_ON}gps_drift",
        _receiver_drift,
    ),
    BAROMETER_BIAS: _aid_error("barometer", strapdown.BAROMETER_BIAS),
    HEADING_BIAS: _aid_error("heading", strapdown.HEADING_BIAS),
    LEVER_ARM: Block(
        _name_states(LEVER_ARM, ("forward", "right", "down")), strapdown.LEVER_ARM, *_LENGTH,
        f"{_ON}lever_arm", _process_of_setting("lever_arm"), constant=True,
    ),
    LATENCY: Block(
        (LATENCY,), strapdown.LATENCY, *_TIME, f"{_ON}latency", _process_of_setting("latency"), constant=True
    ),
    ODOMETER_SCALE: _aid_error("odometer", strapdown.ODOMETER_SCALE),
    WIND: Block(
        _name_states(WIND, ("north", "east")), strapdown.WIND, *_SPEED, "sensors.airspeed.fitted", _wind
    ),
    AIRSPEED_SCALE: _aid_error("airspeed", strapdown.AIRSPEED_SCALE),
    **{aid.state: _aid_error(aid.name, strapdown.AID_ERRORS + k) for k, aid in enumerate(FURTHER)},
}  # fmt: skip
"""The further blocks by name, in the order of the states of a filter."""
SCALES = (GYRO_SCALE, ACCEL_SCALE)
"""The blocks of a filter with 21 states."""
MISALIGNMENTS = (GYRO_MISALIGNMENT, ACCEL_MISALIGNMENT)
"""The blocks of a filter that estimates misalignments: they act on attitude and velocity, as scales do."""
CONSIDERED = (*MISALIGNMENTS, GYRO_G)
"""The blocks of errors that an alignment at rest considers, and does not estimate; see `rest_alignment`."""
DRIFTS = (GYRO_DRIFT, ACCEL_DRIFT)
"""The blocks of a filter with two bias states for each axis: a constant, and this Gauss-Markov process."""

OWN: dict[str, Block] = {}
"""The blocks that a user declared (`user_states`), which follow all others. Names are unique for ever."""


def block(name: str) -> Block:
    """Return a further block, by its name."""
    return BLOCKS[name] if name in BLOCKS else OWN[name]


def in_order(names: Sequence[str]) -> tuple[str, ...]:
    """Return names of blocks in the order of the states."""
    return tuple(name for name in (*BLOCKS, *OWN) if name in names)


NO_STATE = -1
"""First state of a block that a filter does not have."""
IMU_DENSITIES = 12
"""Process noise densities of every filter: of white noise and biases of the IMU. Those of blocks follow."""


def count(names: Sequence[str]) -> int:
    """Return the number of states of a filter with some further blocks."""
    return CORE + sum(block(name).size for name in names)


def first_state(names: Sequence[str], name: str) -> int:
    """Return the first state of a block in a filter with some further blocks; `NO_STATE` if it lacks it."""
    if name not in names:
        return NO_STATE
    at = CORE
    for other in in_order(names):
        if other == name:
            break
        at += block(other).size
    return at


def find_states(names: Sequence[str], name: str) -> slice:
    """Return the states of a block in a filter that has it."""
    first = first_state(names, name)
    return slice(first, first + block(name).size)


def user_states(names: Sequence[str]) -> slice:
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


def find_places(names: Sequence[str]) -> tuple[int, ...]:
    """Return where the estimates of all states from the biases on are in the state of the navigator."""
    found = list(range(strapdown.GYRO_BIAS, strapdown.GYRO_BIAS + 6))
    for name in in_order(names):
        found += range(block(name).place, block(name).place + block(name).size)
    return tuple(found)
