"""Import report: the content of a file, how it was rebuilt, and whether the result is plausible."""

from __future__ import annotations

import shutil
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import scipy

from lab.base.arrays import FloatArray
from lab.base.notebook_card import NotebookCard
from lab.data.checks import limits
from lab.data.checks.likeness import rms
from lab.data.rebuild.derived_motion import body_rates, euler_at, roughness
from lab.data.rebuild.plausibility import (
    IMPLAUSIBLE,
    QUESTIONABLE,
    FlightFinding,
    RebuiltMotion,
    findings,
    motion,
)
from lab.data.rebuild.quantisation import value_steps
from lab.data.rebuild.raw_flight import RawFlight, Reset
from lab.data.rebuild.reconstruction import Reconstruction
from lab.data.rebuild.time_repair import AS_RECORDED, RepairedFlight
from lab.motion.recordings.recording import Recording
from lab.sensors.imu_errors import SensorNoise

PLAUSIBLE = "plausible"

_REPAIRS = {
    "as recorded": "as recorded",
    "spread": "repeated stamps spread evenly",
    "even": "rounded or jittering stamps put on an even spacing",
    "by motion": "estimated from the displacements between the samples",
}
_ATTITUDES = {
    "aircraft": "that of coordinated turns, the nose along the path",
    "car": "the nose along the course and the slope, without roll",
    "boat": "level, the nose along the course",
    "pedestrian": "level, the nose along the course",
    "copter": "its thrust is the specific force, without wind and drag; the nose is taken to be along the "
    "course",
    "rocket": "the nose along the path, without roll",
}
"""How the attitude of each vehicle was reconstructed."""
_VEHICLES = {name: f"{'an' if name == 'aircraft' else 'a'} {name}" for name in _ATTITUDES}
_MAX_NAME = 60
"""Longest name of a vehicle that is shown [characters]: files may have any text."""
_MAX_LOST = 0.2
"""Part of the rows that may be left out of a plausible flight. A plain choice: less calls recordings with
some damaged rows questionable, more passes flights of which a large part is missing."""
_QUESTIONABLE_NOISE, _IMPLAUSIBLE_NOISE = 5.0, 50.0
"""Noise of the specific force [m/s², rms] from which a flight is questionable, and implausible: half of
gravity drowns every manoeuvre but aerobatics, and five times gravity all."""
_MAX_REPORTED_SAMPLES = 100_000
"""Samples by which a longer flight is reported: a million rows are then judged in the time of these."""
_STRETCHES = 10
"""Stretches of a long flight by which its noise is judged."""
_LEAST_WIND = 0.005
"""Smallest wind that is shown [m/s]: less is 0.00 in the digits shown."""
_MAX_CUTS_SHOWN, _MAX_RESETS_SHOWN = 3, 5
"""Most cuts and resets that the report lists one by one."""
_MIN_TEXT = 20
"""Fewest characters of a line beside its indent: a narrower terminal breaks them itself."""
_MAX_WIDTH = 110
"""Widest report [characters]."""


@dataclass(frozen=True)
class ReportRow:
    """A line of the report.

    Attributes
    ----------
    group : str
        Its subject: "File", "Time", "Resolution", "Curve", "Noise", "Motion", "Units" or "Remarks".
    name : str
        Name of the quantity.
    value : str
        Its value, with its unit.
    """

    group: str
    name: str
    value: str


