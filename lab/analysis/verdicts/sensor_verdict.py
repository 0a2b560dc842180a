"""Sensor verdict: findings about Q and unmodelled errors, from the true errors of the inertial sensors."""

from __future__ import annotations

import numpy as np

from lab.analysis.consistency import chi_square_interval
from lab.analysis.verdicts import limits
from lab.analysis.verdicts.finding import (
    Weighed,
    interval_words,
    is_right,
    judge_size,
    mean_square,
    size_weight,
    wrong_direction,
    wrong_factor_interval,
)
from lab.analysis.verdicts.finding_table import EARTH_RATE, FINDINGS, SENSORS
from lab.analysis.verdicts.likely_factor import likely_factor
from lab.analysis.verdicts.selection import Explained, estimates, likelihood_gain, select_causes
from lab.analysis.verdicts.sensor_evidence import FACTORS, FEWEST, MOTION, SensorErrors
from lab.analysis.verdicts.sums import Fit, Squares
from lab.base.arrays import FloatArray
from lab.base.numbers import round_digits
from lab.base.parameters.units import STANDARD_GRAVITY

LEAST_FACTOR = float(FACTORS[0])
"""Smallest factor on a bias drive that is stated: the smallest tried."""

_CAUSES = {  # regressors of each cause
    "scale factor": (0,),
    "misalignment": (1, 2),
    "bandwidth": (3, 4),
    EARTH_RATE: (5,),
}


def judge_sensors(errors: SensorErrors) -> list[Weighed]:
    """Return the wrong assumptions about the inertial sensors, from the errors that they added."""
    found: list[Weighed] = []
    noise: list[tuple[float, float]] = []
    wanders: list[Weighed] = []
    for sensor, kind in enumerate(SENSORS):
        axes = slice(3 * sensor, 3 * sensor + 3)
        motion, rest = _motion(errors, sensor, kind)
        found += _judge_saturation(errors, sensor, kind)
        # The rate of the Earth shows in both kinds of sensors, and is one fault.
        named = {entry.finding.quantity for entry in found}
        found += [entry for entry in motion if entry.finding.quantity not in {EARTH_RATE} & named]
        noise.append(rest)
        wanders += _bias(errors, axes, kind)
    white = _noise(Squares(*(np.array(parts) for parts in zip(*noise, strict=True))))
    # A wrong scale of Q changes noise and drive equally: that is one fault.
    accused = {entry.finding.quantity: entry.finding.direction for entry in white}
    for entry in wanders:
        kind = entry.finding.quantity.split()[1] if entry.finding.quantity.startswith("Q ") else ""
        if accused.get("Q", accused.get(f"Q {kind}")) != entry.finding.direction:
            found.append(entry)
    return found + white


def _motion(errors: SensorErrors, sensor: int, kind: str) -> tuple[list[Weighed], tuple[float, float]]:
    """Judge the errors that depend on the motion; also return squares and number of the remaining ones."""
    axes = slice(3 * sensor, 3 * sensor + 3)
    number = errors.number.values[:, axes]
    count = float(number.sum())
    if not count:
        return [], (0.0, 0.0)
    fit = _records(
        errors.matrix.values[:, axes], errors.vector.values[:, axes], errors.squares.values[:, axes]
    )
    total = float(fit.squares)
    free = count - np.count_nonzero(np.diagonal(fit.matrix, axis1=1, axis2=2))
    if free < FEWEST:  # the causes together explain any errors of so few windows
        return [], (total, count)
    left = total - 2 * likelihood_gain(fit, range(len(MOTION)))
    # Few windows do not show the size of the noise well: it may be as large as this.
    scale = max(left / chi_square_interval(free, 1, limits.VERDICT.confidence)[0], 1e-12)
    chosen = select_causes(
        Fit(fit.matrix / scale, fit.vector / scale, fit.squares / scale),
        _CAUSES,
        limits.VERDICT.likelihood_ratio,
    )
    explained, found = 0.0, []
    for entry in chosen:
        explained += 2 * entry.gain * scale
        if entry.gain < limits.VERDICT.remainder_part * chosen[0].gain:
            continue
        if entry.name == EARTH_RATE:
            found += _earth_rate(entry)
        elif entry.name == "bandwidth" and _lag(entry) < limits.VERDICT.lag:
            continue
        elif 2 * entry.gain / count > limits.VERDICT.noise_part:
            found.append(_state_finding(entry, kind, sensor))
    rest = total - explained
    if found and count < rest < count + limits.VERDICT.remainder_part * explained:
        rest = count
    return found, (rest, count)


