"""Plausibility: whether a vehicle can make a rebuilt flight, and whether the file is consistent.

Position, velocity, attitude, airspeed and recorded rates describe one motion. A wrong unit or sign
violates their agreement by a known factor, which names the likely cause.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from lab.base.arrays import FloatArray
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.checks.wrong_units import Agreement, agreement, cause
from lab.data.rebuild.derived_motion import body_rates, euler_at, specific_force
from lab.data.rebuild.raw_flight import VERTICAL_VELOCITY
from lab.data.rebuild.reconstruction import Reconstruction
from lab.data.rebuild.time_repair import RepairedFlight
from lab.flying import coordinated_turn
from lab.motion.frames import ecef, rotation

QUESTIONABLE, IMPLAUSIBLE = "questionable", "implausible"

_REACHED_QUANTILE = 0.999
"""Quantile of a quantity that is compared with `LIMITS`: single samples may be wrong in a good recording."""
_GRAVITY_RATIO = (0.6, 1.6)
"""Median specific force of a flight [g]: level flight and cruise have 1; a wrong unit is a factor of 2 and
more."""
_MAX_LEGS, _MIN_LEGS = 200, 20
"""Legs in which the path by position is compared with the path by velocity."""
_MIN_LEG = 2.0
"""Shortest of these legs [s]: in shorter ones the noise of a receiver is as large as the displacement."""
_MIN_EXTENT = 30.0
"""Extent of the positions below which a receiver counts as standing, because of its noise [m]."""
_MIN_PATH = 100.0
"""Shortest path, along an axis, from which it is compared [m]: far beyond the noise of a receiver."""
_MIN_CORRELATION = 0.8
"""Correlation from which a slope means a unit, and below which two series have little in common: with random
errors as large as 3/4 of the motion it is 0.8."""
_CERTAIN_CORRELATION = 0.95
"""Smallest correlation for which another axis, or the opposite sign, is reported as the right one."""
_SAME_VELOCITY = (0.9, 1.1)
"""Slopes of velocity against positions that no wrong unit explains: the nearest factor is 0.51."""
_RADIANS_AS_DEGREES = (20, 65)
"""Slopes of velocity against positions in radians: 57 along the meridian, less where the parallels grow."""
_STRIDE = 5
"""Samples over which the increments of attitude and rates are compared: jitter of one sample averages out."""
_SAME_RATE = (0.8, 1.25)
"""Slopes of attitude against recorded rates that are no wrong unit: the nearest factor is 57. On the shipped
flights, an attitude that lags behind with a time constant of 0.5 s has slopes of 0.87 or more, with 1 s 0.73
or more."""
_MIN_RATE_CORRELATION = 0.5
"""Correlation below which a recorded rate has little to do with the attitude."""
_MIN_TURN = np.radians(0.2)
"""Rms increment of an axis from which it is judged [rad]: less is noise of the attitude."""
_MIN_COURSE_SPEED = 5.0
"""Speed from which attitude is compared with the course [m/s]: an error of 0.5 m/s across turns the course by
6°, and no vehicle moves backwards so fast (`forward_speed` of `lab.navigation.alignment.limits`)."""
_MIN_MOVING_SAMPLES = 20
"""Fewest samples at such a speed, or airspeed, by which they are compared."""
_MAX_CRAB = np.radians(35.0)
"""Median angle between heading and course that wind explains [rad]: 17 m/s across an airspeed of 30 m/s."""
_CLEARLY_BETTER = 1 / 3
"""Largest remaining fraction of that angle with another reading of the heading for which that reading is
reported."""
_MIN_BANKING, _MIN_CLIMBING = np.radians(4.0), np.radians(1.5)
"""σ of the bank of coordinated turns, and of the slope of the path, from which roll and pitch are judged
[rad]."""
_MIN_ATTITUDE_CORRELATION = 0.6
"""Correlation of roll and pitch with the path from which their slope is judged: sideslip and changes of
the angle of attack leave it above 0.6."""
_SAME_ROLL, _SAME_PITCH = (0.5, 2.0), (0.2, 5.0)
"""Slopes of roll against the coordinated bank, and of pitch against the path, that are no wrong unit (57)."""
_MIN_AIRSPEED = 15.0
"""Airspeed or speed from which their ratio is judged [m/s]: at lower ones, a wind of 6 m/s takes the ratio
beyond `_SAME_AIRSPEED`."""
_SAME_AIRSPEED = (0.6, 1.6)
"""Median airspeed over speed that wind and density of the air explain; a knot is 0.51 m/s."""
_SLOW = 0.1
"""Least speed by which the airspeed is divided [m/s]."""
_MAX_RESIDUAL, _MAX_AIR_RESIDUAL = 10.0, 500.0
"""Rms distance of a plausible curve from the positions [m]: of one from velocity or positions, where a
receiver is off by a few metres; and of one from air data, where the wind changes."""
_IMPLAUSIBLE_RESIDUAL = 20
"""Multiple of these from which the flight is implausible. On the shipped flights, velocities in a wrong unit
leave 2 to 39 m, and velocities that are 5 s late 8 to 23 m: 200 m is another motion than that of the
positions."""


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


@dataclass(frozen=True)
class Range:
    """The usual and the possible maximum of a quantity of a vehicle."""

    usual: float
    possible: float


LIMITS: Mapping[str, Mapping[str, Range]] = {
    "aircraft": {
        "specific force": Range(50.0, 120.0),
        "body rate": Range(np.radians(150), np.radians(500)),
        "climb": Range(80.0, 250.0),
        "speed": Range(350.0, 1000.0),
    },
    "car": {
        "specific force": Range(30.0, 100.0),
        "body rate": Range(np.radians(120), np.radians(500)),
        "climb": Range(10.0, 50.0),
        "speed": Range(80.0, 200.0),
    },
    "boat": {
        "specific force": Range(25.0, 100.0),
        "body rate": Range(np.radians(90), np.radians(500)),
        "climb": Range(3.0, 20.0),
        "speed": Range(40.0, 120.0),
    },
}
"""For each vehicle: specific force [m/s²], body rate [rad/s], vertical and whole speed [m/s]. A plain
choice: aerobatic aeroplanes, rally cars and racing boats reach what is usual; no crew bears more than what
is possible."""

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
    """

    specific_force: FloatArray
    body_rate: FloatArray
    climb: FloatArray
    speed: FloatArray
    acceleration: float


