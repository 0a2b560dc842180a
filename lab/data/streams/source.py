"""Source: a thread that reads a device, times its samples, keeps the last of them and records the bytes."""

from __future__ import annotations

import math
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Self

from lab.data.log.calibration import Calibration
from lab.data.protocols.decoder import DecoderError
from lab.data.streams.axis_map import AxisMap
from lab.data.streams.raw_recording import (
    DEVICE_LOST,
    NEW_AXES,
    NEW_COLUMNS,
    NEW_UNIT,
    Recorder,
)
from lab.data.streams.reception import Reception
from lab.data.streams.ring import Cursor, Read, Ring
from lab.data.streams.sample_watch import FirstBytes, SampleWatch
from lab.data.streams.source_status import (
    ENDED,
    LOST,
    OPENING,
    STALE,
    STREAMING,
    Event,
    Status,
    measure_rates,
)
from lab.data.streams.transport import Chunk, NoTransport, Pluggable, Transport, describe_cause
from lab.motion.truth.growing_truth import TrueMotion

SILENCE = 0.5
"""Silence after which a source is stale [s]: five samples of the slowest IMU."""
SILENCE_OF_FIXES = 2.5
"""Silence after which a source of fixes alone is stale [s]: two of a receiver at 1 Hz are missing."""
WAKE = 0.1
"""Longest wait for bytes [s]: within it a source that is closed ends."""
FIRST_WAIT, LONGEST_WAIT = 0.1, 1.0
"""Waits before a lost device is opened again [s]: each twice the one before, so it is back within 2 s."""
_LOOKED_AT = 4096, 256
"""Samples and fixes that are looked at for rate, jitter and latency (`source_status.measure_rates`)."""
LATEST = 512, 4096
"""Chunks that are kept to be looked at, and the bytes of each: at most 2 MB, usually a hundredth of it."""
MOST_EVENTS = 100
"""Most events that are kept: the last hours of a bad plug."""