def _earth_rate(entry: Explained) -> list[Weighed]:
    """Judge errors like the rate of the Earth: they have a size, and last, so less of them matters."""
    weight = 1 / np.maximum(entry.sigma, 1e-12) ** 2
    part = float(np.sum(weight * entry.estimate) / weight.sum())
    if abs(part - 1) > limits.VERDICT.earth_rate_off:
        return []
    statistic = f"logarithm of the likelihood ratio {entry.gain:.0f}"
    return [Weighed(entry.gain, FINDINGS["Earth rate"].finding(part, statistic, part=part))]


def _records(matrix: FloatArray, vector: FloatArray, squares: FloatArray) -> Fit:
    """Return the fits of runs and axes, (runs, axes, p, p) and (runs, axes, p), one after the other."""
    p = matrix.shape[-1]
    return Fit(matrix.reshape(-1, p, p), vector.reshape(-1, p), np.array(squares.sum()))


def _lag(entry: Explained) -> float:
    """Return the lag of a sensor of limited bandwidth, root mean square of the axes [s]."""
    return float(np.sqrt(np.mean(entry.estimate.sum(axis=1) ** 2)))


def _state_finding(entry: Explained, kind: str, sensor: int) -> Weighed:
    unit, to_unit = (("°/s", np.degrees(1.0)), ("mg", 1000 / STANDARD_GRAVITY))[sensor]
    is_lag = entry.name == "bandwidth"
    factor = _lag(entry) if is_lag else float(np.sqrt(np.mean(entry.estimate**2)))
    size = (
        factor
        * {
            "scale factor": 100,
            "misalignment": np.degrees(1.0),
            "bandwidth": 1000,
            "temperature": to_unit,
            "g-sensitivity": to_unit * STANDARD_GRAVITY,
            "bias drift": 60 * to_unit,
        }[entry.name]
    )
    statistic = f"logarithm of the likelihood ratio {entry.gain:.0f}"
    wording = FINDINGS[entry.name]
    return Weighed(
        entry.gain, wording.finding(factor, statistic, sensor=kind, size=round_digits(size), unit=unit)
    )


def _judge_saturation(errors: SensorErrors, sensor: int, kind: str) -> list[Weighed]:
    """Judge the windows with saturation."""
    total, count = (float(figure[sensor]) for figure in errors.clipped)
    if not count or total < count or is_right(total, count):
        return []
    root = float(np.sqrt(total / count))
    finding = FINDINGS["saturation"].finding(
        root,
        mean_square(Squares(np.array(total), np.array(count)), "errors at the end of the range"),
        sensor=kind,
        windows=count,
        root=root,
    )
    return [Weighed(size_weight(total, count), finding)]


