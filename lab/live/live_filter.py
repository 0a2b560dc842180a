"""Live filter: the compiled step of the navigator over samples and fixes that arrive late.

A fix arrives after samples that are later than itself, and a rest is known only after ten seconds. The filter
therefore keeps copies of itself. When something becomes known about an earlier time, it returns to the last
copy before that time and advances again over the samples since. Its history is then that of a filter that
knew everything in time, which is what a batch run computes.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.data.streams.rolling import Rolling
from lab.live.live_aids import NONE, LiveAids
from lab.live.live_state import imu_between
from lab.navigation.aids import NO_AIDS
from lab.navigation.belief import implausible, schedule_filter
from lab.navigation.filters.error_models import ErrorModel
from lab.navigation.filters.filter import Filter
from lab.navigation.filters.kalman import MEASUREMENTS, gate
from lab.navigation.filters.schedule import SLACK, Schedule
from lab.navigation.lever_arm import NO_TURNS, WINDOW, mean_rates_at_fixes
from lab.navigation.log_navigation import AROUND, gap_noise
from lab.navigation.navigator import advance
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import NO_REST, Belief, Fixes, Solution, Start, read_only
from lab.navigation.standstill import LEAST_SPEED, SHORTEST, SLOW, SPAN, Held, at_rest, standing_still

BACK: Final = 20.0
"""How far the filter can go back [s]: rest is known after ten seconds and a fix two seconds later, and a fix
may be late."""
COPY: Final = 0.25
"""Time between two copies [s]: a fix costs half of it in samples that are computed again."""
REFRESH: Final = 0.5
"""Time without a fix after which a fix may show a rest [s]: `standstill` wants one within the second."""
_ENDLESS: Final = 2**62  # samples of a stream
_ROUNDING: Final = 1e-6  # of time stamps, as in `log_navigation` [s]
_SLACK: Final = 1e-3  # time about a fix within which its sample is looked for [s]
_CHANGING: Final = (
    "state", "w", "F", "F_sum", "F_step", "T", "clock", "counts", "streak", "rest_sums", "scalars",
    "rest_scalars",
)  # fmt: skip

SAMPLES: Final = {
    "time": (), "dtheta": (3,), "dvelocity": (3,), "magnetic": (3,), "rest": (), "standing": (),
    "position": (3,), "velocity_n": (3,), "q_nb": (4,), "bias": (6,), "covariance": (2, 3),
}  # fmt: skip
"""Columns of the samples: the increments that end at a time, and the solution there without ``variance``.

