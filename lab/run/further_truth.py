"""Further truth: the true values of the further states of a filter, as they were simulated."""

from __future__ import annotations

import numpy as np

from lab.base.aid_table import AIDS
from lab.base.arrays import FloatArray, interpolate_columns
from lab.base.parameters.units import si
from lab.motion.frames.east_north_up import east_north_up
from lab.motion.kinematics.ideal_imu import IdealImu
from lab.navigation.belief import assumed_latency, assumed_lever_arm
from lab.navigation.filters import blocks
from lab.navigation.filters.user_states import UserStates, declared_states, of_blocks
from lab.run.experiment_settings import ExperimentSettings
from lab.sensors import airspeed, gps, imu, processes
from lab.sensors.draws import unit_draws
from lab.sensors.suite import TRIADS


def further_truth(experiment: ExperimentSettings, names: tuple[str, ...], time: FloatArray) -> FloatArray:
    """Return the true values (n, k) of the further states after the scale factors at some times.

    The slow errors are known at the times of readings and fixes, and interpolated between them.

    Parameters
    ----------
    experiment
        The settings.
    names
        The further blocks of the filter.
    time : (n,) array
        Times [s].
    """
    columns: list[FloatArray] = []
    sensors, seed = experiment.sensors, experiment.seed
    for name in names:
        if name in blocks.SCALES:
            continue
        if name in blocks.MISALIGNMENTS:
            triad = sensors.gyro if name == blocks.GYRO_MISALIGNMENT else sensors.accelerometer
            columns += [np.full(time.size, value) for value in si(triad, "misalignment")]
        elif name == blocks.GYRO_G:
            columns += [np.full(time.size, value) for value in si(sensors.gyro, "g_sensitivity")]
        elif name in blocks.DRIFTS:
            columns += list(bias_drift(experiment, blocks.DRIFTS.index(name), time).T)
        elif name in blocks.OWN:
            (own,) = of_blocks((name,))
            columns += list(user_errors(experiment, own, time).T)
        elif name == blocks.GPS_DRIFT:
            columns += list(_drift(experiment, time).T)
        elif name == blocks.WIND:
            columns += list(airspeed.wind_at(sensors.airspeed, seed, time).T)
        elif name in blocks.OF_AIDS:
            (aid,) = (one for one in AIDS if one.state == name)
            columns.append(sensors.aids()[aid.name].state_at(seed, time))
        else:
            columns += [np.full(time.size, value) for value in _constant(experiment, name)]
    return np.stack(columns, axis=-1) if columns else np.zeros((time.size, 0))


def bias_drift(experiment: ExperimentSettings, triad: int, time: FloatArray) -> FloatArray:
    """Return the true drift of the biases of a triad (n, 3), as its output shows it [rad/s] or [m/s²].

    It is the instability, changed by scale factors and misalignments at 25 °C as the biases are.

    Parameters
    ----------
    experiment
        The settings.
    triad
        0 for gyros, 1 for accelerometers.
    time : (n,) array
        Times of IMU samples [s]; the first sample of a flight has the drift of the second.
    """
    name = TRIADS[triad]
    errors = experiment.sensors.groups()[name].copy()
    assert isinstance(errors, imu.GyroErrors | imu.AccelerometerErrors)
    errors.set("rate_random_walk", 0.0)
    errors.set("flicker", 0.0)
    rate = float(experiment.trajectory.imu_rate)
    interval = np.maximum(np.round(time * rate).astype(np.int64) - 1, 0)
    draws = imu.ImuDraws.of(
        experiment.seed,
        name,
        int(interval[-1]) + 1,
        instability=any(errors.instability),
    )
    drift = imu.drift(errors, draws, 1 / rate)
    shown = drift @ (np.eye(3) + imu.cross_coupling(errors, draws)).T
    return shown[interval] if shown.ndim == 2 else np.broadcast_to(shown, (time.size, 3))


def felt_by_gyros(errors: imu.GyroErrors, seed: int, dvelocity: FloatArray, dt: float) -> FloatArray:
    """Return the bias of the gyros (n, 3) from the specific force, as their output shows it [rad/s].

    Parameters
    ----------
    errors, seed
        The errors of the gyros, and the seed of their draws.
    dvelocity : (n, 3) array
        True increments over sample intervals, without vibration [m/s].
    dt
        Length of the intervals [s].
    """
    draws = imu.ImuDraws.of(seed, "gyro", 0, instability=False)
    shown = np.eye(3) + imu.cross_coupling(errors, draws)
    return np.asarray(dvelocity / dt * si(errors, "g_sensitivity") @ shown.T)


