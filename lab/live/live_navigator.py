"""Live navigator: the solution of a stream of an IMU and, if there is one, a GPS receiver, as it arrives.

The compiled step is that of a batch run (`lab.navigation.navigator.advance`), with the same rules about rests,
R, gates and gaps, so the solution equals that of `lab.navigation.recorded.navigate_log` on the recorded log
from the same start. What the batch takes from the future differs:

- the start: the batch looks for the heading in the whole log, the live navigator in the data so far;
- the usual interval of the IMU is the median of the last intervals, not of all; it decides what is a gap, and
  the number of samples that fill it;
- the noise in a filled gap comes from the spread of the rates before it and its own length, not from the whole
  log and its longest gap;
- after a break of the IMU of more than two seconds, the navigator aligns again; the batch navigates the longest
  piece;
- a velocity that the receiver does not measure, and the rates about a fix with a lever arm, are final only
  with the next fix, or 50 ms later.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from lab.displacement import metres_per_radian
from lab.live.attitude_only import NORTH, Anchor, AttitudeOnly
from lab.live.intake import Increments, Intake
from lab.live.live_filter import FIXES, SAMPLES, Gap, LiveFilter
from lab.live.live_history import History
from lab.live.live_log import gnss_of, magnetometer_of, usable_fixes
from lab.live.live_start import LiveStart
from lab.live.live_state import (
    ALIGNING,
    ATTITUDE_ONLY,
    COASTING,
    NAVIGATING,
    PHASES,
    WAITING,
    Cursor,
    LiveHistory,
    LiveState,
    euler_with_sigma,
)
from lab.live.rolling import Rolling
from lab.live.timed import TIMED_FIX
from lab.logs.auxiliary_data import AuxiliaryData, Magnetometer
from lab.logs.sensor_log import GnssLog, SensorLog
from lab.navigation.alignment import Alignment
from lab.navigation.belief import assumed_latency, assumed_lever_arm, belief, schedule_of
from lab.navigation.checks import check_mechanization, check_r
from lab.navigation.choice import chosen_model
from lab.navigation.error_models import POS
from lab.navigation.initial_heading import MAGNETIC_SIGMA, by_magnetometer
from lab.navigation.navigator import PolarError
from lab.navigation.recorded import start_covariance, used_fixes
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import Imu
from lab.navigation.standstill import SHORTEST
from lab.sensors.suite import SensorSuite
from lab.settings import SettingError

FloatArray = NDArray[np.float64]

KEPT: Final = 120.0
"""How long samples are kept [s]: at 1 kHz in 100 MB. A start is sought among them."""
LEAST_KEPT: Final = 60.0
"""Shortest time for which samples can be kept [s]: a rest is looked for over half of it."""
COASTS_AFTER: Final = 3.0
"""Time without a fix after which the navigator coasts [s]: two missing ones of a receiver at 1 Hz."""
POSITION_LIMIT: Final = 100.0
"""Largest σ north or east with which a position is shown [m]: ten times that of a poor fix."""
STOPS_AT: Final = 2000.0
"""The σ at which the navigator stops and keeps the attitude only [m]: far beyond it, the filter is not linear."""
DISPLACEMENT_LIMIT: Final = 10.0
"""Largest σ north or east with which a displacement without fixes is shown [m]."""
DECLINATION_SIGMA: Final = np.radians(20.0)
"""σ of the magnetic declination at an unknown place [rad]: larger only about the magnetic poles."""
STEP: Final = 0.02
"""Shortest time of samples that is processed at once [s]: no page shows more, and a call costs 0.4 ms."""
EARLY: Final = 100
"""Fixes that wait for the first sample of the IMU."""


class Source(Protocol):
    """A stream that can be followed."""

    @property
    def ended(self) -> bool:
        """Whether nothing more will come."""
        ...

    def since(self, cursor: Any) -> tuple[Any, Any, int]:
        """Return the next cursor, the samples since the last (``imu``, ``fix``), and how many were lost.

        The first cursor is None. It waits for samples for a short time.
        """
        ...


class LiveSolution(NamedTuple):
    """The solution at all samples that are kept, including what later data said about them.

    Attributes
    ----------
    time : (n,) array
        Times of the log, which count from the first sample of the stream [s].
    position, velocity_n, q_nb, bias, variance, covariance : arrays
        As in `lab.navigation.solution.Solution`.
    fix_time : (m,) array
        Times of validity of the fixes since the start [s].
    innovation, innovation_covariance, fix_rejected : arrays
        As there.
    """

    time: FloatArray
    position: FloatArray
    velocity_n: FloatArray
    q_nb: FloatArray
    bias: FloatArray
    variance: FloatArray
    covariance: FloatArray
    fix_time: FloatArray
    innovation: FloatArray
    innovation_covariance: FloatArray
    fix_rejected: NDArray[np.bool_]


class LiveNavigator:
    """A navigator that is fed with rows as they arrive, from one thread.

    >>> navigator = LiveNavigator(SensorSuite(), NavigatorSettings())
    >>> navigator.state.phase
    'waiting'

    Parameters
    ----------
    sensors
        The filter's assumptions about the sensors, and the variances of a fix without σ.
    navigator
        The filter, and as for logs: vehicle, initial heading, lever arm and latency.
    place : (3,) array or None
        Latitude, longitude [rad] and height [m], if they are known without GPS: north is sought by
        gyro-compassing only at a known latitude.
    kept
        How long samples are kept at their full rate, at least `LEAST_KEPT` [s].

    Raises
    ------
    SettingError
        If the settings cannot be used for a stream.
    """

    def __init__(
        self,
        sensors: SensorSuite,
        navigator: NavigatorSettings,
        place: FloatArray | None = None,
        kept: float = KEPT,
    ) -> None:
        check_mechanization(navigator)
        if navigator.model == "nonlinear" or navigator.engine != "compiled":
            raise SettingError(
                "navigator: the sigma points of the model nonlinear and the reference in filterpy process whole "
                "logs only; accepted for a stream are the models phi, psi and invariant, and engine = compiled"
            )
        self._sensors, self._navigator, self._place = sensors, navigator, place
        self._kept = max(kept, LEAST_KEPT)
        self._model = chosen_model(navigator)
        assumed = belief(sensors, navigator)
        check_r(assumed.R)
        self._assumed = assumed._replace(
            bias_decay=np.zeros_like(assumed.bias_decay),
            lever_arm=assumed_lever_arm(navigator, np.zeros(3)),
        )
        self._latency = assumed_latency(navigator, 0.0)
        self._intake = Intake()
        self._history = History()
        self._early = np.empty(0, TIMED_FIX)
        self._rows: list[NDArray[np.void]] = []  # not yet taken
        self._taken = -np.inf  # time of the last row when rows were taken
        self._epoch = np.nan
        self._used = self._rejected = self._refused = 0
        self._notes: dict[str, str] = {}
        self._new_stream(np.nan)

    def feed(self, imu: NDArray[np.void] | None = None, fixes: NDArray[np.void] | None = None) -> None:
        """Take rows that arrived.

        Parameters
        ----------
        imu : (n,) array of `TIMED_IMU`
            Rows of the IMU, in the order of arrival.
        fixes : (m,) array of `TIMED_FIX`
            Fixes; they may be older than the rows of the IMU so far, by up to `live_filter.BACK`.
        """
        if imu is not None and imu.size:
            self._rows.append(imu)
            newest = float(imu["time"][-1])
            if 0 <= newest - self._taken < STEP and (fixes is None or not fixes.size):
                return
            self._taken = newest
        self._take_rows()
        if fixes is not None and fixes.size:
            self._take_fixes(fixes)
        self._advance()

    def finish(self) -> None:
        """Process what waits for later samples: there will be none."""
        self._take_rows()
        for part in self._intake.finish():
            self._take(part)
        self._advance()
        if self._filter is not None:
            self._filter.finish()

    def follow(self, source: Source) -> None:
        """Feed from a source until it ends."""
        cursor = None
        while True:
            ended = source.ended  # before the last samples are taken
            cursor, samples, lost = source.since(cursor)
            if lost:
                self._notes["lost"] = (
                    f"{lost} samples came faster than they were processed and were lost to the navigator; the "
                    "recording has them."
                )
            self.feed(samples.imu, samples.fix)
            if ended and not samples.imu.size and not samples.fix.size:
                self.finish()
                return

    @property
    def alignment(self) -> Alignment | None:
        """The start of the navigator, if it was found."""
        return self._alignment

    @property
    def state(self) -> LiveState:
        """What is known now."""
        phase, reason = self._phase()
        fixes = self._fixes
        common: dict[str, Any] = {
            "phase": phase,
            "reason": reason,
            "fixes_used": self._used,
            "fixes_rejected": self._rejected,
            "fixes_refused": self._refused,
            "rows": self._intake.counts,
            "remarks": tuple(self._notes.values()),
        }
        if not len(self._samples):
            return LiveState(**common)
        common["time"] = self._now + self._epoch
        if len(fixes):
            common["fix_time"] = float(fixes.column("time")[-1]) + self._epoch
        if self._filter is not None and self._filter.next_fix > self._first_fix:
            last = slice(self._filter.next_fix - 1, self._filter.next_fix)
            common["innovation"] = fixes.rows("innovation", last.start, last.stop)[0].copy()
            S = fixes.rows("innovation_covariance", last.start, last.stop)[0]
            common["innovation_sigma"] = np.sqrt(np.diagonal(S))
        if phase == ALIGNING:
            return LiveState(**common, **self._of_fix())
        row = {name: self._samples.rows(name, self._end - 1, self._end).copy() for name in _SHOWN}
        euler, sigma = euler_with_sigma(row["q_nb"], row["variance"], row["covariance"])
        sigmas = np.sqrt(np.maximum(row["variance"][0], 0.0))
        common |= {
            "euler": euler[0],
            "euler_sigma": sigma[0],
            "bias": row["bias"][0],
            "bias_sigma": sigmas[9:15],
        }
        common["is_at_rest"] = self._attitude.rest > 0 if self._attitude is not None else self._is_at_rest()
        if self._attitude is not None:
            common["heading_source"] = self._attitude.heading_source
            return LiveState(**common, **self._of_fix(), **self._displacement(row, sigmas))
        assert self._alignment is not None
        common["heading_source"] = self._alignment.heading.source
        if phase != ATTITUDE_ONLY:
            common |= {
                "position": row["position"][0],
                "position_sigma": sigmas[:3],
                "velocity_n": row["velocity_n"][0],
                "velocity_sigma": sigmas[3:6],
            }
        return LiveState(**common)

    def since(self, cursor: Cursor = Cursor()) -> tuple[Cursor, LiveHistory]:  # noqa: B008 - immutable
        """Return the history since a cursor, as it was shown, and the next cursor."""
        return self._history.since(cursor)

    def solution(self) -> LiveSolution:
        """Return the solution at the samples that are kept, from the start of the navigator on."""
        first = self._samples.first if self._filter is None else max(self._filter.first, self._samples.first)
        end = self._samples.end
        fix = max(self._first_fix, self._fixes.first)
        last = max(fix, self._filter.next_fix if self._filter is not None else fix)
        names = ("time", "position", "velocity_n", "q_nb", "bias", "variance", "covariance")
        of_fixes = ("time", "innovation", "innovation_covariance", "rejected")
        return LiveSolution(
            *(self._samples.rows(name, first, end).copy() for name in names),
            *(self._fixes.rows(name, fix, last).copy() for name in of_fixes),
        )

    def log(self) -> SensorLog:
        """Return the samples that are kept as a sensor log, for the batch; all of a short stream."""
        zero = float(self._samples.column("time")[0])
        gnss = GnssLog(
            self._fixes.column("time") + self._latency - zero,
            *(
                self._fixes.column(name).copy()
                for name in ("position", "velocity_n", "position_sigma", "velocity_sigma")
            ),
            self._assumed.lever_arm,
            self._latency,
        )
        time = self._samples.column("time") - zero
        gaps = [(gap.start, gap.end) for gap in self._gaps if gap.start >= zero]
        magnetic = self._samples.column("magnetic")
        return SensorLog(
            "live stream",
            self._epoch + zero,
            time,
            self._samples.column("dtheta")[1:].copy(),
            self._samples.column("dvelocity")[1:].copy(),
            gnss,
            None,
            np.array(gaps).reshape(-1, 2) - zero,
            (),
            auxiliary=AuxiliaryData(magnetometer=magnetometer_of(time, magnetic)),
        )

    @property
    def _end(self) -> int:
        return self._samples.end

    @property
    def _now(self) -> float:
        return float(self._samples.rows("time", self._end - 1, self._end)[0])

    def _new_stream(self, epoch: float) -> None:
        """Begin with the first sample of a stream, at a time of the host [s]."""
        self._epoch = epoch
        self._samples = Rolling(SAMPLES | {"variance": ((self._model.states,), np.float64)})
        self._fixes = Rolling(FIXES)
        self._gaps: list[Gap] = []
        self._start = LiveStart(self._navigator)
        self._alignment: Alignment | None = None
        self._filter: LiveFilter | None = None
        self._attitude: AttitudeOnly | None = None
        self._missing = "No GPS fix has come yet."
        self._second = -1
        self._first_fix = self._shown_fix = 0
        self._shown = 0  # samples in the history

    def _take_rows(self) -> None:
        """Repair and append the rows that arrived since the last time."""
        if self._rows:
            rows = self._rows[0] if len(self._rows) == 1 else np.concatenate(self._rows)
            self._rows = []
            for part in self._intake.accept(rows):
                self._take(part)

    def _take(self, part: Increments) -> None:
        """Append increments; those after a break begin a new stream."""
        if part.begins:
            if len(self._samples):
                self._advance()
                silent = float(part.time[0]) - self._epoch - self._now
                self._notes["break"] = (
                    f"The IMU was silent for {silent:.1f} s, or its clock was set back: the motion in between is "
                    "unknown, so the navigator aligned again."
                )
            self._new_stream(float(part.time[0]))
        before = self._end
        self._samples.extend(part.time.size)
        rows = self._samples.rows
        rows("time", before, self._end)[:] = part.time - self._epoch
        rows("dtheta", before, self._end)[:] = part.values[:, :3]
        rows("dvelocity", before, self._end)[:] = part.values[:, 3:]
        rows("magnetic", before, self._end)[:] = part.magnetic
        for start, end in part.gaps:
            self._take_gap(start - self._epoch, end - self._epoch)
        if part.begins:
            heading = self._navigator.initial_heading
            self._attitude = AttitudeOnly(
                self._samples,
                self._sensors,
                self._place,
                np.nan if heading is None else float(np.radians(heading)),
                float(np.radians(self._navigator.initial_heading_uncertainty)),
            )
            early, self._early = self._early, self._early[:0]
            self._take_fixes(early)

    def _take_gap(self, start: float, end: float) -> None:
        """Take note of a filled gap, with the densities of the unknown motion: the spread of the rates so far."""
        last = max(self._samples.number("time", start - 1e-6), self._samples.first + 1)
        dt = np.diff(self._samples.rows("time", self._samples.first, last + 1))[:, None]
        spread = [
            (self._samples.rows(name, self._samples.first + 1, last + 1) / dt).var(axis=0)
            for name in ("dtheta", "dvelocity")
        ]
        extra = np.concatenate((*spread, np.zeros(6))) * (end - start)
        gap = Gap(start, end, self._assumed.noise + extra)
        self._gaps = [*self._gaps, gap][-1000:]
        if self._filter is not None:
            self._filter.gaps.append(gap)
        self._notes["gap"] = (
            f"{self._intake.counts.gaps} gaps of the IMU were filled linearly with {self._intake.counts.filled} "
            "samples; the filter got large variances there."
        )

    def _take_fixes(self, rows: NDArray[np.void]) -> None:
        """Append fixes that can be used."""
        if np.isnan(self._epoch):
            self._early = np.concatenate((self._early, rows))[-EARLY:]
            return
        good = usable_fixes(rows)
        time = rows["time"] - self._epoch - self._latency
        earliest = float(self._fixes.column("time")[-1]) if len(self._fixes) else -np.inf
        if self._filter is not None:
            earliest = max(earliest, self._filter.reach)
        usable = np.where(good, time, -np.inf)
        good &= usable > np.maximum.accumulate(np.append(earliest, usable))[:-1]
        if not good.all():
            self._refused += int((~good).sum())
            self._notes["refused"] = (
                f"{self._refused} fixes were not used: without a position in three dimensions, not in order, or "
                "too late."
            )
        rows = rows[good]
        if not rows.size:
            return
        if (rows["sea_level"] == 1).any():
            self._notes["sea level"] = (
                "The receiver gives its height above sea level; it is used as height above the ellipsoid."
            )
        gnss = gnss_of(rows)
        start = self._fixes.end
        self._fixes.extend(rows.size)
        put = self._fixes.rows
        put("time", start, self._fixes.end)[:] = time[good]
        put("arrival", start, self._fixes.end)[:] = rows["arrival"]
        for name in ("position", "velocity_n", "position_sigma", "velocity_sigma"):
            put(name, start, self._fixes.end)[:] = getattr(gnss, name)
        put("measured", start, self._fixes.end)[:] = 6 - np.isnan(gnss.velocity_n).sum(axis=1)
        self._know_velocities(start)

    def _know_velocities(self, start: int) -> None:
        """Write the fixes as the filter uses them, from the one before the first new one on."""
        first, end = max(start - 2, self._fixes.first), self._fixes.end
        changed = max(start - 1, self._fixes.first)
        rows = self._fixes.rows
        names = ("time", "position", "velocity_n", "position_sigma", "velocity_sigma")
        window = GnssLog(*(rows(name, first, end) for name in names), np.zeros(3), 0.0)
        alone = end - first == 1
        if alone:  # a difference of positions needs two
            window = GnssLog(
                *(np.repeat(getattr(window, name), 2, axis=0) for name in names), np.zeros(3), 0.0
            )
            window.time[1] += 1.0
        known, R, variances = used_fixes(window, self._assumed, self._navigator)
        old = rows("known_velocity", changed, start).copy()
        for name, values in (("known_velocity", known.velocity_n), ("R", R), ("variances", variances)):
            rows(name, changed, end)[:] = values[changed - first : end - first]
        if self._filter is not None:
            same = np.array_equal(old, rows("known_velocity", changed, start))
            now = start if same or changed < self._first_fix else changed
            self._filter.changed_fixes(now, end)

    def _advance(self) -> None:
        """Advance to the last sample, or look for a start."""
        if not len(self._samples):
            return
        if self._filter is None:
            self._seek()
        if self._filter is not None:
            self._navigate(self._filter)
        _, has_position = self._shows_position()
        if self._attitude is None or self._attitude.begun:
            phase = PHASES.index(self._phase()[0])
            self._history.add(self._samples, self._shown, self._epoch, phase, has_position=has_position)
        self._shown = self._end
        self._forget()

    def _navigate(self, run: LiveFilter) -> None:
        why = ""
        try:
            run.advance()
        except PolarError as error:
            why = str(error)
        state = run.state
        if not why and not np.isfinite(state).all():
            why = "the solution diverged beyond all numbers"
        if not why and np.sqrt(self._variance()[POS][:2].max()) > STOPS_AT:
            why = f"its σ of the position reached {STOPS_AT / 1000:g} km without fixes"
        if run.next_fix > self._shown_fix:
            start = max(self._shown_fix, self._fixes.first)
            rejected = self._fixes.rows("rejected", start, run.next_fix)
            self._rejected += int(rejected.sum())
            self._used += int((~rejected).sum())
            self._history.add_fixes(self._fixes, start, run.next_fix, self._epoch)
            self._shown_fix = run.next_fix
        if why:
            self._stop(why)

    def _stop(self, why: str) -> None:
        """Keep the attitude only."""
        self._notes["stop"] = f"The navigator stopped, since {why}; it starts again with the next fixes."
        here = {name: self._samples.rows(name, self._end - 1, self._end)[0].copy() for name in _SHOWN}
        usable = all(np.isfinite(values).all() for values in here.values())
        prior = None
        if usable:
            P = np.diag(here["variance"][:15])
            for k, (i, j) in enumerate(((6, 7), (6, 8), (7, 8))):
                P[i, j] = P[j, i] = here["covariance"][1, k]
            place = here["position"] if self._place is None else self._place
            prior = Anchor(self._now, place, here["q_nb"], here["bias"], P)
        source = "" if self._alignment is None else self._alignment.heading.source
        self._filter = self._alignment = None
        self._samples.forget(self._end - 1)
        self._fixes.forget(self._fixes.end)
        self._attitude = AttitudeOnly(self._samples, self._sensors, self._place, prior=prior)
        self._attitude.heading_source = source
        self._start = LiveStart(self._navigator)
        self._first_fix = self._shown_fix = self._fixes.end

    def _seek(self) -> None:
        """Advance the attitude, and once a second look for a start."""
        attitude = self._attitude
        assert attitude is not None
        if self._place is None and len(self._fixes):
            attitude.place = self._fixes.column("position")[-1].copy()
        try:
            attitude.advance()
        except PolarError:
            self._stop("the position drifted to a pole")
            return
        second = int(self._now)
        if second == self._second:
            return
        self._second = second
        self._look_at_compass(attitude)
        found = self._start.seek(self._samples, self._fixes, self._shown_heading(attitude))
        self._missing = found.why
        if found.alignment is not None:
            self._begin(found.alignment, found.first)

    def _shown_heading(self, attitude: AttitudeOnly) -> tuple[float, float, str] | None:
        """Return the heading at the first sample with a fix, its σ and its source, if it is well known."""
        if not attitude.heading_is_known or not len(self._fixes):
            return None
        first = self._samples.number("time", float(self._fixes.column("time")[0]) - 1e-6)
        at = first
        if (
            attitude.rest
            and float(self._samples.rows("time", first, first + 1)[0]) > self._now - attitude.rest
        ):
            at = self._end - 1  # at rest, the heading of now is that of then
        row = {name: self._samples.rows(name, at, at + 1) for name in ("q_nb", "variance", "covariance")}
        if not row["q_nb"].any():
            return None
        euler, sigma = euler_with_sigma(row["q_nb"], row["variance"], row["covariance"])
        if not sigma[0, 2] < NORTH:
            return None
        return float(euler[0, 2]), float(sigma[0, 2]), attitude.heading_source

    def _look_at_compass(self, attitude: AttitudeOnly) -> None:
        """Give the attitude the heading of the magnetometer at rest, if it has none as good."""
        if not attitude.begun or not attitude.rest or attitude.P[8, 8] <= 2 * MAGNETIC_SIGMA**2:
            return
        start = max(self._samples.number("time", self._now - SHORTEST), self._samples.first)
        imu = Imu(*(self._samples.rows(name, start, self._end) for name in ("time", "dtheta", "dvelocity")))
        field = magnetometer_of(imu.time, self._samples.rows("magnetic", start, self._end))
        if field is None:
            return
        row = {name: self._samples.rows(name, self._end - 1, self._end) for name in _SHOWN}
        euler, sigma = euler_with_sigma(row["q_nb"], row["variance"], row["covariance"])
        place = attitude.place
        if place is None:
            field = Magnetometer(field.time, field.field, 0.0)
        found = by_magnetometer(
            imu,
            field,
            (float(euler[0, 0]), float(euler[0, 1])),
            float(sigma[0, :2].max()),
            float(SHORTEST),
            np.zeros(3) if place is None else place,
        )
        if found.source:
            more = DECLINATION_SIGMA if place is None else 0.0
            source = "by the magnetometer, from magnetic north" if place is None else found.source
            attitude.give_heading(found.heading, float(np.hypot(found.sigma, more)), source)

    def _begin(self, alignment: Alignment, first: int) -> None:
        """Begin the filter at a sample that has passed."""
        self._alignment, self._attitude = alignment, None
        time = self._samples.rows("time", first, self._end)
        variances = self._fixes.column("variances")[0]
        assumed = self._assumed._replace(
            P0=start_covariance(self._assumed, self._navigator, alignment, variances)
        )
        schedule = schedule_of(self._navigator, float(np.median(np.diff(time))), 2**62)
        run = LiveFilter(
            self._samples,
            self._fixes,
            first,
            alignment.start._replace(gyro_bias=alignment.gyro_bias),
            assumed,
            self._navigator,
            schedule,
            self._model,
            rests=bool(self._navigator.rest_updates),
        )
        run.gaps = [gap for gap in self._gaps if gap.start >= float(time[0]) - 1e-6]
        self._filter = run
        self._first_fix = self._shown_fix = run.next_fix
        if run.next_fix < self._fixes.end:
            run.changed_fixes(run.next_fix, self._fixes.end)
        self._notes["start"] = alignment.remark

    def _variance(self) -> FloatArray:
        return np.asarray(self._samples.rows("variance", self._end - 1, self._end)[0])

    def _is_at_rest(self) -> bool:
        start = self._samples.number("time", self._now - 1.5)
        return bool(self._samples.rows("rest", start, self._end).any())

    def _forget(self) -> None:
        """Forget what is older than is kept."""
        samples, fixes = self._samples, self._fixes
        oldest = float(samples.column("time")[0])
        if self._now - oldest < self._kept + 1.0:
            return
        samples.forget(samples.number("time", self._now - self._kept))
        fixes.forget(fixes.number("time", float(samples.column("time")[0])) - 2)

    def _last_fix_age(self) -> float:
        if not len(self._fixes):
            return np.inf
        return self._now - float(self._fixes.column("time")[-1])

    def _shows_position(self) -> tuple[float, bool]:
        """Return the larger σ north or east [m], and whether a position is shown with it."""
        if self._filter is None:
            return np.nan, False
        sigma = float(np.sqrt(self._variance()[:2].max()))
        return sigma, sigma <= POSITION_LIMIT

    def _phase(self) -> tuple[str, str]:
        """Return the phase, and why it is that one."""
        if not len(self._samples):
            return WAITING, "No sample of the IMU has come yet."
        if self._filter is None:
            return self._phase_without_fixes()
        age = self._last_fix_age()
        sigma, shown = self._shows_position()
        if not shown:
            return ATTITUDE_ONLY, (
                f"The last fix is {age:.0f} s old, and the σ of the position has grown to {sigma:.0f} m: a "
                f"position is shown up to {POSITION_LIMIT:g} m."
            )
        if age > COASTS_AFTER:
            return COASTING, f"The last fix is {age:.0f} s old: the position drifts, and its σ grows."
        return NAVIGATING, f"IMU and GPS: the position has a σ of {sigma:.2g} m."

    def _phase_without_fixes(self) -> tuple[str, str]:
        attitude = self._attitude
        assert attitude is not None
        if not attitude.begun:
            still = f"still for {attitude.still} s so far" if attitude.still else "it moves"
            return ALIGNING, attitude.refused or (
                f"The IMU must stand still for {SHORTEST} s to find the vertical; {still}."
            )
        heading = ""
        if not attitude.heading_is_known:
            reach = np.degrees(attitude.reachable())
            north = (
                "these gyros reach no heading by the Earth's rate"
                if reach > np.degrees(NORTH)
                else f"gyro-compassing reaches a σ of {reach:.2g}° at rest"
            )
            known = "at this latitude" if attitude.place is not None else "at 45° (the latitude is unknown)"
            biased = f" ({reach:.0f}° σ {known})" if reach > np.degrees(NORTH) else f" {known}"
            heading = f" The heading is relative: {north}{biased}."
        return ATTITUDE_ONLY, f"No position: {self._missing}{heading}" + (
            f" {attitude.refused}" if attitude.refused else ""
        )

    def _of_fix(self) -> dict[str, FloatArray]:
        """Return position and velocity of the last fix, as long as the navigator has none of its own."""
        if self._last_fix_age() > COASTS_AFTER:
            return {}
        last = slice(self._fixes.end - 1, self._fixes.end)
        row = {
            name: self._fixes.rows(name, last.start, last.stop)[0].copy()
            for name in ("position", "velocity_n", "variances")
        }
        sigma = np.sqrt(row["variances"])
        return {
            "position": row["position"],
            "position_sigma": sigma[:3],
            "velocity_n": row["velocity_n"],
            "velocity_sigma": np.where(np.isnan(row["velocity_n"]), np.nan, sigma[3:]),
        }

    def _displacement(self, row: dict[str, FloatArray], sigmas: FloatArray) -> dict[str, FloatArray]:
        """Return the displacement since the last rest, as long as it means something."""
        assert self._attitude is not None
        if sigmas[:2].max() > DISPLACEMENT_LIMIT:
            return {}
        place = self._attitude.rest_place
        position = row["position"][0]
        per_latitude, per_longitude = metres_per_radian(position[0], position[2])
        step = position - place
        return {
            "displacement": np.array(
                [float(step[0] * per_latitude), float(step[1] * per_longitude), -float(step[2])]
            ),
            "displacement_sigma": sigmas[:3],
        }


_SHOWN: Final = ("position", "velocity_n", "q_nb", "bias", "variance", "covariance")
