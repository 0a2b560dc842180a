"""Reception: bytes that arrived become timed samples in the axes of the vehicle.

It depends on the bytes and the times of their arrival alone, so a replay of a raw recording gives the same
samples, bit for bit. Bytes -> samples (`StreamDetector`) -> times (`ImuClock`) -> rows (`VehicleRows`,
`FixRows`); a unit in doubt is decided by the first turn (`UnitQuestion`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.data.clock.device_clock import DeviceClock
from lab.data.clock.timed_samples import NO_READINGS, ReadingTimes
from lab.data.protocols.column_map import UNITS_OF, Column, ColumnMap, ColumnMapError, spell_unit
from lab.data.protocols.samples import Samples
from lab.data.protocols.text_lines import TextLines
from lab.data.streams.axis_map import AxisMap
from lab.data.streams.axis_units import AxisUnits
from lab.data.streams.imu_clock import ImuClock
from lab.data.streams.stream_detector import StreamDetector
from lab.data.streams.transport import Chunk, TransportError
from lab.data.streams.unit_question import UnitQuestion, format_question
from lab.data.streams.vehicle_rows import NO_FIXES, NO_IMU, FixRows, VehicleRows

Rows = NDArray[np.void]

_PACED = 3.0
"""Time over which the times of a text are compared with those of their arrival, twice in a row [s]."""
_NEAR_THOUSAND = 0.05
"""Largest part of a power of 1000 by which the pace may miss it: a factor of 1.4."""
_TIMES = ("s", "ms", "µs", "ns")
"""Units of times that differ by 1000."""
_UNPACED = (math.nan, math.nan, 0)
"""No time of a text has come yet."""
_SHOWN_BY_TURNS = ("mrad/s", "m°/s")
"""Units of rates that nobody is asked about, as sensors send them rarely, but that a turn may show."""


@dataclass
class Loss:
    """Losses between the device and the filter.

    Attributes
    ----------
    missing : int
        Samples that the device's clock or counter shows to be missing.
    repeated : int
        Samples that came twice, with the same time and values, of which one is dropped.
    backwards : int
        Samples that came after later ones, which are dropped.
    jumps : int
        How often the device's clock was set, began anew, or became useless, while samples came.
    """

    missing: int = 0
    repeated: int = 0
    backwards: int = 0
    jumps: int = 0


class Reception:
    """Receives one stream.

    Attributes
    ----------
    detector : StreamDetector
        Finds and holds the decoder.
    imu : ImuClock
        Times the samples of the IMU.
    rows : VehicleRows
        Their axes and calibration, which may be replaced at any time, for the samples that come then.
    fixes : FixRows
        Times the fixes.
    decided : str
        How the unit of the angular rates was decided, in a sentence; empty while it was not.
    axis_units : AxisUnits or None
        Whether the axes of a text are in different units; None without text.

    Parameters
    ----------
    protocol
        A key of `DECODERS`, or ``FILE.py:Name``; empty to find out.
    columns
        Of text: what they are; empty to find out.
    axes
        The axis map.
    rate
        Of a device without a clock [Hz]; 0 to find out.
    said, units
        Of text whose columns are to be found out: what a person says of columns, and of the unit of a
        quantity, as of `lab.data.protocols.text_lines.TextLines`.

    Raises
    ------
    TransportError
        If columns or units are given for another protocol than text.
    ColumnMapError, DecoderError
        If they are not accepted.
    """

    def __init__(
        self,
        protocol: str = "",
        columns: str | ColumnMap = "",
        axes: AxisMap | None = None,
        rate: float = 0.0,
        *,
        said: Mapping[str, str] | None = None,
        units: Mapping[str, str] | None = None,
    ) -> None:
        is_text = bool(columns or said or units)
        if is_text and protocol not in ("", TextLines.name):
            raise TransportError(f"columns are of text lines, and the protocol is {protocol!r}")
        for text in (said or {}).values():
            Column.of(text).check()
        units = {kind: checked_unit(kind, unit) for kind, unit in (units or {}).items()}
        known = ColumnMap.of(columns) if isinstance(columns, str) and columns else columns or None
        # For mypy: an empty text has become None above.
        assert not isinstance(known, str)
        self.rows = VehicleRows(axes or AxisMap())
        self.imu = ImuClock(rate, self.rows.put, NO_IMU)
        self.fixes = FixRows()
        self.detector = StreamDetector("text" if columns or said else protocol, known, said or {}, units)
        self._reading_times = ReadingTimes()
        self._readings: list[Rows] = []  # timed, and not yet taken
        self._question: UnitQuestion | None = None
        self.axis_units: AxisUnits | None = None
        self._factor = 1.0
        self.decided = ""
        self._paced = _UNPACED  # when a time of text arrived, the time, and its pace in powers of 1000

    @property
    def loss(self) -> Loss:
        """Losses between the device and the filter, so far."""
        watch = self.imu.watch
        return Loss(self.imu.missing, watch.repeated, watch.backwards, watch.jumps)

    @property
    def described(self) -> str:
        """What speaks for the protocol, and what the decoder found out about the device, in sentences."""
        return " ".join(
            text for text in (self.detector.described, self.decided, *self.fixes.positions) if text
        )

    @property
    def doubt(self) -> tuple[str, ...]:
        """Units that the angular rates may have, the one that is used first; empty where it is known."""
        columns = self.detector.columns
        return () if columns is None else columns.doubt

    @property
    def question(self) -> str:
        """What a person should decide about units, in sentences; empty without a doubt."""
        contradicted = "" if self.axis_units is None else self.axis_units.sentence
        return contradicted or format_question(self.doubt)

    @property
    def header(self) -> dict[str, Any]:
        """What a raw recording says of the stream when it begins, for `restore`."""
        return {
            "protocol": self.detector.protocol,
            "columns": "" if self.detector.columns is None else str(self.detector.columns),
            "doubt": list(self.doubt),
            "axes": str(self.rows.axes),
            "rate": self.imu.rate,
            "clock": self.imu.clock.state,
            "watch": self.imu.watch.state,
            "counted": self.imu.counted,
            "pace": self.imu.pace,
            "found out": self.detector.found_out,
        }

    def restore(self, header: Mapping[str, Any]) -> None:
        """Go on with the state of clock and watch, and the number of samples, that a recording says."""
        if "clock" in header:
            self.imu.clock = DeviceClock.restored(header["clock"])
        self.imu.watch.restore(header.get("watch"))
        if header.get("found out") is True:
            self.detector.find_out()
        self.imu.restore(header.get("counted"), header.get("pace"))

    def accept(self, chunk: Chunk) -> tuple[Rows, Rows]:
        """Return the timed samples and fixes of bytes that arrived.

        Raises
        ------
        DecoderError
            If a decoder of one's own fails.
        """
        if not chunk.data:
            return NO_IMU, NO_FIXES
        return self._time_all(self.detector.accept(chunk))

    def name_columns(self, said: Mapping[str, str]) -> tuple[Rows, Rows]:
        """Read text with columns that a person names; return the samples in bytes that were kept.

        Parameters
        ----------
        said
            As of `lab.data.protocols.text_lines.TextLines`.

        Raises
        ------
        ColumnMapError
            If these are no columns of an IMU.
        """
        ColumnMap(tuple(Column.of(text) for text in said.values()))
        self._question = self.axis_units = None
        return self._time_all(self.detector.name_columns(said))

    def answer(self, unit: str, why: str = "as you said") -> None:
        """Read angular rates in another unit; `taken_factor` says what those are off that were returned.

        Parameters
        ----------
        unit
            The unit, as a person or a file writes it.
        why
            How it is known, as a clause.

        Raises
        ------
        ColumnMapError
            If it is no unit of a rate, or no columns are known.
        """
        unit = checked_unit("rate", unit)
        if self.detector.columns is None:
            raise ColumnMapError("the columns are not known yet; accepted is a unit once they are")
        factor = self.detector.answer(unit)
        self.imu.scale_rates(factor)
        self._factor *= factor
        self._question = self.axis_units = None
        self.decided = f"The angular rates are in {unit}, {why}."

    def taken_factor(self) -> float:
        """Return the factor for the angular rates returned before the last call; 1 as a rule."""
        factor, self._factor = self._factor, 1.0
        return factor

    def taken_readings(self) -> Rows:
        """Return the timed headings and speeds since the last call."""
        found, self._readings = self._readings, []
        return np.concatenate(found) if found else NO_READINGS

    def lose(self, arrival: float) -> tuple[Rows, Rows]:
        """Return the samples that were held back when the device was lost; the next come after a gap."""
        rest = self.detector.finish()
        timed = (NO_IMU, NO_FIXES) if rest is None else self._time_samples(rest, arrival)
        self.imu.restart()
        self.fixes.clock.restart()
        self.rows.restart()
        self._question = self.axis_units = None
        self._paced = _UNPACED
        return timed

    def _time_all(self, parts: list[tuple[Samples, float]]) -> tuple[Rows, Rows]:
        timed = [self._time_samples(samples, arrival) for samples, arrival in parts]
        if len(timed) == 1:
            return timed[0]
        imu = np.concatenate([NO_IMU, *(one for one, _ in timed)])
        return imu, np.concatenate([NO_FIXES, *(one for _, one in timed)])

    def _time_samples(self, samples: Samples, arrival: float) -> tuple[Rows, Rows]:
        imu, fix = NO_IMU, NO_FIXES
        if len(samples.imu):
            rows = self._in_its_time(self.rows.with_both_triads(samples.imu), arrival)
            imu = self._asked(self.imu.timed(rows, arrival, self.detector.wrap_period))
            self._compare_axes(imu)
        if len(samples.fix):
            fix = self.fixes.timed(samples.fix, arrival, self.imu.clock, self.imu.watch.last)
        if len(samples.reading):
            clocks = self.imu.clock, self.fixes.clock, self.imu.watch.last
            timed = self._reading_times.timed(samples.reading, arrival, imu, *clocks)
            timed["attitude"] = self.rows.axes.attitude(timed["attitude"])
            self._readings.append(timed)
        return imu, fix

    def _in_its_time(self, rows: Rows, arrival: float) -> Rows:
        """Return rows of a text in another unit of time, if theirs is a thousand times too fast or slow."""
        decoder = self.detector.decoder
        time = float(rows["time"][-1]) if len(rows) else math.nan
        if not isinstance(decoder, TextLines) or decoder.columns is None or math.isnan(time):
            return rows
        begun, first, power = self._paced
        if not arrival - begun >= _PACED:
            self._paced = (arrival, time, power) if math.isnan(begun) else self._paced
            return rows
        pace = (time - first) / (arrival - begun)
        # Seconds, milliseconds, microseconds: a wrong unit is off by a power of 1000.
        thousands = math.log10(pace) / 3 if pace > 0 else 0.0
        now = round(thousands) if abs(thousands - round(thousands)) < _NEAR_THOUSAND else 0
        self._paced = arrival, time, now
        units = {one.quantity: one.unit for one in decoder.columns.columns}
        # Twice in a row by the same power: one pause of the host makes a wrong pace once.
        if not now or now != power or units["time"] not in _TIMES:
            return rows
        scale = UNITS_OF["time"][units["time"]] / 1000.0**now
        unit = next((one for one in _TIMES if math.isclose(UNITS_OF["time"][one], scale)), "")
        if not unit:
            return rows
        decoder.read_times_in(unit)
        self.imu.restart()
        self.imu.watch.usual = math.nan
        self._paced = _UNPACED
        self.decided = f"The times are in {unit}, not in {units['time']}, as their arrival shows."
        rows = rows.copy()
        rows["time"] /= 1000.0**now
        return rows

    def _compare_axes(self, imu: Rows) -> None:
        """See whether the axes of a text have one unit each."""
        columns, units, axes = self.detector.columns, self.axis_units, self.rows.axes
        if columns is None or not len(imu):
            return
        if units is None or units.columns != columns:
            units = self.axis_units = AxisUnits(columns)
        units.add(imu["time"], axes.unmapped(imu["rate"]), axes.unmapped(imu["force"], force=True))

    def _asked(self, imu: Rows) -> Rows:
        """Return samples in the unit that their turn shows, if it was in doubt."""
        if not self.doubt or not len(imu):
            return imu
        question = self._question
        units = tuple(dict.fromkeys((*self.doubt, *_SHOWN_BY_TURNS)))
        if question is None or question.units != units:
            scales = [UNITS_OF["rate"][unit] for unit in units]
            question = self._question = UnitQuestion(units, scales)
        unit = question.add(imu["time"], imu["rate"], imu["force"])
        if not unit:
            return imu
        before = self._factor
        self.answer(unit, "as the first turn against gravity shows")
        if self._factor != before:
            # `answer` tells of the samples returned before; these were still decoded in the old unit.
            imu["rate"] *= self._factor / before
        return imu


def checked_unit(kind: str, unit: str) -> str:
    """Return a unit as `UNITS_OF` has it.

    Raises
    ------
    ColumnMapError
        If the quantity is none, or has no such unit.
    """
    if kind not in UNITS_OF:
        raise ColumnMapError(f"{kind!r} is no quantity; accepted are {', '.join(UNITS_OF)}")
    known = spell_unit(kind, unit)
    if known not in UNITS_OF[kind]:
        raise ColumnMapError(
            f"{kind}: {unit!r} is no unit of it; accepted are {', '.join(UNITS_OF[kind])}, and each over a "
            "number of counts, such as g/16384"
        )
    return known
