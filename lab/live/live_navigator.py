"""Live navigator: the solution of a stream of an IMU and, if there is one, a GPS receiver, as it arrives.

The compiled step is that of a batch run (`lab.navigation.navigator.advance`), with the same rules about
rests, R, gates and gaps, so the solution equals that of `lab.navigation.log_navigation.navigate_log` on the
recorded log from the same start. What the batch takes from the future differs:

- the start: the batch looks for the heading in the whole log, the live navigator in the data so far. If the
  vehicle was slow then, its first fast course may show that it moved backwards: the navigator begins again;
- the noise in a filled gap comes from the motion on both sides, and is final 5 s after it;
- after a break of the IMU of more than two seconds, the navigator aligns again; the batch navigates the
  longest piece;
- a full navigator whose position became worse than `STOPS_AT` without fixes stops, and aligns again when
  fixes return; the batch goes on;
- a velocity that the receiver does not measure, and the rates about a fix with a lever arm, are final only
  with the next fix, or 50 ms later.
"""

from __future__ import annotations

from collections.abc import Sequence
from threading import RLock
from typing import Final

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.parameters.setting_error import SettingError
from lab.data.clock.timed_samples import NO_READINGS
from lab.data.log.sensor_log import SensorLog
from lab.data.streams.intake import Increments, Intake
from lab.data.streams.source_status import Event
from lab.live.attitude_only import AttitudeOnly
from lab.live.live_aids import LiveAids
from lab.live.live_filter import LiveFilter
from lab.live.live_history import History
from lab.live.live_intake import FixIntake, ReadingIntake
from lab.live.live_start import LiveStart
from lab.live.live_state import PHASES, Anchor, HistoryCursor, LiveHistory, LiveState
from lab.live.live_stream import Stream, log_of_stream, look_at_compass
from lab.live.live_view import describe_phase, read_state
from lab.live.pace import Pace
from lab.live.stream_settings import stream_settings
from lab.motion.frames.rotation import wrap
from lab.navigation.alignment import limits
from lab.navigation.alignment.alignment import Alignment
from lab.navigation.alignment.initial_heading import contradict
from lab.navigation.alignment.start_covariance import start_covariance
from lab.navigation.belief import assumed_latency, assumed_lever_arm, belief, schedule_filter
from lab.navigation.checks import check_mechanization, check_r
from lab.navigation.filters.schedule import EVERY_FIX
from lab.navigation.model_choice import chosen_model
from lab.navigation.navigator import load
from lab.navigation.settings import NavigatorSettings
from lab.sensors.suite import SensorSuite

KEPT: Final = 120.0
"""How long samples are kept [s]: at 1 kHz in 100 MB. A start is sought among them."""
LEAST_KEPT: Final = 60.0
"""Shortest time for which samples can be kept [s]: a rest is sought over half of it."""
STOPS_AT: Final = 2000.0
"""σ of the position at which the navigator stops and keeps the attitude only [m]: it comes from a velocity
wrong by tens of metres per second, and such errors are not small."""
STEP: Final = 0.05
"""Shortest time of samples that is processed at once, where nobody asks for less [s]: no page draws oftener;
a call costs 0.4 ms."""
SOON: Final = 1.0
"""Longest time between the last sample and the loss of its source that caused the break [s]: breaks are at
least 2 s apart."""
GAPS: Final = 1000
"""Gaps that are remembered."""


