"""Belief: the filter's assumptions about its start and sensors, matched to them or given by the settings."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy import linalg

from lab.base.arrays import FloatArray
from lab.base.parameters.setting_error import SettingError
from lab.base.parameters.units import STANDARD_GRAVITY, si
from lab.motion.frames.east_north_up import east_north_up_sizes
from lab.navigation.filters import blocks
from lab.navigation.filters.error_models import ACCEL_BIAS, ACCEL_SCALE, ATT, GYRO_BIAS, GYRO_SCALE, POS, VEL
from lab.navigation.filters.kalman import MEASUREMENTS, gate
from lab.navigation.filters.schedule import Schedule
from lab.navigation.filters.user_states import declared_states
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import Belief
from lab.sensors.imu import AccelerometerErrors, GyroErrors
from lab.sensors.suite import OTHER_SENSORS, TRIADS, SensorSuite

PLAUSIBLE = 0.999
"""Fraction of the good fixes that a robust filter without a gate counts as plausible."""
UNEXPLAINED = 1e-6
"""Probability of rejected good fixes in a row below which chance does not explain them."""
COMMONEST = 1 - 1e-9
"""Largest probability of a rejected good fix that counts: 14 billion rejected fixes in a row are then left to
chance, which no flight has."""
FEWEST_AGREEING = 4
"""Fewest consecutive rejected fixes that indicate a wrong filter if they agree: of four outliers with random
directions, one row in 64 agrees."""
FEWEST_SCATTERED = 10
"""Fewest consecutive rejected fixes that indicate a wrong filter in any directions: with 20 % outliers, one
row in 10 million is as long."""

FLICKER_FLOOR = np.sqrt(2 * np.log(2) / np.pi)
"""Allan deviation of flicker over its coefficient B (IEEE Std 952-1997, annex C)."""
FLICKER_VARIANCE = 5
"""Variance of the process that stands for flicker, in B²: the 4 B² of flicker after some 10⁵ samples, and a
quarter more, found by NEES."""
FLICKER_AT_FIRST = 3.3
"""Variance of flicker 10 s after its start, in B²: (ln n + γ + 4 ln 2) / π after n samples, at 100 Hz.
In these seconds it grows faster than the process that stands for it."""
FLICKER_AFTER_REST = 3.0
"""Variance of flicker less its mean over an alignment, in B²: (ln n + γ + 4 ln 2 − 2) / π after n samples.
The value is that of 30 s at 100 Hz; 10 s make 2.6, and 5 min 3.7."""
FLICKER_PEAK = 1.89
"""Where the Allan deviation of that process is largest, in its correlation times (IEEE Std 952-1997)."""
SHORTEST_MEETING = 10.0
"""Shortest time of that peak [s]: changes within a few fixes average out."""

FAST_RATE = 20.0
"""Rate of a covariance that is propagated cheaply [Hz]: σ differs by some 0.1 % from that of each sample."""
HIDDEN = np.sqrt(2)
"""Largest steady-state variance of a bias estimate, divided by the variance of an instability that the noise
hides.

