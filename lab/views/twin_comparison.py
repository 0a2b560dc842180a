"""Twin comparison: a real stream beside its simulations: spectra and Allan deviations, and a table."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import NamedTuple

import numpy as np
from bokeh.plotting import figure

from lab.base.arrays import FloatArray
from lab.base.numbers import format_number
from lab.base.parameters.units import TO_SI
from lab.live.stream_statistics import LEAST_HZ, Spectrum
from lab.live.twin import CORRELATION, Difference, TwinComparison
from lab.sensors.suite import SensorSuite
from lab.views.allan import TITLES, UNITS, AllanFigures, coefficients
from lab.views.ensemble_cards import scroll_box
from lab.views.paired_curves import PairedCurves

DENSITIES = {"gyro": "°/s/√Hz", "accelerometer": "µg/√Hz"}
"""Units of the spectra by triad."""


class SpectrumFigures:
    """Spectra of gyros and accelerometers.

    Parameters
    ----------
    dashed
        What the dashed curves are.

    Attributes
    ----------
    figures : list of figure
        Gyros, accelerometers.
    """

    def __init__(self, dashed: str) -> None:
        self._curves = {
            triad: PairedCurves(
                f"{TITLES[triad]} (dashed: {dashed})", "spectrum", "frequency [Hz]", ("f", "Hz"), unit
            )
            for triad, unit in DENSITIES.items()
        }
        self.figures: list[figure] = [curves.figure for curves in self._curves.values()]

    def show(self, found: Spectrum, dashed: Mapping[str, FloatArray]) -> None:
        """Draw spectra, and beside them one-sided densities at the first of the same frequencies."""
        for triad, curves in self._curves.items():
            rows = slice(1, min(len(found.frequency), len(dashed[triad])))  # without f = 0
            unit = TO_SI[DENSITIES[triad]]
            curves.show(
                found.frequency[rows],
                np.sqrt(found.density[triad][rows]) / unit,
                np.sqrt(dashed[triad][rows]) / unit,
            )

    def clear(self) -> None:
        """Draw nothing."""
        for curves in self._curves.values():
            curves.clear()


def promised_density(sensors: SensorSuite, triad: str, frequency: FloatArray) -> FloatArray:
    """Return the one-sided density (k, 3) expected from noise density, flicker and random walk, in SI units.

    Rounding to steps is white noise, as in `lab.views.allan.expected_deviation`.

    Parameters
    ----------
    sensors
        The settings of the sensors.
    triad
        ``"gyro"`` or ``"accelerometer"``.
    frequency : (k,) array
        Frequencies [Hz], up to half the rate; at zero, the density of the next one stands.
    """
    white, flicker, walk = coefficients(sensors, triad, 1 / (2 * float(frequency[-1])))
    w = 2 * np.pi * np.maximum(frequency, frequency[1])[:, None]
    return np.asarray(2 * (white**2 + flicker**2 / w + (walk / w) ** 2))


class TwinFigures:
    """Spectra of gyros and accelerometers, and their Allan deviations.

    Attributes
    ----------
    figures : list of figure
        In reading order.
    """

    def __init__(self) -> None:
        self._spectra = SpectrumFigures("simulated")
        self._allan = AllanFigures("simulated")
        self.figures: list[figure] = [*self._spectra.figures, *self._allan.figures]

    def show(self, found: TwinComparison) -> None:
        """Draw a comparison."""
        self._spectra.show(found.real, found.simulated.density)
        counts = {
            triad: min(len(found.real_allan[triad].tau), len(found.simulated_allan[triad].tau))
            for triad in found.real_allan
        }
        self._allan.compare(
            {
                triad: curve._replace(
                    tau=curve.tau[: counts[triad]], deviation=curve.deviation[: counts[triad]]
                )
                for triad, curve in found.real_allan.items()
            },
            {triad: curve.deviation[: counts[triad]] for triad, curve in found.simulated_allan.items()},
        )

    def clear(self) -> None:
        """Draw nothing."""
        self._spectra.clear()
        self._allan.clear()


STYLE = """
table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: 6px 0; }
th, td { text-align: left; padding: 3px 14px 3px 0; vertical-align: top; }
th { font-weight: 500; opacity: 0.7; }
td.number { text-align: right; white-space: nowrap; }
.differs { color: color-mix(in srgb, #e5484d 65%, currentColor); font-weight: 600; }
ul { margin: 4px 0; padding-left: 20px; }
"""
"""Style sheet of the table and of the sentences above it."""
_TRIADS = {"gyro": "gyros", "accelerometer": "accelerometers"}


class _Shown(NamedTuple):
    label: str
    unit: str
    per_unit: float  # what one unit is in the unit of the quantity


def twin_html(found: TwinComparison) -> str:
    """Return the sentences and the table of a comparison."""
    count = len(found.differences)
    said = found.sentences
    where = "at rest" if found.at_rest else "on the same motion"
    if said:
        first = f"{len(said)} of {count} quantities differ by more than chance explains:"
        words = f"<p>{first}</p><ul>{''.join(f'<li>{escape(one)}</li>' for one in said)}</ul>"
    else:
        words = (
            f"<p>All {count} quantities agree within chance: {where}, the simulated sensors behave like the "
            "real ones.</p>"
        )
    head = "<tr><th>Quantity</th><th>Real</th><th>Simulated</th><th>Real / simulated</th></tr>"
    rows = "".join(_row(one) for one in found.differences)
    return f"{words}{scroll_box(f'<table>{head}{rows}</table>', 'Quantities')}"


def _row(one: Difference) -> str:
    shown = _shown(one.name)
    if one.name == CORRELATION:
        real, mean, ratio = f"{one.real:.2f}", f"{one.simulated:.2f} ± {one.spread:.2f}", "—"
    else:
        real, mean = (f"{np.exp(value) / shown.per_unit:.3g}" for value in (one.real, one.simulated))
        mean = f"{mean} ± {format_number(100 * np.expm1(one.spread))} %"
        ratio = f"{np.exp(one.real - one.simulated):.3g}"
    mark = " differs" if one.sentence else ""
    return (
        f"<tr><td>{escape(shown.label)}{f' [{shown.unit}]' if shown.unit else ''}</td>"
        f'<td class="number">{real}</td><td class="number">{mean}</td>'
        f'<td class="number{mark}">{ratio}</td></tr>'
    )


def _shown(name: str) -> _Shown:
    """Return label and unit of a quantity of `lab.live.stream_statistics`."""
    plain = {
        "innovation size": _Shown("Innovations, rms", "σ", 1.0),
        "drift": _Shown("Error after up to 10 s without fixes, rms", "m", 1.0),
        CORRELATION: _Shown("Correlation of successive innovations", "", 1.0),
    }
    if name in plain:
        return plain[name]
    triad, what = name.split(" ", 1)
    if what == "noise":
        unit = DENSITIES[triad]
        return _Shown(f"Noise of the {_TRIADS[triad]} above {LEAST_HZ:g} Hz (one-sided)", unit, TO_SI[unit])
    if what == "line":
        return _Shown(f"Highest peak of the {_TRIADS[triad]} above {LEAST_HZ:g} Hz, in power", "", 1.0)
    unit = UNITS[triad]
    return _Shown(f"Allan {what} of the {_TRIADS[triad]}", unit, TO_SI[unit])