class Source:
    """A stream of samples; as a context manager, it ends its thread and frees the port.

    >>> import lab.live
    >>> with lab.live.open("simulated:montreal") as source:
    ...     read = source.since()

    Parameters
    ----------
    transport
        Brings the bytes.
    reception
        Makes samples of them.
    header
        What raw recordings say of the source beside address, protocol and axes.
    clock
        The host's monotonic clock.
    """

    def __init__(
        self,
        transport: Transport,
        reception: Reception,
        header: Mapping[str, Any] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.address = transport.address
        self._transport = transport
        self._reception = reception
        self._header = dict(header or {})
        self._clock = clock
        self._ring = Ring()
        self._lock = threading.Lock()  # of the recording and the axes; writing to a disk may take long
        self._changed = threading.Condition()
        self._newest = -math.inf  # time of the newest sample of the IMU
        self._awaited: list[float] = []  # times of samples for which others wait
        self._ending = threading.Event()
        self._state, self._why = OPENING, "Opening."
        self._reached = False
        self._heard = clock()
        self._progress = SampleWatch(self._heard)
        self._arrival = self._heard  # of the last bytes; of a replay, that recorded
        self._events: tuple[Event, ...] = ()
        self._losses: tuple[Event, ...] = ()
        self._recorder = Recorder(self._note_event)
        self._first_bytes = FirstBytes()
        self._latest: deque[bytes] = deque(maxlen=LATEST[0])
        self._rescaled = 0
        self._thread = threading.Thread(target=self._run, name=f"live {self.address}", daemon=True)

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def start(self) -> None:
        """Begin to read, if it has not begun yet."""
        if self._thread.ident is None:
            self._thread.start()

    def close(self) -> None:
        """End the thread, the recording and the connection; may be repeated, from any thread."""
        self._ending.set()
        with self._changed:
            self._changed.notify_all()
        if self._thread.ident is None:
            self._close_connection()
        elif self._thread is not threading.current_thread():
            self._thread.join()

    def forget(self) -> None:
        """Forget the samples and the device of a source that was closed, which take 100 MB at 1 kHz.

        A simulated device holds its whole flight.
        """
        self._ring.forget()
        self._first_bytes = FirstBytes()
        self._latest.clear()
        self._transport = NoTransport(self.address)

    @property
    def ended(self) -> bool:
        """Whether nothing more will come."""
        return self._state == ENDED

    @property
    def device(self) -> Pluggable | None:
        """The simulated device that it reads, if it reads one."""
        return getattr(self._transport, "device", None)

    @property
    def truth(self) -> TrueMotion | None:
        """The true motion, if the source knows it: that of a simulated device, or of X-Plane."""
        return getattr(self._transport, "truth", None)

    @property
    def vehicle(self) -> str:
        """The vehicle that carries the device, if the source knows it; else empty."""
        return str(getattr(self._transport, "vehicle", ""))

    def latest_bytes(self, most: int) -> bytes:
        """Return the last bytes that came, at most this many."""
        return b"".join(tuple(self._latest))[-most:]

    def fixes_since(self, cursor: Cursor) -> Read:
        """Return the fixes after a cursor, without the samples of the IMU."""
        end = self._ring.end
        return self._ring.since(Cursor(end.imu, cursor.fix, end.reading))

    @property
    def losses(self) -> tuple[Event, ...]:
        """When the stream broke, by the clock of its arrivals, and why, as a clause; oldest first."""
        return self._losses

    @property
    def recording(self) -> Path | None:
        """The file into which the bytes are being recorded; None if none is."""
        return self._recorder.path

    @property
    def axes(self) -> AxisMap:
        """The axis map; setting it changes the samples that come then, and raw recordings note it."""
        return self._reception.rows.axes

    @axes.setter
    def axes(self, axes: AxisMap) -> None:
        with self._lock:
            self._reception.rows.axes = axes
            self._note_event(f"The axes are {axes} now.")
            self._recorder.report({NEW_AXES: str(axes)}, self._arrival)

    @property
    def calibration(self) -> Calibration | None:
        """The constant errors that are removed from what comes then; raw recordings keep the bytes."""
        return self._reception.rows.calibration

    @calibration.setter
    def calibration(self, calibration: Calibration | None) -> None:
        with self._lock:
            self._reception.rows.calibration = calibration
            words = "none" if calibration is None else calibration.words
            self._note_event(f"The calibration is now: {words}.")

    @property
    def rescaled(self) -> int:
        """How often the angular rates of all samples so far got another unit."""
        return self._rescaled

    def answer(self, unit: str) -> None:
        """Say in which unit the angular rates of a text are, for all samples; raw recordings note it.

        Parameters
        ----------
        unit
            One of `Status.doubt`, or another one.

        Raises
        ------
        ColumnMapError
            If it is no unit of a rate, or no columns are known.
        """
        with self._lock:
            self._reception.answer(unit)
            self._rescale()
            self._recorder.report({NEW_UNIT: unit}, self._arrival)

    def name_columns(self, said: Mapping[str, str]) -> None:
        """Say what the columns of text are, by heading or number; raw recordings note it.

        Raises
        ------
        ColumnMapError
            If these are no columns of an IMU.
        """
        with self._lock:
            self._append_samples(*self._reception.name_columns(said))
            written = ";".join(f"{name}={text}" for name, text in said.items())
            self._note_event(f"The columns are {written} now.")
            self._recorder.report({NEW_COLUMNS: written}, self._arrival)

    def _rescale(self) -> None:
        """Give all samples the unit that their angular rates have."""
        factor = self._reception.taken_factor()
        if factor != 1.0:
            self._ring.scale_rates(factor)
            self._rescaled += 1
        self._note_event(self._reception.decided)

    @property
    def end(self) -> Cursor:
        """The cursor of someone who has read everything."""
        return self._ring.end

    def since(self, cursor: Cursor | None = None) -> Read:
        """Return the samples after a cursor; None stands for the beginning."""
        return self._ring.since(cursor)

    def last(self, seconds: float) -> Read:
        """Return the samples of the last seconds, by their times, at most all that are kept."""
        return self._ring.newest(seconds)

    def wait(self, cursor: Cursor, longest: float, until: float = -math.inf) -> bool:
        """Wait for samples after a cursor; return whether there are some, or the source has ended.

        To wake a thread costs as much as to time a sample.

        Parameters
        ----------
        cursor
            How far one has read.
        longest
            Longest waiting time [s].
        until
            Time of the sample for which one waits; earlier ones without a fix or a reading do not wake [s].
        """

        def has_come() -> bool:
            end = self._ring.end
            return self.ended or (end != cursor and (self._newest >= until or end[1:] != cursor[1:]))

        with self._changed:
            self._awaited.append(until)
            self._changed.wait_for(has_come, longest)
            self._awaited.remove(until)
            return self._ring.end != cursor or self.ended

    @property
    def status(self) -> Status:
        """The state at this moment; it never waits for the disk or the device."""
        reception, end, now = self._reception, self._ring.end, self._clock()
        state, sentence = self._now(now)
        # By the clock of the arrivals, which may not be the host's.
        rates = measure_rates(self._ring.last(*_LOOKED_AT), now + self._arrival - self._heard)
        rate, fix_rate, jitter, latency = rates
        path, size = self._recorder.recorded
        return Status(
            state=state,
            sentence=sentence,
            protocol=reception.detector.protocol,
            evidence=reception.described,
            timing=reception.imu.timing,
            axes=reception.rows.axes,
            samples=end.imu,
            fixes=end.fix,
            rate=rate,
            fix_rate=fix_rate,
            jitter=jitter,
            latency=latency,
            silence=now - self._heard,
            statistics=reception.detector.statistics,
            loss=reception.loss,
            interruptions=len(self._losses),
            drift=reception.imu.clock.drift if end.imu else float("nan"),
            drift_sigma=reception.imu.clock.drift_sigma if end.imu else float("nan"),
            offset=reception.imu.clock.offset,
            clock=reception.imu.watch.events[-1].text if reception.imu.watch.events else "",
            recording=path,
            recorded=size,
            warning=self._recorder.warning,
            events=self._events,
            doubt=reception.doubt,
            question=reception.question,
            reading=reception.axis_units.said if reception.axis_units else {},
            last_lines=reception.detector.last_lines,
        )

    def _now(self, now: float) -> tuple[str, str]:
        """Return the state, which silence changes, and the state in words."""
        silent, end = now - self._heard, self._ring.end
        if self._state != STREAMING:
            return self._state, self._why
        remark = str(getattr(self._transport, "remark", ""))
        if silent > (SILENCE_OF_FIXES if end.fix and not end.imu else SILENCE):
            return STALE, f"No data for {silent:.1f} s. {remark}".rstrip()
        if why := self._progress.missing_reason(
            now, self._reception, is_serial=self.address.startswith("serial:")
        ):
            return STALE, f"{why} {remark}".rstrip()
        if not sum(end) and self._reception.detector.statistics.bytes:
            why = " ".join((self._reception.detector.evidence, *self._reception.fixes.positions)).strip()
            return STREAMING, why or "Bytes come; no sample is complete yet."
        return STREAMING, f"{self._why} {remark}".rstrip()

    def record(self, path: str | os.PathLike[str]) -> None:
        """Begin to record the bytes from now on; the recording ends with `stop_recording`, or the source.

        The first bytes, from which no sample came yet, are recorded too: a replay finds protocol, rate and
        clock from them, as this source does.

        Parameters
        ----------
        path
            The new file.

        Raises
        ------
        RecordingError
            If the file exists or cannot be made, or another recording runs.
        """
        with self._lock:
            about = {"address": self.address, **self._reception.header, **self._header}
            self._recorder.begin(path, about)
            for chunk in self._first_bytes:
                self._recorder.accept(chunk)

    def stop_recording(self, path: Path | None = None) -> Path | None:
        """End the recording; return its path, or None if none runs.

        Parameters
        ----------
        path
            The recording that is meant, where many record: another one, begun after it had ended, goes on.
        """
        with self._lock:
            if path is not None and path != self.recording:
                return None
            return self._recorder.end()

    def _run(self) -> None:
        """Open, read and open again, until it is closed or nothing more will come."""
        wait = FIRST_WAIT
        try:
            while not self._ending.is_set():
                try:
                    self._transport.open()
                except OSError as error:
                    self._note_loss(error, opened=False)
                else:
                    connected = self._heard = self._clock()
                    try:
                        self._read()
                    except OSError as error:
                        self._note_loss(error, opened=True)
                    # Who accepts and ends at once is not asked ten times a second.
                    if self._heard > connected:
                        wait = FIRST_WAIT
                self._transport.close()
                if not self._transport.reconnects and self._state == LOST:
                    self._set(ENDED, self._why)
                    return
                self._ending.wait(wait)
                wait = min(2 * wait, LONGEST_WAIT)
            self._set(ENDED, "Closed.")
        except EOFError as error:
            with self._lock:
                self._append_samples(*self._reception.lose(self._arrival))
            self._set(ENDED, str(error) or "Nothing more will come.")
        except DecoderError as error:
            self._set(ENDED, str(error))
        except Exception as error:
            self._set(ENDED, f"The laboratory failed: {type(error).__name__}: {error}")
            raise
        finally:
            self._close_connection()
            self.stop_recording()

    def _close_connection(self) -> None:
        """Close the connection, and end what belongs to it."""
        self._transport.close()
        end = getattr(self._transport, "end", None)
        if end is not None:
            end()

    def _read(self) -> None:
        self._progress = SampleWatch(self._heard)
        self._set(STREAMING, "Connected; nothing has come yet.")
        while not self._ending.is_set():
            chunk = self._transport.read(WAKE)
            if chunk.data:
                self._accept(chunk)

    def _accept(self, chunk: Chunk) -> None:
        with self._lock:
            self._recorder.accept(chunk)
            self._latest.append(chunk.data[-LATEST[1] :])
            self._heard, self._arrival = self._clock(), chunk.arrival
            decided = self._reception.decided
            imu, fix = self._reception.accept(chunk)
            if self._reception.decided != decided:
                self._rescale()
            self._append_samples(imu, fix)
            self._tell_of_the_clock()
            if len(imu) or len(fix):
                self._first_bytes.end()
                self._progress.sampled(self._heard)
                if self._why != "Streaming.":
                    self._set(STREAMING, "Streaming.")
            else:
                self._first_bytes.add(chunk)
                self._progress.without(self._heard, self._reception.detector.statistics.frames)

    def _append_samples(self, imu: Any, fix: Any) -> None:
        readings = self._reception.taken_readings()
        if len(imu) or len(fix) or len(readings):
            self._ring.append(imu, fix, readings)
            with self._changed:
                self._newest = float(imu["time"][-1]) if len(imu) else self._newest
                if len(fix) or len(readings) or self._newest >= min(self._awaited, default=math.inf):
                    self._changed.notify_all()

    def _note_loss(self, error: OSError, *, opened: bool) -> None:
        """Note that the device is gone, or not there yet."""
        why = describe_cause(error)
        first = self._state != LOST
        self._reached |= opened
        with self._lock:
            if opened:
                self._append_samples(*self._reception.lose(self._arrival))
                self._first_bytes = FirstBytes()
                self._tell_of_the_clock()
                self._losses = (*self._losses, Event(self._arrival, why))[-MOST_EVENTS:]
                self._recorder.report({DEVICE_LOST: why}, self._arrival)
        again = "it is tried again." if self._transport.reconnects else "it ends here."
        self._set(LOST, f"{'Lost' if self._reached else 'Not reached'}: {why}; {again}", reported=first)

    def _tell_of_the_clock(self) -> None:
        for event in self._reception.imu.watch.new_events():
            self._note_event(event.text)

    def _note_event(self, text: str) -> None:
        self._events = (*self._events, Event(self._clock(), text))[-MOST_EVENTS:]

    def _set(self, state: str, why: str, reported: bool = True) -> None:
        self._state, self._why = state, why
        if reported:
            self._note_event(why)
        with self._changed:
            self._changed.notify_all()
