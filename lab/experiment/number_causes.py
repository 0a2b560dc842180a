"""Number causes: why an IMU has more noise in motion than at rest, and what shows it."""

from __future__ import annotations

import math

import numpy as np

from lab.analysis import allan, rest
from lab.analysis.rest_recording import RestRecords
from lab.analysis.vibration import LARGER, SLOWEST, vibration
from lab.base.arrays import FloatArray
from lab.base.parameters.units import TO_SI
from lab.data.checks.full_scale import range_remarks
from lab.experiment.number_table import TERMS, UNITS, Estimate
from lab.sensors.suite import TRIADS

SHOWN = 2.0
"""σ from which the rest shows flicker, as for a card."""


def cause(
    key: tuple[str, str],
    still: Estimate | None,
    moving: Estimate | None,
    records: RestRecords | None,
    rates: FloatArray,
    dt: float,
) -> str:
    """Return why motion and rest differ, and what shows it."""
    triad, term = key
    if moving is None:
        return "unknown: the drive does not show this term"
    if still is None:
        return "unknown: no rest shows this term"
    if moving.low <= still.high and still.low <= moving.high:
        return "none needed: both intervals have values in common"
    if moving.high < still.low:
        return "the drive needs less than the rest shows: its samples are filtered, or the rest was disturbed"
    both = np.zeros((len(rates), 6))
    both[:, 3 * TRIADS.index(triad) :][:, :3] = rates
    causes = range_remarks(both)
    if term == TERMS[0]:
        causes += _vibration_cause(triad, rates, dt, records)
    elif records and (walk := _flicker_walk(triad, records)) is not None:
        equal, tau = walk
        if equal >= moving.low:
            unit = UNITS[1][TRIADS.index(triad)]
            causes.append(
                f"flicker, which no filter has: at {tau:.0f} s it is as large as a walk of {equal:.3g} "
                f"{unit} (Allan deviation at rest)"
            )
    if not causes:
        return (
            "not found: neither range nor vibration nor flicker explains it; scale factors, misalignments, "
            "temperature and time errors do not show in these logs"
        )
    return " ".join(causes)


def _vibration_cause(triad: str, values: FloatArray, dt: float, records: RestRecords | None) -> list[str]:
    """Return vibration as a cause, with its line."""
    moving = vibration(values, dt)
    still = vibration(*records[triad]) if records and triad in records else None
    if moving is None or still is None:
        return []
    densities = [one.rms / math.sqrt(one.highest - SLOWEST) for one in (moving, still)]
    if densities[0] < LARGER * densities[1]:
        return []
    unit, scale = ("°/s", np.degrees(1.0)) if triad == "gyro" else ("m/s²", 1.0)
    times = densities[0] / max(densities[1], np.finfo(float).tiny)
    line = (
        "without a line"
        if math.isnan(moving.line)
        else f"with {100 * moving.part:.0f} % of its power at {moving.line:.1f} Hz"
    )
    return [
        f"vibration {line}: {scale * moving.rms:.3g} {unit} rms from {SLOWEST:g} to {moving.highest:.0f} Hz, "
        f"{times:.2g} times that at rest (spectra of both logs)"
    ]


def _flicker_walk(triad: str, records: RestRecords) -> tuple[float, float] | None:
    """Return the walk as large as the flicker where the flicker begins, and that time [s]; None without."""
    if triad not in records:
        return None
    terms = rest.noise_terms({triad: records[triad]})[triad]
    floor = allan.FLOOR * np.where(SHOWN * terms.B_sigma < terms.B, terms.B, 0.0)
    size, white = float(np.sqrt(np.mean(floor**2))), float(np.sqrt(np.nanmean(terms.N**2)))
    if not size > 0 or not white > 0:
        return None
    tau = (white / size) ** 2
    return size * math.sqrt(3 / tau) / TO_SI[UNITS[1][TRIADS.index(triad)]], tau


def flicker(records: RestRecords | None) -> list[str]:
    """Return a remark about each triad with flicker at rest."""
    found = []
    for triad in records or {}:
        walk = _flicker_walk(triad, records or RestRecords({}))
        if walk is not None:
            unit = UNITS[1][TRIADS.index(triad)]
            found.append(
                f"The {triad}s have flicker (Allan deviation at rest), which no filter has as a state: from "
                f"{walk[1]:.3g} s on it exceeds the white noise; a random walk of {walk[0]:.3g} {unit} is as "
                "large there."
            )
    return found
