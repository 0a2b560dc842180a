"""Known errors: errors determined by flight, settings and seed, sample by sample and fix by fix.

Each is the difference of two simulations, with and without the error: temperature, g-sensitivity and
bandwidth alone on the true flight; saturation, and quantisation steps coarser than the noise, in the run
itself; latency and lever arm in the fixes; the motion against which a condition holds, such as zero velocity.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from lab.analysis.error_sources import rounding
from lab.base.arrays import FloatArray, interpolate_columns
from lab.base.parameters.units import si
from lab.motion.frames import earth, ecef
from lab.motion.frames.east_north_up import east_north_up
from lab.motion.frames.rotation import C_nb_from_euler, wrap
from lab.motion.kinematics.ideal_imu import IdealImu
from lab.motion.truth.trajectory import Truth
from lab.navigation.aids import FORWARD, MAGNETIC, NORTHWARD
from lab.navigation.belief import assumed_latency, assumed_lever_arm
from lab.navigation.filters.blocks import GYRO_G, LATENCY, LEVER_ARM
from lab.run.experiment_settings import ExperimentSettings
from lab.run.run import Run
from lab.sensors import gps, imu
from lab.sensors import temperature as thermal

TriadErrors = imu.GyroErrors | imu.AccelerometerErrors

TERMS = {
    "temperature, bias": "bias_temperature",
    "temperature, scale factor": "scale_temperature",
    "g-sensitivity": "g_sensitivity",
    "bandwidth": "bandwidth",
}
"""Separately simulated errors: the name of the source after its sensor, and its setting."""


class Series(NamedTuple):
    """A known error: one value for each IMU sample, or for each fix.

    Attributes
    ----------
    name
        Name of the source.
    inertial : (n, 6) array
        Errors of gyros and accelerometers in each sample, with the sign of an error of the estimated bias
        [rad/s], [m/s²].
    fixes : (m, 6) array
        Errors of the fixes, position and velocity, north, east, down [m], [m/s].
    aids : (a,) array
        Errors of the measurements besides GPS, in SI units.
    is_bias
        Whether the true bias includes it.
    """

    name: str
    inertial: FloatArray
    fixes: FloatArray
    aids: FloatArray
    is_bias: bool = False


def known_errors(run: Run) -> list[Series]:
    """Return the known errors of a run that are not zero."""
    triads = [*_of_triad(run, 0, "gyro"), *_of_triad(run, 1, "accelerometer")]
    found = [*triads, *_of_fixes(run), *_of_aids(run)]
    return [source for source in found if any(part.any() for part in source[1:4])]


def _of_triad(run: Run, number: int, name: str) -> list[Series]:
    """Return the known errors of the gyros (0) or the accelerometers (1)."""
    experiment = run.experiment
    errors = experiment.sensors.groups()[name]
    assert isinstance(errors, TriadErrors)
    measured = run.accelerometer if number else run.gyro
    if not (
        measured.saturated
        or any(errors.quantisation)
        or any(_has_error(errors, term) for term in TERMS.values())
    ):
        return []  # without the memory for exact increments
    truth, kept = run.true_flight("budget")
    ideal = kept.to_compute_on()
    temperature = thermal.temperature(
        experiment.sensors.temperature, run.time[1:], truth.height[1:] - truth.height[0]
    )
    found = []
    for source, difference, is_bias in chain(
        _errors_on_the_true_flight(run, errors, ideal, temperature, truth),
        _errors_with_noise(experiment, name, errors, measured.saturated > 0, ideal, temperature),
    ):
        inertial = np.zeros((ideal.dtheta.shape[0], 6))
        # With the sign of an error of the estimated bias: too large an output is too small an estimate.
        inertial[:, 3 * number : 3 * number + 3] = -difference / ideal.dt
        none = np.zeros((run.fixes.time.size, 6)), np.zeros(run.aids.time.size)
        found.append(Series(f"{name} {source}", inertial, *none, is_bias))
    return found


def _errors_on_the_true_flight(
    run: Run,
    errors: TriadErrors,
    ideal: IdealImu,
    temperature: FloatArray,
    truth: Truth,
) -> Iterator[tuple[str, FloatArray, bool]]:
    """Yield the errors `TERMS` of a triad on the true flight: name, increments, and whether it is a bias."""
    experiment, environment = run.experiment, imu.Environment(temperature, ideal.dvelocity)
    true = ideal.dtheta if isinstance(errors, imu.GyroErrors) else ideal.dvelocity
    for source, term in TERMS.items():
        compensated = experiment.sensors.temperature.compensation and source.startswith("temperature")
        is_state = term == "g_sensitivity" and GYRO_G in run.blocks
        if not _has_error(errors, term) or compensated or is_state:
            continue
        # A triad with this error alone, and so wide a range that nothing saturates.
        quiet = type(errors)(noise_density=0, bias_sigma=0, range=errors.param["range"].bounds[1])
        quiet.set(term, getattr(errors, term))
        alone = imu.measure(true, ideal.dt, quiet, _NONE, environment).increments - true
        is_bias = bool(imu.induced_bias(quiet, environment, ideal.dt).any())
        if isinstance(errors, imu.GyroErrors) and is_bias and experiment.navigator.alignment:
            # An alignment removed the part present at rest.
            before = imu.Environment(environment.temperature[:1], _at_rest(truth))
            alone = alone - imu.mean_at_rest(quiet, _NONE, np.zeros(3), before) * ideal.dt
        yield source, alone, is_bias


def _errors_with_noise(
    experiment: ExperimentSettings,
    name: str,
    errors: TriadErrors,
    saturated: bool,
    ideal: IdealImu,
    temperature: FloatArray,
) -> Iterator[tuple[str, FloatArray, bool]]:
    """Yield the errors of a triad that depend on its noise, likewise: of range and quantisation."""
    coarse = any(errors.quantisation) and not rounding(errors, ideal.dt).any()
    if not (coarse or saturated):
        return
    dvelocity = imu.with_vibration(
        experiment.sensors.accelerometer, experiment.seed, ideal.dvelocity, ideal.dt
    )
    true = ideal.dtheta if isinstance(errors, imu.GyroErrors) else dvelocity
    draws = imu.ImuDraws.of(
        experiment.seed,
        name,
        true.shape[0],
        instability=any(errors.instability),
        flicker=any(errors.flicker),
        walk=any(errors.rate_random_walk),
    )

    def simulate_errors(**changes: float) -> FloatArray:
        changed = errors.copy()
        for term, value in changes.items():
            changed.set(term, value)
        return imu.measure(true, ideal.dt, changed, draws, imu.Environment(temperature, dvelocity)).increments

    as_it_was = simulate_errors()
    if saturated:
        yield "range", as_it_was - simulate_errors(range=errors.param["range"].bounds[1]), False
    if coarse:
        yield "quantisation", as_it_was - simulate_errors(quantisation=0.0), False


def _has_error(errors: TriadErrors, term: str) -> bool:
    """Return whether the sensors of a triad have an error; not every error is one of both triads."""
    return term in errors.param and any(getattr(errors, term))


def _at_rest(truth: Truth) -> FloatArray:
    """Return the specific force (1, 3) of an IMU at rest in its first attitude [m/s²]."""
    into_b = Rotation.from_quat(truth.q_nb[0], scalar_first=True).inv()
    gravity = float(earth.gravity(np.sin(truth.latitude[0]), truth.height[0]))
    return np.asarray(into_b.apply([[0.0, 0.0, -gravity]]))


_NONE = imu.ImuDraws(*(np.zeros(3),) * 3, *(np.zeros((0, 3)),) * 3, np.zeros((1, 3)))
"""Draws of a triad without random errors."""


def _of_fixes(run: Run) -> list[Series]:
    """Return the errors of the fixes due to latency and lever arm, for which the filter has no states."""
    errors, fixes, navigator = run.experiment.sensors.gps, run.fixes, run.experiment.navigator
    latency, assumed = float(errors.latency), si(errors, "lever_arm")
    if LATENCY not in run.blocks:
        latency = assumed_latency(navigator, latency)
    if LEVER_ARM not in run.blocks:
        assumed = assumed_lever_arm(navigator, assumed)
    is_assumed = latency == errors.latency and np.array_equal(assumed, si(errors, "lever_arm"))
    if not fixes.time.size or is_assumed:
        return []
    # Fixes in outages were drawn too, so that a fix has the draw of its number.
    number = np.round(fixes.time / errors.period).astype(np.int64)
    times = errors.period * np.arange(1.0, number[-1] + 1)
    position, velocity = gps.noise(times, errors, gps.GpsDraws.of(run.experiment.seed, times.size))
    moved = np.concatenate(
        [
            east_north_up(error - noise[number - 1])
            for error, noise in ((fixes.position_error, position), (fixes.velocity_error, velocity))
        ],
        axis=1,
    )
    no_inertial, no_aids = np.zeros((run.time.size - 1, 6)), np.zeros(run.aids.time.size)
    # What latency and lever arm did, less what the filter allows for.
    moved = (
        moved - _displacement_at(run, fixes.time - latency) - _lever_arm(run, fixes.time - latency, assumed)
    )
    arm = _lever_arm(run, fixes.time - errors.latency, si(errors, "lever_arm") - assumed)
    parts = {"GPS lever arm": arm, "GPS latency": moved - arm}
    apart = {"GPS lever arm": bool(arm.any()), "GPS latency": latency != errors.latency}
    return [Series(name, no_inertial, part, no_aids) for name, part in parts.items() if apart[name]]


def _of_aids(run: Run) -> list[Series]:
    """Return the errors of measurements besides GPS that flight and settings determine.

    A condition measures zero, so its error is minus the true speed. That of a magnetometer is the difference
    of the declinations.
    """
    time, kind, value = run.aids.time, run.aids.kind, run.aids.value
    if not time.size:
        return []
    truth, ideal = run.true_flight("budget")
    at = np.clip(np.round((time - run.time[0]) / ideal.dt).astype(np.int64), 1, ideal.dtheta.shape[0])
    C_nb = C_nb_from_euler(truth.taken(at).euler)
    velocity = truth.velocity_n[at].astype(np.float64)
    rate = ideal.dtheta[at - 1].astype(np.float64) / ideal.dt
    of_place = np.einsum("aij,ai->aj", C_nb, velocity) + np.cross(rate, run.aids.place)
    slip, motion, declination = np.zeros((3, time.size))
    for errors, first, speeds in ((slip, FORWARD, of_place), (motion, NORTHWARD, velocity)):
        for axis in range(3):
            those = kind == first + axis
            # Forward, the value is a reading with errors of its own; the others assume zero.
            if first + axis != FORWARD:
                errors[those] = value[those] - speeds[those, axis]
    magnetic = kind == MAGNETIC
    if magnetic.any():
        declination[magnetic] = wrap(value[magnetic] - run.readings["heading"].value)
    found = {
        "vehicle slip": slip,
        "vehicle motion at rest": motion,
        "heading sensor declination": declination,
    }
    no_inertial, no_fixes = np.zeros((run.time.size - 1, 6)), np.zeros((run.fixes.time.size, 6))
    return [Series(name, no_inertial, no_fixes, errors) for name, errors in found.items()]


def _displacement_at(run: Run, times: FloatArray) -> FloatArray:
    """Return displacement and velocity change of the IMU at some times (m,) relative to the time stamps."""
    truth, _ = run.true_flight("budget")
    now, then = (_interpolate_motion(truth, at) for at in (run.fixes.time, times))
    C_en = ecef.axes(*ecef.geodetic(now[:, :3]).T[:2])
    changes = (then - now).reshape(-1, 2, 3)
    return np.asarray((changes @ C_en).reshape(-1, 6))


def _interpolate_motion(truth: Truth, times: FloatArray) -> FloatArray:
    """Return position and velocity (m, 6) in e at some times, linearly interpolated."""
    truth = truth.around(times)
    C_en = ecef.axes(truth.latitude, truth.longitude)
    velocity = np.einsum("nij,nj->ni", C_en, truth.velocity_n)
    motion = np.concatenate((ecef.position(truth.position), velocity), axis=1)
    return interpolate_columns(times, truth.time, motion)


def _lever_arm(run: Run, times: FloatArray, arm: FloatArray) -> FloatArray:
    """Return displacement and velocity (m, 6) of an antenna relative to the IMU at some times (m,)."""
    truth, ideal = run.true_flight("budget")
    at = np.clip(np.round(times / ideal.dt).astype(np.int64), 1, ideal.dtheta.shape[0])
    C_nb = C_nb_from_euler(truth.taken(at).euler)
    sine, cosine = np.sin(truth.latitude[at]), np.cos(truth.latitude[at])
    omega_ie_n = earth.RATE * np.stack((cosine, np.zeros_like(sine), -sine), axis=-1)
    # The antenna moves relative to the Earth with ω_eb, while gyros measure ω_ib.
    omega_eb_b = ideal.dtheta[at - 1].astype(np.float64) / ideal.dt - np.einsum(
        "mij,mi->mj", C_nb, omega_ie_n
    )
    return np.concatenate((C_nb @ arm, np.einsum("mij,mj->mi", C_nb, np.cross(omega_eb_b, arm))), axis=1)