def motion(rebuilt: Reconstruction) -> RebuiltMotion:
    """Return the motion of a rebuilt flight."""
    recording = rebuilt.recording
    position = np.stack((recording.latitude, recording.longitude, recording.height), axis=-1)
    acceleration = CubicSpline(recording.time, recording.velocity_n)(recording.time, 1)
    near = ecef.near_pole(recording.latitude)
    force = specific_force(position, recording.velocity_n, acceleration)
    rates = np.linalg.norm(body_rates(recording.time, recording.euler), axis=1)
    elsewhere = ~near if not near.all() else near
    return RebuiltMotion(
        specific_force=np.linalg.norm(force, axis=1)[elsewhere],
        body_rate=rates[elsewhere[1:]] if elsewhere[1:].any() else rates,
        climb=np.abs(recording.velocity_n[:, 2]),
        speed=np.linalg.norm(recording.velocity_n, axis=1),
        acceleration=float(np.median(np.linalg.norm(acceleration, axis=1)[elsewhere])),
    )


def rate_agreement(flight: RepairedFlight, rebuilt: Reconstruction) -> tuple[Agreement, ...] | None:
    """Return how the recorded body rates agree with those of the rebuilt attitude, about x, y, z.

    Both as increments over five samples; None where the file has no rates.
    """
    raw = flight.raw
    if raw.body_rate is None or raw.euler is None or len(raw.time) <= 2 * _STRIDE:
        return None
    euler = euler_at(rebuilt.recording, raw.time)
    derived = body_rates(raw.time, euler, _STRIDE) * (raw.time[_STRIDE:] - raw.time[:-_STRIDE])[:, None]
    steps = np.diff(raw.time)[:, None] * (raw.body_rate[1:] + raw.body_rate[:-1]) / 2
    turned = np.concatenate((np.zeros((1, 3)), np.cumsum(steps, axis=0)))
    recorded = turned[_STRIDE:] - turned[:-_STRIDE]
    return tuple(agreement(recorded[:, axis], derived[:, axis]) for axis in range(3))


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
        *_attitude_against_path(rebuilt),
        *_rates(flight, rebuilt),
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
        level = CubicSpline(recording.time, recording.velocity_n[:, :2])(recording.time, 1)
        often = float(np.quantile(np.linalg.norm(level, axis=1), _REACHED_QUANTILE))
        if np.hypot(often, STANDARD_GRAVITY) < LIMITS[rebuilt.vehicle]["specific force"].possible:
            made["specific force"] = heights
    return made


