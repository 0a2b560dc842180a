"""Aids: measurements other than GPS fixes, each one number, and how a filter sees them.

A measurement is declared once, as a kind with its kernel: what the navigator says of it minus what was
measured, and the row of H for the errors of position, velocity and attitude in north, east, down and of the
states that only it needs. Vectors are several numbers at one time. A filter takes them one by one.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 6 and
15.1 (zero velocity, non-holonomic constraints), 16.2 (integration of odometer, barometer and magnetometer).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.aid_table import AIDS, FURTHER
from lab.base.arrays import FloatArray
from lab.base.compiling.generated_module import load_module
from lab.navigation import strapdown
from lab.navigation.filters.blocks import CORE, NO_STATE
from lab.navigation.kernels.compilation import inline_kernel, kernel
from lab.navigation.kernels.propagation import STATES
from lab.navigation.strapdown import Matrix, Vector, cross, get, matrix, plus, product, rotate, rotation

BAROMETER_BIAS = HEADING_SENSOR_BIAS = ODOMETER_SCALE = WIND = AIRSPEED_SCALE = NO_STATE
"""First states of the blocks with these names (`propagation.layout_constants`)."""
HEIGHT, FORWARD, RIGHTWARD, DOWNWARD, NORTHWARD, EASTWARD, VERTICAL, HEADING, MAGNETIC, AIRSPEED = range(10)
"""Kinds: height [m]; speed forward, to the right and down of a place of the vehicle [m/s]; velocity north,
east, down [m/s]; true heading [rad]; declination of a magnetic field that is measured in b [rad]; true
airspeed [m/s]."""
NAMES: tuple[str, ...] = (
    "height",
    "speed forward",
    "speed right",
    "speed down",
    "velocity north",
    "velocity east",
    "velocity down",
    "heading",
    "magnetic heading",
    "airspeed",
    *(aid.kinds[0] for aid in FURTHER),
)
"""Names of the kinds, as shown; those of the further sensors of the aid table follow."""
KINDS = {aid.name: NAMES.index(aid.kinds[0]) for aid in AIDS}
"""What the sensors measure, by their group in the settings."""
SENSORS = {NAMES.index(kind): aid.name for aid in AIDS for kind in aid.kinds}
"""Sensors that measure the kinds, by the group of their settings; the others are conditions without one."""
_SHOWN = {kind: (aid.shown_unit, aid.shown_scale) for aid in AIDS for kind in aid.kinds}
SHOWN = tuple(_SHOWN.get(name, ("m/s", 1.0)) for name in NAMES)
"""Unit of each kind on pages and in tables, and its value of one SI unit."""
LEAST_LEVEL = 5.0
"""Least level part of a nose whose heading counts, in σ of the displacement of its tip by tilts. Nearer to
the vertical, the heading is far from normally distributed. In 40 flights of three loops, NEES is 0.96 with
5, and 1.2 to 12 with 3, where some headings mislead the filter for good. A magnetic field is not as steep."""
STILL_AIR = 1e-3
"""Airspeed below which its direction does not count [m/s]: there its derivatives are not defined."""


class Aids(NamedTuple):
    """Measurements other than GPS fixes, one number each.

    Attributes
    ----------
    time : (a,) array
        Times of validity, not decreasing [s].
    kind : (a,) array
        What each measures, such as `HEIGHT`.
    value, variance : (a,) arrays
        The measured values, and their variances as the filter assumes them, in SI units.
    field : (a, 3) array
        Direction of the magnetic field in b, where that is measured.
    place : (3,) array
        The place whose speed is measured, from the IMU forward, right, down [m].
    """

    time: FloatArray
    kind: NDArray[np.int64]
    value: FloatArray
    variance: FloatArray
    field: FloatArray
    place: FloatArray

    def only(self, rows: NDArray[np.bool_]) -> Aids:
        """Return the measurements of a mask (a,)."""
        return self._replace(**{name: getattr(self, name)[rows] for name in self._fields[:5]})

    @classmethod
    def together(cls, parts: list[Aids], place: FloatArray) -> Aids:
        """Return several sets of measurements as one, in the order of their times."""
        if not parts:
            return NO_AIDS
        time, kind, value, variance, field = (
            np.concatenate([getattr(part, name) for part in parts]) for name in cls._fields[:5]
        )
        order = np.argsort(time, kind="stable")
        return cls(time[order], kind[order], value[order], variance[order], field[order], place)


def _nothing() -> Aids:
    values = np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0), np.zeros((0, 3)), np.zeros(3)
    for array in values:
        array.setflags(write=False)
    return Aids(*values)


NO_AIDS = _nothing()
"""No measurements, read-only."""


@inline_kernel
def _see_height(state: FloatArray, age: float, down: float, height: float, H: FloatArray) -> float:
    """Return the height of the navigator minus that of a barometer, with its estimated bias."""
    # The position error is positive down, the height up.
    H[2] = -1.0
    H[5] = age  # the height refers to the time of the measurement
    if BAROMETER_BIAS >= 0:
        H[BAROMETER_BIAS] = 1.0
    return float(state[strapdown.HEIGHT] + age * down - height + state[strapdown.BAROMETER_BIAS])


@inline_kernel
def _see_speed(
    state: FloatArray,
    axis: int,
    C: Matrix,
    v: Vector,
    rate: Vector,
    place: Vector,
    speed: float,
    H: FloatArray,
) -> float:
    """Return the navigator's speed of a place along an axis of the vehicle, minus the measured one.

    v_b = C_bn v_n + ω_ib,b × l; the rotation of the Earth, 0.07 mm/s at a metre, is left out.
    """
    column = C[0][axis], C[1][axis], C[2][axis]
    # δ(c · v) = −(φ × c) · v = φ · (v × c) for the axis c.
    by_attitude = cross(v, column)
    turned = cross(rate, place)
    predicted = v[0] * column[0] + v[1] * column[1] + v[2] * column[2] + turned[axis]
    for i in range(3):
        H[3 + i], H[6 + i] = column[i], by_attitude[i]
    # The rate contains the gyro bias: δ(ω × l) = l × δb / (1 + s).
    x, y, z = place
    per = strapdown.per_scale(state, strapdown.GYRO_SCALE)
    arm = (0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)
    for i in range(3):
        H[9 + i] = arm[axis][i] * per[i]
    if axis == 0:
        scale = 1 + state[strapdown.ODOMETER_SCALE]
        for i in range(12):
            H[i] *= scale
        if ODOMETER_SCALE >= 0:
            H[ODOMETER_SCALE] = predicted
        return float(scale * predicted - speed)
    return float(predicted - speed)


@inline_kernel
def _see_azimuth(state: FloatArray, axis: Vector, azimuth: float, H: FloatArray) -> float:
    """Return the azimuth of an axis by the navigator minus the measured one, with the estimated bias.

    The azimuth of the axis c in n is atan2(c_E, c_N), and φ changes c by −φ × c. The axis is that forward,
    and its azimuth the heading; or that of the magnetic field, and its azimuth the declination.
    """
    north, east, down = axis
    per_level = 1 / (north * north + east * east)
    # The azimuth changes by (c_N δc_E − c_E δc_N) / (c_N² + c_E²), with δc = −φ × c.
    H[6], H[7], H[8] = down * north * per_level, down * east * per_level, -1.0
    if HEADING_SENSOR_BIAS >= 0:
        H[HEADING_SENSOR_BIAS] = 1.0
    off = math.atan2(east, north) - azimuth + state[strapdown.HEADING_BIAS]
    return float(off - 2 * math.pi * math.floor(off / (2 * math.pi) + 0.5))


@inline_kernel
def azimuth_variance(axis: Vector, tilt_variance: float) -> float:
    """Return the variance of the azimuth of an axis from the products of tilts [rad²].

    A tilt moves the end of an axis with the level part l and the part d downwards. An error a of it across
    turns the azimuth by a / l, and to second order by −a b / l² with an error b along the azimuth. Tilts of
    the variance p/2 about each level axis make a and b of the variance d² p/2, and their product has the
    variance (d² p / 2 l²)² (second-order filter: Bar-Shalom, Li & Kirubarajan 10.3.3).

    Parameters
    ----------
    axis
        The axis in n.
    tilt_variance
        Variance p of the tilts about both level axes together [rad²].
    """
    level, down = axis[0] * axis[0] + axis[1] * axis[1], axis[2] * axis[2]
    bend = 0.5 * tilt_variance * down / level
    return bend * bend


@inline_kernel
def _see_airspeed(state: FloatArray, v: Vector, airspeed: float, H: FloatArray) -> float:
    """Return the navigator's speed through the air minus the measured one, with the estimated scale factor.

    It is |v_n − w_n|, with a wind that is level.
    """
    north, east = v[0] - state[strapdown.WIND], v[1] - state[strapdown.WIND + 1]
    predicted = math.sqrt(north * north + east * east + v[2] * v[2])
    scale = 1 + state[strapdown.AIRSPEED_SCALE]
    part = scale / max(predicted, STILL_AIR)
    H[3], H[4], H[5] = part * north, part * east, part * v[2]
    if WIND >= 0:
        H[WIND], H[WIND + 1] = -part * north, -part * east
    if AIRSPEED_SCALE >= 0:
        H[AIRSPEED_SCALE] = predicted
    return float(scale * predicted - airspeed)


@inline_kernel
def _see_none(
    kind: int, state: FloatArray, C: Matrix, v: Vector, age: float, value: float, H: FloatArray
) -> float:
    """Return zero: no further sensor is declared."""
    return 0.0


_FURTHER = '''"""Further aids: how a filter sees the sensors of the aid table with modules of their own."""

from lab.navigation.kernels.compilation import inline_kernel
{imports}

{constants}


@inline_kernel
def see_further(kind, state, C, v, age, value, H):
{branches}
    return 0.0
'''
_BRANCH = """
    if kind == {kind}:
        seen, error = see_{k}(state, C, v, age, H), state[{place}]
        if {is_scale}:
            for i in range({core}):
                H[i] *= 1 + error
        if {first} >= 0:
            H[{first}] = seen if {is_scale} else 1.0
        return ((1 + error) * seen if {is_scale} else seen + error) - value"""


def build_further_kernel() -> Callable[[int, FloatArray, Matrix, Vector, float, float, FloatArray], float]:
    """Return the kernel that sees the further sensors of the aid table, with their biases or scale factors.

    Each has a module of its own with its ``see(state, C, v, age, H)``, which returns what it measures without
    errors, and writes the elements of H for position, velocity, attitude and biases. C takes b to north,
    east, down, and v is the velocity there, both at the time of the reading; the state is that at the end of
    the sample, `age` later.
    """
    if not FURTHER:
        return _see_none
    firsts = [aid.state.upper().replace(" ", "_") for aid in FURTHER]
    branches = (
        _BRANCH.format(
            kind=KINDS[aid.name],
            k=k,
            place=strapdown.AID_ERRORS + k,
            is_scale=aid.is_scale,
            core=CORE,
            first=firsts[k],
        )
        for k, aid in enumerate(FURTHER)
    )
    text = _FURTHER.format(
        imports="\n".join(f"from {aid.belief} import see as see_{k}" for k, aid in enumerate(FURTHER)),
        constants="\n".join(f"{first} = {NO_STATE}" for first in firsts),
        branches="".join(branches),
    )
    return load_module("lab.navigation.further_aids", text).see_further  # type: ignore[no-any-return]


see_further = build_further_kernel()


@kernel
def predict_aid(
    state: FloatArray,
    axes: Matrix,
    kind: int,
    value: float,
    field: FloatArray,
    place: FloatArray,
    age: float,
    dt: float,
    H: FloatArray,
) -> float:
    """Return navigator minus measurement, and write its row of H.

    Parameters
    ----------
    state
        The navigator, after the sample in which the measurement falls.
    axes
        North, east and down in the navigation frame.
    kind, value, field, place
        As of `Aids`.
    age
        Time from the measurement to the end of the sample [s].
    dt
        Length of the sample [s].
    H : (n,) array
        Receives the row for the errors in north, east, down and the sensor errors.
    """
    for i in range(STATES):
        H[i] = 0.0
    v, before = get(state, strapdown.VELOCITY), get(state, strapdown.PREVIOUS_VELOCITY)
    # Back to the time of the measurement, along the straight line between the ends of the sample.
    part = age / dt
    change = v[0] - before[0], v[1] - before[1], v[2] - before[2]
    v = rotate(axes, plus(v, -part, change))
    if kind == HEIGHT:
        return _see_height(state, age, v[2], value, H)
    if NORTHWARD <= kind <= VERTICAL:
        H[3 + kind - NORTHWARD] = 1.0
        return float(v[kind - NORTHWARD] - value)
    if kind == AIRSPEED:
        return _see_airspeed(state, v, value, H)
    rate = plus((0.0, 0.0, 0.0), state[strapdown.PER_STEP], get(state, strapdown.PREVIOUS_DTHETA))
    at = strapdown.Q_NB
    # The attitude, turned back by the corrected rate of the sample.
    q = product(
        (state[at], state[at + 1], state[at + 2], state[at + 3]),
        rotation((-age * rate[0], -age * rate[1], -age * rate[2])),
    )
    C = matrix(q)
    # C takes vectors to the navigation frame; its columns there are turned to north, east, down.
    columns = (
        rotate(axes, (C[0][0], C[1][0], C[2][0])),
        rotate(axes, (C[0][1], C[1][1], C[2][1])),
        rotate(axes, (C[0][2], C[1][2], C[2][2])),
    )
    C = (
        (columns[0][0], columns[1][0], columns[2][0]),
        (columns[0][1], columns[1][1], columns[2][1]),
        (columns[0][2], columns[1][2], columns[2][2]),
    )
    if kind > AIRSPEED:
        return see_further(kind, state, C, v, age, value, H)
    if HEADING <= kind <= MAGNETIC:
        axis = (C[0][0], C[1][0], C[2][0]) if kind == HEADING else rotate(C, get(field, 0))
        return _see_azimuth(state, axis, value, H)
    return _see_speed(state, kind - FORWARD, C, v, rate, get(place, 0), value, H)
