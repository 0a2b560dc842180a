"""Reception: bytes that arrived become timed samples in the axes of the vehicle.

It depends on the bytes and the times of their arrival alone, so a replay of a raw recording gives the same
samples, bit for bit.
"""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.parameters.counted import counted
from lab.data.clock.clock_watch import ClockWatch, sent_again
from lab.data.clock.device_clock import DeviceClock
from lab.data.clock.faults import increasing
from lab.data.clock.limits import LIMITS
from lab.data.clock.reading_times import NO_READINGS, ReadingTimes
from lab.data.clock.timed_samples import TIMED_FIX, TIMED_IMU
from lab.data.protocols.catalogue import decoder_of
from lab.data.protocols.column_map import ColumnMap
from lab.data.protocols.decoder import Decoder, Statistics
from lab.data.protocols.recognition import Candidate, recognise, sound_frames
from lab.data.protocols.samples import NAMED, NO_FIX, UNMEASURED, Samples
from lab.data.protocols.text_lines import TextLines
from lab.data.streams.axis_map import AxisMap
from lab.data.streams.transport import Chunk, TransportError

Rows = NDArray[np.void]

RECOGNISED = 1.0
"""Time of bytes in which a protocol is looked for, and until it is looked for again [s]: 20 samples of a slow
device, a fix of a receiver."""
ENOUGH = 4096
"""Bytes that are enough to look for the first time, however soon they come: 40 frames of 100 bytes."""
MOST = 2**14
"""Bytes in which it is looked for again: to look in them takes 0.1 s."""
COUNTED = 2.0
"""Time over which the rate of a device without a clock is taken [s]."""

_NEXT = 0.05
"""Part of the usual interval by which the next sample of a counter that turns over may miss it: then it came
late, and nothing is missing. Samples that are missing leave any part of a turn, of 21 intervals, so this is
wrong in one of 200 short silences."""