def _beyond_limits(
    flight: RepairedFlight, rebuilt: Reconstruction, moves: RebuiltMotion
) -> list[FlightFinding]:
    vehicle, found = rebuilt.vehicle, []
    many = vehicle if vehicle == "aircraft" else f"{vehicle}s"
    made = _derived_quantities(flight, rebuilt)
    causes = {**_CAUSES, **made}
    for name, limit in LIMITS[vehicle].items():
        unit, factor = _UNITS[name]
        often = float(np.quantile(getattr(moves, name.replace(" ", "_")), _REACHED_QUANTILE))
        if often > limit.usual:
            # A file is not refused for quantities that the lab derived.
            level = IMPLAUSIBLE if often > limit.possible and name not in made else QUESTIONABLE
            found.append(
                FlightFinding(
                    level,
                    f"The {name} reaches {often * factor:.4g} {unit}, and {many} seldom exceed "
                    f"{limit.usual * factor:.4g} {unit}. Likely: {causes[name]}.",
                )
            )
    usual = float(np.median(moves.specific_force))
    if not _GRAVITY_RATIO[0] < usual / STANDARD_GRAVITY < _GRAVITY_RATIO[1]:
        found.append(
            FlightFinding(
                QUESTIONABLE,
                f"The specific force is usually {usual:.3g} m/s², and not about gravity's 9.8. Likely: "
                "a wrong unit of "
                "height, velocity or time.",
            )
        )
    return found


def _velocity_against_positions(flight: RepairedFlight) -> list[FlightFinding]:
    """Compare the displacement by positions with the integral of the recorded velocity, in legs."""
    raw = flight.raw
    if raw.velocity_n is None or raw.latitude is None or raw.longitude is None:
        return []
    count = int(np.clip(raw.time[-1] / _MIN_LEG, _MIN_LEGS, _MAX_LEGS))
    legs = np.unique(np.linspace(0, len(raw.time) - 1, count + 1).astype(int))
    height = np.zeros(len(raw.time)) if raw.height is None else raw.height
    position = np.stack((raw.latitude, raw.longitude, height), axis=-1)[legs]
    steps = np.diff(raw.time)[:, None] * (raw.velocity_n[1:] + raw.velocity_n[:-1]) / 2
    travelled = np.concatenate((np.zeros((1, 3)), np.cumsum(steps, axis=0)))[legs]
    by_velocity, by_position = np.diff(travelled, axis=0), ecef.displacement(position[:-1], position[1:])
    if ecef.near_pole(position[:, 0]).any() or np.abs(by_position[:, :2]).sum() < _MIN_PATH:
        return []
    if np.linalg.norm(np.ptp(np.cumsum(by_position[:, :2], axis=0), axis=0)) < _MIN_EXTENT:
        return []
    swapped = _swapped(by_position, by_velocity)
    if swapped:
        return [swapped]
    found = []
    level = agreement(by_position[:, :2].ravel(), by_velocity[:, :2].ravel())
    axes = {"The horizontal velocity": level}
    recorded = raw.height is not None and VERTICAL_VELOCITY not in raw.made
    if recorded and np.abs(by_position[:, 2]).sum() > _MIN_PATH:
        axes["The vertical velocity"] = agreement(by_position[:, 2], by_velocity[:, 2])
    for name, like in axes.items():
        if (
            abs(like.correlation) > _MIN_CORRELATION
            and not _SAME_VELOCITY[0] < like.slope < _SAME_VELOCITY[1]
        ):
            noisy = like.explained_by_noise()
            words = _cause_of_slope(like.slope) if like is level else cause(like.slope, "speed")
            words = "noise of the positions, or fixes too seldom for the motion" if noisy else words
            sentence = f"{name} is {like.slope:.3g} times that of the positions. Likely: {words}."
            found.append(FlightFinding(QUESTIONABLE if noisy else IMPLAUSIBLE, sentence))
        elif abs(like.correlation) <= _MIN_CORRELATION:
            found.append(
                FlightFinding(
                    QUESTIONABLE,
                    f"{name} is hardly correlated with the change of the positions (correlation "
                    f"{like.correlation:.2f}). Likely: other axes than north, east, down, or another clock.",
                )
            )
    return found


