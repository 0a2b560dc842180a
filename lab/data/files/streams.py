"""Streams: quantities that an autopilot logs at different rates, interpolated to the times of one of them.

Between its messages a quantity follows a cubic spline, an attitude a rotation spline. Times within long
gaps or across resets are left out, not interpolated.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, RotationSpline

from lab.base.arrays import Flags, FloatArray
from lab.base.files.bounds import LATITUDES, LONGITUDES, MIN_SAMPLES
from lab.base.files.mission_error import MissionError
from lab.data.checks import estimator_resets
from lab.data.checks.log_check import check_log
from lab.data.clock.faults import increasing
from lab.data.log.auxiliary_data import AuxiliaryData
from lab.data.log.sensor_log import MAX_LEVER_ARM, GnssLog, SensorLog, believed_sigma, repair_log
from lab.data.rebuild.raw_flight import ColumnUnit, Dropped, RawFlight, Reset
from lab.motion.frames.rotation import euler_from_quaternion, quaternion_from_euler

MAX_LOG_BYTES = 512 * 2**20
"""Largest binary log accepted, as stored and as decompressed [bytes]."""

FIX_3D = 3
"""Kind of a three-dimensional fix: MAVLink's GPS_FIX_TYPE, which ArduPilot's and PX4's logs share."""
MAX_GPS_DELAY = 1.0
"""Longest delay of a GPS that a parameter is believed to give [s]; PX4 itself accepts up to 0.3 s."""
MAX_GEOID_HEIGHT = 200.0
"""Largest height of the geoid over the ellipsoid that is believed [m]: EGM2008 has -107 to 86 m."""
_MAX_NORM_ERROR = 0.1
"""Largest error of a quaternion's norm: rounded ones are off by less than 1e-3, damaged ones by anything."""

Messages = Mapping[str, FloatArray]
"""The fields of the messages of one kind, by name, and their time under `TIME`."""
TIME = "time [s]"
"""Key of the time of messages; none of their fields can have this name."""
SWITCHED_ON = "Time counts from when the autopilot was switched on."
"""What readers of autopilots say of their time."""

_RECEIVER = "GPS"
_MAX_VALUE = 1e12
"""Largest number that a message may hold, in its SI unit: damaged ones hold any."""
_SLOWER = 0.7
"""Rate relative to the samples' below which a quantity counts as interpolated: rates that are meant to be
equal differ by less."""
_MAX_GAP = 1.0
"""Longest time between messages over which a quantity is interpolated [s]; slow ones have
`_MAX_GAP_STEPS`."""
_MAX_GAP_STEPS = 5.0
"""The same in usual steps."""