_NO_IMU, _NO_FIX = np.empty(0, TIMED_IMU), np.empty(0, TIMED_FIX)
"""No samples, no fixes."""


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
    axes : AxisMap
        The axis map; may be replaced at any time, for the samples that come then.
    protocol, evidence : str
        The protocol, empty while it is unknown; and what speaks for it, or why nothing is recognised.
    timing : str
        How samples are timed, in words.
    rate : float
        Rate by which samples are counted [Hz]; 0 if their clock is used, or it is not known yet.
    counted : int
        Samples that were timed by their number.
    triads_apart : bool
        Whether the device sends rates and forces one by one: a rate then gets the last force.
    loss : Loss
        Losses between the device and the filter.
    clock, fix_clock : DeviceClock
        Clock of the IMU, and of the receiver if it has its own.

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

    Raises
    ------
    TransportError
        If columns are given for another protocol than text.
    ColumnMapError, DecoderError
        If they are not accepted.
    """

    def __init__(
        self, protocol: str = "", columns: str = "", axes: AxisMap | None = None, rate: float = 0.0
    ) -> None:
        if columns and protocol not in ("", "text"):
            raise TransportError(f"columns are of text lines, and the protocol is {protocol!r}")
        self.axes = axes or AxisMap()
        self.protocol = "text" if columns else protocol
        self.evidence = ""
        self.timing = ""
        self.rate = rate
        self.triads_apart = False
        self._missing = 0
        self._kinds: Counter[int] = Counter()  # of positions
        self.clock = DeviceClock()
        self.fix_clock = DeviceClock()
        self._columns = ColumnMap.of(columns) if columns else None
        self._given_rate = rate > 0
        self._before = Statistics()
        self._decoder: Decoder | None = self._made() if self.protocol else None
        self._first: deque[Chunk] = deque()
        self._held = 0  # bytes in them
        self._tried: float | None = None  # when a protocol was last looked for
        self._has_counter = self._counting = False
        self._waiting: list[tuple[float, Rows]] = []
        self.counted = 0
        self.watch = ClockWatch()
        self._values: FloatArray | None = None  # times, rates and forces of the last samples
        self._paced: deque[tuple[float, int]] = deque()  # arrivals and numbers of the last samples
        self._rebase = False  # whether times by number begin
        self._last_arrival = np.nan
        self._wrapped = 0.0
        self._force: FloatArray | None = None  # the last, of a device that sends the triads one by one
        self._gap = True
        self._latest = -np.inf
        self._latest_fix = -np.inf
        self._reading_times = ReadingTimes()
        self._readings: list[Rows] = []  # timed, and not yet taken

    def _made(self) -> Decoder:
        if self._columns is not None:
            return TextLines(self._columns)
        return decoder_of(self.protocol)

    @property
    def statistics(self) -> Statistics:
        """What the decoders have seen, since the beginning."""
        now = self._decoder.statistics if self._decoder else Statistics(self._held)
        return Statistics(*(a + b for a, b in zip(_counts(self._before), _counts(now), strict=True)))

    @property
    def loss(self) -> Loss:
        """Losses between the device and the filter, so far."""
        watch = self.watch
        return Loss(self._missing, watch.repeated, watch.backwards, watch.jumps)

    @property
    def described(self) -> str:
        """What speaks for the protocol, and what the decoder found out about the device, in sentences."""
        found = (self.evidence, getattr(self._decoder, "evidence", ""), *self.positions)
        return " ".join(text for text in found if text)

    @property
    def positions(self) -> tuple[str, ...]:
        """What the receiver says of positions that are no usual fixes, in sentences."""
        total = self._kinds.total()
        left_out = {kind: f"not used: {reason}" for kind, reason in UNMEASURED.items()}
        return tuple(
            f"{self._kinds[kind]} of {counted(total, 'position')} are {words}."
            for kind, words in (NAMED | left_out).items()
            if self._kinds[kind]
        )

    @property
    def columns(self) -> ColumnMap | None:
        """The columns of text lines, once they are known."""
        return self._decoder.columns if isinstance(self._decoder, TextLines) else self._columns

    def restore(self, watch: Any, number: Any) -> None:
        """Go on with the state of a watch, and the number of samples, that a recording says."""
        self.watch.restore(watch)
        if isinstance(number, int) and 0 <= number < 2**53:
            self.counted = number

    def accept(self, chunk: Chunk) -> tuple[Rows, Rows]:
        """Return the timed samples and fixes of bytes that arrived.

        Raises
        ------
        DecoderError
            If a decoder of one's own fails.
        """
        if not chunk.data:
            return _NO_IMU, _NO_FIX
        if self._decoder is None:
            return self._recognise(chunk)
        return self._timed(self._decoder.feed(chunk.data), chunk.arrival)

    def taken_readings(self) -> Rows:
        """Return the timed headings and speeds since the last call."""
        found, self._readings = self._readings, []
        return np.concatenate(found) if found else NO_READINGS

    def lose(self, arrival: float) -> tuple[Rows, Rows]:
        """Return the samples that were held back when the device was lost; the next come after a gap."""
        rest = (_NO_IMU, _NO_FIX)
        if self._decoder is not None:
            rest = self._timed(self._decoder.finish(), arrival)
            self._before = self.statistics
            if self._columns is None and isinstance(self._decoder, TextLines):
                self._columns = self._decoder.columns
            self._decoder = self._made()
        self._first.clear()
        self._held, self._tried = 0, None
        self._waiting.clear()
        self.clock.restart()
        self.fix_clock.restart()
        self.watch.forget()
        self._paced.clear()
        self._last_arrival, self._wrapped, self._gap = np.nan, 0.0, True
        self._force = None
        return rest

    def _recognise(self, chunk: Chunk) -> tuple[Rows, Rows]:
        """Keep bytes until a protocol is found in them, then decode them."""
        first = self._first
        first.append(chunk)
        self._held += len(chunk.data)
        begin = first[0].arrival if self._tried is None else self._tried
        if (self._held < ENOUGH or self._tried is not None) and chunk.arrival - begin < RECOGNISED:
            return _NO_IMU, _NO_FIX
        self._tried = chunk.arrival
        while self._held > MOST and len(first) > 1:
            gone = len(first.popleft().data)
            self._held -= gone
            self._before.bytes += gone
            self._before.skipped += gone
        found = recognise(b"".join(one.data for one in first))
        if not found:
            seen = counted(self.statistics.bytes, "byte")
            known = sound_frames(b"".join(one.data for one in first))
            self.evidence = known or f"Nothing is recognised in {seen}."
            return _NO_IMU, _NO_FIX
        self._use(found[0])
        parts = [self._timed(self._feed(one.data), one.arrival) for one in self._first]
        self._first.clear()
        self._held = 0
        return _joined(parts)

    def _use(self, found: Candidate) -> None:
        self.protocol, self.evidence = found.name, found.evidence
        self._decoder = self._made()

    def _feed(self, data: bytes) -> Samples:
        assert self._decoder is not None
        return self._decoder.feed(data)

    def _timed(self, samples: Samples, arrival: float) -> tuple[Rows, Rows]:
        imu = self._timed_imu(samples.imu, arrival) if len(samples.imu) else _NO_IMU
        fix = self._timed_fix(samples.fix, arrival) if len(samples.fix) else _NO_FIX
        if len(samples.reading):
            clocks = self.clock, self.fix_clock, self.watch.last
            self._readings.append(self._reading_times.timed(samples.reading, arrival, imu, *clocks))
        return imu, fix

    def _timed_imu(self, rows: Rows, arrival: float) -> Rows:
        rows = self._with_both_triads(rows)
        if not len(rows):
            return _NO_IMU
        if np.isfinite(rows["time"][-1]):
            device = self._unwrapped(rows["time"], arrival)
            rows, device = self._once(rows, device, arrival)
            if not len(rows):
                return _NO_IMU
            if not self.watch.distrusted:
                self.timing = "by the clock of the device"
                return self._by_clock(rows, device, arrival)
        numbers = self.counted + np.arange(len(rows), dtype=float)
        self.counted += len(rows)
        if self.rate == 0.0:
            return self._measure_rate(rows, arrival)
        return self._by_count(rows, numbers, arrival)

    def _once(self, rows: Rows, device: FloatArray, arrival: float) -> tuple[Rows, FloatArray]:
        """Return samples without those that were sent twice; see whether a bad clock runs evenly again."""
        values = np.concatenate((device[:, None], rows["rate"], rows["force"]), axis=1)
        before = np.full((1, 7), np.nan) if self._values is None else self._values
        fresh = ~sent_again(values, before)
        self._values = np.concatenate((before, values[fresh]))[-LIMITS.compared :]
        if not fresh.all():
            self.watch.repeated += int((~fresh).sum())
            rows, device = rows[fresh], device[fresh]
        passed = self._paced[-1][1] if self._paced else 0
        self._paced.append((arrival, passed + len(rows)))
        while arrival - self._paced[0][0] > 2 * COUNTED:
            self._paced.popleft()
        waits = not self.watch.distrusted or not self.rate or not len(device)
        if not waits and self.watch.runs_again(device, 1 / self.rate, arrival):
            self.watch.rebase(float(device[0]) - 1 / self.rate, self.clock)
            self.clock.counted = False
            self.rate = self.rate if self._given_rate else 0.0
        return rows, device

    def _with_both_triads(self, rows: Rows) -> Rows:
        """Return the rows with rates; those that lack the force get the last one that came by itself."""
        alone = np.isnan(rows["rate"][:, 0])
        if alone.any() and not np.isnan(rows["force"][alone][:, 0]).any():
            self.triads_apart = True
        if not self.triads_apart:
            return rows
        made = np.array(rows)
        last = np.maximum.accumulate(np.where(alone, np.arange(len(made)), -1))
        before = np.full(3, np.nan) if self._force is None else self._force
        forces = np.where((last >= 0)[:, None], made["force"][last], before)
        if alone.any():
            self._force = made["force"][last[-1]].copy()
        lacking = np.isnan(made["force"][:, 0])
        made["force"][lacking] = forces[lacking]
        return np.asarray(made[~alone & ~np.isnan(made["force"][:, 0])])

    def _unwrapped(self, device: FloatArray, arrival: float) -> FloatArray:
        """Return times of the device's clock with the turns that it made in a silence."""
        period = self._decoder.wrap_period if self._decoder else np.inf
        silence = arrival - self._last_arrival
        self._last_arrival = arrival
        step = (float(device[0]) + self._wrapped - self.watch.last) % period
        stalled = abs(step - self.watch.usual) < _NEXT * self.watch.usual and silence < 2 * period
        if np.isfinite(period) and silence > period / 2 and not stalled:
            missed = self.watch.last + silence - (float(device[-1]) + self._wrapped)
            self._wrapped += period * round(missed / period)
        return device + self._wrapped

    def _measure_rate(self, rows: Rows, arrival: float) -> Rows:
        """Keep samples until their nominal rate is known, then time them."""
        self._waiting.append((arrival, np.array(rows)))
        begin, first = self._waiting[0]
        if arrival - begin < COUNTED:
            return _NO_IMU
        counts = np.concatenate([part["count"] for _, part in self._waiting])
        # A counter that stands still or runs backwards is none.
        self._has_counter = bool(counts.min() >= 0 and (np.diff(counts) > 0).all())
        passed = counts[-1] - first["count"][-1] if self._has_counter else len(counts) - len(first)
        self.rate = nominal_rate(max(float(passed), 1.0) / (arrival - begin))
        self.counted = 0
        held, self._waiting = self._waiting, []
        parts = []
        for when, part in held:
            numbers = self.counted + np.arange(len(part), dtype=float)
            self.counted += len(part)
            parts.append(self._by_count(part, numbers, when))
        return np.concatenate(parts)

    def _by_count(self, rows: Rows, numbers: FloatArray, arrival: float) -> Rows:
        """Time samples by the counter of the device, or by their numbers, at the nominal rate."""
        if self._given_rate and not self._counting:
            self._has_counter = bool((rows["count"] >= 0).all()) and not self.watch.distrusted
        self._counting = True
        counter = "by the counter of the device" if self._has_counter else "by the number of samples"
        self.clock.counted = not self._has_counter
        self.timing = f"{counter} at {self.rate:g} Hz, {'given' if self._given_rate else 'measured'}"
        count = rows["count"].astype(float) if self._has_counter else numbers
        if self._rebase:
            self.watch.rebase(-1 / self.rate, self.clock)
            self._rebase = False
        return self._by_clock(rows, count / self.rate, arrival)

    def _by_clock(self, rows: Rows, device: FloatArray, arrival: float) -> Rows:
        """Map times of the device to those of the host; drop what was sent twice, or came after later."""
        known = np.isfinite(device)
        rows, device = rows[known], device[known]
        if not len(rows):
            return _NO_IMU
        begun, last = np.isfinite(self.clock.offset), self.watch.last
        followed = self.watch.follow(device, arrival, self.clock)
        rows, device = rows[followed.kept], followed.device
        if not len(rows):
            return _NO_IMU
        steps = np.diff(device, prepend=last)
        times, anew = self.clock.mapped(device, arrival)
        steps[followed.changed] = np.nan  # the clock was set: no sample is missing
        gap, missing = self.watch.gaps(steps)
        self._missing += missing
        if anew and begun:
            gap[0] = True
        if self._gap:
            gap[0], self._gap = True, False
        self.clock.shift(followed.moved)
        if followed.useless:
            self._begin_to_count(arrival)
        return self._put(rows, times, arrival, gap)

    def _begin_to_count(self, arrival: float) -> None:
        """Time samples by their number from now on, at the rate so far if it is known."""
        self.counted, self._rebase, self._counting, self._has_counter = 0, True, True, False
        if self.rate or not self._paced or arrival - self._paced[0][0] < COUNTED:
            return
        begin, first = self._paced[0]
        measured = (self._paced[-1][1] - first) / (arrival - begin)
        usual = 1 / self.watch.usual
        self.rate = nominal_rate(usual if abs(usual / measured - 1) < NEAR else measured)

    def _put(self, rows: Rows, times: FloatArray, arrival: float, gap: NDArray[np.bool_]) -> Rows:
        kept = increasing(times, self._latest)
        if not kept.all():  # the mapping began anew, or the host cannot tell them apart
            begins = not kept[0]
            rows, times, gap = rows[kept], times[kept], gap[kept]
            if not len(rows):
                self._gap = True
                return _NO_IMU
            gap[0] |= begins
        self._latest = float(times[-1])
        made = np.empty(len(rows), TIMED_IMU)
        made["time"], made["arrival"], made["gap"] = times, arrival, gap
        made["rate"] = self.axes.mapped(rows["rate"])
        made["force"] = self.axes.mapped(rows["force"], force=True)
        made["magnetic"] = self.axes.mapped(rows["magnetic"])
        for name in ("temperature", "pressure", "clipped", "end"):
            made[name] = rows[name]
        return made

    def _timed_fix(self, rows: Rows, arrival: float) -> Rows:
        """Return fixes at their times of validity; those without position are left out."""
        rows = rows[np.isfinite(rows["latitude"])]
        self._kinds.update(rows["fix_type"].tolist())
        rows = rows[rows["fix_type"] > NO_FIX]
        if not len(rows):
            return _NO_FIX
        own = rows["time"]
        shared = np.isfinite(own).all() and np.isfinite(self.clock.offset)
        if shared and abs(own[-1] - self.watch.last) < LIMITS.stale:
            times = self.clock.offset + own
        else:
            clock = np.where(np.isfinite(rows["week_time"]), rows["week_time"], rows["utc"])
            if np.isfinite(clock).all() and (np.diff(clock) > 0).all():
                times = self.fix_clock.mapped(np.asarray(clock), arrival)[0] - LIMITS.latency
            else:
                times = np.full(len(rows), arrival) - LIMITS.latency
        kept = increasing(times, self._latest_fix)
        rows, times = rows[kept], times[kept]
        if not len(rows):
            return _NO_FIX
        self._latest_fix = float(times[-1])
        made = np.empty(len(rows), TIMED_FIX)
        made["time"], made["arrival"] = times, arrival
        for name in TIMED_FIX.names or ():
            if name not in ("time", "arrival"):
                made[name] = rows[name]
        return made