class LiveNavigator:
    """A navigator that is fed with rows as they arrive, from one thread; others may read it.

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
    step
        Shortest time of samples that is processed at once [s].

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
        step: float = STEP,
    ) -> None:
        check_mechanization(navigator)
        if navigator.model == "nonlinear" or navigator.engine != "compiled":
            raise SettingError(
                "navigator: the sigma points of the model nonlinear and the reference in filterpy process "
                "whole logs only; accepted for a stream are the models phi, psi and invariant, and engine = "
                "compiled"
            )
        sensors, navigator = stream_settings(sensors, navigator)
        self._sensors, self._navigator, self._place = sensors, navigator, place
        self._kept = max(kept, LEAST_KEPT)
        self._pace = Pace(step)
        self._model = chosen_model(navigator, sensors)
        assumed = belief(sensors, navigator)
        check_r(assumed.R)
        self._assumed = assumed._replace(
            decay=np.append(np.zeros(6), assumed.decay[6:]),
            lever_arm=assumed_lever_arm(navigator, np.zeros(3)),
        )
        self._latency = assumed_latency(navigator, 0.0)
        self._intake = Intake()
        self._fix_intake = FixIntake(self._assumed, navigator, self._latency)
        self._reading_intake = ReadingIntake()
        self._history = History()
        self._rows: list[NDArray[np.void]] = []  # not yet taken
        self._used = self._rejected = 0
        self._lock = RLock()
        self._broken = False  # whether this stream is not the first
        self._notes: dict[str, str] = {}
        self._why_again = ""  # why the next stream begins, if not by a break
        self.losses: Sequence[Event] = ()
        """When and why the source broke, as far as it knows; whoever feeds the navigator sets it."""
        self._new_stream(np.nan)
        load(self._assumed, EVERY_FIX)
        load(self._assumed, schedule_filter(navigator, STEP, 1), self._model, aided=self._aids.are_used)

    def feed(
        self,
        imu: NDArray[np.void] | None = None,
        fixes: NDArray[np.void] | None = None,
        readings: NDArray[np.void] = NO_READINGS,
    ) -> bool:
        """Take rows that arrived; return whether they were processed: few samples wait for the next ones.

        Parameters
        ----------
        imu : (n,) array of `TIMED_IMU`
            Rows of the IMU, in the order of arrival.
        fixes : (m,) array of `TIMED_FIX`
            Fixes; they may be older than the rows of the IMU so far, by up to `live_filter.BACK`.
        readings : (k,) array of `lab.data.clock.timed_samples.TIMED_READING`
            Headings and speeds; they may be as old.
        """
        if readings.size:
            with self._lock:
                self._reading_intake.arrive(readings)
        if imu is not None and imu.size:
            self._rows.append(imu)
            if not self._pace.is_due(float(imu["time"][-1])) and (fixes is None or not fixes.size):
                return False
        with self._lock:
            self._append_rows()
            if fixes is not None and fixes.size:
                self._fix_intake.accept(self._stream, fixes)
            self._reading_intake.accept(self._stream, self._aids)
            self._advance()
        return True

    @property
    def due(self) -> float:
        """Time of a sample with which those that wait are processed, by the clock of the rows [s]."""
        return self._pace.next

    def finish(self) -> None:
        """Process what waits for later samples: there will be none."""
        with self._lock:
            self._append_rows()
            for part in self._intake.finish():
                self._accept(part)
            self._reading_intake.accept(self._stream, self._aids)
            self._advance()
            if self._stream.filter is not None:
                self._stream.filter.finish()

    def restart(self, why: str) -> None:
        """Align again with the samples to come, as when they have other axes.

        Parameters
        ----------
        why
            The reason, as the beginning of a sentence.
        """
        with self._lock:
            self._append_rows()
            self._advance()
            self._intake.restart()
            self._why_again = why

    @property
    def alignment(self) -> Alignment | None:
        """The start of the navigator, if it was found."""
        return self._stream.alignment

    @property
    def state(self) -> LiveState:
        """What is known now."""
        with self._lock:
            counted = {
                "fixes_used": self._used,
                "fixes_rejected": self._rejected,
                "fixes_refused": self._fix_intake.refused,
                "utc_offset": self._fix_intake.utc_offset,
                "is_above_sea": self._fix_intake.above_sea if self._fix_intake.first else None,
                "rows": self._intake.counts,
                "remarks": (*self._notes.values(), *self._intake.counts.remarks, *self._fix_intake.remarks),
            }
            return read_state(self._stream, counted)

    def since(self, cursor: HistoryCursor | None = None) -> tuple[HistoryCursor, LiveHistory]:
        """Return the history since a cursor, as it was shown, and the next cursor."""
        with self._lock:
            return self._history.since(cursor or HistoryCursor())

    def log(self) -> SensorLog:
        """Return the samples that are kept as a sensor log, for the batch; all of a short stream.

        Raises
        ------
        MissionError
            If nothing has come yet.
        """
        with self._lock:
            return log_of_stream(
                self._stream,
                self._assumed.lever_arm,
                self._latency,
                self._reading_intake.heights.shift,
                self.state.remarks,
            )

    def _new_stream(self, epoch: float) -> None:
        """Begin with the first sample of a stream, at a time of the host [s]."""
        self._stream = Stream(epoch, self._model.states)
        stream = self._stream
        self._aids = LiveAids(self._sensors, self._navigator, stream.readings, stream.samples)
        self._start = LiveStart(self._navigator, self._assumed)
        self._second = -1  # in which a start was sought
        self._shown_fix = self._shown = 0  # fixes and samples in the history

    def _append_rows(self) -> None:
        """Repair and append the rows that arrived since the last time."""
        if self._rows:
            rows = self._rows[0] if len(self._rows) == 1 else np.concatenate(self._rows)
            self._rows = []
            for part in self._intake.accept(rows):
                self._accept(part)
            self._reading_intake.append_rows(rows, self._stream, self._aids)

    def _accept(self, part: Increments) -> None:
        """Append increments; those after a break begin a new stream."""
        if part.begins:
            self._break(float(part.time[0]))
        stream = self._stream
        stream.samples.append(
            time=part.time - stream.epoch,
            dtheta=part.values[:, :3],
            dvelocity=part.values[:, 3:],
            magnetic=part.magnetic,
        )
        for start, end in part.gaps:
            self._take_gap(start - stream.epoch, end - stream.epoch)
        if part.begins:
            heading = self._navigator.initial_heading
            stream.attitude = AttitudeOnly(
                stream.samples,
                self._sensors,
                self._place,
                np.nan if heading is None or self._broken else float(np.radians(heading)),
                float(np.radians(self._navigator.initial_heading_uncertainty)),
            )
            self._fix_intake.early(stream)

    def _break(self, time: float) -> None:
        """Begin a new stream at a time of the host [s], and say so if it is not the first."""
        self._broken = len(self._stream.samples) > 0
        if self._broken:
            self._advance()
            what = self._why_again or self._cause(self._stream.epoch + self._stream.now, time)
            self._notes["break"] = f"{what}, so the navigator aligned again."
        self._why_again = ""
        self._new_stream(time)

    def _cause(self, last: float, time: float) -> str:
        """Return why a stream begins anew after its last time, both of the host [s]."""
        # The last sample came at most a second before its source broke: a longer silence shows by itself.
        known = [loss.text for loss in self.losses if last - SOON <= loss.time <= min(last + SOON, time)]
        if known:
            return f"The stream broke ({known[-1]})"
        if time > last:
            return f"The IMU was silent for {time - last:.1f} s: the motion in between is unknown"
        return "The clock was set back"

    def _take_gap(self, start: float, end: float) -> None:
        """Take note of a filled gap."""
        stream = self._stream
        stream.gaps = [*stream.gaps, (start, end)][-GAPS:]
        for run in (stream.filter, stream.attitude):
            if run is not None:
                run.add_gaps([(start, end)])

    def _advance(self) -> None:
        """Advance to the last sample, or look for a start."""
        stream = self._stream
        if not len(stream.samples):
            return
        stream.forget(self._kept)  # before a start is sought among the rest
        self._reading_intake.begin(self._fix_intake.first, stream, self._aids)
        self._notes |= {name: remark for name, remark in self._aids.remarks.items() if remark}
        if stream.attitude is not None:
            self._seek(stream.attitude)
        elif stream.filter is not None:
            self._check_course()
        if stream.filter is not None:
            self._navigate(stream.filter)
        if stream.attitude is None or stream.attitude.begun:
            phase = PHASES.index(describe_phase(stream)[0])
            shown = max(self._shown, stream.samples.first)
            self._history.add(stream.samples, shown, stream.epoch, phase, has_position=stream.has_position)
        self._shown = stream.end

    def _navigate(self, run: LiveFilter) -> None:
        """Advance the full navigator, or stop it if its solution means nothing any more."""
        why = ""
        run.advance()
        stream = self._stream
        if not np.isfinite(run.state).all():
            why = "the solution diverged beyond all numbers"
        if not why and stream.position_sigma > STOPS_AT:
            why = f"the σ of the position reached {STOPS_AT / 1000:g} km without fixes"
        if run.next_fix > self._shown_fix:
            start = max(self._shown_fix, stream.fixes.first)
            rejected = stream.fixes.rows("rejected", start, run.next_fix)
            self._rejected += int(rejected.sum())
            self._used += int((~rejected).sum())
            self._history.add_fixes(stream.fixes, start, run.next_fix, stream.epoch)
            self._shown_fix = run.next_fix
        if why:
            self._stop(why)

    def _check_course(self) -> None:
        """Begin again if the first fast course shows that the vehicle began backwards, or was carried."""
        stream = self._stream
        if not self._is_new_second():
            return
        found = self._start.seek_again(stream.samples, stream.fixes, stream.readings["heading"])
        if found.alignment is None or stream.alignment is None:
            return
        then = stream.sample(found.first)
        own = stream.alignment.heading._replace(heading=then.euler[2], sigma=then.euler_sigma[2])
        if not then.is_usable or not contradict(own, found.alignment.heading):
            return
        apart = np.degrees(abs(wrap(found.alignment.heading.heading - own.heading)))
        self._begin(found.alignment, found.first)
        self._notes["again"] = (
            f"The first course above {limits.ALIGNMENT.forward_speed:g} m/s showed that the heading at the "
            f"start was wrong by {apart:.0f}°: the navigator began again with the samples that are kept."
        )

    def _stop(self, why: str) -> None:
        """Keep the attitude only."""
        stream = self._stream
        self._notes["stop"] = f"The navigator stopped, since {why}; it starts again with the next fixes."
        here, prior, source = stream.sample(stream.end - 1), None, ""
        if here.is_usable:
            P = np.diag(here.variance[:15])
            # Of the covariances beside the variances, the history has those of the attitude.
            for k, (i, j) in enumerate(((6, 7), (6, 8), (7, 8))):
                P[i, j] = P[j, i] = here.covariance[1, k]
            place = here.position if self._place is None else self._place
            prior = Anchor(stream.now, place, here.q_nb, here.bias, P)
            source = "" if stream.alignment is None else stream.alignment.heading.source
        stream.filter = stream.alignment = None
        stream.missing = "The last position is too uncertain."
        stream.samples.forget(stream.end - 1)
        stream.fixes.forget(stream.fixes.end)
        stream.attitude = AttitudeOnly(stream.samples, self._sensors, self._place, prior=prior)
        stream.attitude.heading_source = source
        stream.first_fix = self._shown_fix = stream.fixes.end
        self._start = LiveStart(self._navigator, self._assumed)

    def _is_new_second(self) -> bool:
        """Return whether a second began since the last call: a start is sought once in each."""
        second = int(self._stream.now)
        is_new, self._second = second != self._second, second
        return is_new

    def _seek(self, attitude: AttitudeOnly) -> None:
        """Advance the attitude, and once a second look for a start."""
        stream = self._stream
        if self._place is None and len(stream.fixes):
            attitude.place = stream.fixes.column("position")[-1].copy()
        attitude.advance()
        if not self._is_new_second():
            return
        look_at_compass(stream)
        found = self._start.seek(
            stream.samples, stream.fixes, stream.shown_heading(), stream.readings["heading"]
        )
        stream.missing = found.why
        if found.alignment is not None:
            self._begin(found.alignment, found.first)

    def _begin(self, alignment: Alignment, first: int) -> None:
        """Begin the full navigator at a sample that has passed."""
        stream = self._stream
        stream.alignment, stream.attitude = alignment, None
        variances = stream.fixes.column("variances")[0, :3]
        P0 = start_covariance(self._assumed, self._navigator, self._model.blocks, alignment, variances)
        run = LiveFilter(
            stream.samples,
            stream.fixes,
            first,
            alignment.start._replace(gyro_bias=alignment.gyro_bias),
            self._assumed._replace(P0=P0),
            self._navigator,
            self._model,
            self._aids,
            rests=bool(self._navigator.rest_updates),
        )
        run.add_gaps(stream.gaps)
        stream.filter = run
        stream.first_fix = run.next_fix
        self._shown_fix = max(self._shown_fix, run.next_fix)
        if run.next_fix < stream.fixes.end:
            run.changed_fixes(run.next_fix, stream.fixes.end)
        self._notes["start"] = alignment.remark
