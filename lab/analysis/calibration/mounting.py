"""Mounting calibration: pitch and yaw of the IMU in a vehicle on wheels, judged by the other half of a drive.

A vehicle on wheels goes where it points: the speeds to its right and down are zero. An IMU that is mounted
askew by 0.2° sees 5 cm/s of them at 15 m/s, which the filter takes for an error of its own heading. The
angles are those that make the innovations of fixes and of these conditions most likely: by Fisher scoring,
with derivatives that are differences of whole runs of the filter. σ comes from the scatter of the scores, not
from the slip that the filter assumes, and counts that those of neighbouring seconds say the same. The place
of the vehicle that does not slip is estimated beside them. The roll does not show, since both speeds are
zero.

Each half of the drive gives angles, and the other half judges them: its innovations must be smaller than
without the angles, and the positions after fixes withheld for 10 s better, and not worse than without the
conditions.

References
----------
E.-H. Shin, *Estimation techniques for low-cost inertial navigation*, UCGE 20219, Calgary 2005, ch. 4.4
(boresight). W. K. Newey, K. D. West, Econometrica 55, 1987 (σ with correlated scores). D. W. K. Andrews,
Econometrica 59, 1991, eq. 6.2 and 6.4 (how many lags).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from lab.analysis.calibration.terms import Judgement, Term, judge
from lab.analysis.identification.withheld import OUTAGE, outages
from lab.base.arrays import Flags, FloatArray
from lab.base.files.mission_error import MissionError
from lab.base.progress import Progress
from lab.data.log.calibration import Calibration
from lab.data.log.sensor_log import SensorLog
from lab.data.log.vehicle import vehicle_of
from lab.navigation.aids import DOWNWARD, FORWARD, RIGHTWARD
from lab.navigation.alignment.alignment import Alignment
from lab.navigation.belief import assumed_latency
from lab.navigation.log_navigation import RecordedRun, navigate_log
from lab.run.experiment_settings import ExperimentSettings


@dataclass(frozen=True)
class MountingLimits:
    """What a drive must show of the mounting."""

    speed: float = 3.0
    """Speed from which a fix counts as driving [m/s]: 0.2° are 1 cm/s, the noise of a good receiver."""
    shortest: float = 120.0
    """Shortest time of driving [s]: each half of it must give angles, and five outages that judge them."""
    turned: float = math.radians(180.0)
    """Least sum of the turns [rad]: on a straight road, the heading of the IMU does not show."""
    apart: float = 5.0
    """Time between two courses whose difference may be a turn [s]."""
    turn: float = math.radians(5.0)
    """Least difference of them [rad]: velocities of 0.2 m/s and 5 m/s make 3°."""
    known: float = math.radians(0.3)
    """Largest σ of an angle that is stated [rad]: with more, wheels do not gain."""
    largest: float = math.radians(20.0)
    """Largest angle [rad]: a larger one is said by the axes, and the filter is not linear in it."""
    rounds: int = 5
    """Most rounds of scoring: from 3° off, the third changes a tenth of σ."""
    settled: float = 0.1
    """Change in σ that ends the rounds."""
    memory: int = 30
    """Lag up to which scores may be correlated [s]: a bend of a road lasts as long."""
    most_alike: float = 0.97
    """Largest correlation of scores of neighbouring seconds: with more, the drive shows one number."""
    least: float = 1e-9
    """Least variance of the scores, in what the information says: of a direction that shows nothing."""
    step: float = math.radians(0.1)
    """Step of the angles for derivatives [rad]."""
    arm_step: float = 0.1
    """Step of the place that does not slip for derivatives [m]."""
    arm_sigma: float = 2.0
    """σ of the place that does not slip, beforehand, along the vehicle [m]: half of a car."""
    block: float = 10.0
    """Time over which innovations are compared [s]: those of neighbouring seconds are alike."""
    start: float = 20.0
    """Time at the begin of the drive without withheld fixes [s]: the start shows there."""
    same: float = 1e-3
    """Largest difference of the times of one fix [s]."""
    no_worse: float = 1.05
    """Ratio of the errors with the conditions to those without above which the conditions harm."""


LIMITS = MountingLimits()
"""The limits in use."""
GROUP = "mounting"


@dataclass(frozen=True, eq=False)
class MountingCalibration:
    """Small angles of the IMU in its vehicle.

    Attributes
    ----------
    terms : tuple of Term
        Pitch and yaw [°], and the place along the vehicle that does not slip [m].
    judgements : tuple of Judgement
        What the innovations of the other half say.
    errors : (float, float, float)
        Root mean square of the horizontal errors after fixes withheld for 10 s in the other half: without the
        conditions, with them, and with them and the angles [m].
    sentences : tuple of str
        What was found, each with what it rests on.
    calibration : Calibration
        The angles, if they gain; else empty.
    """

    terms: tuple[Term, ...]
    judgements: tuple[Judgement, ...]
    errors: tuple[float, float, float]
    sentences: tuple[str, ...]
    calibration: Calibration

    @property
    def stated(self) -> tuple[Term, ...]:
        """The known terms, if they gain."""
        return () if self.calibration.is_empty else tuple(term for term in self.terms if term.is_known)


class _Angles(NamedTuple):
    """Pitch, yaw [rad] and place along the vehicle [m] with their covariance."""

    values: FloatArray
    covariance: FloatArray

    @property
    def sigma(self) -> FloatArray:
        """σ (3,)."""
        return np.sqrt(np.diagonal(self.covariance))


class _Drive:
    """A log that is navigated with other mountings."""

    def __init__(self, log: SensorLog, experiment: ExperimentSettings) -> None:
        self.log = log
        self.experiment = experiment.copy()
        for path, value in (("smoother", False), ("engine", "compiled"), ("no_slip", True)):
            self.experiment.navigator.set(path, value)
        self._start: Alignment | None = None
        self._arm = np.array(self.experiment.sensors.odometer.lever_arm, dtype=np.float64)

    def run(self, values: FloatArray, withheld: Flags | None = None, *, wheels: bool = True) -> RecordedRun:
        """Navigate with pitch, yaw [rad] and place [m]."""
        turned = Calibration(mounting=np.array([0.0, values[0], values[1]]))
        settings = self.experiment.copy()
        settings.navigator.set("no_slip", wheels)
        settings.sensors.odometer.set("lever_arm", (self._arm[0] + float(values[2]), *self._arm[1:]))
        log = self.log if not values[:2].any() else turned.applied(self.log)
        start = None if self._start is None else _rotate_start(self._start, turned.turn)
        sensors = settings.sensors
        run = navigate_log(log, sensors, settings.navigator, sensors.gps.outages, withheld, start)
        if self._start is None and not values[:2].any():
            self._start = run.alignment
        return run


def _rotate_start(start: Alignment, C: FloatArray) -> Alignment:
    """Return a start in the axes of the vehicle: x of the vehicle is C times x of the IMU."""
    q_nb = Rotation.from_quat(start.start.q_nb, scalar_first=True) * Rotation.from_matrix(C).inv()
    bias = C @ start.gyro_bias
    moved = start.start._replace(q_nb=q_nb.as_quat(scalar_first=True))
    return start._replace(start=moved, gyro_bias=bias, rate=C @ start.rate)


def calibrate(
    log: SensorLog, experiment: ExperimentSettings, source: str, progress: Progress | None = None
) -> MountingCalibration:
    """Return the mounting of the IMU in the vehicle of a drive.

    Parameters
    ----------
    log
        The log of the drive.
    experiment
        The settings of its filter.
    source
        The log, for the calibration.
    progress
        Called with a phrase and the fraction done, from 0 to 1.

    Raises
    ------
    MissionError
        If the log is no drive of a vehicle on wheels, or too short, or without turns.
    ValueError
        If it cannot be navigated.
    """
    tell: Callable[[str, float], None] = progress or (lambda _stage, _fraction: None)
    check_drive(log)
    drive = _Drive(log, experiment)
    tell("finding the angles", 0.1)
    whole, run = _find_likely_angles(drive, None)
    time = log.gnss.time
    half = float(time[0] + time[-1]) / 2
    tell("finding the angles in each half", 0.4)
    halves = [_find_likely_angles(drive, part, whole.values)[0] for part in ((-np.inf, half), (half, np.inf))]
    tell("withholding fixes", 0.7)
    others = halves[1].values, halves[0].values
    judgement = _judge_halves(drive, others, half)
    sizes = [
        float(np.sqrt(np.mean(one**2))) if one.size else math.nan
        for one in _outage_errors(drive, others, half)
    ]
    terms = _terms(whole)
    known = all(term.is_known for term in terms[:2])
    helps = sizes[2] < sizes[1] and sizes[2] <= LIMITS.no_worse * sizes[0]
    gains = judgement.gains and helps and known
    angles = np.array([0.0, *whole.values[:2]]) if gains else np.zeros(3)
    return MountingCalibration(
        terms,
        (judgement,),
        (sizes[0], sizes[1], sizes[2]),
        tuple(_sentences(terms, judgement, sizes, helps, run, halves)),
        Calibration(source=source, mounting=angles),
    )


def check_drive(log: SensorLog) -> None:
    """Raise `MissionError` if a log is no drive of a vehicle on wheels, or too short, or without turns."""
    vehicle = vehicle_of(log.auxiliary.vehicle)
    if vehicle.name and vehicle.name != "car":
        raise MissionError(
            f"{log.name}: is of a {vehicle.name}, which slips; accepted is a vehicle on wheels"
        )
    if not log.gnss.time.size:
        raise MissionError(f"{log.name}: has no fixes; accepted is a drive with GPS")
    speed = np.linalg.norm(np.nan_to_num(log.gnss.velocity_n[:, :2]), axis=1)
    if np.isnan(log.gnss.velocity_n[:, :2]).all():
        raise MissionError(
            f"{log.name}: its fixes have no velocity; accepted is a drive whose receiver measures it"
        )
    steps = np.minimum(np.diff(log.gnss.time, append=log.gnss.time[-1]), 1.0)
    driven = float(steps[speed > LIMITS.speed].sum())
    if driven < LIMITS.shortest:
        raise MissionError(
            f"{log.name}: drives faster than {LIMITS.speed:g} m/s for {driven:.0f} s; accepted are at least "
            f"{LIMITS.shortest:g} s, half of which judge the angles of the other half"
        )
    course = np.unwrap(np.arctan2(log.gnss.velocity_n[:, 1], log.gnss.velocity_n[:, 0])[speed > LIMITS.speed])
    every = max(round(LIMITS.apart / max(float(np.median(np.diff(log.gnss.time))), LIMITS.same)), 1)
    turns = np.abs(np.diff(course[::every]))
    turned = float(turns[turns > LIMITS.turn].sum())
    if turned < LIMITS.turned:
        raise MissionError(
            f"{log.name}: turns by {math.degrees(turned):.0f}° in all; accepted are drives that turn by "
            f"{math.degrees(LIMITS.turned):.0f}° or more: on a straight road, the heading of the IMU does "
            "not show"
        )


class _Innovations(NamedTuple):
    """Times (k,) [s], innovations and variances of single components; the same in each run of a drive."""

    time: FloatArray
    value: FloatArray
    variance: FloatArray


def _innovations(run: RecordedRun) -> _Innovations:
    """Return the innovations of fixes, each component whitened by the others, and of the aids."""
    found = run.solution
    S = found.innovation_covariance
    seen: Flags = np.asarray(np.isfinite(S).all(axis=(1, 2)))
    unit = np.where(seen[:, None, None], S, np.eye(S.shape[1]))
    L = np.linalg.cholesky((unit + np.swapaxes(unit, 1, 2)) / 2)
    white = np.linalg.solve(L, np.nan_to_num(found.innovation)[:, :, None])[:, :, 0]
    white[~seen] = np.nan
    white[np.isnan(found.innovation)] = np.nan  # a component that the receiver does not measure
    sizes = np.ones(white.size)
    kinds = np.isin(run.aids.kind, (FORWARD, RIGHTWARD, DOWNWARD))
    return _Innovations(
        np.concatenate((np.repeat(run.fixes.time, white.shape[1]), run.aids.time[kinds])),
        np.concatenate((white.ravel(), found.aid_innovation[kinds])),
        np.concatenate((sizes, found.aid_variance[kinds])),
    )


def _find_likely_angles(
    drive: _Drive, part: tuple[float, float] | None, begin: FloatArray | None = None
) -> tuple[_Angles, RecordedRun]:
    """Return the most likely angles by the innovations within a part of the time, and the run with them."""
    values = np.zeros(3) if begin is None else begin.copy()
    steps = np.array([LIMITS.step, LIMITS.step, LIMITS.arm_step])
    prior = np.array([0.0, 0.0, 1 / LIMITS.arm_sigma**2])
    for _ in range(LIMITS.rounds):
        run = drive.run(values)
        base = _innovations(run)
        others = [_innovations(drive.run(values + step)) for step in np.diag(steps)]
        used = np.isfinite(base.value) & np.isfinite(base.variance)
        for other in others:
            used &= np.isfinite(other.value)
        if part is not None:
            used &= (base.time >= part[0]) & (base.time < part[1])
        G = np.stack(
            [(one.value - base.value)[used] / step for one, step in zip(others, steps, strict=True)], axis=-1
        )
        weight = 1 / base.variance[used]
        information = (G * weight[:, None]).T @ G + np.diag(prior)
        scores = -G * (weight * base.value[used])[:, None]
        inverse = np.linalg.inv(information)
        change = inverse @ (scores.sum(axis=0) - prior * values)
        values = values + change
        if (np.abs(values[:2]) > LIMITS.largest).any():
            raise MissionError(
                f"{drive.log.name}: the IMU would be mounted askew by more than "
                f"{math.degrees(LIMITS.largest):.0f}°; accepted are axes that point forward, right and down: "
                "ins-lab import --axes, or mounting_deg in log.toml"
            )
        covariance = (
            # A sandwich: σ of the scores as they are, not as the filter assumes.
            inverse @ (_score_covariance(base.time[used], scores, information) + np.diag(prior)) @ inverse
        )
        if (np.abs(change) < LIMITS.settled * np.sqrt(np.diagonal(covariance))).all():
            break
    return _Angles(values, covariance), run


def _score_covariance(time: FloatArray, scores: FloatArray, information: FloatArray) -> FloatArray:
    """Return the covariance (3, 3) of the sum of correlated scores, which slip less or more than assumed.

    Along each direction, it is the larger of two: with the lags of a process of first order, which few
    seconds show, and with those of a bend.
    """
    second = np.floor(time - time.min()).astype(np.int64)
    sums = np.zeros((int(second.max()) + 1, scores.shape[1]))
    np.add.at(sums, second, scores)
    L = np.linalg.cholesky(information)
    sums = np.linalg.solve(L, (sums - sums.mean(axis=0)).T).T
    own, bend = _of_lags(sums, _lags(sums)), _of_lags(sums, LIMITS.memory)
    root = np.linalg.cholesky(own + LIMITS.least * np.eye(len(own)))
    L, inverse = L @ root, np.linalg.inv(root)
    sizes, axes = np.linalg.eigh(inverse @ bend @ inverse.T)
    return np.asarray(L @ (axes * np.maximum(sizes, 1.0)) @ axes.T @ L.T)


def _lags(sums: FloatArray) -> int:
    """Return the lags that Andrews takes for scores (n, k) that follow processes of first order."""
    before, after = sums[:-1], sums[1:]
    rho = (before * after).sum(axis=0) / np.maximum((before**2).sum(axis=0), LIMITS.least)
    rho = np.minimum(np.abs(rho), LIMITS.most_alike)
    power = ((sums**2).mean(axis=0) * (1 - rho**2)) ** 2 + LIMITS.least
    slope = np.sum(4 * rho**2 * power / ((1 - rho) ** 6 * (1 + rho) ** 2)) / np.sum(power / (1 - rho) ** 4)
    return math.ceil(1.1447 * math.cbrt(slope * len(sums)))


def _of_lags(sums: FloatArray, lags: int) -> FloatArray:
    """Return the covariance (k, k) of the sum of scores (n, k) about their mean, by Newey and West."""
    lags = min(lags, len(sums) // 2)
    total = sums.T @ sums
    for lag in range(1, lags + 1):
        part = sums[lag:].T @ sums[:-lag]
        total += (1 - lag / (lags + 1)) * (part + part.T)
    share = (lags + 1) / len(sums)  # the mean that was taken off is that of the scores themselves
    return np.asarray(total / (1 - share + share**2 / 3))


def _judge_halves(drive: _Drive, mountings: Sequence[FloatArray], half: float) -> Judgement:
    """Return what the innovations say, in blocks of time, by mountings for each half."""
    runs = [_innovations(drive.run(values)) for values in (np.zeros(3), *mountings)]
    block = np.floor((runs[0].time - runs[0].time.min()) / LIMITS.block).astype(np.int64)
    sizes = np.stack([one.value**2 / one.variance for one in runs])
    known: Flags = np.asarray(np.isfinite(sizes).all(axis=0))
    count = np.bincount(block[known])
    means = [np.bincount(block[known], one[known])[count > 0] / count[count > 0] for one in sizes]
    last = runs[0].time.min() + LIMITS.block * (np.flatnonzero(count) + 1) > half
    return judge(
        GROUP,
        f"innovations of fixes and wheels in {LIMITS.block:g} s",
        "σ",
        np.sqrt(means[0]),
        np.sqrt(np.where(last, means[2], means[1])),
    )


def _outage_errors(
    drive: _Drive, mountings: Sequence[FloatArray], half: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the errors at the ends of outages: without wheels, with them, with mountings for each half."""
    stamps = drive.log.gnss.time
    begin, end = float(stamps[0]) + LIMITS.start, float(stamps[-1])
    masks = [*outages(stamps, begin, end), *outages(stamps, begin, end, OUTAGE)]
    found: tuple[list[float], list[float], list[float]] = ([], [], [])
    straight = np.zeros(3)
    validity = stamps - assumed_latency(drive.experiment.navigator, drive.log.gnss.latency)
    for mask in masks:
        edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(int)))
        pieces = [(begin, end - 1) for begin, end in zip(edges[::2], edges[1::2], strict=True)]
        plain = _errors(drive.run(straight, mask, wheels=False), validity, pieces)
        wheels = _errors(drive.run(straight, mask), validity, pieces)
        both = [_errors(drive.run(values, mask), validity, pieces) for values in mountings]
        for place, (_, end) in enumerate(pieces):
            three = plain[place], wheels[place], both[int(stamps[end] >= half)][place]
            if np.isfinite(three).all():
                for into, one in zip(found, three, strict=True):
                    into.append(one)
    return np.array(found[0]), np.array(found[1]), np.array(found[2])