@dataclass(frozen=True, eq=False, repr=False)
class ImportReport(NotebookCard):
    """The content of a file, how it was rebuilt, and whether the result is plausible.

    Attributes
    ----------
    verdict : str
        "plausible", "questionable" or "implausible".
    findings : tuple of FlightFinding
        The reasons, worst first; none if plausible.
    rows : tuple of ReportRow
        Everything else, in groups.
    specific_force_noise : float
        Rms of the fast part of the specific force of the rebuilt flight [m/s²].
    body_rate_noise : float
        Rms of the fast part of its body rates [rad/s].
    """

    CARD = "import report"

    verdict: str
    findings: tuple[FlightFinding, ...]
    rows: tuple[ReportRow, ...]
    specific_force_noise: float
    body_rate_noise: float

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the verdict is not "plausible", in sentences."""
        return tuple(finding.sentence for finding in self.findings)

    def __str__(self) -> str:
        width = min(shutil.get_terminal_size(fallback=(_MAX_WIDTH, 24)).columns, _MAX_WIDTH)
        names = max(len(row.name) for row in self.rows)
        lines: list[str] = []
        group = ""
        for row in self.rows:
            lines += [f"{row.group}"] if row.group != group else []
            group = row.group
            indent = f"  {row.name.ljust(names)}  "
            lines += textwrap.wrap(
                row.value,
                max(width, len(indent) + _MIN_TEXT),
                initial_indent=indent,
                subsequent_indent=" " * len(indent),
            ) or [indent.rstrip()]
        lines.append(f"Verdict: {self.verdict}")
        for sentence in self.reasons:
            lines += textwrap.wrap(sentence, width, initial_indent="  - ", subsequent_indent="    ")
        return "\n".join(lines)

    def __repr__(self) -> str:
        return f"<ImportReport: {self.verdict}, {len(self.findings)} findings>"


def report(
    raw: RawFlight, flight: RepairedFlight, rebuilt: Reconstruction, sensor: SensorNoise | None = None
) -> ImportReport:
    """Return the report on a flight that was read, repaired and rebuilt.

    Parameters
    ----------
    raw
        The data of the file.
    flight
        Its longest unbroken stretch, with repaired time stamps.
    rebuilt
        The flight rebuilt from that.
    sensor
        An IMU to compare the noise of the recording with.
    """
    force, rate = _fast_parts(flight, rebuilt)
    seen, in_fewer = _thin_flight(flight, rebuilt)
    moves = motion(seen, in_fewer)
    doubts = (FlightFinding(QUESTIONABLE, sentence) for sentence in raw.doubts)
    found = (*doubts, *findings(seen, in_fewer, moves), *_losses(raw, flight))
    if force > _QUESTIONABLE_NOISE:
        sentence = (
            f"The specific force has {force:.3g} m/s² rms of noise: differentiated samples, not motion. "
            "Likely: coarse numbers or time stamps; repair and smoothing (settings time_stamps, smoothing) "
            "reduce it."
        )
        level = IMPLAUSIBLE if force > _IMPLAUSIBLE_NOISE else QUESTIONABLE
        found = (*found, FlightFinding(level, sentence))
    levels = {finding.level for finding in found}
    verdict = next((level for level in (IMPLAUSIBLE, QUESTIONABLE) if level in levels), PLAUSIBLE)
    stated = f" (the file: {raw.vehicle[:_MAX_NAME]})" if raw.vehicle else ""
    vehicle = f"judged as {_VEHICLES[rebuilt.vehicle]}{stated}; --set vehicle=NAME states another one"
    units = [(one.column, f"{one.unit} ({one.source})") for one in raw.units]
    units += [("", "another unit is given with --unit COLUMN=UNIT")] if units else []
    sections: dict[str, Iterable[tuple[str, str]]] = {
        "File": _file(raw, flight),
        "Time": _time(flight),
        "Resolution": _resolutions(flight),
        "Curve": (*_curve(rebuilt), ("Vehicle", vehicle)),
        "Noise": _noise(flight, force, rate, sensor),
        "Motion": _motion(moves),
        "Units": units,
        "Remarks": [("", text) for text in (*raw.remarks, *rebuilt.remarks)],
    }
    rows = [ReportRow(group, *pair) for group, pairs in sections.items() for pair in pairs]
    return ImportReport(verdict, found, tuple(rows), force, rate)


_WORDS = {
    "velocity_n": "velocity", "euler": "attitude", "body_rate": "body rates",
    "acceleration_b": "acceleration", "alpha": "angle of attack", "beta": "sideslip",
}  # fmt: skip
"""Quantities of a raw flight, in words."""


def _file(raw: RawFlight, flight: RepairedFlight) -> Iterator[tuple[str, str]]:
    yield "Format", raw.format
    yield "Samples", f"{raw.rows_read or len(raw.time)} rows read, {len(flight.raw.time)} used"
    yield "Quantities", ", ".join(_WORDS.get(name, name) for name in raw.quantities)
    for one in raw.dropped:
        yield "Left out", f"{one.count} × {one.reason} (first: row {one.first_row})"
    for one in flight.dropped:
        yield "Left out", f"{one.count} × {one.reason}"


def _time(flight: RepairedFlight) -> Iterator[tuple[str, str]]:
    steps = np.diff(flight.raw.time)
    usual = float(np.median(steps))
    each = " and ".join(f"the {name} (recorded at {rate:.3g} Hz)" for name, rate in flight.raw.rates)
    yield (
        "Rate",
        (
            f"{1 / usual:.4g} Hz, steps of {1000 * steps.min():.4g} to {1000 * steps.max():.4g} ms, usually "
            f"{1000 * usual:.4g} ms{f'; interpolated to them: {each}' if each else ''}"
        ),
    )
    yield "Duration", f"{flight.raw.time[-1]:.2f} s, from {flight.started:.12g} s of its clock"
    if flight.tick:
        yield "Resolution", f"stamps lie on a grid of {1000 * flight.tick:.4g} ms"
    text = _REPAIRS[flight.method]
    if flight.step:
        text += f" of {1000 * flight.step:.6g} ms"
    if flight.method != AS_RECORDED:
        text += f", moved by {1000 * flight.moved_rms:.3g} ms rms, {1000 * flight.moved_max:.3g} ms at most"
    if flight.calmed < 1:
        text += f"; the roughness of the motion falls to {100 * flight.calmed:.3g} %"
    yield "Stamps", text
    yield "Gaps", _gaps(flight)
    if flight.raw.resets:
        yield "Resets", _resets(flight.raw.resets)


def _resolutions(flight: RepairedFlight) -> Iterator[tuple[str, str]]:
    for name, (step, unit) in value_steps(flight.raw).items():
        yield name.capitalize(), f"steps of {step:.3g} {unit}" if step else "finer than the samples show"


def _gaps(flight: RepairedFlight) -> str:
    bridged = f"{flight.gaps} of more than three usual steps bridged" if flight.gaps else "none bridged"
    if not flight.cuts:
        return bridged
    where = ", ".join(f"{_stamp(start)} to {_stamp(end)} s" for start, end in flight.cuts[:_MAX_CUTS_SHOWN])
    more = ", ..." if len(flight.cuts) > _MAX_CUTS_SHOWN else ""
    kept = f". {_suggest_keeping_more(flight)}" if flight.bridging else ""
    return f"{bridged}; cut at {len(flight.cuts)} gaps, jumps or restarts ({where}{more}){kept}"


def _stamp(time: float) -> str:
    """Return a time of the file's clock, to the millisecond: it may count from 1970."""
    return f"{round(time, 3):.15g}"


