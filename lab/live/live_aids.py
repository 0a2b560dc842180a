"""Live aids: the measurements besides fixes that the live filter uses, as the batch has them.

They are heights by pressure, speeds of an odometer, headings or the magnetic field, and zero velocity where
the IMU shows that the vehicle stands still.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.parameters.setting_error import SettingError
from lab.base.parameters.units import si
from lab.data.streams.live_log import magnetometer_of
from lab.data.streams.rolling import Rolling
from lab.motion.frames.magnetic_field import magnetic_declination
from lab.navigation import aids
from lab.navigation.aiding import (
    CONDITION_PERIOD,
    ROUNDING,
    known_variance,
    of_fields,
    of_one_kind,
    zero_velocity,
)  # fmt: skip
from lab.navigation.aids import Aids
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import Solution
from lab.sensors.heading_sensor import HEADING, MAGNETOMETER, check_field
from lab.sensors.suite import SensorSuite

READINGS: Final = {
    "time": ((), np.float64),
    "value": ((), np.float64),
    "innovation": ((), np.float64),
    "variance": ((), np.float64),
}
"""Columns of heights by pressure and of speeds, and what came of them in the filter."""
HEADINGS: Final = READINGS | {"sigma": ((), np.float64)}
"""Columns of headings: also their σ; NaN where the device gives none."""
FIELDS: Final = {
    "time": ((), np.float64),
    "field": ((3,), np.float64),
    "innovation": ((), np.float64),
    "variance": ((), np.float64),
}
"""Columns of the readings of a magnetometer: directions of the field in b, and what came of them."""


class Readings(NamedTuple):
    """Heights [m], speeds [m/s], headings [rad] and fields.

    The first two have the columns `READINGS`, the others those of `HEADINGS` and `FIELDS`.
    """

    height: Rolling
    speed: Rolling
    heading: Rolling
    field: Rolling


class FirstReadings(NamedTuple):
    """Numbers of the first readings among the measurements of an advance."""

    height: int
    speed: int
    heading: int
    field: int


NONE: Final = FirstReadings(0, 0, 0, 0)
"""The first readings of a filter that uses none."""
_KINDS: Final = FirstReadings(aids.HEIGHT, aids.FORWARD, aids.HEADING, aids.MAGNETIC)


class LiveAids:
    """The measurements of a filter besides fixes.

    Parameters
    ----------
    sensors, navigator
        The assumptions of the filter.
    readings
        The readings; the results are written into them.
    samples
        Rows with the columns ``time`` and ``standing``.
    """

    def __init__(
        self,
        sensors: SensorSuite,
        navigator: NavigatorSettings,
        readings: Readings,
        samples: Rolling,
    ) -> None:
        self.readings = readings
        self._sensors, self._samples, self._navigator = sensors, samples, navigator
        self._is_fitted = bool(sensors.barometer.fitted)
        self._has_odometer = bool(sensors.odometer.fitted)
        magnetic = sensors.heading.source == MAGNETOMETER
        self._has_compass = bool(sensors.heading.fitted) and magnetic
        self._has_antennas = bool(sensors.heading.fitted) and not magnetic
        self._declination = np.nan
        self._no_compass = ""  # why the field does not show the heading here
        self._period = -1.0  # number of that of the last field
        self._newest = 0.0  # time of the last row with a field [s]
        self.stands = bool(navigator.zero_velocity)
        """Whether the filter uses zero velocity."""
        self.are_used = bool(self._is_fitted or self._has_odometer or sensors.heading.fitted or self.stands)
        """Whether the filter uses any."""
        self.shift = np.nan
        """What is added to the heights [m]."""
        self._scale = scale = float(navigator.aiding_scale)
        self._variance = scale * float(si(sensors.barometer, "noise")) ** 2
        self._speed_variance = scale * float(si(sensors.odometer, "noise")) ** 2
        self._heading_variance = scale * float(si(sensors.heading, "noise")) ** 2
        self._place = si(sensors.odometer, "lever_arm")
        # It is never due. With it, the same compiled loop runs whether there are readings or not.
        self._never = of_one_kind(np.full(1, np.inf), aids.HEIGHT, np.zeros(1), 1.0)

    @property
    def remarks(self) -> dict[str, str]:
        """What becomes of the readings of each sensor; empty if nobody expects any."""
        return {
            "barometer": self._of_barometer(),
            "magnetometer": self._of_magnetometer(),
            "odometer": self._of_odometer(),
            "headings": self._of_headings(),
        }

    def _of_odometer(self) -> str:
        there = len(self.readings.speed) > 0
        if not self._has_odometer:
            wanted = "The stream has speeds that are not used; sensors.odometer.fitted = true uses them."
            return wanted if there else ""
        if not there:
            return "The stream has no speed for sensors.odometer.fitted so far."
        last = _last(self.readings.speed)
        if last is None:
            return "Odometer: no reading was used so far."
        return f"Odometer: the last innovation is {last[0]:.2f} m/s with σ = {last[1]:.2f} m/s."

    def _of_headings(self) -> str:
        there = len(self.readings.heading) > 0
        if not self._has_antennas:
            wanted = (
                "The stream has headings that are used at the start only; sensors.heading.fitted = true with "
                f"sensors.heading.source = {HEADING} uses them on."
            )
            return wanted if there else ""
        if not there:
            return "The stream has no heading for sensors.heading.fitted so far."
        last = _last(self.readings.heading)
        if last is None:
            return "Heading sensor: no reading was used so far."
        innovation, sigma = np.degrees(last)
        return f"Heading sensor: the last innovation is {innovation:.1f}° with σ = {sigma:.1f}°."

    def _of_barometer(self) -> str:
        there = len(self.readings.height) > 0
        if not self._is_fitted:
            wanted = "The stream has pressures that are not used; sensors.barometer.fitted = true uses them."
            return wanted if there else ""
        if not there:
            return "The stream has no pressure for sensors.barometer.fitted so far."
        last = _last(self.readings.height)
        if last is None:
            return "Barometer: no reading was used so far."
        return (
            f"Barometer: the last innovation is {last[0]:.2f} m with σ = {last[1]:.2f} m; heights "
            f"by pressure are shifted by {self.shift:.0f} m, to the height of the first fix."
        )

    def _of_magnetometer(self) -> str:
        there = len(self.readings.field) > 0
        if not self._has_compass:
            wanted = (
                "The stream has a magnetic field that is used at the start only; sensors.heading.fitted = "
                f"true with sensors.heading.source = {MAGNETOMETER} uses it on."
            )
            return wanted if there else ""
        if self._no_compass or not there:
            return self._no_compass or "The stream has no magnetic field for sensors.heading.fitted so far."
        last = _last(self.readings.field)
        if last is None:
            return "Magnetometer: no reading was used so far."
        innovation, sigma = np.degrees(last)
        return f"Magnetometer: the last innovation of the heading is {innovation:.1f}° with σ = {sigma:.1f}°."

    def take_fields(self, time: FloatArray, magnetic: FloatArray) -> None:
        """Append fields, one in each period of the sensor: their errors are those of the vehicle's iron.

        Parameters
        ----------
        time : (n,) array
            Times of rows in the order of arrival [s].
        magnetic : (n, 3) array
            Field in b [T]; NaN, or zero in all axes, where it was not measured.
        """
        good = time > np.maximum.accumulate(np.append(self._newest, time))[:-1]
        self._newest = max(self._newest, *time.tolist()) if time.size else self._newest
        found = magnetometer_of(time[good], magnetic[good])
        if found is None:
            return
        period = np.floor(found.time / float(self._sensors.heading.period))
        rows = np.flatnonzero(np.diff(period, prepend=self._period) > 0)
        self._period = float(period[-1])
        field = found.field[rows]
        _append(self.readings.field, found.time[rows], field=field / np.linalg.norm(field, axis=1)[:, None])

    def take_heights(self, time: FloatArray, height: FloatArray) -> None:
        """Append heights by pressure (n,) [m] at times (n,) in increasing order [s]."""
        _append(self.readings.height, time, value=height)

    def take(self, rows: NDArray[np.void], epoch: float, reach: float) -> float:
        """Append headings and speeds; return the earliest time of one that is used, infinite without one [s].

        Parameters
        ----------
        rows : (n,) array of `lab.data.clock.timed_samples.TIMED_READING`
            Readings; the times of each quantity increase.
        epoch
            Time of the host at the first sample of the stream [s].
        reach
            Earliest time to which the filter can return [s]; earlier readings are left out.
        """
        earliest = np.inf
        for name, kept, is_used in (
            ("speed", self.readings.speed, self._has_odometer),
            ("heading", self.readings.heading, self._has_antennas),
        ):
            found = rows[np.isfinite(rows[name])]
            time = found["time"] - epoch
            good = time > max(reach, float(kept.column("time")[-1]) if len(kept) else -np.inf)
            own = {"sigma": found["heading_sigma"][good]} if name == "heading" else {}
            _append(kept, time[good], value=found[name][good], **own)
            if is_used and good.any():
                earliest = min(earliest, float(time[good][0]))
        return earliest

    def begin_at(self, position: FloatArray) -> None:
        """Take the declination at the first fix (3,) [rad], [m]; later fixes change nothing."""
        if not self._has_compass or np.isfinite(self._declination) or self._no_compass:
            return
        try:
            check_field(position[None])
        except SettingError as error:
            self._no_compass = f"The magnetometer is not used: {error}"
        else:
            self._declination, _ = magnetic_declination(position)

    def within(self, begun: float, after: float, until: float) -> tuple[Aids, FirstReadings]:
        """Return the measurements after a time and until another, and the numbers of the first readings.

        Parameters
        ----------
        begun
            Start of the filter, from which the seconds count [s].
        after, until
            The times [s].
        """
        used = FirstReadings(
            self._is_fitted and bool(np.isfinite(self.shift)),
            self._has_odometer,
            self._has_antennas,
            bool(np.isfinite(self._declination)),
        )
        ends = [readings.number("time", until, "right") for readings in self.readings]
        first = FirstReadings(
            *(
                readings.number("time", after, "right") if one else end
                for readings, one, end in zip(self.readings, used, ends, strict=True)
            )
        )
        height, speed, heading, field = (
            (readings, start, end) for readings, start, end in zip(self.readings, first, ends, strict=True)
        )
        magnetic = of_one_kind(
            _rows("time", *field),
            aids.HEADING,
            np.full(field[2] - field[1], self._declination),
            self._heading_variance,
        )
        still = zero_velocity(self._standing(begun, after, until), self._navigator) if self.stands else []
        parts = [
            of_one_kind(
                _rows("time", *height), aids.HEIGHT, _rows("value", *height) + self.shift, self._variance
            ),
            of_one_kind(_rows("time", *speed), aids.FORWARD, _rows("value", *speed), self._speed_variance),
            of_one_kind(
                _rows("time", *heading),
                aids.HEADING,
                _rows("value", *heading),
                known_variance(_rows("sigma", *heading), self._scale, self._heading_variance),
            ),
            of_fields(self._sensors, magnetic, _rows("field", *field)),
            *still,
            self._never,
        ]
        return Aids.together(parts, self._place), first

    def _standing(self, begun: float, after: float, until: float) -> FloatArray:
        """Return the whole seconds since the start in which the vehicle stands still."""
        first = max(int(np.floor((after - begun) / CONDITION_PERIOD)), 1)
        seconds = begun + CONDITION_PERIOD * np.arange(first, int((until - begun) / CONDITION_PERIOD) + 2)
        seconds = seconds[(seconds > after) & (seconds <= until)]
        samples = [self._samples.number("time", second - ROUNDING) for second in seconds.tolist()]
        still = [bool(self._samples.rows("standing", at, at + 1)[0]) for at in samples]
        return np.asarray(seconds[np.array(still, dtype=np.bool_)])

    def keep(self, out: Solution, used: Aids, first: FirstReadings) -> None:
        """Keep the results of readings, which begin with some numbers."""
        due = np.isfinite(used.time)  # without that which is never due
        for kind, readings, start in zip(_KINDS, self.readings, first, strict=True):
            rows = np.flatnonzero(due & (used.kind == kind))
            readings.rows("innovation", start, start + rows.size)[:] = out.aid_innovation[rows]
            readings.rows("variance", start, start + rows.size)[:] = out.aid_variance[rows]


def _append(readings: Rolling, time: FloatArray, **columns: FloatArray) -> None:
    """Append readings (n,) at times (n,) [s] that the filter has not used yet."""
    start = readings.end
    readings.extend(time.size)
    for name, values in (("time", time), ("innovation", np.full(time.size, np.nan)), *columns.items()):
        readings.rows(name, start, readings.end)[:] = values


def _rows(name: str, readings: Rolling, start: int, end: int) -> FloatArray:
    """Return a column of readings between two numbers."""
    return np.asarray(readings.rows(name, start, end))


def _last(readings: Rolling) -> tuple[float, float] | None:
    """Return the last innovation of readings and its σ; None if none was used."""
    innovation = readings.column("innovation")
    used = np.flatnonzero(np.isfinite(innovation))
    if not used.size:
        return None
    return float(innovation[used[-1]]), float(np.sqrt(readings.column("variance")[used[-1]]))