def _errors(run: RecordedRun, validity: FloatArray, pieces: Sequence[tuple[int, int]]) -> FloatArray:
    """Return the horizontal innovations (o,) at the last withheld fix of each outage [m]; NaN if none."""
    found = np.full(len(pieces), np.nan)
    for place, (_, end) in enumerate(pieces):
        row = int(np.argmin(np.abs(run.fixes.time - validity[end])))
        if abs(run.fixes.time[row] - validity[end]) < LIMITS.same:
            found[place] = float(np.linalg.norm(run.solution.innovation[row, :2]))
    return found


def _terms(angles: _Angles) -> tuple[Term, ...]:
    *sigmas, arm = map(float, angles.sigma)
    *values, place = map(float, angles.values)
    degrees = math.degrees(1.0)
    return (
        *(
            Term(GROUP, "angle", axis, value * degrees, sigma * degrees, "°", math.inf, sigma < LIMITS.known)
            for axis, value, sigma in zip(("pitch", "yaw"), values, sigmas, strict=True)
        ),
        Term(
            GROUP,
            "place that does not slip",
            "forward",
            place,
            arm,
            "m",
            math.inf,
            arm < LIMITS.arm_sigma / 2,
        ),
    )


def _sentences(
    terms: Sequence[Term],
    judgement: Judgement,
    sizes: Sequence[float],
    helps: bool,
    run: RecordedRun,
    halves: Sequence[_Angles],
) -> list[str]:
    seconds = float(run.imu.time[-1] - run.imu.time[0])
    parts = []
    unknown = [term for term in terms[:2] if not term.is_known]
    if unknown:
        names = " and ".join(term.axis for term in unknown)
        worst = max(term.sigma for term in unknown)
        parts.append(
            f"The calibration of the mounting is refused: {names} would have a σ of {worst:.2g}°, and stated "
            f"are angles with {math.degrees(LIMITS.known):g}° or less ({seconds:.0f} s of driving; turns and "
            "changes of speed show the heading of the IMU)."
        )
        return parts
    outage = (
        f"horizontal error after {OUTAGE:g} s without fixes in the other half: {sizes[0]:.3g} m without the "
        f"conditions of wheels, {sizes[1]:.3g} m with them, {sizes[2]:.3g} m with them and the angles"
    )
    if judgement.gains and not helps:
        parts.append(
            "The calibration of the mounting is refused: with it, positions without fixes are not better "
            f"({outage}). The vehicle slips, or the place that does not is elsewhere."
        )
        return parts
    parts.append(str(judgement))
    if judgement.gains:
        both = ", ".join(
            f"{name} {math.degrees(halves[0].values[k]):.2f}° and {math.degrees(halves[1].values[k]):.2f}°"
            for k, name in enumerate(("pitch", "yaw"))
        )
        parts.append(f"Wheels help with the angles ({outage}).")
        parts.append(f"Each half of the drive judged the angles of the other: {both}.".replace("-", "−"))
    return parts