def _cause_of_slope(slope: float) -> str:
    """Return what probably makes a velocity too large for the positions."""
    # Radians shrink latitude and longitude, and with the latitude the parallels grow.
    if _RADIANS_AS_DEGREES[0] < abs(slope) < _RADIANS_AS_DEGREES[1]:
        return "latitude and longitude in radians read as degrees"
    return cause(slope, "speed")


def _swapped(by_position: FloatArray, by_velocity: FloatArray) -> FlightFinding | None:
    straight = agreement(by_position[:, :2].ravel(), by_velocity[:, :2].ravel()).correlation
    across = agreement(by_position[:, :2].ravel(), by_velocity[:, 1::-1].ravel()).correlation
    if across > _CERTAIN_CORRELATION and straight < _MIN_CORRELATION:
        return FlightFinding(IMPLAUSIBLE, "The velocities north and east look exchanged.")
    for axis, name in enumerate(("north", "east")):
        if np.abs(by_position[:, axis]).sum() > _MIN_PATH:
            one = agreement(by_position[:, axis], by_velocity[:, axis])
            if one.correlation < -_CERTAIN_CORRELATION:
                return FlightFinding(IMPLAUSIBLE, f"The velocity {name} has the opposite sign.")
    return None


def _attitude_against_path(rebuilt: Reconstruction) -> list[FlightFinding]:
    """Compare heading, roll and pitch with the path."""
    recording = rebuilt.recording
    if rebuilt.attitude_reconstructed:
        return []
    velocity, euler = recording.velocity_n, recording.euler
    moving = np.hypot(velocity[:, 0], velocity[:, 1]) > _MIN_COURSE_SPEED
    if moving.sum() < _MIN_MOVING_SAMPLES:
        return []
    found = _heading(velocity[moving], euler[moving, 2])
    if rebuilt.vehicle == "aircraft" and not found:
        found += _bank(rebuilt, moving)
        found += _pitch(velocity[moving], euler[moving, 1])
    return found


def _heading(velocity: FloatArray, yaw: FloatArray) -> list[FlightFinding]:
    course = np.arctan2(velocity[:, 1], velocity[:, 0])
    off = _usual_angle(yaw - course)
    if off < _MAX_CRAB:
        return []
    guesses = {
        "radians read as degrees": np.degrees(yaw),
        "degrees read as radians": np.radians(yaw),
        "it has the opposite sign": -yaw,
        "counted from east, anticlockwise": np.pi / 2 - yaw,
        "it is reversed by 180°": yaw + np.pi,
    }
    best = min(guesses, key=lambda name: _usual_angle(guesses[name] - course))
    sentence = f"The heading is usually {np.degrees(off):.0f}° from the direction of motion"
    if _usual_angle(guesses[best] - course) < _CLEARLY_BETTER * off:
        return [FlightFinding(IMPLAUSIBLE, f"{sentence}. Likely: {best}.")]
    return [
        FlightFinding(QUESTIONABLE, f"{sentence}. Likely: another column, or a vehicle that moves sideways.")
    ]


def _bank(rebuilt: Reconstruction, moving: NDArray[np.bool_]) -> list[FlightFinding]:
    recording = rebuilt.recording
    expected = coordinated_turn.attitude(recording.time, recording.velocity_n, "aircraft")[moving, 0]
    roll = rotation.wrap(recording.euler[moving, 0])
    if np.std(expected) < _MIN_BANKING:
        return []
    like = agreement(expected, roll)
    if (
        like.correlation < _MIN_CORRELATION
        and agreement(expected, recording.euler[moving, 1]).correlation > _CERTAIN_CORRELATION
    ):
        return [FlightFinding(IMPLAUSIBLE, "Roll and pitch look exchanged.")]
    if abs(like.correlation) < _MIN_ATTITUDE_CORRELATION or _SAME_ROLL[0] < like.slope < _SAME_ROLL[1]:
        return []
    return [
        FlightFinding(
            IMPLAUSIBLE,
            f"The roll is {like.slope:.3g} times the value that the turns require. Likely: "
            f"{cause(like.slope, 'angle')}.",
        )
    ]


