"""Rest: the output of an IMU at rest, logged or simulated, and a card made from it.

`read_log` is that of `lab.analysis.rest_recording`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lab.analysis import allan, low_pass
from lab.analysis.rest_recording import Record, RestRecords, read_log
from lab.analysis.rest_samples import OFF_GRAVITY
from lab.base.arrays import Flags, FloatArray
from lab.base.parameters.units import TO_SI
from lab.data.log.sensor_log import SensorLog
from lab.sensors import imu
from lab.sensors.cards import Card
from lab.sensors.datum import DENSITY, TWO_SIDED, Datum
from lab.sensors.suite import TRIADS, SensorSuite

__all__ = ["OFF_GRAVITY", "Record", "RestRecords", "read_log"]

SAMPLES = 2**15
"""Number of samples of a simulated record."""
TERMS = {"N": "noise_density", "B": "flicker", "K": "rate_random_walk"}
"""The setting of each fitted noise term."""
SHOWN_AT_REST = (*TERMS.values(), "instability", "bandwidth", "quantisation")
"""Settings that shape the noise at rest: of these, a card of a record has `TERMS`."""
OTHER_TERMS = {
    "Q": ("quantisation_noise", "Quantisation noise", {"gyro": "″", "accelerometer": "mm/s"}),
    "R": ("rate_ramp", "Rate ramp", {"gyro": "°/h²", "accelerometer": "mg/h"}),
}
"""Name, label and units of the fitted terms without a setting."""

_PER_CORNER = 32
"""Number of samples within the averaging time at which bias instability exceeds white noise."""
_SHORTEST = 5e-4
"""Shortest time from sample to sample that is simulated: 2 kHz, the fastest rate of an IMU here [s]."""
_CLEAR = 10.0
"""White noise in its σ from which its value in the spectrum is taken."""
_LOOKED_AT = 100_000
"""Samples in which the values are counted."""
_OF_TWO_VALUES = 0.95
"""Part of the samples with the two most frequent values from which they do not show the noise: its σ is
below half of the rounding step."""
_MEMORIES = 5.0
"""Averaging time from which a filter acts by its 1/τ² alone, in its time constants: e⁻⁵ is below 1 %."""
_LONGER = 3
"""How often that time is tried, twice as long each time."""
_FEWEST_TIMES = 8.0
"""Longest averaging time, in samples, of which at least the white noise is taken: there are ten shorter
ones."""
_SHOWN = 2.0
"""A record does not show a term below this multiple of its σ. `allan.fit` states σ so that terms that are not
present are at most 1.5 σ and all others more than 4 σ, so any number in between separates them."""


def of_log(log: SensorLog, length: float) -> dict[str, Record]:
    """Return the beginning of a log, during which the vehicle was at rest.

    Parameters
    ----------
    log
        The log; its samples are treated as equally spaced.
    length
        Duration of the rest [s].
    """
    count = int(np.searchsorted(log.time, length, side="right")) - 1
    dt = float(log.time[count] / count)
    return {triad: Record(rates[:count], dt) for triad, rates in zip(TRIADS, log.rates, strict=True)}


def simulate(sensors: SensorSuite, seed: int = 1) -> dict[str, Record]:
    """Return the simulated output of the sensors at rest, long enough to fit their noise terms.

    It contains only the errors, without the Earth's rate and gravity, which do not affect the Allan
    deviation. The sample interval of each triad is chosen so that white noise and bias instability both show.

    Parameters
    ----------
    sensors
        The errors of the sensors.
    seed
        Seed of the draws.
    """
    records = {}
    for triad in TRIADS:
        errors: Any = sensors.groups()[triad]
        draws = imu.ImuDraws.of(
            seed,
            triad,
            SAMPLES,
            instability=any(errors.instability),
            flicker=any(errors.flicker),
            walk=any(errors.rate_random_walk),
        )
        dt = _spacing(errors)
        increments = imu.measure(np.zeros((SAMPLES, 3)), dt, errors, draws).increments
        records[triad] = Record(increments / dt, dt)
    return records


def noise_terms(records: Mapping[str, Record]) -> dict[str, allan.NoiseTerms]:
    """Return the noise terms of each triad, in SI units; with a low-pass, those before it."""
    return {triad: _noise_terms(record) for triad, record in records.items()}


def _noise_terms(record: Record) -> allan.NoiseTerms:
    terms = _terms_of_noise(record)
    hidden = np.where(_is_rounded(record.rates), np.nan, 0.0)
    return terms._replace(N=terms.N + hidden, N_sigma=terms.N_sigma + hidden)


def _is_rounded(rates: FloatArray) -> Flags:
    """Return on which axes nearly all samples have one or two values, which do not show the noise."""
    hidden = np.zeros(rates.shape[1], bool)
    for axis, values in enumerate(rates.T):
        numbers, counts = np.unique(values[:_LOOKED_AT], return_counts=True)
        two = np.sort(counts)[-2:].sum() / counts.sum()
        hidden[axis] = numbers.size > 1 and two > _OF_TWO_VALUES
    return hidden


def _terms_of_noise(record: Record) -> allan.NoiseTerms:
    rates, dt = record
    found, white, sigma = low_pass.find(rates, dt)
    if found is None or found.explains:
        terms = (
            allan.fit(allan.deviation(rates, dt))
            if found is None
            else allan.fit(allan.deviation(found.undone(rates, dt), dt), found.shown_from(dt))
        )
        # The spectrum shows white noise more exactly, if it is above all else, and alone if behind a filter.
        better = (white > _CLEAR * sigma) & ((sigma < terms.N_sigma) | (found is not None))
        return terms._replace(
            N=np.where(better, white, terms.N), N_sigma=np.where(better, sigma, terms.N_sigma), low_pass=found
        )
    # Whatever the filter is, it lowers the variance at long averaging times by a term with 1/τ².
    deviation = allan.deviation(rates, dt)
    # The time constant of a low-pass of first order is 1 / (2π cut-off).
    shortest = _MEMORIES / (2 * np.pi * found.cut_off)
    for _ in range(_LONGER):
        terms = allan.fit(deviation, shortest)
        if (terms.p_value >= allan.FITS).all():
            break
        shortest *= 2
    unknown = np.where(terms.p_value < allan.FITS, np.nan, 0.0)
    return terms._replace(N=terms.N + unknown, N_sigma=terms.N_sigma + unknown, low_pass=found)


def in_setting_units(triad: str, terms: allan.NoiseTerms) -> dict[str, dict[str, Any]]:
    """Return fitted terms by name: label, unit, and a value and σ for each axis.

    The terms of `TERMS` are settings, in their units; those of `OTHER_TERMS` follow.

    Parameters
    ----------
    triad
        ``"gyro"`` or ``"accelerometer"``.
    terms
        Its terms in SI units.
    """
    group = SensorSuite().groups()[triad]
    named = {
        letter: (name, str(group.param[name].label), group.param[name].unit) for letter, name in TERMS.items()
    }
    named |= {letter: (name, label, units[triad]) for letter, (name, label, units) in OTHER_TERMS.items()}
    out = {}
    for letter, (name, label, unit) in named.items():
        values, sigmas = getattr(terms, letter), getattr(terms, f"{letter}_sigma")
        scale = TO_SI[unit]
        out[name] = {"label": label, "unit": unit, "value": values / scale, "sigma": sigmas / scale}
    return out


def about_fit(fitted: Mapping[str, allan.NoiseTerms]) -> str:
    """Return sentences about filters in the sensors, and about axes that the five terms do not explain.

    Parameters
    ----------
    fitted
        The terms of each triad.
    """
    parts = []
    for triad, terms in fitted.items():
        if terms.low_pass is not None:
            how = (
                "the terms are those before it"
                if terms.low_pass.explains
                else "its shape is not known, so the terms are fitted at long averaging times alone"
            )
            parts.append(f"The {triad}s have a low-pass of about {terms.low_pass.cut_off:.2g} Hz: {how}.")
        if hidden := [axis for axis, value in zip("xyz", terms.N, strict=True) if np.isnan(value)]:
            parts.append(
                f"The white noise of {triad} {', '.join(hidden)} is not known: the samples are rounded too "
                "coarsely, or the filter hides it."
            )
    poor = [
        f"{triad} {axis} (p {p_value:.1g})"
        for triad, terms in fitted.items()
        for axis, p_value in zip("xyz", terms.p_value, strict=True)
        if p_value < allan.FITS
    ]
    if poor:
        parts.append(
            f"The five terms do not explain the Allan deviation of {', '.join(poor)}. Other possible causes "
            "are vibration, a changing temperature, or a bias with a correlation time."
        )
    return " ".join(parts)


def card_of(name: str, records: Mapping[str, Record], source: str) -> Card:
    """Return a card of an IMU from its record at rest.

    A term that the record does not show (below twice its σ on every axis) is omitted; so are quantisation
    noise and ramp, which have no setting. If the five terms do not explain the deviation, only white noise is
    written, if they explain short averaging times. A record at rest does not show turn-on bias, scale
    factor, range and bandwidth, so these are missing too. The note names filters and poor fits.

    Parameters
    ----------
    name
        Name of the card.
    records
        Records of gyros and accelerometers, or of one of them, such as from `read_log`.
    source
        Source of the records.

    Raises
    ------
    ValueError
        If no number is supported by the fit.
    """
    groups, found = {}, noise_terms(records)
    note = about_fit(found)
    for triad, terms in found.items():
        record = records[triad]
        where = f"Allan deviation of {source}: {record.duration:.0f} s at rest, {1 / record.dt:.5g} Hz"
        written, names = _supported_terms(record, terms)
        groups[triad] = {
            setting: Datum(
                tuple(float(f"{value:.4g}") for value in fitted["value"]),
                fitted["unit"],
                where,
                TWO_SIDED if setting == DENSITY else "",
            )
            for setting, fitted in in_setting_units(triad, written).items()
            if setting in names
            and np.isfinite(fitted["value"]).all()
            and (fitted["value"] > _SHOWN * fitted["sigma"]).any()
        }
        if missing := [one for one in TERMS.values() if one not in names]:
            labels = [str(SensorSuite().groups()[triad].param[one].label).lower() for one in missing]
            note += (
                f" The fit does not support {', '.join(labels)} of the {triad}s, which the card leaves out."
            )
    if not any(groups.values()):
        raise ValueError(f"no card can be made of {source}. {note or 'The record shows no noise.'}")
    return Card(name=name, maker="", grade="own", note=note.strip(), terms=groups)


def _supported_terms(record: Record, terms: allan.NoiseTerms) -> tuple[allan.NoiseTerms, tuple[str, ...]]:
    """Return terms for a card, and the names of those that the fit supports on all axes."""
    if (terms.p_value >= allan.FITS).all():
        return terms, tuple(TERMS.values())
    if not np.isfinite(terms.N).all():
        return terms, ()
    if terms.low_pass is not None:
        return terms, (DENSITY,) if terms.low_pass.explains else ()
    deviation = allan.deviation(record.rates, record.dt)
    longest = float(deviation.tau[-1])
    while longest > _FEWEST_TIMES * record.dt:
        longest /= 2
        short = allan.fit(deviation, longest=longest)
        if (short.p_value >= allan.FITS).all() and (_SHOWN * short.N_sigma < short.N).all():
            return short, (DENSITY,)
    return terms, ()


def with_noise(sensors: SensorSuite, card: Card) -> SensorSuite:
    """Return sensors with the noise of a card that was made of a record at rest.

    Everything that such a record does not show, such as turn-on bias, scale factor and range, stays. A filter
    that took it for zero would be overconfident by far.

    Parameters
    ----------
    sensors
        The sensors; they are not changed.
    card
        From `card_of`. What it omits of noise, its record did not show: it is zero.
    """
    sensors = sensors.copy()
    for triad in TRIADS:
        for name in SHOWN_AT_REST:
            zero = [0.0] * 3
            sensors.set(f"{triad}.{name}", zero if (value := card.value(triad, name)) is None else value)
    return sensors


def _spacing(errors: Any) -> float:
    white, flicker = (
        float(np.mean(getattr(errors, name))) * TO_SI[errors.param[name].unit]
        for name in ("noise_density", "flicker")
    )
    if not (white and flicker):
        return 1.0
    return max((white / (allan.FLOOR * flicker)) ** 2 / _PER_CORNER, _SHORTEST)
