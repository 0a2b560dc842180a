"""Twin: the motion of a real stream, simulated with the sensors of the settings and compared with it.

The smoothed solution of the stream, at ten samples a second, is taken as the motion. IMU and receiver are
simulated on it several times, each with other random numbers, and every simulation is evaluated as the real
stream is. So the simulations show by how much a quantity varies by chance, whatever its distribution and
whatever the navigator does to it: no threshold rests on a theory of the estimate. The motion has no
frequencies above `MOTION_RATE`/2, and contains noise of the real stream below; noise is therefore compared
above `LEAST_HZ`. Spectra are medians over pieces, so that shocks, such as those of a runway, do not count.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from lab.live.live_log import log_of
from lab.live.live_verdict import batch_of
from lab.live.simulated_flight import SimulatedFlight
from lab.logs.sensor_log import SensorLog
from lab.navigation.settings import NavigatorSettings
from lab.recordings.flight_csv import write_flight_csv
from lab.recordings.recording import Recording
from lab.rotation import euler_from_quaternion
from lab.sensors.suite import TRIADS, SensorSuite

FloatArray = NDArray[np.float64]

TWINS: Final = 10
"""Simulations: with ten, chance must exceed 4.6 of their spreads to be taken for a difference."""
CHANCE: Final = 0.001
"""Probability that chance alone makes a sentence about one quantity."""
MOTION_RATE: Final = 10.0
"""Samples of the motion a second [Hz]: the fixes and the attitude decide about slower motion."""
LEAST_HZ: Final = 20.0
"""Lowest frequency at which noise is compared [Hz]. The mission Montréal has motion up to 15 Hz:
at 12.5 Hz, it is 28 times the noise of the default accelerometers."""
SEGMENT: Final = 2.0
"""Length of the pieces whose spectra are averaged [s]: lines 0.5 Hz apart are told apart."""
NEIGHBOURS: Final = 15
"""Frequencies whose median a line must exceed: 7 Hz, over which the spectrum of a motion changes little."""
WORTH: Final = 0.1
"""Smallest difference of a size that is reported, as a part: settings are rarely known better."""
LINE_WORTH: Final = 1.5
"""Smallest growth of the highest peak that is reported: the largest of many values is skewed."""
LEAST_FIXES: Final = 20
"""Fewest fixes for a comparison of innovations."""


@dataclass(frozen=True)
class Spectrum:
    """Spectra of a log: frequencies (k,) [Hz] and one-sided densities (k, 3) of each triad, in SI units."""

    frequency: FloatArray
    density: dict[str, FloatArray]


@dataclass(frozen=True)
class Difference:
    """One quantity of the real stream and of its simulations.

    Attributes
    ----------
    name : str
        The quantity.
    real, simulated, spread : float
        Its value, mean and standard deviation of the simulations; logarithms of sizes.
    statistic : float
        Difference in its σ, Student's t with `TWINS` − 1 degrees of freedom.
    sentence : str
        Where the real one differs; empty where that cannot be told.
    """

    name: str
    real: float
    simulated: float
    spread: float
    statistic: float
    sentence: str


@dataclass(frozen=True)
class TwinComparison:
    """A real stream beside its simulations.

    Attributes
    ----------
    differences : tuple of Difference
        All quantities.
    real, simulated : Spectrum
        Spectra of the stream and the mean of the simulations.
    """

    differences: tuple[Difference, ...]
    real: Spectrum
    simulated: Spectrum

    @property
    def sentences(self) -> list[str]:
        """Where the real stream differs."""
        return [one.sentence for one in self.differences if one.sentence]


def twin_of(
    log: SensorLog,
    sensors: SensorSuite,
    navigator: NavigatorSettings,
    seed: int = 1,
    progress: Callable[[str, float], None] | None = None,
) -> TwinComparison:
    """Compare a stream with simulations of its motion.

    Parameters
    ----------
    log
        The stream, with fixes.
    sensors, navigator
        The sensors that are simulated, and the filter of both.
    seed
        Of the first simulation.
    progress
        Called with a sentence and the fraction done.

    Raises
    ------
    MissionError, SettingError, ValueError
        If the stream cannot be navigated.
    """
    tell = progress or (lambda _words, _part: None)
    tell("Navigating the stream", 0.0)
    smoothing = NavigatorSettings()
    smoothing.update({**navigator.to_dict(), "smoother": True})
    motion = _motion(batch_of(log, sensors, smoothing))
    found = [_quantities(log, sensors, navigator)]
    rate = 1 / float(np.median(np.diff(log.time)))
    with tempfile.TemporaryDirectory(prefix="ins-lab-") as folder:
        path = Path(folder) / "flight.csv"
        write_flight_csv(path, motion)
        for k in range(TWINS):
            tell(f"Simulating, {k + 1} of {TWINS}", (k + 1) / (TWINS + 2))
            found.append(_quantities(_simulated(path, rate, sensors, seed + k), sensors, navigator))
    (real, spectrum), others = found[0], found[1:]
    mean = Spectrum(
        spectrum.frequency,
        {
            triad: np.mean([one.density[triad][: len(spectrum.frequency)] for _, one in others], axis=0)
            for triad in TRIADS
        },
    )
    differences = tuple(
        _difference(name, value, np.array([one[name] for one, _ in others])) for name, value in real.items()
    )
    return TwinComparison(differences, spectrum, mean)


def _motion(result: Any) -> Recording:
    """Return the solution as a flight, ten samples a second."""
    solution, time = result.solution_arrays, result.time
    step = max(round(1 / (MOTION_RATE * float(np.median(np.diff(time))))), 1)
    rows = slice(0, None, step)
    latitude, longitude, height = solution.position[rows].T
    return Recording(
        time=time[rows] - time[0],
        latitude=latitude,
        longitude=longitude,
        height=height,
        velocity_n=solution.velocity_n[rows],
        euler=euler_from_quaternion(solution.q_nb[rows]),
    )


def _simulated(path: Path, rate: float, sensors: SensorSuite, seed: int) -> SensorLog:
    """Return a simulation of the motion as a log, through the same repair as a stream."""
    flight = SimulatedFlight.of(str(path), rate, seed=seed, settings={"sensors": sensors.to_dict()})
    return log_of("twin", *flight.timed())


def _quantities(
    log: SensorLog, sensors: SensorSuite, navigator: NavigatorSettings
) -> tuple[dict[str, float], Spectrum]:
    """Return the quantities of a log that are compared, and its spectra."""
    from scipy import ndimage  # noqa: PLC0415 - takes a tenth of a second, and only this needs it

    spectrum = _spectrum(log)
    found = {}
    high = (spectrum.frequency >= LEAST_HZ) & (spectrum.frequency < 0.98 * spectrum.frequency[-1])
    for triad, density in spectrum.density.items():
        if high.sum() < 4:
            continue
        level = np.median(density[high], axis=0)
        found[f"{triad} noise"] = float(np.mean(np.log(level)) / 2)
        around = ndimage.median_filter(density, size=(NEIGHBOURS, 1), mode="nearest")
        found[f"{triad} line"] = float(np.log((density[high] / around[high]).max()))
    solution = batch_of(log, sensors, navigator).solution_arrays
    used = solution.fix_sample >= 0
    if used.sum() >= LEAST_FIXES:
        spread = np.sqrt(np.diagonal(solution.innovation_covariance[used], axis1=1, axis2=2))
        normed = solution.innovation[used] / spread
        found["innovation size"] = float(np.log(np.mean(normed**2)) / 2)
        found["innovation correlation"] = float(np.sum(normed[1:] * normed[:-1]) / np.sum(normed**2))
    return found, spectrum


def _spectrum(log: SensorLog) -> Spectrum:
    from scipy import signal  # noqa: PLC0415 - takes a tenth of a second, and only this needs it

    hz = 1 / float(np.median(np.diff(log.time)))
    densities = {}
    for triad, rates in zip(TRIADS, log.rates, strict=True):
        frequency, densities[triad] = signal.welch(
            rates, hz, nperseg=round(SEGMENT * hz), axis=0, average="median"
        )
    return Spectrum(frequency, densities)


def _difference(name: str, real: float, twins: FloatArray) -> Difference:
    from scipy import special  # noqa: PLC0415 - takes a tenth of a second, and only this needs it

    mean, spread = float(twins.mean()), float(twins.std(ddof=1))
    sigma = spread * np.sqrt(1 + 1 / len(twins))
    t = float((real - mean) / sigma)
    limit = float(special.stdtrit(len(twins) - 1, 1 - CHANCE / 2))
    sentence = ""
    if abs(t) > limit:
        sentence = _sentence(name, real - mean, sigma, real, mean, t)
    return Difference(name, real, mean, spread, t, sentence)


def _sentence(name: str, by: float, sigma: float, real: float, mean: float, t: float) -> str:
    """Return where the real stream differs; empty if the difference is too small to matter."""
    if name == "innovation correlation":
        return (
            f"Successive innovations of the real stream have a correlation of {real:.2f}, those of the "
            f"simulation {mean:.2f} ± {sigma:.2f} (t = {t:.1f})."
            if abs(by) > WORTH
            else ""
        )
    factor, low, high = np.exp((by, by - 2 * sigma, by + 2 * sigma))
    if abs(factor - 1) < WORTH:
        return ""
    range_of = f"{factor:.2f} times ({low:.2f} to {high:.2f}, t = {t:.1f})"
    if name == "innovation size":
        return f"The innovations of the real stream are {range_of} as large as those of the simulation."
    triad, what = name.split(" ")
    if what == "noise":
        return f"The noise of the real {triad} above {LEAST_HZ:g} Hz is {range_of} that of the simulation."
    if factor < LINE_WORTH:
        return ""
    return f"The spectrum of the real {triad} has a line: its peak is {range_of} that of the simulation."