NEES of the gyro biases over ten flights of montreal, with 30 and 100 °/h and τ of 0.5 and 5 s, is 0.69 to
1.46 without this limit, 0.87 to 1.35 at 1, and 0.88 to 1.12 at √2.
"""


def chosen_blocks(navigator: NavigatorSettings, sensors: SensorSuite | None) -> tuple[str, ...]:
    """Return the further blocks of states of a filter with some settings.

    Parameters
    ----------
    navigator
        The filter.
    sensors
        The sensors that it uses besides IMU and GPS, each of which has a state for its error; None for none.
    """
    chosen = list(blocks.SCALES if navigator.states > blocks.CORE else ())
    chosen += [name for name, one in blocks.BLOCKS.items() if _is_on(one.setting, navigator, sensors)]
    chosen += [own.block for own in declared_states(navigator.own_states, "navigator.own_states")]
    return blocks.in_order(chosen)


def _is_on(setting: str, navigator: NavigatorSettings, sensors: SensorSuite | None) -> bool:
    """Return whether the setting with a path is on; no path is no setting."""
    if not setting:
        return False
    owner, _, name = setting.partition(".")
    if owner == "navigator":
        return bool(getattr(navigator, name))
    return sensors is not None and bool(sensors.get(name))


def is_aided(navigator: NavigatorSettings, sensors: SensorSuite) -> bool:
    """Return whether a filter uses measurements other than GPS fixes and the rates at rest."""
    fitted = any(sensors.groups()[name].get("fitted") for name in OTHER_SENSORS)
    return bool(fitted or navigator.no_slip or navigator.zero_velocity)


def belief(
    sensors: SensorSuite,
    navigator: NavigatorSettings,
    constants: FloatArray | None = None,
    single: SensorSuite | None = None,
) -> Belief:
    """Return the filter's assumptions: P0, Q and R, matched or given, and scaled.

    Parameters
    ----------
    sensors, navigator
        The errors of the sensors, and the filter.
    constants : (21, 21) or (36, 36) array
        Covariance of the constant errors after an alignment, also with that of the errors that it considered
        (`blocks.CONSIDERED`); by default, those before any alignment.
    single
        The sensors as `of_bias_states` returns them, if they are at hand: making them takes a millisecond.

    Raises
    ------
    SettingError
        If P0 is given for another number of states than the filter has.
    """
    aligned = constants is not None
    constants = constant_errors(sensors, navigator) if constants is None else constants
    single = of_bias_states(sensors, navigator) if single is None else single
    drive, decay = bias_processes(single, np.diag(constants), aligned=aligned)
    noise = (
        _expand_diagonal(navigator.q)
        if navigator.q is not None
        else matched_noise(sensors, drive[:3], drive[3:])
    )
    R = _expand_diagonal(navigator.r) if navigator.r is not None else matched_r(sensors)
    # Factors on variances: by their roots on both sides, correlation coefficients stay.
    root = np.sqrt(r_factors(navigator))
    P0 = (
        _given_p0(navigator)
        if navigator.p0 is not None
        else _matched_p0(single, navigator, constants, aligned=aligned)
    )
    further = further_process(sensors, navigator)
    if further.variance.size:
        P0 = linalg.block_diag(P0, np.diag(further.variance))
        if navigator.p0 is None:
            _correlate(P0, constants, chosen_blocks(navigator, sensors))
        # Scale factors are constants, with neither drive nor decay.
        scales = np.zeros(navigator.states - blocks.CORE)
        drive = np.concatenate((np.diag(noise), scales, further.drive))
        decay = np.concatenate((decay, scales, further.decay))
    else:
        drive = np.diag(noise)
    return Belief(
        P0=navigator.p0_scale * P0,
        R=R * np.outer(root, root),
        noise=navigator.q_scale * drive,
        decay=decay,
        lever_arm=assumed_lever_arm(navigator, si(sensors.gps, "lever_arm")),
    )


def of_bias_states(sensors: SensorSuite, navigator: NavigatorSettings) -> SensorSuite:
    """Return sensors with the errors for which the bias states stand: without those that have their own."""
    own = [f"{triad}.instability" for triad in TRIADS if navigator.estimate_bias_drift]
    own += ["gyro.g_sensitivity"] if navigator.estimate_g_sensitivity else []
    if not own:
        return sensors
    single = sensors.copy()
    for path in own:
        single.set(path, 0.0)
    return single


def further_process(sensors: SensorSuite, navigator: NavigatorSettings) -> blocks.Process:
    """Return what the filter takes its states after the scale factors for."""
    found = [block.process for block in map(blocks.block, chosen_blocks(navigator, sensors))]
    processes = [process(sensors, navigator) for process in found if process is not None]
    if not processes:
        return blocks.Process(*np.zeros((3, 0)))
    return blocks.Process(*(np.concatenate(parts) for parts in zip(*processes, strict=True)))


def assumed_lever_arm(navigator: NavigatorSettings, true: FloatArray) -> FloatArray:
    """Return the lever arm (3,) that the filter assumes; `true` is that of the receiver [m]."""
    return np.array(true if navigator.lever_arm is None else navigator.lever_arm, dtype=np.float64)


def assumed_latency(navigator: NavigatorSettings, true: float) -> float:
    """Return the latency that the filter assumes; `true` is that of the receiver [s]."""
    return float(true if navigator.latency is None else navigator.latency)


def _expand_diagonal(value: Any) -> FloatArray:
    """Return the matrix that is given whole or by its diagonal."""
    array = np.asarray(value, dtype=np.float64)
    return np.diag(array) if array.ndim == 1 else array


def _given_p0(navigator: NavigatorSettings) -> FloatArray:
    """Return the given P0, if it has the filter's number of states."""
    P0 = _expand_diagonal(navigator.p0)
    if P0.shape[0] != navigator.states:
        raise SettingError(
            f"navigator.p0: has {P0.shape[0]} states, but the filter has {navigator.states} "
            f"(navigator.states); accepted are {navigator.states} variances or a matrix of so many rows"
        )
    return P0