``rest`` is whether the fixes and the IMU show a rest, ``standing`` also whether it lasts without fixes.
"""
SAMPLE_TYPES: Final = {"rest": np.bool_, "standing": np.bool_}
"""Types of the columns that are no real numbers."""
FIXES: Final = {
    "time": (), "position": (3,), "velocity_n": (3,), "position_sigma": (3,), "velocity_sigma": (3,),
    "known_velocity": (3,), "R": (MEASUREMENTS, MEASUREMENTS), "variances": (MEASUREMENTS,), "measured": (),
    "turn": (4,), "innovation": (MEASUREMENTS,), "innovation_covariance": (MEASUREMENTS, MEASUREMENTS),
    "sample": (), "rejected": (), "recovered": (),
}  # fmt: skip
"""Columns of the fixes: as they arrived, as the filter uses them, and what came of it."""
FIX_TYPES: Final = {"measured": np.int64, "sample": np.int64, "rejected": np.bool_, "recovered": np.bool_}
"""Types of those that are no real numbers."""
_OF_SAMPLES: Final = ("position", "velocity_n", "q_nb", "bias", "variance", "covariance")


@dataclass
class Gap:
    """A filled gap of the IMU.

    Attributes
    ----------
    start, end : float
        Times [s].
    edges : tuple of int
        Numbers of its first and its last sample.
    noise : (12,) array
        Densities of the process noise in it, from the motion so far.
    settled : bool
        Whether no later sample changes it.
    """

    start: float
    end: float
    edges: tuple[int, int]
    noise: FloatArray
    settled: bool = False


class _Copy(NamedTuple):
    sample: int
    fix: int
    values: tuple[NDArray[np.float64], ...]


class LiveFilter:
    """A filter over samples and fixes that are appended from outside.

    Parameters
    ----------
    samples, fixes
        Rows with the columns `SAMPLES` and `FIXES`; the filter writes the solution into them.
    first
        Number of the sample at which it starts.
    start
        The start, with the gyro bias.
    assumed
        The filter's assumptions; R of each fix is in its row.
    navigator, model
        Its settings and error model.
    aids
        Its measurements besides fixes.
    rests
        Whether it uses rests that the fixes and the IMU show.
    """

    def __init__(
        self,
        samples: Rolling,
        fixes: Rolling,
        first: int,
        start: Start,
        assumed: Belief,
        navigator: NavigatorSettings,
        model: ErrorModel,
        aids: LiveAids,
        *,
        rests: bool,
    ) -> None:
        self.samples, self.fixes, self.first = samples, fixes, first
        self._begun = self._time(first)
        self._step = imu_between(self.samples, first, samples.end - 1).step
        self.at = first
        """Number of the sample that it has reached."""
        self.next_fix = fixes.number("time", self._time(first) + _ROUNDING, "right")
        """Number of the next fix; the last one before the start was used for the start."""
        self._gaps: list[Gap] = []
        self._gap_second = 0  # in which the noise in gaps was settled
        self.assumed, self.model, self._aids = assumed, model, aids
        self._first_fix = self.next_fix
        self._navigator, self._rests = navigator, rests
        self._schedule = schedule_filter(navigator, self._step, _ENDLESS)
        self._gates: dict[int, Schedule] = {}
        self._run = Filter.begin(start, assumed._replace(R=np.eye(MEASUREMENTS)), self._time(first), model)
        self._copies = [self._copy()]
        self._stale = first + 1  # first sample whose solution must be computed again, beyond `at` if none
        self._seconds = 0  # for which the rest was looked for
        self._looks_changed = False
        self._held: dict[int, Held | None] = {}  # what is held after a second
        self._unturned = self.next_fix  # first fix whose rates may still change

    @property
    def P(self) -> FloatArray:  # noqa: N802
        """Covariance (n, n) at `at`, of the model's own errors; a copy."""
        return self._run.P[:, : self.model.states].copy()

    @property
    def state(self) -> FloatArray:
        """State of the strapdown at `at`; a copy."""
        return self._run.state.copy()

    @property
    def reach(self) -> float:
        """Earliest time to which it can return [s]."""
        return self._time(self._copies[0].sample)

    def changed_fixes(self, start: int, end: int) -> None:
        """Take note of fixes that arrived or changed.

        Parameters
        ----------
        start, end
            Their numbers; the time of each is later than `reach`.
        """
        times = self.fixes.rows("time", start, end)
        self._stale = min(self._stale, self.samples.number("time", float(times[0]) - _SLACK))
        square = self.fixes.rows("known_velocity", start, end) ** 2
        variance = np.maximum(self.fixes.rows("variances", start, end)[:, 3:], LEAST_SPEED**2)
        fast = bool((np.sum(square / variance, axis=1) > SLOW).any())
        before = self.fixes.rows("time", max(start - 1, self.fixes.first), start)
        alone = not before.size or float(times[0] - before[-1]) > REFRESH
        self._looks_changed |= fast or alone

    def changed_readings(self, time: float) -> None:
        """Take note of a heading or a speed at a time that is later than `reach` [s]."""
        self._stale = min(self._stale, self.samples.number("time", time - _SLACK))

    def add_gaps(self, gaps: Iterable[tuple[float, float]]) -> None:
        """Take note of filled gaps that end after the start, by their times [s]; the samples are there."""
        for start, end in gaps:
            if end > self._begun + _ROUNDING:
                first, last = (self.samples.number("time", time - _ROUNDING) for time in (start, end))
                self._gaps.append(Gap(start, end, (first, last), self._noise_in(start, end)))

    def advance(self) -> None:
        """Advance to the last sample."""
        last = self.samples.end - 1
        self._turn(last, settled=False)
        self._look_for_rest(last)
        second = int(self._time(last))
        if second != self._gap_second:
            self._gap_second = second
            self._settle_gaps(self._time(last) - AROUND)
        if self._stale <= self.at:
            self._return(self._stale)
        while self.at < last:
            self._advance_piece(self._next_stop(last))
        self._stale = self.at + 1

    def finish(self) -> None:
        """Advance once more, with averages over the last fixes and gaps that end with the last sample."""
        self._turn(self.samples.end - 1, settled=True)
        self._settle_gaps(np.inf)
        self.advance()

    def _settle_gaps(self, until: float) -> None:
        """Take the noise in gaps that ended before a time [s] from the motion on both sides."""
        for gap in self._gaps:
            if not gap.settled and gap.end < until:
                gap.noise, gap.settled = self._noise_in(gap.start, gap.end), True
                self._stale = min(self._stale, self.samples.number("time", gap.start + _ROUNDING))

    def _noise_in(self, start: float, end: float) -> FloatArray:
        """Return the densities (12,) of the process noise in a gap [s], from the samples so far."""
        first = max(self.samples.number("time", start - AROUND - _SLACK), self.first)
        around = imu_between(self.samples, first, self.samples.end - 1)
        return np.asarray(
            self.assumed.noise
            + np.append(gap_noise(around, start, end), np.zeros(self.assumed.noise.size - 6))
        )

    def _time(self, sample: int) -> float:
        return float(self.samples.rows("time", sample, sample + 1)[0])

    def _turn(self, last: int, *, settled: bool) -> None:
        """Average the rates about new fixes, and again about those whose time is over."""
        arm = self.assumed.lever_arm
        if not arm.any():
            return
        now = self._time(last)
        due = self.fixes.number("time", now, "right")
        self._unturned = max(self._unturned, self.fixes.first)
        if due <= self._unturned:
            return
        times = self.fixes.rows("time", self._unturned, due)
        turn = self.fixes.rows("turn", self._unturned, due)
        start = max(self.samples.number("time", float(times[0]) - 1.0), self.first)
        imu = imu_between(self.samples, start, last)
        half = max(WINDOW, 2 * self._step) / 2
        whole = times + half <= now
        # New ones, and those whose window has passed since: those between wait for the rest of their
        # samples.
        rows = (turn[:, 3] == 0) | whole | settled
        if not rows.any():
            return
        turn[rows] = mean_rates_at_fixes(imu, times[rows], arm, self._step)
        first = float(times[int(np.argmax(rows))])
        self._stale = min(self._stale, self.samples.number("time", first - _SLACK))
        self._unturned += int(whole.size if whole.all() else np.argmin(whole))

    def _look_for_rest(self, last: int) -> None:
        """Mark the samples at rest as a batch run over the samples so far would."""
        if not self._rests and not self._aids.stands:
            return
        begun, now = self._begun, self._time(last)
        seconds = int((now - begun) / SPAN)
        if seconds == self._seconds and not self._looks_changed:
            return
        settled = min(self._seconds, seconds) - int(BACK)  # seconds that nothing can change any more
        self._seconds, self._looks_changed = seconds, False
        # A rest is one of `SHORTEST` seconds at least: as many before those that may change, and one more
        # whose mean rate is not compared.
        whole = max(0, settled - SHORTEST - 1)
        grid = np.asarray(begun + SPAN * np.arange(whole, seconds + 1), dtype=np.float64)
        start = max(self.samples.number("time", float(grid[0]) - 1e-9), self.first)
        fix = max(self._first_fix, self.fixes.number("time", float(grid[0]) - SPAN - _SLACK))
        end = max(fix, self.fixes.number("time", now, "right"))
        if grid.size < SHORTEST + 1 or (end == fix and not self._aids.stands):
            return
        fixes = Fixes(*(self.fixes.rows(name, fix, end) for name in ("time", "position", "known_velocity")))
        R = self.fixes.rows("R", fix, end)
        assumed, imu = self.assumed._replace(R=R), imu_between(self.samples, start, last)
        found = at_rest(imu, fixes, assumed, grid) if end > fix else np.zeros(last - start, np.bool_)
        free = 0 if whole == 0 else self.samples.number("time", begun + settled) - start
        rest = self._write_flags("rest", found, start, free)
        if self._aids.stands:
            first = settled - 1 if whole else 0  # the last second that is settled
            known = [self._held[first]] if whole else None
            standing, after = standing_still(rest, imu, fixes, assumed, grid[first - whole :], known)
            self._held = {first + second: one for second, one in enumerate(after)}
            self._write_flags("standing", standing, start, free)

    def _write_flags(self, name: str, found: NDArray[np.bool_], start: int, free: int) -> NDArray[np.bool_]:
        """Write and return a column of flags after sample `start`, of which the first `free` ones stay."""
        kept = self.samples.rows(name, start + 1, start + 1 + found.size)
        changed = np.flatnonzero(found[free:] != kept[free:])
        if changed.size:
            kept[free:] = found[free:]
            self._stale = min(self._stale, start + 1 + free + int(changed[0]))
        return kept

    def _copy(self) -> _Copy:
        return _Copy(self.at, self.next_fix, tuple(getattr(self._run, name).copy() for name in _CHANGING))

    def _return(self, stale: int) -> None:
        """Return to the last copy before a sample."""
        # The first copy stays whatever is stale: before it, there is nothing to return to.
        while len(self._copies) > 1 and self._copies[-1].sample >= stale:
            self._copies.pop()
        copy = self._copies[-1]
        for name, values in zip(_CHANGING, copy.values, strict=True):
            getattr(self._run, name)[...] = values
        self.at, self.next_fix = copy.sample, copy.fix

    def _next_stop(self, last: int) -> int:
        """Return the sample up to which the conditions are the same, at most that of the next copy."""
        # Copies lie on a grid of time, so that a return does not shift them.
        step = np.floor(self._time(self.at) / COPY + 1e-6) + 1
        stop = min(last, max(self.at + 1, self.samples.number("time", step * COPY)))
        for gap in self._gaps:
            for edge in gap.edges:
                if self.at < edge < stop:
                    stop = edge
        due = self.fixes.number("time", self._time(stop) + _SLACK, "right")
        measured = self.fixes.rows("measured", self.next_fix, max(due, self.next_fix))
        # The gate depends on how many values a fix has, so a piece has fixes of one number only.
        change = np.flatnonzero(np.diff(measured))
        if change.size:
            time = float(self.fixes.rows("time", self.next_fix, due)[change[0]])
            stop = min(stop, max(self.at + 1, self.samples.number("time", time - _ROUNDING)))
        return stop

    def _conditions(self, end: int) -> tuple[Schedule, FloatArray]:
        """Return the schedule up to a sample, with the gate of its fixes, and the process noise."""
        count = MEASUREMENTS
        if self.next_fix < self.fixes.end:
            count = int(self.fixes.rows("measured", self.next_fix, self.next_fix + 1)[0])
        if count not in self._gates:
            self._gates[count] = self._schedule._replace(
                gate=gate(self._navigator.gate, count), implausible=implausible(self._navigator, count)
            )
        noise = self.assumed.noise
        for gap in self._gaps:
            if gap.edges[0] <= self.at and end <= gap.edges[1]:
                noise = gap.noise
        return self._gates[count], noise

    def _latest_measurement_time(self, sample: int) -> float:
        """Return the latest time of a measurement that is used at a sample or before [s]."""
        time = self._time(sample)
        if sample == self.first:
            return 0.0  # a log has no readings at its first sample or before
        return time + SLACK * (time - self._time(sample - 1))

    def _advance_piece(self, end: int) -> None:
        """Advance to a sample under constant conditions."""
        schedule, noise = self._conditions(end)
        # The kernel stores the start itself if it begins with sample 0.
        before = self.at - (self.at > self.first)
        imu = imu_between(self.samples, before, end)
        imu = imu._replace(rest=self.samples.rows("rest", before + 1, end + 1) if self._rests else NO_REST)
        due = max(self.next_fix, self.fixes.number("time", self._time(end) + _SLACK, "right"))
        count = due - self.next_fix
        shown = Fixes(
            *(self.fixes.rows(name, self.next_fix, due) for name in ("time", "position", "known_velocity"))
        )
        arm = count > 0 and self.assumed.lever_arm.any()
        run = self._run._replace(
            R=self.fixes.rows("R", self.next_fix, due) if count else np.eye(MEASUREMENTS)[None],
            turns=self.fixes.rows("turn", self.next_fix, due) if arm else NO_TURNS.copy(),
        )
        aids, reading = (
            self._aids.within(
                self._begun, self._latest_measurement_time(self.at), self._latest_measurement_time(end)
            )
            if self._aids.are_used
            else (NO_AIDS, NONE)
        )
        run = run._replace(aids=read_only(aids))
        run.noise[:] = noise
        # The kernel counts the fixes and aids of this piece alone.
        run.counts[0] = run.counts[2] = 0
        out = Solution.empty(end - before + 1, count, self.model.blocks, aids=aids.time.size)
        advance(run, imu, shown, out, self.at - before, schedule, self.model)
        # The sample reached before was written by the piece before; the first of all by none.
        written = self.at if self.at == self.first else self.at + 1
        for name in _OF_SAMPLES:
            self.samples.rows(name, written, end + 1)[:] = getattr(out, name)[written - before :]
        self._keep_fixes(out, int(run.counts[0]), before)
        if aids.time.size:
            self._aids.keep(out, aids, reading)
        self.at = end
        self._keep_copy()

    def _keep_fixes(self, out: Solution, used: int, before: int) -> None:
        """Keep what came of the fixes."""
        start, end = self.next_fix, self.next_fix + used
        for name in ("innovation", "innovation_covariance"):
            self.fixes.rows(name, start, end)[:] = getattr(out, name)[:used]
        unknown = np.isnan(self.fixes.rows("velocity_n", start, end))
        self.fixes.rows("innovation", start, end)[:, 3:][unknown] = np.nan
        sample = out.fix_sample[:used]
        self.fixes.rows("sample", start, end)[:] = np.where(sample >= 0, sample + before, -1)
        self.fixes.rows("rejected", start, end)[:] = out.fix_rejected[:used]
        self.fixes.rows("recovered", start, end)[:] = out.fix_recovered[:used]
        self.next_fix = end

    def _keep_copy(self) -> None:
        """Keep a copy on the grid of times, and forget those that are too old."""
        now = self._time(self.at)
        if np.floor(now / COPY + 1e-6) > np.floor(self._time(self._copies[-1].sample) / COPY + 1e-6):
            self._copies.append(self._copy())
            while len(self._copies) > 2 and self._time(self._copies[1].sample) < now - BACK:
                self._copies.pop(0)
            self._gaps = [gap for gap in self._gaps if gap.end > self.reach]