@dataclass(frozen=True, eq=False)
class Stream:
    """Messages of one kind.

    Attributes
    ----------
    what : str
        Name of the quantity, for messages.
    time : (n,) array
        Time of each, increasing [s].
    values : (n, k) array
        Their values, finite.
    read : int
        How many messages the log has.
    first_lost : int
        Number of the first of them that cannot be used, counted from 1; 0 if all can be.
    counter : (n,) array or None
        The counter of resets, if the log has one.
    resets : (m,) array
        Indices of the first messages after each reset.
    """

    what: str
    time: FloatArray
    values: FloatArray
    read: int
    first_lost: int
    counter: FloatArray | None = None
    resets: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))

    @classmethod
    def of_fields(
        cls,
        what: str,
        messages: Messages | None,
        *names: str,
        valid: Flags | None = None,
        counter: FloatArray | None = None,
    ) -> Stream | None:
        """Return fields of messages as a stream; None without messages, or if a field is missing."""
        values = stack_fields(messages, *names)
        if messages is None or values is None:
            return None
        return cls.of(what, messages[TIME], values, valid, counter)

    @classmethod
    def of_place(
        cls,
        what: str,
        messages: Messages | None,
        place: FloatArray | None,
        valid: Flags | None = None,
        counter: FloatArray | None = None,
    ) -> Stream | None:
        """Return the places (n, 3) of messages, where they are on the Earth; None without any."""
        if messages is None or place is None:
            return None
        fine = is_position(place) if valid is None else is_position(place) & valid
        return cls.of(what, messages[TIME], place, fine, counter)

    @classmethod
    def of(
        cls,
        what: str,
        time: FloatArray,
        values: FloatArray,
        valid: Flags | None = None,
        counter: FloatArray | None = None,
    ) -> Stream:
        """Return the messages that are finite, marked valid, and later than all before.

        Parameters
        ----------
        what
            In words.
        time : (n,) array
            Time of each [s].
        values : (n, k) array
            What each says.
        valid : (n,) array, optional
            Which are valid.
        counter : (n,) array, optional
            The counter of resets.
        """
        values = np.asarray(values, dtype=np.float64)
        values = values[:, None] if values.ndim == 1 else values
        kept = np.isfinite(time) & np.isfinite(values).all(axis=1) & (np.abs(values) < _MAX_VALUE).all(axis=1)
        if valid is not None:
            kept &= valid
        at = np.flatnonzero(kept)
        # Among the sound ones alone: a wild time must not condemn all that come after it.
        kept[at[~increasing(time[at])]] = False
        lost = 0 if kept.all() else int(np.argmin(kept)) + 1
        counted = None if counter is None else counter[kept]
        return cls(what, time[kept], values[kept], len(time), lost, counted)

    def watched(self, kind: estimator_resets.Kind) -> Stream:
        """Return the stream with its resets."""
        return replace(self, resets=estimator_resets.resets(kind, self.time, self.values, self.counter))

    @property
    def usable(self) -> bool:
        """Whether there are enough messages."""
        return len(self.time) >= MIN_SAMPLES

    @property
    def rate(self) -> float:
        """Messages per second, as a rule [Hz]."""
        return 1 / float(np.median(np.diff(self.time)))

    @property
    def lost(self) -> tuple[Dropped, ...]:
        """The report on the messages that cannot be used."""
        count = self.read - len(self.time)
        reason = f"{self.what} not valid, no number or not in order of time"
        return (Dropped(reason, count, self.first_lost),) if count else ()

    def known(self, time: FloatArray) -> Flags:
        """Return at which times the quantity is known."""
        after = np.clip(np.searchsorted(self.time, time), 1, len(self.time) - 1)
        step = np.diff(self.time)[after - 1]
        inside = (time >= self.time[0]) & (time <= self.time[-1])
        known = inside & (step <= max(_MAX_GAP, _MAX_GAP_STEPS / self.rate))
        # Between the last message before a reset and the first after it nothing is known.
        known &= ~np.isin(after, self.resets) | (time == self.time[after])
        # Between two resets in quick succession, there is too little for a spline.
        piece, lengths = self._number_pieces(time), np.diff(self._edges)
        return np.asarray(known & (lengths[piece] >= MIN_SAMPLES))

    def at(self, time: FloatArray) -> FloatArray:
        """Return values (m, k) at times at which they are known."""
        return self._by_pieces(time, lambda t, values, at: scipy.interpolate.CubicSpline(t, values)(at))

    def attitude_at(self, time: FloatArray) -> FloatArray:
        """Return quaternions (m, 4) at times at which they are known, of a stream of quaternions."""

        def interpolate_attitude(t: FloatArray, values: FloatArray, at: FloatArray) -> FloatArray:
            spline = RotationSpline(t, Rotation.from_quat(values, scalar_first=True))
            return np.asarray(spline(at).as_quat(scalar_first=True))

        return self._by_pieces(time, interpolate_attitude)

    @property
    def _edges(self) -> NDArray[np.int64]:
        """Where the pieces between resets begin, and the end of the last."""
        return np.concatenate(([0], self.resets, [len(self.time)])).astype(np.int64)

    def _number_pieces(self, time: FloatArray) -> NDArray[np.int64]:
        # To the right: the first message after a reset is part of its new piece.
        return np.searchsorted(self.time[self.resets], time, side="right")

    def _by_pieces(
        self, time: FloatArray, between: Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
    ) -> FloatArray:
        piece, edges = self._number_pieces(time), self._edges
        found = np.empty((len(time), self.values.shape[1]))
        for number in np.unique(piece):
            rows, part = piece == number, slice(edges[number], edges[number + 1])
            found[rows] = between(self.time[part], self.values[part], time[rows])
        return found