def user_errors(experiment: ExperimentSettings, own: UserStates, time: FloatArray) -> FloatArray:
    """Return the true values (n, k) of states that a user declared; zero if they are not simulated.

    Parameters
    ----------
    experiment
        The settings.
    own
        The states.
    time : (n,) array
        Times of IMU samples [s].
    """
    if own not in declared_states(experiment.sensors.own_errors, "sensors.own_errors"):
        return np.zeros((time.size, own.size))
    seed, rate = experiment.seed, float(experiment.trajectory.imu_rate)
    samples = np.round(time * rate).astype(np.int64)
    errors = own.sigma * unit_draws(seed, f"own {own.name}.constant", (own.size,))
    if not own.drift_sigma.any():
        return np.broadcast_to(errors, (time.size, own.size))
    draws = unit_draws(seed, f"own {own.name}.drift", (int(samples[-1]) + 1, own.size))
    decay = float(np.exp(-1 / (rate * own.correlation_time)))
    drift = processes.gauss_markov(draws[0], draws, decay)
    return np.asarray(errors + own.drift_sigma * drift[samples])


def simulated_user_errors(experiment: ExperimentSettings, ideal: IdealImu) -> FloatArray:
    """Return what gyros and accelerometers read too much (n, 6) by the errors that a user declared.

    Parameters
    ----------
    experiment
        The settings.
    ideal
        The true increments.
    """
    total = np.zeros((ideal.dtheta.shape[0], 6))
    for own in declared_states(experiment.sensors.own_errors, "sensors.own_errors"):
        E = own.effects(ideal.dtheta / ideal.dt, ideal.dvelocity / ideal.dt)
        total += np.einsum("nik,nk->ni", E, user_errors(experiment, own, ideal.time[1:]))
    return total


def errors_of_states(
    experiment: ExperimentSettings, names: tuple[str, ...], ideal: IdealImu
) -> FloatArray | None:
    """Return what errors of the IMU with further states add to its output, (n, 6) [rad/s], [m/s²]; or None.

    Parameters
    ----------
    experiment
        The settings.
    names
        The further blocks of the filter.
    ideal
        The true increments.
    """
    own = of_blocks(names)
    if not own and not {*blocks.CONSIDERED, *blocks.DRIFTS} & set(names):
        return None
    rates, forces, time = ideal.dtheta / ideal.dt, ideal.dvelocity / ideal.dt, ideal.time[1:]
    total = np.zeros((time.size, 6))
    for triad, values in enumerate((rates, forces)):
        part = slice(3 * triad, 3 * triad + 3)
        if blocks.MISALIGNMENTS[triad] in names:
            errors = experiment.sensors.groups()[TRIADS[triad]]
            assert isinstance(errors, imu.GyroErrors | imu.AccelerometerErrors)
            total[:, part] += values @ imu.misalignment(errors).T
        if blocks.DRIFTS[triad] in names:
            total[:, part] += bias_drift(experiment, triad, time)
    if blocks.GYRO_G in names:
        total[:, :3] += felt_by_gyros(experiment.sensors.gyro, experiment.seed, ideal.dvelocity, ideal.dt)
    for one in own:
        total += np.einsum("nik,nk->ni", one.effects(rates, forces), user_errors(experiment, one, time))
    return total


def _drift(experiment: ExperimentSettings, time: FloatArray) -> FloatArray:
    """Return the correlated position error of the receiver (n, 3), north, east, down [m]."""
    errors = experiment.sensors.gps
    times = gps.fix_times(errors, float(time[-1]))
    drift = east_north_up(gps.drift(times, errors, gps.GpsDraws.of(experiment.seed, times.size)))
    if not times.size:
        return np.zeros((time.size, 3))
    return interpolate_columns(time, times, drift)


def _constant(experiment: ExperimentSettings, name: str) -> FloatArray:
    """Return what a constant is off from its assumed value."""
    navigator, receiver = experiment.navigator, experiment.sensors.gps
    if name == blocks.LEVER_ARM:
        true = si(receiver, "lever_arm")
        return np.asarray(true - assumed_lever_arm(navigator, true))
    return np.array([receiver.latency - assumed_latency(navigator, receiver.latency)])
