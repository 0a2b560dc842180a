"""Twin: the motion of a real stream, simulated with the sensors of the settings and compared with it.

The smoothed solution of the stream, at ten samples a second, is taken as the motion. IMU and receiver are
simulated on it several times, each with other random numbers, and every simulation is evaluated as the real
stream is. So the simulations show by how much a quantity varies by chance, whatever its distribution and
whatever the navigator does to it: no threshold rests on a theory of the estimate. The motion has no
frequencies above `MOTION_RATE`/2, and contains noise of the real stream below; noise is therefore compared
above `lab.live.stream_statistics.LEAST_HZ`. Spectra are medians over pieces, so that shocks, such as those of
a runway, do not count. At rest, the motion is known, so slow noise is compared too, by Allan deviations.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from lab.analysis.allan import AllanDeviation
from lab.analysis.rest import Record
from lab.base.arrays import FloatArray
from lab.data.log.sensor_log import SensorLog
from lab.data.streams.live_log import make_log
from lab.live.live_verdict import run_batch
from lab.live.simulated.simulated_flight import REST, SimulatedFlight
from lab.live.stream_settings import stream_settings
from lab.live.stream_statistics import LEAST_HZ, Spectrum, StreamStatistics, of_log, of_rest
from lab.motion.frames.rotation import euler_from_quaternion
from lab.motion.recordings.flight_csv import write_flight_csv
from lab.motion.recordings.recording import Recording
from lab.navigation.settings import NavigatorSettings
from lab.sensors.suite import TRIADS, SensorSuite

Tell = Callable[[str, float], None]

TWINS: Final = 10
"""Simulations: with ten, chance must exceed 4.6 of their spreads to be taken for a difference."""
CHANCE: Final = 0.001
"""Probability that chance alone makes a sentence about one quantity."""
MOTION_RATE: Final = 10.0
"""Samples of the motion a second [Hz]: the fixes and the attitude decide about slower motion."""
WORTH: Final = 0.1
"""Smallest difference of a size that is reported, as a part: settings are rarely known better."""
LINE_WORTH: Final = 1.5
"""Smallest growth of the highest peak that is reported: the largest of many values is skewed."""
_TWO_DIGITS: Final = 0.1
"""Factor below which two decimals are fewer than two digits."""
CORRELATION: Final = "innovation correlation"
"""The only quantity that is not a size."""
_START: Final = {
    "size": "The innovations of the real stream are {range} as large as those of the simulation.",
    "drift": "After up to 10 s without fixes, the real stream is {range} as far from them as the simulation.",
    "noise": f"The noise of the real {{triad}} above {LEAST_HZ:g} Hz is {{range}} that of the simulation.",
    "line": "The spectrum of the real {triad} has a line: its peak is {range} that of the simulation.",
    "deviation": "The Allan {name} of the real {triad} is {range} that of the simulation.",
}
"""Sentences by the kind of quantity."""


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
    real_allan, simulated_allan : dict of AllanDeviation
        Allan deviations of both triads, of the stream and the root mean square of the simulations.
    at_rest : bool
        Whether a record at rest was compared.
    """

    differences: tuple[Difference, ...]
    real: Spectrum
    simulated: Spectrum
    real_allan: dict[str, AllanDeviation]
    simulated_allan: dict[str, AllanDeviation]
    at_rest: bool

    @property
    def sentences(self) -> list[str]:
        """Where the real stream differs."""
        return [one.sentence for one in self.differences if one.sentence]