def stack_fields(messages: Messages | None, *names: str) -> FloatArray | None:
    """Return fields of messages side by side (n, k); None without messages, or if one is missing."""
    if messages is None or not set(names) <= set(messages):
        return None
    return np.column_stack([messages[name] for name in names])


def read_place(messages: Messages | None, *names: str) -> FloatArray | None:
    """Return latitude, longitude [rad] and height [m] (n, 3) of fields in ° and m; None if one is missing."""
    place = stack_fields(messages, *names)
    return None if place is None else place * (np.radians(1.0), np.radians(1.0), 1.0)


def is_position(place: FloatArray) -> Flags:
    """Return which latitudes, longitudes [rad] (n, 2 or more) are known and on the Earth.

    Autopilots log zeros before their first fix.
    """
    on_earth = np.abs(place[:, :2]) <= np.radians((LATITUDES[1], LONGITUDES[1]))
    return np.asarray(on_earth.all(axis=1) & (place[:, :2] != 0).any(axis=1))


def make_attitude_stream(quaternions: Stream | None) -> Stream | None:
    """Return the quaternions, scalar first, whose norm is near 1."""
    if quaternions is None:
        return None
    fine = np.abs(np.linalg.norm(quaternions.values, axis=1) - 1) < _MAX_NORM_ERROR
    return Stream.of(quaternions.what, quaternions.time, quaternions.values, fine, quaternions.counter)


def attitude_of_angles(angles: Stream | None, unit: float = 1.0) -> Stream | None:
    """Return roll, pitch, yaw in a unit [rad] as quaternions."""
    return None if angles is None else replace(angles, values=quaternion_from_euler(unit * angles.values))


def geoid_height(heights: FloatArray) -> float | None:
    """Return the height of the geoid over the ellipsoid [m], of those a receiver gives; None without any."""
    known = heights[np.abs(heights) < MAX_GEOID_HEIGHT]
    # Zeros alone are what receivers without a model of the geoid write.
    return float(np.median(known)) if known.size and known.any() else None


def gps_delay(seconds: float) -> float:
    """Return the delay of a GPS that a parameter gives [s]; 0 for one that is not believed."""
    return seconds if 0 <= seconds <= MAX_GPS_DELAY else 0.0


def read_lever_arm(parameters: Mapping[str, float], pairs: Sequence[tuple[str, str]]) -> FloatArray:
    """Return the lever arm (3,) from the IMU to the antenna that parameters give [m]; zero if it is huge.

    Parameters
    ----------
    parameters
        Those of the autopilot.
    pairs
        Beginnings of the names of the places of antenna and IMU; the first is taken whose antenna has one.
    """
    for antenna, imu in pairs:
        if any(f"{antenna}{axis}" in parameters for axis in "XYZ"):
            of_antenna, of_imu = (
                np.array([parameters.get(f"{name}{axis}", 0.0) for axis in "XYZ"]) for name in (antenna, imu)
            )
            arm = of_antenna - of_imu
            return arm if (np.abs(arm) <= MAX_LEVER_ARM).all() else np.zeros(3)
    return np.zeros(3)