def constant_errors(sensors: SensorSuite, navigator: NavigatorSettings) -> FloatArray:
    """Return the second moment (21, 21) of the initial errors, given and drawn, and of the constant biases.

    Scale factors are included. The effect of temperature on biases and scale factors is not.
    """
    variance = np.empty(21)
    variance[POS] = si(navigator, "position_sigma") ** 2 + si(navigator, "position_error") ** 2
    variance[VEL] = si(navigator, "velocity_sigma") ** 2 + si(navigator, "velocity_error") ** 2
    variance[ATT] = si(navigator, "attitude_sigma") ** 2 + si(navigator, "attitude_error") ** 2
    variance[GYRO_BIAS] = _turn_on_variance(sensors.gyro)
    variance[ACCEL_BIAS] = _turn_on_variance(sensors.accelerometer)
    for block, errors in ((GYRO_SCALE, sensors.gyro), (ACCEL_SCALE, sensors.accelerometer)):
        variance[block] = si(errors, "scale_factor") ** 2 + si(errors, "scale_factor_sigma") ** 2
    return np.diag(variance)


def _matched_p0(
    sensors: SensorSuite, navigator: NavigatorSettings, constants: FloatArray, *, aligned: bool
) -> FloatArray:
    """Return the covariance of the initial errors, including the instability of the biases."""
    varying = np.zeros(21)
    varying[GYRO_BIAS] = si(sensors.gyro, "instability") ** 2
    varying[ACCEL_BIAS] = si(sensors.accelerometer, "instability") ** 2
    flicker = FLICKER_AFTER_REST if aligned else FLICKER_AT_FIRST
    varying[GYRO_BIAS] += flicker * si(sensors.gyro, "flicker") ** 2
    varying[ACCEL_BIAS] += flicker * si(sensors.accelerometer, "flicker") ** 2
    return (constants[:21, :21] + np.diag(varying))[: navigator.states, : navigator.states]


def _correlate(P0: FloatArray, constants: FloatArray, names: tuple[str, ...]) -> None:
    """Write into P0 what an alignment makes the errors that it considered and those before in common."""
    # Behind the 21 errors of every alignment stand those that it considered, in the order of `CONSIDERED`.
    first = known = 21
    if constants.shape[0] == known:
        return
    core = known if blocks.GYRO_SCALE in names else blocks.CORE
    for name in blocks.CONSIDERED:
        last = first + blocks.block(name).size
        if name in names:
            across, states = constants[:core, first:last], blocks.find_states(names, name)
            P0[:core, states], P0[states, :core] = across, across.T
        first = last


def matched_noise(sensors: SensorSuite, gyro_drive: FloatArray, accel_drive: FloatArray) -> FloatArray:
    """Return the process noise densities of the sensors as a diagonal matrix (12, 12).

    Vibration is white for the accelerometers and counts as part of their noise.
    """
    gyro = si(sensors.gyro, "noise_density") ** 2
    accel = si(sensors.accelerometer, "noise_density") ** 2
    accel = accel + si(sensors.accelerometer, "vibration_density") ** 2
    return np.diag(np.concatenate((gyro, accel, gyro_drive, accel_drive)))


def matched_r(sensors: SensorSuite) -> FloatArray:
    """Return the covariance (6, 6) of a fix, north, east, down."""
    variances = (si(sensors.gps, "position_variance"), si(sensors.gps, "velocity_variance"))
    return np.diag(np.concatenate([east_north_up_sizes(variance) for variance in variances]))


def r_factors(navigator: NavigatorSettings) -> FloatArray:
    """Return the factors (6,) on the variances of a fix, position and velocity north, east, down."""
    horizontal, vertical, velocity = navigator.r_factors
    factors = np.array([horizontal, horizontal, vertical, velocity, velocity, velocity])
    return np.asarray(navigator.r_scale * factors)