def _pitch(velocity: FloatArray, pitch: FloatArray) -> list[FlightFinding]:
    climb = np.arctan2(-velocity[:, 2], np.hypot(velocity[:, 0], velocity[:, 1]))
    if np.std(climb) < _MIN_CLIMBING:
        return []
    like = agreement(climb - climb.mean(), pitch - pitch.mean())
    unlike = not _SAME_PITCH[0] < like.slope < _SAME_PITCH[1]
    if like.correlation < -_MIN_ATTITUDE_CORRELATION or (
        like.correlation > _MIN_ATTITUDE_CORRELATION and unlike
    ):
        return [
            FlightFinding(
                IMPLAUSIBLE,
                f"The pitch changes by {like.slope:.3g} times the slope of the path. Likely: "
                f"{cause(like.slope, 'angle')}.",
            )
        ]
    return []


def _rates(flight: RepairedFlight, rebuilt: Reconstruction) -> list[FlightFinding]:
    agreements = rate_agreement(flight, rebuilt)
    if agreements is None:
        return []
    found = []
    for axis, like in zip(("roll", "pitch", "yaw"), agreements, strict=True):
        if like.strength < _MIN_TURN:
            continue
        if abs(like.correlation) > _MIN_CORRELATION and not _SAME_RATE[0] < like.slope < _SAME_RATE[1]:
            found.append(
                FlightFinding(
                    QUESTIONABLE,
                    f"The attitude turns {like.slope:.3g} times as fast as the recorded {axis} rate "
                    "says. Likely: "
                    f"{cause(1 / like.slope, 'angle')} in the rate, or the attitude's.",
                )
            )
        elif abs(like.correlation) < _MIN_RATE_CORRELATION:
            found.append(
                FlightFinding(
                    QUESTIONABLE,
                    f"The recorded {axis} rate is hardly correlated with the attitude (correlation "
                    f"{like.correlation:.2f}). Likely: another axis, or wrong time stamps.",
                )
            )
    return found


def _airspeed(rebuilt: Reconstruction) -> list[FlightFinding]:
    airspeed, recording = rebuilt.recording.airspeed, rebuilt.recording
    if airspeed is None or rebuilt.curve == "air data":
        return []
    speed = np.linalg.norm(recording.velocity_n, axis=1)
    flying = np.maximum(speed, np.abs(airspeed)) > _MIN_AIRSPEED
    if flying.sum() < _MIN_MOVING_SAMPLES:
        return []
    ratio = float(np.median(airspeed[flying] / np.maximum(speed[flying], _SLOW)))
    if _SAME_AIRSPEED[0] < ratio < _SAME_AIRSPEED[1]:
        return []
    return [
        FlightFinding(
            QUESTIONABLE,
            f"The airspeed is usually {ratio:.3g} times the speed over the Earth. Likely: "
            f"{cause(ratio, 'speed')}, or indicated for true airspeed.",
        )
    ]


def _residuals(rebuilt: Reconstruction) -> list[FlightFinding]:
    residual = rebuilt.position_residual
    if residual is None:
        return []
    off = float(np.linalg.norm(residual))
    limit = _MAX_AIR_RESIDUAL if rebuilt.curve == "air data" else _MAX_RESIDUAL
    if off < limit:
        return []
    level = IMPLAUSIBLE if off > _IMPLAUSIBLE_RESIDUAL * limit else QUESTIONABLE
    words = "velocity and position of different clocks or units; another curve may do better (setting curve)"
    if rebuilt.curve == "position":
        words = "noise of the positions, or fixes too seldom for the turns (setting smoothing)"
    said = (
        f"The curve from {rebuilt.curve} is {off:.3g} m (rms) from the recorded positions. Likely: {words}."
    )
    return [FlightFinding(level, said)]


def _usual_angle(angle: FloatArray) -> float:
    return float(np.median(np.abs(rotation.wrap(angle))))
