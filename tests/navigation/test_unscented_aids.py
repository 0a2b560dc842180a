"""The unscented filter with other sensors: its update in plain NumPy, the linear filter, and seeds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from aided_flights import flight
from motions import NO_FILTER
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.base.parameters.setting_error import SettingError
from lab.experiment.result import Result
from lab.motion.frames import ecef
from lab.motion.frames.rotation import wrap
from lab.navigation import aids, strapdown, wander
from lab.navigation.aids import Aids
from lab.navigation.checks import check_user_states
from lab.navigation.filters import blocks
from lab.navigation.filters.blocks import in_order
from lab.navigation.filters.north_slaved import north_axes, north_variance
from lab.navigation.filters.schedule import Schedule
from lab.navigation.filters.unscented_aids import observe_aid
from lab.navigation.filters.unscented_filter import UnscentedFilter
from lab.navigation.frames import keep_radii
from lab.navigation.kernels.generation import Variant, interpret_kernel
from lab.navigation.kernels.lane_views import numbers, plain_numbers
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import Solution, Start

NAMES = in_order((blocks.BAROMETER_BIAS, blocks.HEADING_BIAS, blocks.ODOMETER_SCALE, *blocks.DRIFTS))
STATES = blocks.count(NAMES)
AGE, DT = 0.007, 0.01
FIELD, PLACE = np.array([0.3, -0.2, 0.9]), np.array([-1.2, 0.3, 0.5])
VALUES = (995.0, 30.0, 1.0, -2.0, 20.0, 15.0, 1.0, 0.7, -0.4)
"""A measured value of each kind."""


def filter_at(latitude: float, seed: int, kind: int) -> UnscentedFilter:
    """Return a filter with a random covariance, a heading uncertain by 20°, and one measurement."""
    rng = np.random.default_rng(seed)
    one = Aids(np.zeros(1), np.array([kind]), np.array(VALUES)[[kind]], np.array([0.01]), FIELD[None], PLACE)
    attitude = Rotation.from_euler("ZYX", [0.5, 0.2, -0.3]).as_quat(scalar_first=True)
    begin = Start(np.array([latitude, 0.4, 1000.0]), np.array([30.0, -40.0, 5.0]), attitude)
    run = UnscentedFilter.begin(begin, NO_FILTER._replace(P0=np.eye(STATES)), names=NAMES, aids=one)
    sigma = np.concatenate((np.repeat([5.0, 2.0], 3), [0.1, 0.1, 0.35], np.full(STATES - 9, 1e-3)))
    root = sigma[:, None] * rng.normal(size=(STATES, STATES)) / np.sqrt(STATES)
    run.P[:] = root @ root.T
    state = run.state
    keep_radii(state)
    state[np.array(blocks.find_places(NAMES))] = rng.normal(0, 1e-3, STATES - 9)
    state[strapdown.PREVIOUS_VELOCITY :][:3] = state[strapdown.VELOCITY :][:3] + rng.normal(0, 0.1, 3)
    state[strapdown.PREVIOUS_DTHETA :][:3] = rng.normal(0, 0.002, 3)
    state[strapdown.PER_STEP] = 1 / DT
    return run


def predicted(run: UnscentedFilter, kind: int, x: FloatArray) -> float:
    """Return the measurement that the navigator minus an error x predicts, by Earth-fixed axes."""
    state, errors = run.state, dict(zip(blocks.find_places(NAMES), x[9:], strict=True))
    C_ew = Rotation.from_quat(state[wander.Q_EW :][:4], scalar_first=True).as_matrix()
    up = -C_ew[:, 2]
    here = np.array([np.arcsin(up[2]), np.arctan2(up[1], up[0]), state[strapdown.HEIGHT]])
    C_en = ecef.axes(here[:1], here[1:2])[0]
    there = ecef.displaced(here[None], (-C_en.T @ C_ew @ x[:3])[None])[0]
    v, before = state[strapdown.VELOCITY :][:3], state[strapdown.PREVIOUS_VELOCITY :][:3]
    then = ecef.displaced(here[None], (-C_en.T @ C_ew @ (x[:3] + AGE * (v - x[3:6])))[None])[0]
    C_ne = ecef.axes(then[:1], then[1:2])[0].T
    v_n = C_ne @ C_ew @ (v - AGE / DT * (v - before) - x[3:6])
    bias = np.array([errors[strapdown.GYRO_BIAS + i] + errors[strapdown.GYRO_DRIFT + i] for i in range(3)])
    rate = state[strapdown.PREVIOUS_DTHETA :][:3] / DT + bias
    C_wb = Rotation.from_rotvec(x[6:9]) * Rotation.from_quat(state[strapdown.Q_NB :][:4], scalar_first=True)
    C_nb = C_ne @ C_ew @ (C_wb * Rotation.from_rotvec(-AGE * rate)).as_matrix()

    def slow(at: int) -> float:
        return float(state[at] - errors[at])

    if kind == aids.HEIGHT:
        return float(there[2] + AGE * v_n[2] + slow(strapdown.BAROMETER_BIAS))
    if kind in (aids.HEADING, aids.MAGNETIC):
        axis = C_nb @ (FIELD if kind == aids.MAGNETIC else np.array([1.0, 0.0, 0.0]))
        return float(np.arctan2(axis[1], axis[0]) + slow(strapdown.HEADING_BIAS))
    if kind >= aids.NORTHWARD:
        return float(v_n[kind - aids.NORTHWARD])
    speed = float((C_nb.T @ v_n + np.cross(rate, PLACE))[kind - aids.FORWARD])
    return speed * (1 + slow(strapdown.ODOMETER_SCALE)) if kind == aids.FORWARD else speed


def products_of_tilts(run: UnscentedFilter, kind: int) -> float:
    """Return the variance of an azimuth that points on the axes of P do not show, (d² p / 2 l²)²."""
    if kind not in (aids.HEADING, aids.MAGNETIC):
        return 0.0
    attitude = Rotation.from_quat(run.state[strapdown.Q_NB :][:4], scalar_first=True)
    axis = attitude.apply(FIELD if kind == aids.MAGNETIC else np.array([1.0, 0.0, 0.0]))
    per_level = axis[2] ** 2 / (axis[0] ** 2 + axis[1] ** 2)
    return float((per_level * np.trace(run.P[6:8, 6:8]) / 2) ** 2)


@pytest.mark.parametrize("latitude", [45.0, 89.99], ids=["45°", "a kilometre from the pole"])
@pytest.mark.parametrize("kind", range(9), ids=lambda kind: aids.NAMES[kind])
def test_an_update_is_that_of_a_plain_unscented_filter(kind: int, latitude: float) -> None:
    run = filter_at(np.radians(latitude), 10 + kind, kind)
    order = np.r_[6:9, 0:6, 9:STATES]
    root = np.zeros((STATES, STATES))
    root[order] = np.linalg.cholesky(run.P[np.ix_(order, order)])
    x = np.concatenate((np.zeros((1, STATES)), np.sqrt(3) * root.T, -np.sqrt(3) * root.T))
    weights = np.r_[1 - STATES / 3, np.full(2 * STATES, 1 / 6)]
    z = np.array([predicted(run, kind, one) for one in x])
    if kind in (aids.HEADING, aids.MAGNETIC):
        z = z[0] + wrap(z - z[0])
    mean = weights @ z
    S = weights @ (z - mean) ** 2 + 0.01 + products_of_tilts(run, kind)
    gain = (weights * (z - mean)) @ -x / S
    nu = mean - VALUES[kind]  # the error of the navigator is what it says beyond the measurement
    if kind in (aids.HEADING, aids.MAGNETIC):
        nu = float(wrap(nu))
    before, P = run.state.copy(), run.P.copy()
    out = Solution.empty(2, 0, NAMES, aids=1)
    own = {
        north_axes: wander.north_axes_before,
        north_variance: wander.north_variance,
        numbers: plain_numbers,
    }
    update = interpret_kernel(observe_aid, Variant(own))
    assert update(run, 0, AGE, DT, Schedule(), out)
    assert out.aid_innovation[0] == pytest.approx(nu, rel=1e-5, abs=1e-6)
    assert out.aid_variance[0] == pytest.approx(S, rel=1e-5)
    estimate = gain * nu
    places = np.array(blocks.find_places(NAMES))
    sigma = np.sqrt(np.diag(P))
    found = np.concatenate(((before - run.state)[places], run.P[9:, 9:].ravel()))
    expected = np.concatenate((estimate[9:], (P - np.outer(gain, gain) * S)[9:, 9:].ravel()))
    scale = np.concatenate((sigma[9:], np.outer(sigma, sigma)[9:, 9:].ravel()))
    np.testing.assert_allclose(found / scale, expected / scale, atol=1e-5)
    C_ew, C_wb = (
        [Rotation.from_quat(one[at : at + 4], scalar_first=True) for one in (before, run.state)]
        for at in (wander.Q_EW, strapdown.Q_NB)
    )
    turned = C_ew[0].inv() * C_ew[1] * C_wb[1] * C_wb[0].inv()
    np.testing.assert_allclose(turned.as_rotvec(), estimate[6:9], atol=1e-5)
    np.testing.assert_allclose(run.P, run.P.T, atol=1e-12)


RATE = 25.0
"""Rate of the IMU [Hz]: measurements come once a second, at any rate."""
SENSORS: dict[str, Any] = {
    "sensors.barometer.fitted": True,
    "sensors.heading.fitted": True,
    "sensors.heading.drift_sigma": 0.5,
    "sensors.odometer.fitted": True,
    "sensors.odometer.lever_arm": (-1.2, 0.3, 0.5),
    "sensors.airspeed.fitted": True,
    "navigator.states": 21,
    **{
        f"navigator.estimate_{what}": True
        for what in ("misalignments", "g_sensitivity", "bias_drift", "gps_drift", "lever_arm", "latency")
    },
}
"""All sensors and all states."""
GOOD: dict[str, Any] = {
    "sensors.gyro.noise_density": 0.001,
    "sensors.gyro.bias_sigma": 0.001,
    "sensors.gyro.instability": 1.0,
    "sensors.accelerometer.noise_density": 35.0,
    "sensors.accelerometer.bias_sigma": 0.02,
    "sensors.accelerometer.instability": 0.02,
    "navigator.attitude_sigma": 0.05,
    "navigator.position_sigma": 0.1,
    "navigator.velocity_sigma": 0.01,
    "sensors.airspeed.wind_sigma": 0.3,
    "sensors.airspeed.wind_drift_sigma": 0.1,
}
"""Errors so small that the linear filter is right."""


def run(model: str, seed: int, settings: dict[str, Any]) -> Result:
    """Navigate los_angeles with a model."""
    own = {"trajectory.imu_rate": RATE, "navigator.model": model}
    return flight("los_angeles", seed, settings | own).run()


@pytest.mark.proof
def test_small_errors_are_the_linear_filters() -> None:
    one, other = (run(model, 1, SENSORS | GOOD).solution_arrays for model in ("nonlinear", "phi"))
    np.testing.assert_array_equal(one.aid_sample, other.aid_sample)
    assert (one.aid_sample >= 0).all()
    sigma = np.sqrt(other.aid_variance)
    assert np.abs((one.aid_innovation - other.aid_innovation) / sigma).max() < 0.05
    np.testing.assert_allclose(one.aid_variance, other.aid_variance, rtol=0.005)
    at = other.fix_sample
    uncertain = other.variance[-1] > 0
    ratio = np.sqrt(one.variance[at][:, uncertain] / other.variance[at][:, uncertain])
    apart = (one.further - other.further)[at] / np.sqrt(other.variance[at, 21:])
    print(
        f"\nnonlinear beside phi: further states {np.abs(apart).max():.3f} σ, σ {np.abs(ratio - 1).max():.4f}"
    )
    assert np.abs(apart).max() < 0.1
    np.testing.assert_allclose(ratio, 1, atol=0.02)  # the steps of the linear filter, 40 ms long, show


def test_states_of_a_user_are_refused() -> None:
    check_user_states(NavigatorSettings(model="phi", own_states="mine"))
    with pytest.raises(SettingError, match=r"navigator.own_states: .*the models phi, psi, invariant"):
        check_user_states(NavigatorSettings(model="nonlinear", own_states="mine"))
