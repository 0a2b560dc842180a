"""Live aids: the measurements besides fixes that the live filter uses, as the batch has them.

They are heights by pressure, the magnetic field as a heading, and zero velocity where the IMU shows that the
vehicle stands still.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.live.live_log import magnetometer_of
from lab.live.rolling import Rolling
from lab.magnetic_field import magnetic_declination
from lab.navigation import aids
from lab.navigation.aiding import CONDITION_PERIOD, ROUNDING, of_fields, of_one_kind, zero_velocity
from lab.navigation.aids import Aids
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import Solution
from lab.sensors.heading_sensor import MAGNETOMETER, check_field
from lab.sensors.suite import SensorSuite
from lab.settings import SettingError
from lab.units import si

FloatArray = NDArray[np.float64]

READINGS: Final = {
    "time": ((), np.float64),
    "value": ((), np.float64),
    "innovation": ((), np.float64),
    "variance": ((), np.float64),
}
"""Columns of the readings of a barometer: heights by pressure, and what came of them in the filter."""
FIELDS: Final = {
    "time": ((), np.float64),
    "field": ((3,), np.float64),
    "innovation": ((), np.float64),
    "variance": ((), np.float64),
}
"""Columns of the readings of a magnetometer: directions of the field in b, and what came of them."""


class FirstReadings(NamedTuple):
    """Numbers of the first readings among the measurements of an advance: heights and fields."""

    height: int
    field: int


class LiveAids:
    """The measurements of a filter besides fixes.

    Parameters
    ----------
    sensors, navigator
        The assumptions of the filter.
    readings, fields
        Rows with the columns `READINGS` and `FIELDS`; the results are written into them.
    samples
        Rows with the columns ``time`` and ``standing``.
    """

    def __init__(
        self,
        sensors: SensorSuite,
        navigator: NavigatorSettings,
        readings: Rolling,
        fields: Rolling,
        samples: Rolling,
    ) -> None:
        self.readings, self.fields = readings, fields
        self._sensors, self._samples, self._navigator = sensors, samples, navigator
        self._is_fitted = bool(sensors.barometer.fitted)
        self._has_compass = bool(sensors.heading.fitted) and sensors.heading.source == MAGNETOMETER
        self._declination = np.nan
        self._no_compass = ""  # why the field does not show the heading here
        self._period = -1.0  # number of that of the last field
        self._newest = 0.0  # time of the last row with a field [s]
        self.stands = bool(navigator.zero_velocity)
        """Whether the filter uses zero velocity."""
        self.are_used = self._is_fitted or self._has_compass or self.stands
        """Whether the filter uses any."""
        self.shift = np.nan
        """What is added to the heights [m]."""
        scale = float(navigator.aiding_scale)
        self._variance = scale * float(si(sensors.barometer, "noise")) ** 2
        self._heading_variance = scale * float(si(sensors.heading, "noise")) ** 2
        self._place = si(sensors.odometer, "lever_arm")
        # It is never due. With it, the same compiled loop runs whether there are readings or not.
        self._never = of_one_kind(np.full(1, np.inf), aids.HEIGHT, np.zeros(1), 1.0)

    @property
    def remarks(self) -> dict[str, str]:
        """What becomes of the readings of each sensor; empty if nobody expects any."""
        return {"barometer": self._of_barometer(), "magnetometer": self._of_magnetometer()}

    def _of_barometer(self) -> str:
        there = len(self.readings) > 0
        if not self._is_fitted:
            wanted = "The stream has pressures that are not used; sensors.barometer.fitted = true uses them."
            return wanted if there else ""
        if not there:
            return "The stream has no pressure for sensors.barometer.fitted so far."
        last = _last(self.readings)
        if last is None:
            return "Barometer: no reading was used so far."
        return (
            f"Barometer: the last innovation is {last[0]:.2f} m with σ = {last[1]:.2f} m; heights "
            f"by pressure are shifted by {self.shift:.0f} m, to the height of the first fix."
        )

    def _of_magnetometer(self) -> str:
        there = len(self.fields) > 0
        if not self._has_compass:
            wanted = (
                "The stream has a magnetic field that is used at the start only; sensors.heading.fitted = "
                f"true with sensors.heading.source = {MAGNETOMETER} uses it on."
            )
            return wanted if there else ""
        if self._no_compass or not there:
            return self._no_compass or "The stream has no magnetic field for sensors.heading.fitted so far."
        last = _last(self.fields)
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
        start = self.fields.end
        self.fields.extend(rows.size)
        put = self.fields.rows
        put("time", start, self.fields.end)[:] = found.time[rows]
        field = found.field[rows]
        put("field", start, self.fields.end)[:] = field / np.linalg.norm(field, axis=1)[:, None]
        put("innovation", start, self.fields.end)[:] = np.nan

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
        first, end = (self.readings.number("time", time, "right") for time in (after, until))
        if np.isnan(self.shift) or not self._is_fitted:
            first = end
        time, value = (self.readings.rows(name, first, end) for name in ("time", "value"))
        heights = of_one_kind(time, aids.HEIGHT, value + self.shift, self._variance)
        one, end = (self.fields.number("time", time, "right") for time in (after, until))
        if np.isnan(self._declination):
            one = end
        value = np.full(end - one, self._declination)
        headings = of_one_kind(
            self.fields.rows("time", one, end), aids.HEADING, value, self._heading_variance
        )
        fields = of_fields(self._sensors, headings, self.fields.rows("field", one, end))
        still = zero_velocity(self._standing(begun, after, until), self._navigator) if self.stands else []
        parts = [heights, fields, *still, self._never]
        return Aids.together(parts, self._place), FirstReadings(first, one)

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
        for kind, readings, start in (
            (aids.HEIGHT, self.readings, first.height),
            (aids.MAGNETIC, self.fields, first.field),
        ):
            rows = np.flatnonzero(due & (used.kind == kind))
            readings.rows("innovation", start, start + rows.size)[:] = out.aid_innovation[rows]
            readings.rows("variance", start, start + rows.size)[:] = out.aid_variance[rows]


def _last(readings: Rolling) -> tuple[float, float] | None:
    """Return the last innovation of readings and its σ; None if none was used."""
    innovation = readings.column("innovation")
    used = np.flatnonzero(np.isfinite(innovation))
    if not used.size:
        return None
    return float(innovation[used[-1]]), float(np.sqrt(readings.column("variance")[used[-1]]))