def make_gnss_log(
    time: FloatArray,
    place: FloatArray | None,
    velocity: FloatArray | None,
    sigmas: Sequence[FloatArray | None],
    fixed: Flags | None,
    lever_arm: FloatArray,
    latency: float,
    *,
    once: bool = False,
) -> GnssLog:
    """Return the fixes of a receiver, without messages that have no time or no position on the Earth.

    Parameters
    ----------
    time : (n,) array
        Time of the messages [s].
    place, velocity : (n, 3) arrays or None
        Latitude, longitude [rad], height [m]; velocity north, east, down [m/s]; NaN where unknown.
    sigmas
        σ of the position horizontally and vertically [m], and of the velocity [m/s], (n,) each, or None.
    fixed : (n,) array or None
        Which messages have a fix; None if they do not say.
    lever_arm, latency
        As of `GnssLog`.
    once
        Whether a fix that was logged again has the time of the first, and is left out.
    """
    unknown = np.full((len(time), 3), np.nan)
    place, velocity = (unknown if one is None else one for one in (place, velocity))
    fine = np.isfinite(time) & np.isfinite(place).all(axis=1) & is_position(place)
    if fixed is not None:
        fine &= fixed
    if once:
        fine[fine] = increasing(time[fine])
    level, vertical, speed = (unknown[:, 0] if one is None else believed_sigma(one) for one in sigmas)
    of_position, of_velocity = np.column_stack((level, level, vertical)), np.column_stack((speed,) * 3)
    return GnssLog(time, place, velocity, of_position, of_velocity, lever_arm, latency).rows(fine)


def checked_log(path: Path, imu: Stream, gnss: GnssLog, auxiliary: AuxiliaryData) -> SensorLog:
    """Return an IMU and fixes as a sensor log, repaired and checked; may raise a `MissionError`."""
    made = repair_log(str(path), imu.time, imu.values, gnss, auxiliary=auxiliary)
    check_log(made)
    return made


def usable_imu(path: Path, imu: Stream | None, words: str) -> Stream:
    """Return an IMU; `MissionError` if it cannot be used."""
    if imu is None or not imu.usable:
        raise MissionError(f"{path}: {words}")
    return imu


def undecoded_remark(count: int) -> list[str]:
    """Return the remark on bytes of a file that are no messages; none without any."""
    return [f"{count} bytes of the file could not be decoded and are left out."] if count else []


def without_fix(what: str, count: int, field_name: str, kinds: FloatArray | None) -> str:
    """Return that none of some messages has a fix, with the best kind of fix there is."""
    best = 0 if kinds is None else int(np.nan_to_num(kinds).max(initial=0.0))
    return f"none of the {count} {what} has a fix with a position ({field_name} {best} at most)"


def most_frequent(streams: Sequence[Stream | None]) -> Stream | None:
    """Return the usable stream with the highest rate, the first of equal ones; None without any."""
    usable = (one for one in streams if one is not None and one.usable)
    return max(usable, key=lambda one: round(one.rate), default=None)


def first_usable(streams: Sequence[Stream | None]) -> Stream | None:
    """Return the first stream that can be used; None if none can be."""
    return next((stream for stream in streams if stream is not None and stream.usable), None)