def bias_processes(
    sensors: SensorSuite, constants: FloatArray | None = None, *, aligned: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Return drive densities (6,) and decay rates (6,) of the filter's bias states, as `bias_process`.

    Parameters
    ----------
    sensors
        The errors of the sensors.
    constants : (21,) array
        Variances of the constant errors; by default, those before any alignment.
    aligned
        Whether they are those after an alignment.
    """
    gyro, accel = (None, None) if constants is None else (constants[GYRO_BIAS], constants[ACCEL_BIAS])
    hidden = hidden_by_fixes(sensors)
    parts = (
        bias_process(sensors.gyro, gyro, hidden[:3], aligned=aligned),
        bias_process(sensors.accelerometer, accel, hidden[3:]),
    )
    drive, decay = (np.concatenate(part) for part in zip(*parts, strict=True))
    return drive, decay


def bias_process(
    errors: GyroErrors | AccelerometerErrors,
    constant: FloatArray | None = None,
    hidden: FloatArray | float = 0.0,
    *,
    aligned: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """Return drive density (3,) and decay rate (3,) of the filter's one bias state for each axis.

    `hidden` is the time of `hidden_by_fixes`, and `aligned` says that a gyro's constant is what an alignment
    left.

    The true bias is a constant plus Gauss-Markov processes; flicker is modelled as one of them. The filter's
    single Gauss-Markov state has the variance of all together and the short-term growth Σ 2 σ² / τ. A random
    walk adds K² to the drive and nothing to the decay. The model is exact for a single part.

    Beside a large constant, a state of that growth is a random walk, which goes on growing where flicker does
    not. After an alignment, such a constant is about the vertical: the bias is known but for the
    g-sensitivity, which has states of its own. Headings show this bias late. So the state then changes by
    flicker as the process that stands for it does within the time T of its largest Allan deviation, by
    2 σ² (1 − exp(−T / τ)).

    The noise hides fast changes of the instability, so only their variance counts. For a bias with the drive
    q under noise of the density N², the steady state of the Riccati equation has the variance √(q N²). With a
    constant of variance C, that variance need not exceed `HIDDEN` σ² √((C + σ²) / C).
    """
    constant = _turn_on_variance(errors) if constant is None else constant
    instability, (flicker, flicker_time) = si(errors, "instability") ** 2, flicker_process(errors, hidden)
    total = constant + instability + flicker
    growth = 2 * instability / si(errors, "correlation_time")
    level = HIDDEN * instability * np.sqrt(constant + instability)
    hiding = constant * si(errors, "noise_density") ** 2
    settled = np.divide(level**2, hiding, out=np.full(3, np.inf), where=hiding > 0)
    if aligned:
        share = np.divide(flicker, total, out=np.zeros(3), where=total > 0)
        changing = -total * np.log1p(share * np.expm1(-FLICKER_PEAK)) / FLICKER_PEAK
    else:
        changing = flicker
    drive = np.minimum(growth, settled) + 2 * changing / flicker_time
    # In the mean, a Gauss-Markov process of the variance σ² and the drive q decays by q / (2 σ²).
    decay = np.divide(drive, 2 * total, out=np.zeros(3), where=total > 0)
    return drive + si(errors, "rate_random_walk") ** 2, decay


def hidden_by_fixes(sensors: SensorSuite) -> FloatArray:
    """Return the time (6,) within which the fixes hide the flicker of gyros and accelerometers [s].

    It is 0 without flicker. A polynomial of degree k through values with the variance R, one in each period
    Δ, shows its last derivative over a time T with the variance (2k + 1) ((2k)! / k!)² R Δ / T^(2k + 1). The
    bias of an accelerometer is the first derivative of the velocity error and the second of that of the
    position. The bias of a gyro tilts the navigator and is, times gravity, the second and the third. The time
    is that at which the better of the two falls to the floor of the flicker.
    """
    period = float(sensors.gps.period)
    times = []
    for errors, order, size in ((sensors.gyro, 2, STANDARD_GRAVITY), (sensors.accelerometer, 1, 1.0)):
        floor = (FLICKER_FLOOR * size * si(errors, "flicker")) ** 2
        until = []
        for quantity, degree in (("velocity_variance", order), ("position_variance", order + 1)):
            # perm(2k, k) is (2k)! / k!.
            factor = (2 * degree + 1) * math.perm(2 * degree, degree) ** 2
            seen = factor * period * float(np.mean(si(sensors.gps, quantity)))
            variance = np.divide(seen, floor, out=np.zeros(3), where=floor > 0)
            until.append(variance ** (1 / (2 * degree + 1)))
        times.append(np.minimum(*until))
    return np.concatenate(times)


def flicker_process(
    errors: GyroErrors | AccelerometerErrors, hidden: FloatArray | float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Return variance (3,) and correlation time (3,) [s] of the Gauss-Markov process that models flicker.

    No process with one state has a 1/f spectrum. This one has the variance 5 B²: flicker reaches 4 B² some
    10⁵ samples after its start, and NEES requires a quarter more, for changes that last longer than the
    correlation time. The peak of its Allan deviation (at 1.89 correlation times, IEEE 952) is at the time at
    which the white noise falls to the floor 0.664 B of the flicker, because the noise hides faster changes.
    That time is at least 10 s, since changes within a few fixes average out, and at least that within which
    the fixes hide changes, `hidden`: between fixes of metres, quiet accelerometers show nothing.
    """
    B, N = si(errors, "flicker"), si(errors, "noise_density")
    # The Allan deviation N / √T of white noise meets the floor at T = (N / floor)².
    meeting = np.divide(N, FLICKER_FLOOR * B, out=np.zeros(3), where=B > 0) ** 2
    shown = np.maximum(np.maximum(meeting, hidden), SHORTEST_MEETING)
    return FLICKER_VARIANCE * B**2, shown / FLICKER_PEAK


def _turn_on_variance(errors: GyroErrors | AccelerometerErrors) -> FloatArray:
    """Return the second moment (3,) of the turn-on bias."""
    return np.asarray(si(errors, "bias") ** 2 + si(errors, "bias_sigma") ** 2)


def fast_rate(sensors: SensorSuite, navigator: NavigatorSettings) -> float:
    """Return the rate at which a covariance is propagated cheaply, with σ as at each sample [Hz].

    It is 0, each sample, for a smoother, which refuses another. A rate that is set stays.
    """
    if navigator.filter_rate or navigator.smoother:
        return float(navigator.filter_rate)
    return max(FAST_RATE, float(belief(sensors, navigator).decay.max()))


def schedule_filter(navigator: NavigatorSettings, dt: float, samples: int) -> Schedule:
    """Return the schedule of the filter.

    Parameters
    ----------
    navigator
        The settings.
    dt
        Time from IMU sample to IMU sample [s].
    samples
        Number of IMU samples.
    """
    rate = navigator.filter_rate
    by_chance = min(max(1 - suspicion(navigator), UNEXPLAINED), COMMONEST)
    # So many rejections in a row have, by chance alone, the probability `UNEXPLAINED`: pⁿ.
    accusing = math.ceil(math.log(UNEXPLAINED) / math.log(by_chance))
    return Schedule(
        feedback=navigator.correction == "feedback",
        correction_period=float(navigator.correction_period),
        stride=max(1, round(min(1 / (rate * dt), samples))) if rate else 1,
        gate=gate(navigator.gate),
        robust=("none", "huber", "student-t").index(navigator.robust),
        implausible=implausible(navigator),
        agreeing=max(FEWEST_AGREEING, accusing),
        any_of=max(FEWEST_SCATTERED, 2 * accusing),
        aid_gate=gate(navigator.gate, 1),
        # The backward pass of a smoother is that of optimal updates.
        hold_heading=bool(navigator.hold_heading),
    )


def implausible(navigator: NavigatorSettings, measurements: int = MEASUREMENTS) -> float:
    """Return the NIS above which consecutive fixes indicate a wrong filter; infinite if every fix is used."""
    if not navigator.gate and navigator.robust == "none":
        return math.inf
    return gate(suspicion(navigator), measurements)


def suspicion(navigator: NavigatorSettings) -> float:
    """Return the plausible fraction of the good fixes: that of the gate, else `PLAUSIBLE`."""
    return float(navigator.gate) or PLAUSIBLE
