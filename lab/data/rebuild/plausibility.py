"""Plausibility: whether a vehicle can make a rebuilt flight, and whether the file is consistent.

Position, velocity, attitude, airspeed and recorded rates describe one motion. A wrong unit or sign
violates their agreement by a known factor, which names the likely cause.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy

from lab.base.arrays import Flags, FloatArray, running_sums
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.checks import limits
from lab.data.checks.attitude_check import (
    bank_fault,
    compare_lean,
    heading_fault,
    is_leaning,
    pitch_fault,
    rates_agree,
)
from lab.data.checks.likeness import Likeness, cause, likeness
from lab.data.checks.path_check import UNIT, UNLIKE, path_faults
from lab.data.rebuild.derived_motion import body_rates, euler_at, specific_force
from lab.data.rebuild.raw_flight import VERTICAL_VELOCITY
from lab.data.rebuild.reconstruction import Reconstruction
from lab.data.rebuild.time_repair import RepairedFlight
from lab.flying import coordinated_turn
from lab.motion.frames import ecef

QUESTIONABLE, IMPLAUSIBLE = "questionable", "implausible"

_SLOW = 0.1
"""Least speed by which the airspeed is divided [m/s]."""


@dataclass(frozen=True)
class FlightFinding:
    """Something implausible about a flight.

    Attributes
    ----------
    level : str
        "questionable" or "implausible".
    sentence : str
        The finding and its likely cause.
    """

    level: str
    sentence: str


_UNITS = {  # unit shown, and its factor from SI
    "specific force": ("m/s²", 1.0),
    "body rate": ("°/s", np.degrees(1.0)),
    "climb": ("m/s", 1.0),
    "speed": ("m/s", 1.0),
}
_CAUSES = {
    "specific force": "noise of the positions, wrong time stamps, or feet for metres",
    "body rate": "noise of the attitude, wrong time stamps, or radians for degrees",
    "climb": "feet for metres, or feet per minute for m/s",
    "speed": "knots for m/s, milliseconds for seconds, or radians for degrees",
}


@dataclass(frozen=True, eq=False)
class RebuiltMotion:
    """The motion of a rebuilt flight, at the rate of the recording.

    Attributes
    ----------
    specific_force, body_rate, climb, speed : (n,) arrays
        Lengths of the specific force [m/s²] and the body rate [rad/s]; vertical speed, without sign, and
        speed [m/s].
    acceleration : float
        Median length of the acceleration over the Earth [m/s²].
    leaning : Likeness or None
        How its horizontal specific force follows pitch and roll; None if they are not recorded.
    agreements : tuple of Likeness or None
        How the rates of its attitude follow the recorded ones, about x, y, z; None if there are none.
    """

    specific_force: FloatArray
    body_rate: FloatArray
    climb: FloatArray
    speed: FloatArray
    acceleration: float
    leaning: Likeness | None
    agreements: tuple[Likeness, ...] | None


def motion(flight: RepairedFlight, rebuilt: Reconstruction) -> RebuiltMotion:
    """Return the motion of a flight that was rebuilt from repaired samples."""
    recording = rebuilt.recording
    acceleration = scipy.interpolate.CubicSpline(recording.time, recording.velocity_n)(recording.time, 1)
    force = specific_force(recording.position, recording.velocity_n, acceleration)
    near = ecef.near_pole(recording.latitude)
    rates = np.linalg.norm(body_rates(recording.time, recording.euler), axis=1)
    elsewhere = ~near if not near.all() else near
    return RebuiltMotion(
        specific_force=np.linalg.norm(force, axis=1)[elsewhere],
        body_rate=rates[elsewhere[1:]] if elsewhere[1:].any() else rates,
        climb=np.abs(recording.velocity_n[:, 2]),
        speed=np.linalg.norm(recording.velocity_n, axis=1),
        acceleration=float(np.median(np.linalg.norm(acceleration, axis=1)[elsewhere])),
        leaning=None
        if rebuilt.attitude_reconstructed
        else compare_lean(recording.time, recording.euler, force),
        agreements=_rate_agreement(flight, rebuilt),
    )


def _rate_agreement(flight: RepairedFlight, rebuilt: Reconstruction) -> tuple[Likeness, ...] | None:
    """Return how the rates of the rebuilt attitude follow the recorded body rates, about x, y, z.

    Both as increments over some samples; None where the file has no rates.
    """
    raw, stride = flight.raw, limits.LOG.rate_stride
    if raw.body_rate is None or raw.euler is None or len(raw.time) <= 2 * stride:
        return None
    fastest = float(np.abs(raw.body_rate).max()) * float(np.median(np.diff(raw.time)))
    stride = int(np.clip(limits.LOG.rate_turn // max(fastest, 1e-9), 1, stride))
    euler = euler_at(rebuilt.recording, raw.time)
    derived = body_rates(raw.time, euler, stride) * (raw.time[stride:] - raw.time[:-stride])[:, None]
    steps = np.diff(raw.time)[:, None] * (raw.body_rate[1:] + raw.body_rate[:-1]) / 2
    turned = running_sums(steps)
    recorded = turned[stride:] - turned[:-stride]
    return tuple(likeness(recorded[:, axis], derived[:, axis], centred=False) for axis in range(3))


def findings(
    flight: RepairedFlight, rebuilt: Reconstruction, moves: RebuiltMotion
) -> tuple[FlightFinding, ...]:
    """Return the implausible properties of a flight, worst first.

    Parameters
    ----------
    flight
        The samples it was rebuilt from.
    rebuilt
        The flight.
    moves
        Its motion.
    """
    found = [
        *_beyond_limits(flight, rebuilt, moves),
        *_velocity_against_positions(flight),
        *_attitude_against_path(rebuilt, moves),
        *_rates(moves.agreements),
        *_airspeed(rebuilt),
        *_residuals(rebuilt),
    ]
    return tuple(sorted(found, key=lambda finding: finding.level != IMPLAUSIBLE))


def _derived_quantities(flight: RepairedFlight, rebuilt: Reconstruction) -> dict[str, str]:
    """Return the quantities that the lab derived because the file lacks them, with their sources."""
    made = {}
    if rebuilt.attitude_reconstructed:
        made["body rate"] = "the attitude is not recorded but reconstructed, from slow or noisy motion"
    if VERTICAL_VELOCITY in flight.raw.made and rebuilt.curve == "velocity":
        heights = "the vertical velocity is not recorded but the slope of heights that jump or are noisy"
        made["climb"] = heights
        recording = rebuilt.recording
        level = scipy.interpolate.CubicSpline(recording.time, recording.velocity_n[:, :2])(recording.time, 1)
        often = float(np.quantile(np.linalg.norm(level, axis=1), limits.LOG.reached))
        if np.hypot(often, STANDARD_GRAVITY) < limits.VEHICLES[rebuilt.vehicle].specific_force.possible:
            made["specific force"] = heights
    return made


def _finding(level: str, said: str, likely: str) -> FlightFinding:
    return FlightFinding(level, f"{said}. Likely: {likely}.")


def _beyond_limits(
    flight: RepairedFlight, rebuilt: Reconstruction, moves: RebuiltMotion
) -> Iterator[FlightFinding]:
    vehicle = rebuilt.vehicle
    many = vehicle if vehicle == "aircraft" else f"{vehicle}s"
    made = _derived_quantities(flight, rebuilt)
    causes = {**_CAUSES, **made}
    for name, (unit, factor) in _UNITS.items():
        limit = getattr(limits.VEHICLES[vehicle], name.replace(" ", "_"))
        often = float(np.quantile(getattr(moves, name.replace(" ", "_")), limits.LOG.reached))
        if often > limit.usual and not (name == "body rate" and rates_agree(moves.agreements)):
            # A file is not refused for quantities that the lab derived.
            level = IMPLAUSIBLE if often > limit.possible and name not in made else QUESTIONABLE
            seldom = f"{many} seldom exceed {limit.usual * factor:.4g} {unit}"
            yield _finding(
                level, f"The {name} reaches {often * factor:.4g} {unit}, and {seldom}", causes[name]
            )
    usual = float(np.median(moves.specific_force))
    low, high = limits.LOG.gravity_of_flight
    # A rocket may coast, or hang under its parachute, for most of its flight.
    if vehicle != "rocket" and not low < usual / STANDARD_GRAVITY < high:
        said = f"The specific force is usually {usual:.3g} m/s², and not about gravity's 9.8"
        yield _finding(QUESTIONABLE, said, "a wrong unit of height, velocity or time")


def _velocity_against_positions(flight: RepairedFlight) -> Iterator[FlightFinding]:
    """Compare the displacement by positions with the integral of the recorded velocity."""
    raw = flight.raw
    position, velocity = raw.position, raw.velocity_n
    if velocity is None or position is None:
        return
    if raw.height is None or VERTICAL_VELOCITY in raw.made:
        velocity = velocity * (1.0, 1.0, np.nan)
    for one in path_faults(raw.time, position, velocity):
        name = f"The {'vertical' if one.vertical else 'horizontal'} velocity"
        said = {
            UNIT: f"{name} is {1 / one.like.ratio:.3g} times that of the positions",
            UNLIKE: f"{name} is hardly correlated with the change of the positions (coherence "
            f"{one.like.coherence:.2f})",
        }.get(one.kind, f"{name} does not point where the positions move")
        yield _finding(QUESTIONABLE if one.kind == UNLIKE else IMPLAUSIBLE, said, one.cause)


def _attitude_against_path(rebuilt: Reconstruction, moves: RebuiltMotion) -> Iterator[FlightFinding]:
    """Compare heading, roll and pitch with the path and with the specific force."""
    leaning = moves.leaning
    if leaning is None:
        return
    if rebuilt.vehicle == "copter":
        if is_leaning(leaning, limits.LOG.coherent) and abs(leaning.angle) > limits.LOG.crab:
            side = f"{abs(np.degrees(leaning.angle)):.0f}° to the {'right' if leaning.angle > 0 else 'left'}"
            likely = "the heading is off by that, or pitch and roll have other signs or places"
            yield _finding(
                IMPLAUSIBLE, f"The specific force points {side} of where pitch and roll lean", likely
            )
        return
    velocity, euler = rebuilt.recording.velocity_n, rebuilt.recording.euler
    moving = np.hypot(velocity[:, 0], velocity[:, 1]) > limits.LOG.course_of_flight
    if moving.sum() < limits.LOG.compared_fixes or not limits.VEHICLES[rebuilt.vehicle].shows_heading:
        return
    off = heading_fault(velocity[moving], euler[moving, 2])
    if off is None and rebuilt.vehicle == "aircraft":
        yield from _of_wings(rebuilt, moving)
    elif off is not None and not (
        is_leaning(leaning, limits.LOG.lean) and abs(leaning.angle) < limits.LOG.crab
    ):
        said = f"The heading is usually {np.degrees(off.angle):.0f}° from the direction of motion"
        likely = off.cause or "another column, or a vehicle that moves sideways"
        yield _finding(IMPLAUSIBLE if off.cause else QUESTIONABLE, said, likely)


def _of_wings(rebuilt: Reconstruction, moving: Flags) -> Iterator[FlightFinding]:
    """Compare roll and pitch of an aircraft with its turns and climbs."""
    recording = rebuilt.recording
    velocity, euler = recording.velocity_n, recording.euler[moving]
    bank = coordinated_turn.attitude(recording.time, velocity, "aircraft")[moving, 0]
    kind, factor = bank_fault(bank, euler[:, 0], euler[:, 1])
    if kind == "exchanged":
        yield FlightFinding(IMPLAUSIBLE, "Roll and pitch look exchanged.")
    elif kind:
        said = f"The roll is {factor:.3g} times the value that the turns require"
        yield _finding(IMPLAUSIBLE, said, cause(factor, "angle"))
    slope = pitch_fault(velocity[moving], euler[:, 1])
    if slope != 1.0:
        said = f"The pitch changes by {slope:.3g} times the slope of the path"
        yield _finding(IMPLAUSIBLE, said, cause(slope, "angle"))


def _rates(agreements: tuple[Likeness, ...] | None) -> Iterator[FlightFinding]:
    low, high = limits.LOG.same_rate
    for axis, like in zip(("roll", "pitch", "yaw"), agreements or (), strict=False):
        if like.strength < limits.LOG.increment:
            continue
        if abs(like.correlation) > limits.LOG.axis_correlation and not low < like.slope < high:
            said = f"The attitude turns {like.slope:.3g} times as fast as the recorded {axis} rate says"
            likely = f"{cause(1 / like.slope, 'angle')} in the rate, or the attitude's"
            yield _finding(QUESTIONABLE, said, likely)
        elif abs(like.correlation) < limits.LOG.unlike_rate:
            said = f"The recorded {axis} rate is hardly correlated with the attitude (correlation "
            said += f"{like.correlation:.2f})"
            yield _finding(QUESTIONABLE, said, "another axis, or wrong time stamps")


def _airspeed(rebuilt: Reconstruction) -> Iterator[FlightFinding]:
    airspeed, recording = rebuilt.recording.airspeed, rebuilt.recording
    if airspeed is None or rebuilt.curve == "air data":
        return
    speed = np.linalg.norm(recording.velocity_n, axis=1)
    flying = np.maximum(speed, np.abs(airspeed)) > limits.LOG.airspeed_of_flight
    if flying.sum() < limits.LOG.compared_fixes:
        return
    ratio = float(np.median(airspeed[flying] / np.maximum(speed[flying], _SLOW)))
    low, high = limits.LOG.same_airspeed
    if not low < ratio < high:
        said = f"The airspeed is usually {ratio:.3g} times the speed over the Earth"
        yield _finding(QUESTIONABLE, said, f"{cause(ratio, 'speed')}, or indicated for true airspeed")


def _residuals(rebuilt: Reconstruction) -> Iterator[FlightFinding]:
    residual = rebuilt.position_residual
    off = 0.0 if residual is None else float(np.linalg.norm(residual))
    limit = limits.LOG.air_residual if rebuilt.curve == "air data" else limits.LOG.curve_residual
    if off < limit:
        return
    likely = "velocity and position of different clocks or units; another curve may do better (setting curve)"
    if rebuilt.curve == "position":
        likely = "noise of the positions, or fixes too seldom for the turns (setting smoothing)"
    said = f"The curve from {rebuilt.curve} is {off:.3g} m (rms) from the recorded positions"
    level = IMPLAUSIBLE if off > limits.LOG.implausible_residual * limit else QUESTIONABLE
    yield _finding(level, said, likely)