def _resets(resets: Sequence[Reset]) -> str:
    where = "; ".join(f"{reset.change} at {_stamp(reset.time)} s" for reset in resets[:_MAX_RESETS_SHOWN])
    more = f" and {len(resets) - _MAX_RESETS_SHOWN} more" if len(resets) > _MAX_RESETS_SHOWN else ""
    return (
        "the solution jumps, as an estimator does that is reset. This is no motion, so the recording is cut "
        f"there: {where}{more}"
    )


def _suggest_keeping_more(flight: RepairedFlight) -> str:
    kept = " and ".join(
        f"--set longest_gap={more.gap:g} keeps {100 * more.share:.0f} % of the samples"
        for more in flight.bridging
    )
    return f"The recording is cut at pauses longer than {flight.longest_gap:.4g} s: {kept}"


def _curve(rebuilt: Reconstruction) -> Iterator[tuple[str, str]]:
    recording = rebuilt.recording
    how = "the samples as they are" if rebuilt.unchanged else f"rebuilt from {rebuilt.curve}"
    rate = (len(recording.time) - 1) / recording.duration
    yield "Mission", f"{how}, {len(recording.time)} samples at {rate:.4g} Hz"
    for name, noise in rebuilt.offered.items():
        yield f"From {name}", f"noise of the acceleration {noise:.3g} m/s² before smoothing"
    if rebuilt.smoothing:
        yield "Smoothed", ", ".join(f"{name} λ = {value:.2g} s³" for name, value in rebuilt.smoothing.items())
    if rebuilt.position_residual is not None:
        yield "Position residual", f"{_ned(rebuilt.position_residual)} m rms"
    if rebuilt.velocity_residual is not None:
        yield "Velocity residual", f"{_ned(rebuilt.velocity_residual)} m/s rms"
    if rebuilt.attitude_residual is not None:
        yield "Attitude residual", f"{np.degrees(rebuilt.attitude_residual):.2g}° rms"
    if rebuilt.attitude_reconstructed:
        how = f"reconstructed from the velocity: {_ATTITUDES[rebuilt.vehicle]}; the file has none"
        yield "Attitude", how
    if rebuilt.wind is not None:
        yield "Wind", _wind(rebuilt.wind)