def twin_of(
    log: SensorLog,
    sensors: SensorSuite,
    navigator: NavigatorSettings,
    seed: int = 1,
    progress: Tell | None = None,
) -> TwinComparison:
    """Compare a stream with simulations of its motion.

    Parameters
    ----------
    log
        The stream, with fixes.
    sensors, navigator
        The sensors that are simulated, and the filter of both, as far as they hold for a stream.
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
    sensors, navigator = stream_settings(sensors, navigator)
    smoothing = NavigatorSettings()
    smoothing.update({**navigator.to_dict(), "smoother": True})
    # A smoother also uses later fixes: what it gives as motion has the least noise of the navigator.
    motion = _motion(run_batch(log, sensors, smoothing))
    rate = 1 / float(np.median(np.diff(log.time)))
    with tempfile.TemporaryDirectory(prefix="ins-lab-") as folder:
        path = Path(folder) / "flight.csv"
        write_flight_csv(path, motion)
        return _compare_statistics(
            of_log(log, sensors, navigator),
            lambda k: of_log(_simulate_log(path, rate, sensors, seed + k), sensors, navigator),
            tell,
            at_rest=False,
        )


def twin_at_rest(
    records: Mapping[str, Record], sensors: SensorSuite, seed: int = 1, progress: Tell | None = None
) -> TwinComparison:
    """Compare a record at rest with simulations of a device at rest; it needs no fixes.

    Parameters
    ----------
    records
        Records of gyros and accelerometers, with one interval of the samples.
    sensors
        The sensors that are simulated.
    seed
        Of the first simulation.
    progress
        Called with a sentence and the fraction done.

    Raises
    ------
    SettingError, ValueError
        If the record is too short, or the sensors cannot be simulated at its rate.
    """
    record = records[TRIADS[0]]
    dt, samples = record.dt, len(record.rates)

    def simulate_twin(k: int) -> StreamStatistics:
        flight = SimulatedFlight.of(
            REST, 1 / dt, seed=seed + k, rest=samples * dt, settings={"sensors": sensors.to_dict()}
        )
        rows = flight.imu[:samples]
        return of_rest({"gyro": rows["rate"], "accelerometer": rows["force"]}, dt)

    real = of_rest({triad: one.rates for triad, one in records.items()}, dt)
    return _compare_statistics(real, simulate_twin, progress or (lambda _words, _part: None), at_rest=True)


def _compare_statistics(
    real: StreamStatistics, simulated: Callable[[int], StreamStatistics], tell: Tell, *, at_rest: bool
) -> TwinComparison:
    """Compare statistics with those of `TWINS` simulations, by their number."""
    twins = []
    for k in range(TWINS):
        tell(f"Simulating, {k + 1} of {TWINS}", (k + 1) / (TWINS + 2))
        twins.append(simulated(k))
    differences = [
        _difference(name, value, np.array([one.sizes[name] for one in twins]))
        for name, value in real.sizes.items()
        if all(name in one.sizes for one in twins)
    ]
    if np.isfinite(real.correlation):
        others = np.array([one.correlation for one in twins])
        if np.isfinite(others).all():
            differences.append(_difference(CORRELATION, real.correlation, others))
    density = {
        triad: np.mean([one.spectrum.density[triad] for one in twins], axis=0)
        for triad in real.spectrum.density
    }
    return TwinComparison(
        tuple(differences),
        real.spectrum,
        Spectrum(twins[0].spectrum.frequency, density),
        real.allan,
        {triad: _mean_deviation([one.allan[triad] for one in twins]) for triad in real.allan},
        at_rest,
    )


def _mean_deviation(curves: list[AllanDeviation]) -> AllanDeviation:
    """Return the root mean square of deviations, at the averaging times that all have."""
    first = min(curves, key=lambda curve: len(curve.tau))
    count = len(first.tau)
    squares = np.mean([curve.deviation[:count] ** 2 for curve in curves], axis=0)
    # The simulations are independent: their degrees of freedom add up.
    return first._replace(deviation=np.sqrt(squares), degrees=len(curves) * first.degrees)


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


def _simulate_log(path: Path, rate: float, sensors: SensorSuite, seed: int) -> SensorLog:
    """Return a simulation of the motion as a log, through the same repair as a stream."""
    flight = SimulatedFlight.of(str(path), rate, seed=seed, settings={"sensors": sensors.to_dict()})
    return make_log("twin", *flight.timed())


def _difference(name: str, real: float, twins: FloatArray) -> Difference:
    from scipy import special  # noqa: PLC0415 - takes a tenth of a second, and only this needs it

    mean, spread = float(twins.mean()), float(twins.std(ddof=1))
    # The mean of the simulations is itself uncertain by a part of their spread.
    sigma = spread * np.sqrt(1 + 1 / len(twins))
    t = float((real - mean) / sigma)
    limit = float(special.stdtrit(len(twins) - 1, 1 - CHANCE / 2))
    sentence = ""
    if abs(t) > limit:
        sentence = _sentence(name, real - mean, sigma, real, mean, t)
    return Difference(name, real, mean, spread, t, sentence)


def _sentence(name: str, by: float, sigma: float, real: float, mean: float, t: float) -> str:
    """Return where the real stream differs; empty if the difference is too small to matter."""
    if name == CORRELATION:
        said = (
            f"Successive innovations of the real stream have a correlation of {real:.2f}, those of the "
            f"simulation {mean:.2f} ± {sigma:.2f} (t = {t:.1f})."
        )
        return said if abs(by) > WORTH else ""
    # Sizes are compared by their logarithms, so a difference is a factor.
    factor, *ends = np.exp((by, by - 2 * sigma, by + 2 * sigma))
    if abs(factor - 1) < WORTH or (name.endswith(" line") and factor < LINE_WORTH):
        return ""
    return _START[name.split(" ", 1)[-1].split(" over ", maxsplit=1)[0]].format(
        triad=name.split(" ", maxsplit=1)[0],
        name=name.split(" ", 1)[-1],
        range=f"{_format_factor(factor)} times ({' to '.join(map(_format_factor, ends))}, t = {t:.1f})",
    )


def _format_factor(factor: float) -> str:
    """Return a factor with two decimals, or two digits where these would be few."""
    return f"{factor:.2f}" if factor >= _TWO_DIGITS else f"{factor:.2g}"
