"""Error sources: the constant and random errors of a run, in a form for covariance analysis.

Errors known sample by sample, such as the effect of a temperature or a latency, are in `known_errors`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lab.analysis.transition import N
from lab.base.aid_table import AIDS
from lab.base.arrays import FloatArray
from lab.base.parameters.units import si
from lab.motion.frames.east_north_up import east_north_up_sizes
from lab.navigation.belief import assumed_latency, assumed_lever_arm
from lab.navigation.filters import blocks
from lab.navigation.filters.error_models import (
    ACCEL_BIAS,
    ACCEL_SCALE,
    ATT,
    GYRO_BIAS,
    GYRO_SCALE,
    POS,
    STATES,
    VEL,
)
from lab.sensors import imu
from lab.sensors.suite import TRIADS

if TYPE_CHECKING:
    from lab.base.parameters.settings import Settings
    from lab.motion.kinematics.ideal_imu import IdealImu
    from lab.navigation.alignment.rest_alignment import Aligned
    from lab.run.experiment_settings import ExperimentSettings


STAGE = 1.0
"""Spacing of the processes that model flicker, in the logarithm of their correlation times."""

GYRO, ACCELEROMETER, GPS_POSITION, GPS_VELOCITY, WIND = range(5)
"""Indices of the groups of sensors to which errors belong, and of the wind."""
SENSOR_CHANNELS = {aid.name: place for place, aid in enumerate(AIDS, WIND + 1)}
"""Index of each sensor with one number, by its group in the settings."""
SLOW_ERRORS = {
    GPS_POSITION: blocks.GPS_DRIFT,
    WIND: blocks.WIND,
    **{SENSOR_CHANNELS[aid.name]: aid.state for aid in AIDS if not aid.is_scale},
}
"""States that stand for the slow error of a measurement."""
INSTABILITY = "bias instability"
"""Last words of the names of the processes for which a filter may have states of their own."""


class Constant(NamedTuple):
    """An error that is constant during a flight: independent numbers, one column each.

    Attributes
    ----------
    name
        Name of the source.
    start : (n, c) array
        Initial error states for one standard deviation of each number, as many as the filter has.
    coupling : (c, 6, 6) array
        Maps angular rate and specific force in b to the errors of gyros and accelerometers.
    """

    name: str
    start: FloatArray
    coupling: FloatArray


class Process(NamedTuple):
    """A random error on three axes: white noise, a first-order Gauss-Markov process or a random walk.

    Attributes
    ----------
    name
        Name of the source.
    channel
        The disturbed measurement, such as `GYRO` or `GPS_POSITION`.
    variance : (3,) array
        Steady-state variance, body axes or north, east, down; for a random walk, its growth per second. That
        of a sensor with one number is the first one.
    time
        Correlation time [s]; 0 for white noise from sample to sample or fix to fix; infinite for a random
        walk.
    settled
        Whether the process is stationary from the start; otherwise it starts from zero.
    graded
        Whether its σ is larger while the constellation is bad.
    """

    name: str
    channel: int
    variance: FloatArray
    time: float = 0.0
    settled: bool = True
    graded: bool = False

    def decay(self, elapsed: float) -> float:
        """Return the remaining fraction of a value after some time [s]."""
        return float(np.exp(-elapsed / self.time)) if self.time else 0.0

    def drive(self, elapsed: float) -> FloatArray:
        """Return the added variance (3,) after some time [s]."""
        if np.isinf(self.time):
            return self.variance * elapsed
        return self.variance * (1 - self.decay(elapsed) ** 2)


def constants(experiment: ExperimentSettings, aligned: Aligned, names: Sequence[str] = ()) -> list[Constant]:
    """Return the constant errors that are not zero.

    Parameters
    ----------
    experiment
        The settings.
    aligned
        The start of the navigator; an alignment reduces the errors before the flight to the remaining ones.
    names
        The further blocks of the filter.
    """
    navigator, sensors = experiment.navigator, experiment.sensors
    found: list[Constant] = []
    scaled = blocks.GYRO_SCALE in names
    for name, block in (("position", POS), ("velocity", VEL), ("attitude", ATT)):
        found.append(initial(f"initial {name}", block, np.diag(si(navigator, f"{name}_sigma"))))
        found.append(initial(f"initial {name}, given", block, si(navigator, f"{name}_error")[None]))
    triads = (("gyro", GYRO_BIAS, GYRO_SCALE), ("accelerometer", ACCEL_BIAS, ACCEL_SCALE))
    for number, (name, block, scale_block) in enumerate(triads):
        errors = sensors.groups()[name]
        own = slice(3 * number, 3 * number + 3)
        # The estimate starts at zero, so its error is minus the bias.
        found.append(initial(f"{name} turn-on bias σ", block, -np.diag(si(errors, "bias_sigma"))))
        found.append(initial(f"{name} turn-on bias, given", block, -si(errors, "bias")[None]))
        scale, drawn = si(errors, "scale_factor"), si(errors, "scale_factor_sigma")
        # With states for them, they are errors of an estimate that starts at zero, as for the biases.
        sources = [
            initial(f"{name} scale factor σ", scale_block, -np.diag(drawn)),
            initial(f"{name} scale factor, given", scale_block, -scale[None]),
        ]
        if not scaled:
            each = np.einsum("c,ci,cj->cij", drawn, np.eye(3), np.eye(3))
            couplings = each, np.diag(scale)[None]
            sources = [
                coupled_source(source.name, own, own, matrices)._replace(start=source.start)
                for source, matrices in zip(sources, couplings, strict=True)
            ]
        found += sources
    # An alignment takes its estimate off the output of the gyros: the filter's own estimate starts at zero.
    found = [source._replace(start=aligned.kept @ source.start) for source in found]
    uncoupled = np.zeros((aligned.noise.shape[1], 6, 6))
    noise = Constant("noise of the alignment", aligned.noise, uncoupled)
    found = [_with_room(source, names) for source in (*found, noise)]
    found += [_considered_source(experiment, aligned, names, name) for name in blocks.CONSIDERED]
    found += _of_measurements(experiment, names)
    return [source for source in found if source.start.any() or source.coupling.any()]


def _considered_source(
    experiment: ExperimentSettings, aligned: Aligned, names: Sequence[str], block: str
) -> Constant:
    """Return a source that an alignment considered, with the tilts and biases that this left.

    Misalignments, and the g-sensitivity if the filter has states for it; otherwise the latter is a part of
    the biases, in `known_errors`.
    """
    number = 0 if block == blocks.GYRO_G else blocks.MISALIGNMENTS.index(block)
    errors, own = experiment.sensors.groups()[TRIADS[number]], slice(3 * number, 3 * number + 3)
    assert isinstance(errors, imu.GyroErrors | imu.AccelerometerErrors)
    if block == blocks.GYRO_G:
        values = si(errors, "g_sensitivity") * (block in names)
        source = coupled_source(block, own, slice(3, 6), np.diag(values)[None])
    else:
        values = si(errors, "misalignment")
        source = coupled_source(block, own, own, imu.misalignment(errors)[None])
    if aligned.considered.size:
        first = sum(blocks.block(name).size for name in blocks.CONSIDERED[: blocks.CONSIDERED.index(block)])
        columns = aligned.considered[:, first : first + values.size]
        source = source._replace(start=columns @ np.sign(values)[:, None])
    source = _with_room(source, names)
    if block in names:
        source.start[blocks.find_states(names, block), 0] = -values
        source = source._replace(coupling=np.zeros_like(source.coupling))
    return source


def _with_room(source: Constant, names: Sequence[str]) -> Constant:
    """Return a source with as many rows as a filter with some further blocks has states."""
    start = np.zeros((blocks.count(names), source.start.shape[1]))
    known = N + sum(blocks.block(name).size for name in names if name in blocks.SCALES)
    start[:known] = source.start[:known]
    return source._replace(start=start)


def _of_measurements(experiment: ExperimentSettings, names: Sequence[str]) -> list[Constant]:
    """Return the constant errors of measurements for which the filter has states; these start at zero."""
    sensors, navigator = experiment.sensors, experiment.navigator
    arm, latency = si(sensors.gps, "lever_arm"), float(sensors.gps.latency)
    found: dict[str, tuple[str, FloatArray]] = {
        blocks.LEVER_ARM: ("GPS lever arm", assumed_lever_arm(navigator, arm) - arm),
        blocks.LATENCY: ("GPS latency", np.array(assumed_latency(navigator, latency) - latency)),
    }
    for aid in AIDS:
        if aid.name == "airspeed":
            found[blocks.WIND] = "wind", -np.eye(2) * si(sensors.airspeed, "wind_sigma")
        name = f"{aid.state} factor" if aid.is_scale else aid.state
        found[aid.state] = name, -si(sensors.aids()[aid.name], aid.sigma)
    return [
        _of_block(source, names, block, values) for block, (source, values) in found.items() if block in names
    ]


def _of_block(name: str, names: Sequence[str], block: str, values: FloatArray) -> Constant:
    """Return a source of initial errors of all states of a further block.

    It is given by the values of the states, or by those for one σ of c independent numbers (states, c).
    """
    size = blocks.block(block).size
    columns = np.broadcast_to(values, (size,)).reshape(size, 1) if np.ndim(values) < 2 else values
    start = np.zeros((blocks.count(names), columns.shape[1]))
    start[blocks.find_states(names, block)] = columns
    return Constant(name, start, np.zeros((columns.shape[1], 6, 6)))


def initial(name: str, block: slice, columns: FloatArray) -> Constant:
    """Return a source of initial errors, from (c, 3) values of one block of states."""
    start = np.zeros((len(STATES), columns.shape[0]))
    start[block] = columns.T
    return Constant(name, start, np.zeros((columns.shape[0], 6, 6)))


def coupled_source(name: str, rows: slice, columns: slice, matrices: FloatArray) -> Constant:
    """Return a source proportional to rate or force, from (c, 3, 3) matrices."""
    coupling = np.zeros((matrices.shape[0], 6, 6))
    coupling[:, rows, columns] = matrices
    none = np.zeros((len(STATES), matrices.shape[0]))
    return Constant(name, none, coupling)


def processes(experiment: ExperimentSettings, ideal: IdealImu, duration: float) -> list[Process]:
    """Return the random processes that are not zero, those of the IMU first.

    Parameters
    ----------
    experiment
        The settings.
    ideal
        Increments of the true flight.
    duration
        Length of the flight [s].
    """
    sensors = experiment.sensors
    found: list[Process] = []
    for channel, name in ((GYRO, "gyro"), (ACCELEROMETER, "accelerometer")):
        errors = sensors.groups()[name]
        time, instability = float(si(errors, "correlation_time")), si(errors, "instability") ** 2
        walk = si(errors, "rate_random_walk") ** 2
        increments = ideal.dvelocity if channel else ideal.dtheta
        # A square of all increments would take 70 MB in four hours.
        squares = np.einsum("ki,ki->i", increments, increments, dtype=np.float64)
        size = np.sqrt(squares / len(increments)) / ideal.dt
        found += [
            Process(f"{name} white noise", channel, si(errors, "noise_density") ** 2 / ideal.dt),
            Process(f"{name} {INSTABILITY}", channel, instability, time),
            *flicker(f"{name} flicker", channel, si(errors, "flicker"), ideal.dt, duration),
            Process(f"{name} random walk", channel, walk, np.inf, settled=False),
            Process(f"{name} quantisation", channel, rounding(errors, ideal.dt)),
            Process(f"{name} thermometer", channel, _thermometer(experiment, errors, size)),
        ]
    vibration = si(sensors.accelerometer, "vibration_density") ** 2 / ideal.dt
    found.append(Process("vibration", ACCELEROMETER, vibration))
    found.append(Process("vibration", GYRO, si(sensors.gyro, "g_sensitivity") ** 2 * vibration))
    found += [*_of_fixes(experiment), *_of_sensors(experiment)]
    return [source for source in found if source.variance.any()]


def _of_sensors(experiment: ExperimentSettings) -> list[Process]:
    """Return the random errors of the fitted sensors with one number."""
    found = []
    for aid in AIDS:
        errors, channel = experiment.sensors.aids()[aid.name], SENSOR_CHANNELS[aid.name]
        if not errors.get("fitted"):
            continue
        found.append(Process(f"{aid.owner} noise", channel, _first(si(errors, "noise") ** 2)))
        if not aid.is_scale:
            drift, time = _first(si(errors, "drift_sigma") ** 2), float(si(errors, "correlation_time"))
            found.append(Process(f"{aid.owner} drift", channel, drift, time))
    air = experiment.sensors.airspeed
    if air.fitted:
        wind = np.array([1.0, 1.0, 0.0]) * float(si(air, "wind_drift_sigma")) ** 2
        found.append(Process("wind drift", WIND, wind, float(air.correlation_time)))
    return found


def _first(variance: FloatArray) -> FloatArray:
    """Return the variance (3,) of a sensor with one number."""
    return np.array([float(variance), 0.0, 0.0])


def _of_fixes(experiment: ExperimentSettings) -> list[Process]:
    """Return the random errors of the fixes, north, east, down."""
    errors = experiment.sensors.gps
    found = []
    for channel, name in ((GPS_POSITION, "position"), (GPS_VELOCITY, "velocity")):
        variance = east_north_up_sizes(si(errors, f"{name}_variance"))
        found.append(Process(f"GPS {name} noise", channel, variance, graded=True))
    correlated, time = (
        east_north_up_sizes(si(errors, "correlated_sigma")) ** 2,
        float(si(errors, "correlation_time")),
    )
    found.append(Process("GPS correlated position", GPS_POSITION, correlated, time, graded=True))
    if not experiment.navigator.gate:
        # As a random error: the variance is that of all fixes, outliers or not.
        jumps = np.full(3, errors.outlier_rate * float(si(errors, "outlier_size")) ** 2)
        found.append(Process("GPS outliers", GPS_POSITION, jumps))
    return found


def left_out(experiment: ExperimentSettings) -> list[str]:
    """Return the settings with errors that are not among the sources."""
    found = []
    if experiment.navigator.gate and experiment.sensors.gps.outlier_rate:
        found.append(
            "sensors.gps.outlier_rate (the gate rejects outliers, and those it passes are not followed)"
        )
    if experiment.sensors.own_errors:
        found.append("sensors.own_errors (errors that a notebook declared)")
    return found


def rounding(errors: Settings, dt: float) -> FloatArray:
    """Return the variance (3,) of the quantisation if it is white: q² / 12, otherwise zeros.

    It is white where the noise of the samples exceeds the quantisation step (B. Widrow, I. Kollár,
    *Quantization Noise*, ch. 4 and 20). Elsewhere it depends on the motion, and `known_errors` includes it.
    """
    step = si(errors, "quantisation")
    spread = si(errors, "noise_density") / np.sqrt(dt)
    return step**2 / 12 if np.all(spread >= step / 2) else np.zeros(3)


def _thermometer(experiment: ExperimentSettings, errors: Settings, size: FloatArray) -> FloatArray:
    """Return the variance (3,) that the thermometer's noise leaves after a compensation.

    The formula assumes a separate thermometer for each axis, and a constant rate or force with the same mean
    square.
    """
    temperature = experiment.sensors.temperature
    if not temperature.compensation:
        return np.zeros(3)
    sensitivity = si(errors, "bias_temperature") ** 2 + (si(errors, "scale_temperature") * size) ** 2
    return np.asarray(sensitivity * float(si(temperature, "thermometer_sigma")) ** 2)


def flicker(name: str, channel: int, coefficient: FloatArray, dt: float, duration: float) -> list[Process]:
    """Return flicker that starts from zero, as first-order processes, one for each `STAGE`.

    White noise integrated to order one half has the covariance (B² / π) ln((√t + √s)² / |t − s|). Processes
    of all correlation times T that start from zero, with B² / π for each unit of ln T, have (B² / π) ln((t +
    s) / |t − s|). The difference hardly changes with time, and is (B² / π) ln 2 where t and s are similar.
    The shortest correlation time, a quarter of a sample, gives the variance of the sampled process (Kasdin,
    Proc. IEEE 83, eq. 104).
    """
    density = coefficient**2 / np.pi
    times = np.exp(np.arange(np.log(dt / 4) + STAGE / 2, np.log(30 * duration), STAGE))
    constant = Process(name, channel, density * np.log(2), 1e6 * duration)
    return [constant, *(Process(name, channel, density * STAGE, time, settled=False) for time in times)]