def make_flight(
    path: Path,
    reader: str,
    velocity: Stream | None,
    position: Stream | None,
    attitude: Stream | None,
    *,
    units: tuple[ColumnUnit, ...],
    remarks: Sequence[str],
    vehicle: str,
    there_is: Callable[[], str] | None = None,
) -> RawFlight:
    """Return the flight of a log, at the times of velocity or attitude, whichever is logged more often.

    Parameters
    ----------
    path
        The file, for messages.
    reader
        Name of the format.
    velocity
        North, east, down [m/s].
    position
        Latitude, longitude [rad], height [m].
    attitude
        Quaternions, scalar first; None if the log has none.
    units, remarks, vehicle
        As of `RawFlight`.
    there_is
        Says what the log has, for messages.

    Raises
    ------
    MissionError
        If there is no velocity or no position, or they have no time in common.
    """
    said = "" if there_is is None else f". {there_is()}"
    if velocity is None or position is None:
        missing = "velocity" if velocity is None else "position"
        raise MissionError(
            f"{path}: the log has no {missing} that can be used; accepted are logs of a navigation solution "
            f"or of a GPS receiver with its velocity{said}"
        )
    velocity, position, attitude = _watch_resets(velocity, position, attitude)
    base = attitude if attitude is not None and attitude.rate > velocity.rate else velocity
    used = [stream for stream in (velocity, position, attitude) if stream is not None]
    others = [stream for stream in used if stream is not base]
    kept, unknown = _mask_known_together(base, others)
    time = base.time[kept]
    if len(time) < MIN_SAMPLES:
        raise MissionError(
            f"{path}: {' and '.join(stream.what for stream in used)} have {len(time)} times in common; "
            f"accepted are at least {MIN_SAMPLES}{said}"
        )
    place = _position_at(position, time)
    euler = None
    if attitude is not None:
        euler = euler_from_quaternion(
            attitude.values[kept] if attitude is base else attitude.attitude_at(time)
        )
    return RawFlight(
        format=reader,
        time=time,
        latitude=place[:, 0],
        longitude=place[:, 1],
        height=place[:, 2],
        velocity_n=velocity.values[kept] if velocity is base else velocity.at(time),
        euler=euler,
        # Each message counts once: those of the base, and those of the others that are lost.
        rows_read=base.read + sum(other.read - len(other.time) for other in others),
        dropped=(*(drop for stream in used for drop in stream.lost), *unknown),
        units=units,
        remarks=tuple(remarks),
        vehicle=vehicle,
        rates=_list_slower(base, velocity, position, attitude),
        resets=_resets(velocity, position, attitude),
    )


def _mask_known_together(base: Stream, others: Sequence[Stream]) -> tuple[Flags, list[Dropped]]:
    """Return at which times of a stream all others are known, and the report on the other times."""
    kept, dropped = np.ones(len(base.time), dtype=bool), list[Dropped]()
    for other in others:
        known = other.known(base.time)
        dropped += Dropped.of(f"{base.what} while the {other.what} was not logged", kept & ~known)
        kept &= known
    return kept, dropped


def _position_at(position: Stream, time: FloatArray) -> FloatArray:
    """Return latitude, continuous longitude [rad] and height [m] (m, 3) at some times."""
    longitude = np.unwrap(position.values[:, 1])
    places = np.column_stack((position.values[:, 0], longitude, position.values[:, 2]))
    return replace(position, values=places).at(time)


def _watch_resets(
    velocity: Stream, position: Stream, attitude: Stream | None
) -> tuple[Stream, Stream, Stream | None]:
    """Return the streams with their resets; a receiver has no estimator, and is noisy."""
    if _RECEIVER not in velocity.what:
        velocity = velocity.watched(estimator_resets.VELOCITY)
    if _RECEIVER not in position.what:
        position = position.watched(estimator_resets.POSITION)
    return velocity, position, None if attitude is None else attitude.watched(estimator_resets.ATTITUDE)


def _resets(velocity: Stream, position: Stream, attitude: Stream | None) -> tuple[Reset, ...]:
    found = []
    for stream, kind in (
        (attitude, estimator_resets.ATTITUDE), (velocity, estimator_resets.VELOCITY),
        (position, estimator_resets.POSITION),
    ):  # fmt: skip
        if stream is not None:
            found += [
                Reset(float(stream.time[at]), estimator_resets.reported_step(kind, stream.values, int(at)))
                for at in stream.resets
            ]
    return tuple(sorted(found, key=lambda one: one.time))


def _list_slower(
    base: Stream, velocity: Stream, position: Stream, attitude: Stream | None
) -> tuple[tuple[str, float], ...]:
    """Return which quantities are logged less often than the samples, and how often [Hz]."""
    named = (("velocity", velocity), ("position", position), ("attitude", attitude))
    return tuple(
        (name, stream.rate)
        for name, stream in named
        if stream is not None and stream is not base and stream.rate < _SLOWER * base.rate
    )
