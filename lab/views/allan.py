"""Allan: figures of the Allan deviation of the sensors at rest, measured and expected from the settings."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lab.analysis.allan import FLOOR, AllanDeviation
from lab.base.arrays import FloatArray
from lab.base.parameters.units import TO_SI, si
from lab.sensors.suite import SensorSuite
from lab.views.paired_curves import PairedCurves

UNITS = {"gyro": "°/h", "accelerometer": "mg"}
TITLES = {"gyro": "Gyros", "accelerometer": "Accelerometers"}


def expected_deviation(sensors: SensorSuite, triad: str, tau: FloatArray) -> FloatArray:
    """Return the Allan deviation (k, 3) expected from noise density, flicker and random walk, in SI units.

    Quantisation with the step q is included as white noise with σ = q/√12 in each sample, where the noise of
    a sample exceeds half a step.

    Parameters
    ----------
    sensors
        The settings of the sensors.
    triad
        ``"gyro"`` or ``"accelerometer"``.
    tau : (k,) array
        Averaging times [s]; the first is the time from sample to sample.
    """
    white, flicker, walk = coefficients(sensors, triad, float(tau[0]))
    t = tau[:, None]
    return np.asarray(np.sqrt(white**2 / t + (FLOOR * flicker) ** 2 + walk**2 * t / 3))


def coefficients(sensors: SensorSuite, triad: str, dt: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return white noise N with that of rounding, flicker B and random walk K of each axis, in SI units.

    Parameters
    ----------
    sensors, triad
        As of `expected_deviation`.
    dt
        Time from sample to sample [s].
    """
    errors = sensors.groups()[triad]
    white, flicker, walk = (si(errors, name) for name in ("noise_density", "flicker", "rate_random_walk"))
    step = si(errors, "quantisation")
    rounded = np.where(white**2 / dt >= (step / 2) ** 2, step**2 * dt / 12, 0.0)
    return np.sqrt(white**2 + rounded), flicker, walk


class AllanFigures:
    """The Allan deviation of the gyros and of the accelerometers over the averaging time.

    Parameters
    ----------
    dashed
        What the dashed curves are.

    Attributes
    ----------
    figures : list of figure
        Gyros, accelerometers.
    """

    def __init__(self, dashed: str = "the settings") -> None:
        self._curves = {
            triad: PairedCurves(
                f"{TITLES[triad]} (dashed: {dashed})",
                "Allan deviation",
                "averaging time τ [s]",
                ("τ", "s"),
                unit,
            )
            for triad, unit in UNITS.items()
        }
        self.figures = [curves.figure for curves in self._curves.values()]

    def show(self, sensors: SensorSuite, deviations: Mapping[str, AllanDeviation]) -> None:
        """Draw the deviations of the triads, beside those expected from the settings."""
        self.compare(
            deviations,
            {triad: expected_deviation(sensors, triad, found.tau) for triad, found in deviations.items()},
        )

    def compare(self, deviations: Mapping[str, AllanDeviation], others: Mapping[str, FloatArray]) -> None:
        """Draw the deviations of the triads beside others (k, 3) at the same averaging times, SI units.

        A triad without a deviation, as of a recording of gyros alone, is drawn empty.
        """
        for triad, curves in self._curves.items():
            found, unit = deviations.get(triad), TO_SI[UNITS[triad]]
            if found is None:
                curves.clear()
                continue
            curves.show(found.tau, found.deviation / unit, others[triad] / unit)

    def clear(self) -> None:
        """Draw nothing."""
        for curves in self._curves.values():
            curves.clear()