def _counts(statistics: Statistics) -> tuple[int, ...]:
    return (
        statistics.bytes, statistics.frames, statistics.skipped, statistics.failed, statistics.unknown,
        statistics.refused,
    )  # fmt: skip


def _joined(parts: list[tuple[Rows, Rows]]) -> tuple[Rows, Rows]:
    return np.concatenate([imu for imu, _ in parts]), np.concatenate([fix for _, fix in parts])


USUAL_RATES = (
    1, 2, 4, 5, 8, 10, 20, 25, 40, 50, 60, 100, 104, 119, 120, 125, 128, 150, 160, 200, 208, 238, 240, 250,
    256, 300, 400, 416, 476, 500, 512, 600, 800, 833, 952, 1000, 1024, 1125, 1600, 2000,
)  # fmt: skip
"""Rates that devices are set to [Hz]."""
NEAR = 0.03
"""Largest part by which a measured rate may differ from a usual one: over `COUNTED`, at 50 Hz, one sample."""


def nominal_rate(measured: float) -> float:
    """Return the usual rate next to a measured one [Hz], or the measured one if none is near."""
    best = min(USUAL_RATES, key=lambda rate: abs(rate / measured - 1)) if measured > 0 else 0
    return float(best) if best and abs(best / measured - 1) <= NEAR else measured
