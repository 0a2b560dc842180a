"""Live aids: the measurements besides fixes that the live filter uses, as the batch has them.

They are heights by pressure, speeds of an odometer, headings or the magnetic field, and zero velocity where
the IMU shows that the vehicle stands still.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from lab.base.aid_table import AIDS, FURTHER, SENT
from lab.base.arrays import FloatArray
from lab.base.parameters.setting_error import SettingError
from lab.base.parameters.units import si
from lab.data.clock.faults import increasing
from lab.data.streams.live_log import make_magnetometer
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
from lab.navigation.aids import KINDS, Aids
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import Solution
from lab.sensors.heading_sensor import HEADING, MAGNETOMETER, check_field
from lab.sensors.suite import SensorSuite

_HEADING: Final = next(aid for aid in AIDS if aid.name == "heading")
Columns = dict[str, tuple[int, ...]]
"""Shapes of the rows of some columns."""
READINGS: Final[Columns] = {"time": (), "value": (), "innovation": (), "variance": ()}
"""Columns of heights by pressure and of speeds, and what came of them in the filter."""
HEADINGS: Final[Columns] = READINGS | {"sigma": ()}
"""Columns of headings: also their σ; NaN where the device gives none."""
FIELDS: Final[Columns] = {"time": (), "field": (3,), "innovation": (), "variance": ()}
"""Columns of the readings of a magnetometer: directions of the field in b, and what came of them."""


COLUMNS: Final[dict[str, Columns]] = {
    "height": READINGS,
    "speed": READINGS,
    "heading": HEADINGS,
    "field": FIELDS,
    **{aid.live: READINGS for aid in FURTHER if aid.live},
}
"""Columns of heights [m], speeds [m/s], headings [rad], fields, and readings of further sensors."""
Readings = dict[str, Rolling]
"""Readings by the names of `COLUMNS`."""
FirstReadings = dict[str, int]
"""Numbers of the first readings among the measurements of an advance, by the names of `COLUMNS`."""
NONE: Final[FirstReadings] = dict.fromkeys(COLUMNS, 0)
"""The first readings of a filter that uses none."""
_SENSORS: Final = {aid.live: aid for aid in AIDS if aid.live} | {"field": _HEADING}
"""The sensors that give them."""


def empty_readings() -> Readings:
    """Return room for the readings of a stream."""
    return {name: Rolling(columns) for name, columns in COLUMNS.items()}


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
        unused = "field" if sensors.heading.source == HEADING else "heading"
        self._fitted = {
            name
            for name, aid in _SENSORS.items()
            if sensors.aids()[aid.name].get("fitted") and name != unused
        }
        self._declination = np.nan
        self._no_compass = ""  # why the field does not show the heading here
        self._period = -1.0  # number of that of the last field
        self._newest = 0.0  # time of the last row with a field [s]
        self.stands = bool(navigator.zero_velocity)
        """Whether the filter uses zero velocity."""
        self.are_used = bool(self._fitted or self.stands)
        """Whether the filter uses any."""
        self.shift = np.nan
        """What is added to the heights [m]."""
        self._scale = scale = float(navigator.aiding_scale)
        self._variance = {
            name: scale * float(si(sensors.aids()[aid.name], "noise")) ** 2 for name, aid in _SENSORS.items()
        }
        self._place = si(sensors.odometer, "lever_arm")
        # It is never due. With it, the same compiled loop runs whether there are readings or not.
        self._never = of_one_kind(np.full(1, np.inf), aids.HEIGHT, np.zeros(1), 1.0)

    @property
    def remarks(self) -> dict[str, str]:
        """What becomes of the readings of each sensor; empty if nobody expects any."""
        shift = ""
        if np.isfinite(self.shift):
            shift = f"; heights by pressure are shifted by {self.shift:.0f} m, to the height of the first fix"
        at_start = "used at the start only; sensors.heading.fitted = true with sensors.heading.source = "
        field = f"a magnetic field that is {at_start}{MAGNETOMETER} uses it on."
        headings = f"headings that are {at_start}{HEADING} uses them on."
        compass = self._describe_unused("field", "Magnetometer", "magnetic field", field, " of the heading")
        found = {
            "barometer": self._describe_unused("height", "Barometer", "pressure", after=shift),
            "magnetometer": self._no_compass or compass,
            "odometer": self._describe_unused("speed", "Odometer", "speed"),
            "headings": self._describe_unused("heading", "Heading sensor", "heading", headings),
        }
        for aid in (one for one in FURTHER if one.live):
            words = f"{aid.words[0].upper()}{aid.words[1:]}"
            found[aid.name] = self._describe_unused(aid.live, words, aid.live.replace("_", " "))
        return found

    def _describe_unused(
        self, name: str, sensor: str, quantity: str, unused: str = "", of: str = "", after: str = ""
    ) -> str:
        """Return what becomes of some readings, in a sentence; empty if nobody expects any."""
        aid, there = _SENSORS[name], len(self.readings[name]) > 0
        if name not in self._fitted:
            usual = f"{quantity}s that are not used; sensors.{aid.name}.fitted = true uses them."
            return f"The stream has {unused or usual}" if there else ""
        if not there:
            return f"The stream has no {quantity} for sensors.{aid.name}.fitted so far."
        last = _last_innovation(self.readings[name])
        if last is None:
            return f"{sensor}: no reading was used so far."
        form, unit = (".1f", "°") if aid.shown_unit == "°" else (".2f", f" {aid.shown_unit}")
        innovation, sigma = (f"{aid.shown_scale * value:{form}}{unit}" for value in last)
        return f"{sensor}: the last innovation{of} is {innovation} with σ = {sigma}{after}."

    def append_fields(self, time: FloatArray, magnetic: FloatArray) -> None:
        """Append fields, one in each period of the sensor: their errors are those of the vehicle's iron.

        Parameters
        ----------
        time : (n,) array
            Times of rows in the order of arrival [s].
        magnetic : (n, 3) array
            Field in b [T]; NaN, or zero in all axes, where it was not measured.
        """
        good = increasing(time, self._newest)
        self._newest = max(self._newest, *time.tolist()) if time.size else self._newest
        found = make_magnetometer(time[good], magnetic[good])
        if found is None:
            return
        period = np.floor(found.time / float(self._sensors.heading.period))
        rows = np.flatnonzero(np.diff(period, prepend=self._period) > 0)
        self._period = float(period[-1])
        field = found.field[rows]
        _append(
            self.readings["field"], found.time[rows], field=field / np.linalg.norm(field, axis=1)[:, None]
        )

    def append_heights(self, time: FloatArray, height: FloatArray) -> None:
        """Append heights by pressure (n,) [m] at times (n,) in increasing order [s]."""
        _append(self.readings["height"], time, value=height)

    def accept(self, rows: NDArray[np.void], epoch: float, reach: float) -> float:
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
        for name in (aid.live for aid in SENT):
            kept = self.readings[name]
            found = rows[np.isfinite(rows[name])]
            time = found["time"] - epoch
            good = time > max(reach, float(kept.column("time")[-1]) if len(kept) else -np.inf)
            own = {"sigma": found["heading_sigma"][good]} if name == "heading" else {}
            _append(kept, time[good], value=found[name][good], **own)
            if name in self._fitted and good.any():
                earliest = min(earliest, float(time[good][0]))
        return earliest

    def begin_at(self, position: FloatArray) -> None:
        """Take the declination at the first fix (3,) [rad], [m]; later fixes change nothing."""
        if "field" not in self._fitted or np.isfinite(self._declination) or self._no_compass:
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
        known = {"height": np.isfinite(self.shift), "field": np.isfinite(self._declination)}
        first: FirstReadings = {}
        parts = []
        for name, readings in self.readings.items():
            end = readings.number("time", until, "right")
            used = name in self._fitted and known.get(name, True)
            start = readings.number("time", after, "right") if used else end
            first[name] = start
            parts.append(self._part(name, readings, start, end))
        still = (
            zero_velocity(self._seconds_at_rest(begun, after, until), self._navigator) if self.stands else []
        )
        return Aids.together([*parts, *still, self._never], self._place), first

    def _part(self, name: str, readings: Rolling, start: int, end: int) -> Aids:
        """Return readings between two numbers as measurements."""
        time, kind = _rows("time", readings, start, end), KINDS[_SENSORS[name].name]
        variance: float | FloatArray = self._variance[name]
        if name == "field":
            declination = of_one_kind(time, kind, np.full(time.size, self._declination), variance)
            return of_fields(self._sensors, declination, _rows("field", readings, start, end))
        value = _rows("value", readings, start, end)
        if name == "heading":
            variance = known_variance(_rows("sigma", readings, start, end), self._scale, self._variance[name])
        return of_one_kind(time, kind, value + self.shift if name == "height" else value, variance)

    def _seconds_at_rest(self, begun: float, after: float, until: float) -> FloatArray:
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
        for name, readings in self.readings.items():
            kind = aids.MAGNETIC if name == "field" else KINDS[_SENSORS[name].name]
            rows, start = np.flatnonzero(due & (used.kind == kind)), first[name]
            readings.rows("innovation", start, start + rows.size)[:] = out.aid_innovation[rows]
            readings.rows("variance", start, start + rows.size)[:] = out.aid_variance[rows]


def _append(readings: Rolling, time: FloatArray, **columns: FloatArray) -> None:
    """Append readings (n,) at times (n,) [s] that the filter has not used yet."""
    readings.append(time=time, innovation=np.full(time.size, np.nan), **columns)


def _rows(name: str, readings: Rolling, start: int, end: int) -> FloatArray:
    """Return a column of readings between two numbers."""
    return np.asarray(readings.rows(name, start, end))


def _last_innovation(readings: Rolling) -> tuple[float, float] | None:
    """Return the last innovation of readings and its σ; None if none was used."""
    innovation = readings.column("innovation")
    used = np.flatnonzero(np.isfinite(innovation))
    if not used.size:
        return None
    return float(innovation[used[-1]]), float(np.sqrt(readings.column("variance")[used[-1]]))