def _ned(values: FloatArray) -> str:
    return f"north {values[0]:.2g}, east {values[1]:.2g}, down {values[2]:.2g}"


def _wind(wind: FloatArray) -> str:
    speed = float(np.hypot(wind[0], wind[1]))
    origin = np.degrees(np.arctan2(-wind[1], -wind[0])) % 360
    vertical = (
        f", {abs(wind[2]):.2g} m/s {'down' if wind[2] > 0 else 'up'}" if abs(wind[2]) >= _LEAST_WIND else ""
    )
    return f"{speed:.2f} m/s from {origin:.0f}°{vertical}" if speed >= _LEAST_WIND else "none"


def _noise(
    flight: RepairedFlight, force: float, rate: float, sensor: SensorNoise | None
) -> Iterator[tuple[str, str]]:
    usual = float(np.median(np.diff(flight.raw.time)))
    own = (0.0, 0.0) if sensor is None else (sensor.accelerometer, np.degrees(sensor.gyro))
    for name, quantity, noise, density, unit in (
        ("Specific force", "velocity", force, own[0], "m/s²"),
        ("Body rates", "attitude", np.degrees(rate), own[1], "°/s"),
    ):
        text, band = f"{noise:.3g} {unit} rms in the fast part", 0.5 / (usual * flight.raw.every(quantity))
        if sensor is not None:
            # Three axes, each with white noise up to half of the rate.
            text += f"; {sensor.name} itself up to {band:.3g} Hz: {np.sqrt(3 * band) * density:.3g} {unit}"
        yield name, text


