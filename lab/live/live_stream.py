"""Live stream: the samples and fixes of one unbroken stream, and the navigators that work on them.

Without fixes, a magnetometer at rest gives its heading. What is kept of it becomes a sensor log for the
batch.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from lab.base.aid_table import SERIES
from lab.base.arrays import FloatArray
from lab.base.files.mission_error import MissionError
from lab.data.log.auxiliary_data import AuxiliaryData, Magnetometer, Series
from lab.data.log.sensor_log import GnssLog, SensorLog
from lab.data.streams.live_log import make_headings, make_magnetometer
from lab.data.streams.rolling import Rolling
from lab.live.attitude_only import NORTH, AttitudeOnly
from lab.live.live_aids import empty_readings
from lab.live.live_filter import FIX_TYPES, FIXES, SAMPLE_TYPES, SAMPLES, LiveFilter
from lab.live.live_state import euler_with_sigma, imu_between
from lab.navigation.alignment import limits
from lab.navigation.alignment.alignment import Alignment
from lab.navigation.alignment.initial_heading import by_magnetometer
from lab.navigation.standstill import SHORTEST

DECLINATION_SIGMA: Final = np.radians(20.0)
"""σ of the magnetic declination at an unknown place [rad]: larger only about the magnetic poles."""
WORSE: Final = np.sqrt(2)
"""σ of a heading, in that of a magnetometer, from which the magnetometer takes its place: it errs by iron,
which no mean removes."""
POSITION_LIMIT: Final = 100.0
"""Largest σ north or east with which a position is shown [m]: ten times that of a poor fix."""
RECENT: Final = 1.5
"""Time over which a vehicle counts as at rest after a sample at rest [s]: rest is known by whole seconds."""


class Sample(NamedTuple):
    """The solution at one sample: as of `lab.navigation.solution.Solution`, and Euler angles, σ [rad]."""

    position: FloatArray
    velocity_n: FloatArray
    q_nb: FloatArray
    bias: FloatArray
    variance: FloatArray
    covariance: FloatArray
    euler: FloatArray
    euler_sigma: FloatArray

    @property
    def is_usable(self) -> bool:
        """Whether there is a solution, with finite numbers."""
        return bool(self.q_nb.any()) and all(np.isfinite(values).all() for values in self)


class Stream:
    """An unbroken stream.

    Parameters
    ----------
    epoch
        Time of the host at its first sample, at which its own time is 0 [s]; NaN before there is one.
    states
        Number of error states of the filter.
    """

    def __init__(self, epoch: float, states: int) -> None:
        self.epoch = epoch
        self.samples = Rolling(SAMPLES | {"variance": (states,)}, SAMPLE_TYPES)
        self.fixes = Rolling(FIXES, FIX_TYPES)
        self.readings = empty_readings()
        self.gaps: list[tuple[float, float]] = []
        """Start and end of the filled gaps [s]."""
        self.filter: LiveFilter | None = None
        """The full navigator, once it started."""
        self.alignment: Alignment | None = None
        """Its start."""
        self.attitude: AttitudeOnly | None = None
        """The navigator without fixes, as long as the full one did not start."""
        self.missing = "No GPS fix has come yet."
        """What the full navigator lacks to start."""
        self.first_fix = 0
        """Number of the first fix of the filter."""

    @property
    def end(self) -> int:
        """Number of the next sample."""
        return self.samples.end

    @property
    def now(self) -> float:
        """Time of the last sample [s]."""
        return float(self.samples.rows("time", self.end - 1, self.end)[0])

    @property
    def fix_age(self) -> float:
        """Time since the last fix [s]; infinite without one."""
        return self.now - float(self.fixes.column("time")[-1]) if len(self.fixes) else float(np.inf)

    @property
    def position_sigma(self) -> float:
        """The larger σ north or east [m]; infinite without a full navigator."""
        if self.filter is None:
            return float(np.inf)
        return float(np.sqrt(self.samples.rows("variance", self.end - 1, self.end)[0, :2].max()))

    @property
    def has_position(self) -> bool:
        """Whether the position means something."""
        return self.position_sigma <= POSITION_LIMIT

    @property
    def is_at_rest(self) -> bool:
        """Whether the vehicle stands still, as far as is known."""
        if self.attitude is not None:
            return self.attitude.rest > 0
        start = self.samples.number("time", self.now - RECENT)
        return bool(self.samples.rows("rest", start, self.end).any())

    def sample(self, number: int) -> Sample:
        """Return the solution at a sample, by its number."""
        # Rows move when the stream makes room, and a view would then show others.
        row = {name: self.samples.rows(name, number, number + 1).copy() for name in Sample._fields[:6]}
        euler, sigma = euler_with_sigma(row["q_nb"], row["variance"], row["covariance"])
        here = {name: values[0] for name, values in row.items()}
        return Sample(**here, euler=euler[0], euler_sigma=sigma[0])

    def shown_heading(self) -> tuple[float, float, str] | None:
        """Return the heading at the first sample with a fix that the IMU shows, its σ and its source.

        None if there is none, or it is less certain than `attitude_only.NORTH`.
        """
        attitude = self.attitude
        if attitude is None or not attitude.heading_is_known or not len(self.fixes):
            return None
        first = min(self.samples.number("time", float(self.fixes.column("time")[0]) - 1e-6), self.end - 1)
        time = float(self.samples.rows("time", first, first + 1)[0])
        # At rest, the heading of now is that of then.
        here = self.sample(self.end - 1 if attitude.rest and time > self.now - attitude.rest else first)
        if not here.is_usable or here.euler_sigma[2] >= NORTH:
            return None
        return float(here.euler[2]), float(here.euler_sigma[2]), attitude.heading_source

    def forget(self, kept: float) -> None:
        """Forget samples and fixes older than `kept` seconds, but for the fix before the oldest sample."""
        # A second at a time, and not with each sample.
        if self.now - float(self.samples.column("time")[0]) < kept + 1.0:
            return
        self.samples.forget(self.samples.number("time", self.now - kept))
        oldest = float(self.samples.column("time")[0])
        self.fixes.forget(self.fixes.number("time", oldest) - 2)
        for readings in self.readings.values():
            readings.forget(readings.number("time", oldest))


def look_at_compass(stream: Stream) -> None:
    """Give the attitude of a stream the heading of its magnetometer at rest, if it has none as good."""
    attitude = stream.attitude
    if attitude is None or not attitude.begun or not attitude.rest:
        return
    if attitude.P[8, 8] <= (WORSE * limits.ALIGNMENT.magnetic_sigma) ** 2:
        return
    samples = stream.samples
    start = max(samples.number("time", stream.now - SHORTEST), samples.first)
    imu = imu_between(samples, start, samples.end - 1)
    field = make_magnetometer(imu.time, samples.rows("magnetic", start, samples.end))
    if field is None:
        return
    here = stream.sample(stream.end - 1)
    place, more = attitude.place, 0.0
    if place is None:
        field, place, more = Magnetometer(field.time, field.field, 0.0), np.zeros(3), DECLINATION_SIGMA
    tilt = float(here.euler_sigma[:2].max())
    level = float(here.euler[0]), float(here.euler[1])
    found = by_magnetometer(imu, field, level, tilt, float(SHORTEST), place)
    if found.source:
        source = f"{found.source}, from magnetic north" if more else found.source
        attitude.give_heading(found.heading, float(np.hypot(found.sigma, more)), source)


def log_of_stream(
    stream: Stream, lever_arm: FloatArray, latency: float, height_shift: float, repairs: tuple[str, ...]
) -> SensorLog:
    """Return the samples of a stream that are kept as a sensor log, whose time 0 is the first of them.

    Parameters
    ----------
    stream
        The stream.
    lever_arm : (3,) array
        From the IMU to the antenna, in b [m].
    latency
        How much later than the fixes their times are [s].
    height_shift
        What is added to a height by pressure [m]; NaN if it is unknown.
    repairs
        What was repaired, as sentences.

    Raises
    ------
    MissionError
        If nothing has come yet.
    """
    samples, fixes = stream.samples, stream.fixes
    if not len(samples):
        raise MissionError("live stream: no sample has come yet; accepted is a stream with samples")
    zero = float(samples.column("time")[0])
    time = samples.column("time") - zero
    gaps = [(max(start, zero), end) for start, end in stream.gaps if end > zero]
    headings, series = stream.readings["heading"], {}
    for aid in SERIES:
        readings = stream.readings.get(aid.live)
        shift = height_shift if aid.name == "barometer" else 0.0
        if readings and not np.isnan(shift):
            series[aid.name] = Series(readings.column("time") - zero, readings.column("value") + shift)
    return SensorLog(
        name="live stream",
        epoch=stream.epoch + zero,
        time=time,
        # An increment leads to its sample, and the first has no sample before it.
        dtheta=samples.column("dtheta")[1:].copy(),
        dvelocity=samples.column("dvelocity")[1:].copy(),
        gnss=GnssLog(
            # A log has times with the latency, which the stream has taken off.
            time=fixes.column("time") + latency - zero,
            position=fixes.column("position").copy(),
            velocity_n=fixes.column("velocity_n").copy(),
            position_sigma=fixes.column("position_sigma").copy(),
            velocity_sigma=fixes.column("velocity_sigma").copy(),
            lever_arm=lever_arm,
            latency=latency,
        ),
        reference=None,
        gaps=np.array(gaps).reshape(-1, 2) - zero,
        repairs=repairs,
        auxiliary=AuxiliaryData.of_series(
            series,
            magnetometer=make_magnetometer(time, samples.column("magnetic")),
            headings=make_headings(
                headings.column("time") - zero, headings.column("value"), headings.column("sigma")
            ),
        ),
    )