def _bias(errors: SensorErrors, axes: slice, kind: str) -> list[Weighed]:
    """Judge the changes of the biases: by the drive, or with time, temperature or specific force.

    One state models turn-on bias, instability and flicker together. The sensor errors may then be likelier
    with a smaller drive than the one that keeps the estimates consistent. So a drive is compared with smaller
    ones only down to that of a filter matched to the sensor.
    """
    number = errors.number.values[:, axes]
    used = number > 0
    if not used.any():
        return []
    matrix = errors.drift_matrix.values[:, axes][used]
    vector = errors.drift_vector.values[:, axes][used]
    squares = errors.drift_squares.values[:, axes][used]
    determinant = errors.log_determinant.values[:, axes][used]
    drive, matched = errors.drive.values[:, axes][used].mean(axis=0).tolist()

    sizes = -0.5 * (squares + determinant).sum(axis=0)
    # With a constant bias under each drive.
    alone, shown = matrix[..., 0, 0], vector[..., 0]
    gained = np.divide(shown**2, alone, out=np.zeros_like(shown), where=alone > 0)
    constant = sizes + 0.5 * gained.sum(axis=0)
    assumed, of_matched, drives = float(constant[0]), float(constant[1]), constant[2:]
    likeliest, *ends, gain = likely_factor(FACTORS, drives - assumed)
    if likeliest < min(drive, matched):
        gain, likeliest = (of_matched - assumed, matched) if matched < drive else (0.0, drive)
        ends = []
    candidates = {"bias drift": (0, 1), "temperature": (0, 2), "g-sensitivity": (0, 3)}
    price = limits.VERDICT.price * matrix.shape[0]
    gains = {
        name: likelihood_gain(Fit(matrix[:, 0], vector[:, 0], np.zeros(())), columns)
        + sizes[0]
        - assumed
        - price
        for name, columns in candidates.items()
        if matrix[:, 0, columns[1], columns[1]].any()
    }
    top = max(gains, key=lambda name: gains[name])
    factor = likeliest / drive if drive else np.inf
    if gains[top] > max(gain - limits.VERDICT.likelihood_ratio, limits.VERDICT.likelihood_ratio):
        column = candidates[top][1]
        estimate = estimates(Fit(matrix[:, 0], vector[:, 0], np.zeros(())), (0, column))[:, 1:]
        return [_state_finding(Explained(top, gains[top], estimate, estimate * 0), kind, axes.start // 3)]
    statistic = f"logarithm of the likelihood ratio {gain:.0f}"
    known = float(errors.known.values[:, axes][used].sum())
    if gain < limits.VERDICT.likelihood_ratio < known:
        # To a filter of constant biases, noise hides by chance a walk that it hardly hides from others.
        statistic = f"logarithm of the likelihood ratio {known:.0f} of the true biases"
        gain, factor, ends = limits.VERDICT.likelihood_ratio, np.inf, []
    if (
        gain < limits.VERDICT.likelihood_ratio
        or 1 / limits.VERDICT.drive_factor < factor < limits.VERDICT.drive_factor
    ):
        return []
    times = factor if factor > 1 else 1 / max(factor, LEAST_FACTOR)
    interval = wrong_factor_interval(factor, ends[0] / drive, ends[1] / drive) if ends and drive else None
    wording = FINDINGS["more wander" if factor > 1 else "less wander"]
    finding = (wording if np.isfinite(times) else FINDINGS["wander without a drive"]).finding(
        float(times),
        f"{statistic}{interval_words(interval)}",
        interval,
        (axes.start + 6, axes.stop + 6),
        direction=wrong_direction(factor),
        sensor=kind,
        factor=float(times),
        multiply=float(factor),
    )
    return [Weighed(gain, finding)]


def _noise(noise: Squares) -> list[Weighed]:
    """Judge Q by the sensor errors besides the biases and the errors that depend on the motion."""
    ratio = noise.mean
    together = (
        bool(noise.number.all())
        and 1 / limits.VERDICT.together_ratio
        < ratio[0] / max(ratio[1], 1e-12)
        < limits.VERDICT.together_ratio
    )
    if together:
        whole = Squares(noise.total.sum(), noise.number.sum())
        return judge_size(whole, FINDINGS["Q"], "noise of the inertial sensors")
    found = []
    for index, kind in enumerate(SENSORS):
        found += judge_size(
            Squares(noise.total[index], noise.number[index]),
            FINDINGS["Q of a sensor"],
            f"noise of the {kind}s",
            rows=(3 * index, 3 * index + 3),
            sensor=kind,
        )
    return found