def _thin_flight(flight: RepairedFlight, rebuilt: Reconstruction) -> tuple[RepairedFlight, Reconstruction]:
    """Return a long flight thinned out: fewer samples show the same motion."""
    raw, recording = flight.raw, rebuilt.recording
    if len(raw.time) > _MAX_REPORTED_SAMPLES:
        # Rounded up, so that no more are left than are reported on.
        step = -(-len(raw.time) // _MAX_REPORTED_SAMPLES)
        flight = replace(flight, raw=raw.rows(np.arange(0, len(raw.time), step)))
    if len(recording.time) > _MAX_REPORTED_SAMPLES:
        every = slice(None, None, -(-len(recording.time) // _MAX_REPORTED_SAMPLES))
        rebuilt = replace(rebuilt, recording=_part(recording, every))
    return flight, rebuilt


def _part(recording: Recording, samples: slice) -> Recording:
    arrays = {field.name: getattr(recording, field.name) for field in fields(recording)}
    return replace(recording, **{name: each[samples] for name, each in arrays.items() if each is not None})


def _stretches(recording: Recording) -> Iterator[Recording]:
    """Yield a flight, or ten stretches of a long one."""
    count = len(recording.time)
    if count <= _MAX_REPORTED_SAMPLES:
        yield recording
        return
    # Whole stretches, not every tenth sample: the fast parts are those from one sample to the next.
    for start in np.linspace(0, count - _MAX_REPORTED_SAMPLES // _STRETCHES, _STRETCHES).astype(int):
        yield _part(recording, slice(start, start + _MAX_REPORTED_SAMPLES // _STRETCHES))


def _space_times(part: Recording, flight: RepairedFlight, rebuilt: Reconstruction, name: str) -> FloatArray:
    """Return times in a stretch at the rate of a quantity, or that of the recording if lower."""
    # What was interpolated between samples has no noise of its own, and would dilute theirs.
    share = min(1.0, len(flight.raw.time) / flight.raw.every(name) / len(rebuilt.recording.time))
    return np.linspace(part.time[0], part.time[-1], max(2, round(share * len(part.time))))


def _fast_parts(flight: RepairedFlight, rebuilt: Reconstruction) -> tuple[float, float]:
    """Return the rms of the fast parts of specific force and body rates, at the rate of the samples."""
    found = []
    for part in _stretches(rebuilt.recording):
        at, euler = part.time, part.euler
        if not rebuilt.unchanged:
            at = _space_times(part, flight, rebuilt, "attitude")
            euler = euler_at(part, at)
        force = scipy.interpolate.CubicSpline(part.time, part.velocity_n)(
            _space_times(part, flight, rebuilt, "velocity"), 1
        )
        found.append((roughness(force), roughness(body_rates(at, euler))))
    force, rate = rms(np.array(found), 0)
    return float(force), float(rate)


def _motion(moves: RebuiltMotion) -> Iterator[tuple[str, str]]:
    force, rate = moves.specific_force, np.degrees(moves.body_rate)
    yield "Specific force", f"usually {np.median(force):.3g}, at most {force.max():.3g} m/s²"
    yield "Acceleration", f"usually {moves.acceleration:.3g} m/s²"
    yield "Body rates", f"usually {np.median(rate):.2g}, at most {rate.max():.3g} °/s"
    yield "Climb or descent", f"at most {moves.climb.max():.3g} m/s"
    yield "Speed", f"usually {np.median(moves.speed):.3g}, at most {moves.speed.max():.3g} m/s"
    like = moves.leaning
    if like is not None and like.strength > limits.LOG.lively_speed:
        yield (
            "Pitch and roll",
            (
                f"horizontal specific force {like.ratio:.2f} times what they lean for, "
                f"{abs(np.degrees(like.angle)):.0f}° beside it, coherence {like.coherence:.2f}"
            ),
        )
    if moves.agreements is not None:
        yield (
            "Against recorded rates",
            "; ".join(
                f"{axis} slope {like.slope:.3f}, correlation {like.correlation:.4f}"
                for axis, like in zip("xyz", moves.agreements, strict=True)
            ),
        )


def _losses(raw: RawFlight, flight: RepairedFlight) -> Iterable[FlightFinding]:
    """Report when much of the file was left out."""
    rows = raw.rows_read or len(raw.time)
    used = len(flight.raw.time) / max(rows, 1)
    if used < 1 - _MAX_LOST:
        yield FlightFinding(
            QUESTIONABLE,
            f"Only {100 * used:.0f} % of the rows are used; the section File lists the omitted rows and the "
            f"reasons.{f' {_suggest_keeping_more(flight)}.' if flight.bridging else ''}"
            f"{' It is cut where the recorded solution jumps.' if flight.raw.resets else ''}",
        )
