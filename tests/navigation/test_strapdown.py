"""The strapdown against closed forms, with hand-made increments."""

from __future__ import annotations

import numpy as np
import pytest
from motions import (
    earth_rate_n,
    increments,
    offset,
    resting_imu,
    start,
    steady,
    turned,
    unaided,
)
from scipy.spatial.transform import Rotation
from scipy.special import j1

from lab.base.arrays import FloatArray
from lab.motion.frames import earth
from lab.motion.frames.rotation import euler_from_quaternion
from lab.navigation import strapdown
from lab.navigation.kernels.generation import interpret_kernel
from lab.navigation.navigator import Imu

LATITUDES = np.radians([-89.8, -60.0, -33.9, 0.0, 30.0, 45.5, 80.0, 89.8])
TILTED = Rotation.from_euler("ZYX", [2.5, -0.2, 0.3])
RADIUS = earth.SEMI_MAJOR_AXIS


@pytest.mark.parametrize("latitude", LATITUDES)
def test_what_rests_stays_at_rest(latitude: float) -> None:
    begin = start(latitude, TILTED)
    still = unaided(resting_imu(np.arange(0, 60.005, 0.005), latitude, TILTED), begin)
    # 12 000 steps, each rounding the attitude to 1e-16 rad and the position to 1e-9 m.
    np.testing.assert_allclose(turned(still, TILTED), 0, atol=2e-12)
    np.testing.assert_allclose(still.velocity_n, 0, atol=1e-9)
    np.testing.assert_allclose(offset(still, begin), 0, atol=1e-7)


@pytest.mark.parametrize("latitude", LATITUDES[1:-1])
def test_free_fall_drifts_east(latitude: float) -> None:
    time = np.arange(0, 10.0005, 0.001)
    begin = start(latitude, height=2000.0)
    fall = unaided(increments(time, steady([0, 0, 0]), steady([0, 0, 0])), begin)
    _, east, down = offset(fall, begin)[-1]
    g = earth.gravity(np.sin(latitude), 2000.0)
    # Gravity grows on the way down: ḧ = g + k² z.
    k = np.sqrt(2 * g / RADIUS)
    assert down == pytest.approx(g / k**2 * (np.cosh(10 * k) - 1), rel=1e-5)
    assert fall.velocity_n[-1, 2] == pytest.approx(g / k * np.sinh(10 * k), rel=1e-5)
    assert east == pytest.approx(earth.RATE * g * np.cos(latitude) * 10**3 / 3, rel=1e-3)


@pytest.mark.parametrize("latitude", LATITUDES[1:-1])
@pytest.mark.parametrize("attitude", [TILTED, Rotation.identity()], ids=["tilted", "level"])
def test_a_body_held_in_inertial_space_turns_against_the_earth(latitude: float, attitude: Rotation) -> None:
    time, omega_n = np.arange(0, 600.05, 0.1), earth_rate_n(latitude)
    g = earth.gravity(np.sin(latitude), 300.0)

    def f_b(t: FloatArray) -> FloatArray:
        return (Rotation.from_rotvec(np.outer(-t, omega_n)) * attitude).apply([0, 0, -g], inverse=True)

    drift = unaided(increments(time, steady([0, 0, 0]), f_b), start(latitude, attitude))
    expected = Rotation.from_rotvec(np.outer(-time, omega_n)) * attitude
    np.testing.assert_allclose(turned(drift, expected), 0, atol=3e-10)
    np.testing.assert_allclose(drift.velocity_n, 0, atol=1e-6)
    # The heading drifts at ω_ie sin L: to the right in the north, on the equator not at all.
    heading = euler_from_quaternion(drift.q_nb[[0, 100]])[:, 2]
    if attitude is not TILTED:
        assert heading[1] - heading[0] == pytest.approx(earth.RATE * np.sin(latitude) * time[100], abs=3e-7)


@pytest.mark.parametrize("latitude", LATITUDES)
@pytest.mark.parametrize("speed", [-250.0, 250.0])
def test_flight_along_a_parallel(latitude: float, speed: float) -> None:
    """Level flight due east or west is steady: Coriolis and transport rate hold it there."""
    time, height = np.arange(0, 60.005, 0.005), 9000.0
    radius = (earth.radii(float(np.sin(latitude)))[1] + height) * np.cos(latitude)
    rate = earth.RATE + speed / radius
    omega_n = rate * np.array([np.cos(latitude), 0, -np.sin(latitude)])
    # Centripetal acceleration of the circle in space; gravity already holds the Earth's own centrifugal part.
    f_n = (rate**2 - earth.RATE**2) * radius * np.array([np.sin(latitude), 0, np.cos(latitude)])
    f_n[2] -= earth.gravity(np.sin(latitude), height)
    imu = increments(time, *(steady(TILTED.apply(x, inverse=True)) for x in (omega_n, f_n)))
    # Close to a pole this crosses the date line, from either side.
    begin = start(latitude, TILTED, [0, speed, 0], longitude=np.copysign(3.1, speed), height=height)
    flight = unaided(imu, begin)
    way = offset(flight, begin)
    assert np.abs(flight.position[:, 1]).max() <= np.pi
    if abs(latitude) > np.radians(89):
        assert flight.position[-1, 1] == pytest.approx(-begin.position[1], abs=1.0)
    np.testing.assert_allclose(flight.velocity_n, np.tile([0, speed, 0], (time.size, 1)), atol=1e-6)
    np.testing.assert_allclose(way[:, [0, 2]], 0, atol=2e-5)
    expected = np.angle(np.exp(1j * speed * time / radius)) * radius
    np.testing.assert_allclose(way[:, 1], expected, atol=2e-5)
    np.testing.assert_allclose(turned(flight, TILTED), 0, atol=1e-9)


@pytest.mark.parametrize("height", [0.0, 10000.0])
def test_schuler_oscillation_of_a_velocity_error(height: float) -> None:
    time = np.arange(0, 5600.0, 1.0)
    begin = start(0.0, velocity_n=[0.01, 0, 0], height=height)
    found = unaided(resting_imu(time, 0.0, Rotation.identity(), height), begin)
    radius = earth.radii(0.0)[0] + height
    schuler = np.sqrt(earth.gravity(0.0, height) / radius)
    if height == 0:
        assert 2 * np.pi / schuler / 60 == pytest.approx(84.4, abs=0.2)
    np.testing.assert_allclose(found.velocity_n[:, 0], 0.01 * np.cos(schuler * time), atol=3e-6)
    latitude = 0.01 / (radius * schuler) * np.sin(schuler * time)
    np.testing.assert_allclose(offset(found, begin)[:, 0], latitude * radius, atol=0.003)
    np.testing.assert_allclose(turned(found, Rotation.identity())[:, 1], -latitude, atol=5e-10)


def test_schuler_oscillation_of_a_tilt() -> None:
    """On the equator a tilt about east swings with the Schuler frequency and turns the heading by ω_ie."""
    tilt, time = 1e-5, np.arange(0, 5200.0, 1.0)
    radius = earth.radii(0.0)[0] + 300.0
    schuler = np.sqrt(earth.gravity(0.0, 300.0) / radius)
    tilted = Rotation.from_rotvec([0, -tilt, 0])
    found = unaided(resting_imu(time, 0.0, Rotation.identity()), start(0.0, tilted))
    # φ̇_E = −v_N / R + ω_ie φ_D, φ̇_D = −ω_ie (φ_E + δL), v̇_N = g φ_E, δL̇ = v_N / R.
    bend = -tilt * earth.RATE**2 / (schuler**2 - earth.RATE**2)
    phi_east = (tilt - bend) * np.cos(schuler * time) + bend * np.cos(earth.RATE * time)
    velocity = (tilt - bend) * np.sin(schuler * time) / schuler
    velocity += bend * np.sin(earth.RATE * time) / earth.RATE
    phi = turned(found, Rotation.identity())
    np.testing.assert_allclose(phi[:, 1], phi_east, atol=1e-3 * tilt)
    np.testing.assert_allclose(phi[:, 2], -tilt * np.sin(earth.RATE * time), atol=1e-3 * tilt)
    np.testing.assert_allclose(
        found.velocity_n[:, 0], velocity * schuler**2 * radius, atol=1e-3 * schuler * radius * tilt
    )


def test_a_gyro_bias_swings_the_velocity_and_drives_the_position_away() -> None:
    bias, time = 1e-9, np.arange(0, 1500.0, 0.5)
    imu = resting_imu(time, 0.0, Rotation.identity())
    begin = start(0.0)
    found = unaided(imu._replace(dtheta=imu.dtheta - [0, bias * 0.5, 0]), begin)
    radius = earth.radii(0.0)[0] + 300.0
    schuler = np.sqrt(earth.gravity(0.0, 300.0) / radius)
    # A rate too small about east lets the computed frame turn about east: φ̇_E = bias.
    velocity = bias * radius * (1 - np.cos(schuler * time))
    way = bias * radius * (time - np.sin(schuler * time) / schuler)
    np.testing.assert_allclose(found.velocity_n[:, 0], velocity, atol=5e-3 * bias * radius)
    np.testing.assert_allclose(offset(found, begin)[:, 0], way, atol=5e-3 * abs(way[-1]))


@pytest.mark.parametrize("latitude", LATITUDES[1:-1])
def test_the_height_channel_runs_away(latitude: float) -> None:
    """An error of height grows as cosh(√(2g/R) t), for nothing but height itself feels it."""
    time = np.arange(0, 1800.5, 0.5)
    begin = start(latitude)
    imu = resting_imu(time, latitude, Rotation.identity(), height=299.0)
    height = unaided(imu, begin).position[:, 2] - 299.0
    rate = np.sqrt(2 * earth.gravity(np.sin(latitude), 300.0) / RADIUS)
    assert height[-1] > 10
    np.testing.assert_allclose(height, np.cosh(rate * time), rtol=0.03)


def residual(x: float) -> float:
    """Return what the compensation leaves of coning and sculling of unit size in a step through the phase x.

    True is (x − sin x) / 2, of which the cross product with the sample before takes sin²(x/2) sin(x) / 3; the
    difference is x⁵/60 to first order.
    """
    return 0.5 * (x - np.sin(x)) - np.sin(x / 2) ** 2 * np.sin(x) / 3


@pytest.mark.parametrize("frequency", [5.0, 10.0, 20.0])
def test_coning_drifts_as_the_algorithm_must(frequency: float) -> None:
    cone, latitude, dt = np.radians(1.0), -0.6, 0.005
    omega, s, c = 2 * np.pi * frequency, np.sin(cone / 2), np.cos(cone / 2)
    time = np.arange(0, 40.0, dt)
    g = earth.gravity(np.sin(latitude), 300.0)

    def attitude(t: FloatArray) -> Rotation:
        p = omega * t
        q_nb = np.stack((np.full_like(t, c), s * np.cos(p), s * np.sin(p), np.zeros_like(t)), axis=-1)
        return Rotation.from_quat(q_nb, scalar_first=True)

    def rate(t: FloatArray) -> FloatArray:
        p = omega * t
        cone_b = np.stack(
            (-np.sin(cone) * np.sin(p), np.sin(cone) * np.cos(p), np.full_like(t, -2 * s * s)), axis=-1
        )
        return omega * cone_b + attitude(t).apply(earth_rate_n(latitude), inverse=True)

    imu = increments(time, rate, lambda t: attitude(t).apply([0, 0, -g], inverse=True))
    phi = turned(unaided(imu, start(latitude, attitude(time[:1])[0])), attitude(time))
    # Mean over whole turns of the cone, at the beginning and at the end.
    turn = round(1 / frequency / dt)
    drift = (phi[-turn:, 2].mean() - phi[turn : 2 * turn, 2].mean()) / (time[-1] - time[2 * turn - 1])
    expected = np.sin(cone) ** 2 * residual(omega * dt) / dt
    uncompensated = np.sin(cone) ** 2 * 0.5 * (omega * dt - np.sin(omega * dt)) / dt
    print(
        f"\nconing {frequency:g} Hz: {drift:.4e} rad/s, closed form {expected:.4e}, bare {uncompensated:.4e}"
    )
    assert drift == pytest.approx(expected, rel=0.03)
    assert drift < 0.2 * uncompensated


@pytest.mark.parametrize("frequency", [5.0, 10.0, 20.0])
def test_sculling_drifts_as_the_algorithm_must(frequency: float) -> None:
    swing, push, latitude, dt = np.radians(1.0), 20.0, 0.7, 0.005
    omega = 2 * np.pi * frequency
    time = np.arange(0, 20.0, dt)
    g = earth.gravity(np.sin(latitude), 300.0)

    def attitude(t: FloatArray) -> Rotation:
        return Rotation.from_rotvec(np.outer(swing * np.sin(omega * t), [1, 0, 0]))

    def rate(t: FloatArray) -> FloatArray:
        roll_rate = np.outer(swing * omega * np.cos(omega * t), [1, 0, 0])
        return roll_rate + attitude(t).apply(earth_rate_n(latitude), inverse=True)

    def force(t: FloatArray) -> FloatArray:
        return attitude(t).apply([0, 0, -g], inverse=True) + np.outer(push * np.sin(omega * t), [0, 1, 0])

    # Starting with the velocity that has no mean over a swing, for the Eötvös effect of one would show.
    begin = start(latitude, velocity_n=[0, -push / omega, 0])
    down = unaided(increments(time, rate, force), begin).velocity_n[:, 2]
    turn = round(1 / frequency / dt)
    seconds = time[-1] - time[turn - 1]
    gained = (down[-turn:].mean() - down[:turn].mean()) / seconds
    # The mean of push sin(p) sin(swing sin(p)) is push J₁(swing); on the way down gravity grows.
    growth = 1 + (seconds**2) * earth.gravity(np.sin(latitude), 300.0) / RADIUS / 3
    missed = push * swing / omega * residual(omega * dt) / dt
    bare = push * swing / omega * 0.5 * (omega * dt - np.sin(omega * dt)) / dt
    error = gained / growth - push * j1(swing)
    print(f"\nsculling {frequency:g} Hz: {error:.4e} m/s², closed form {-missed:.4e}, bare {-bare:.4e}")
    assert error == pytest.approx(-missed, rel=0.05, abs=2e-6)
    assert abs(error) < 0.2 * bare


@pytest.mark.parametrize("latitude", LATITUDES[1:-1])
@pytest.mark.parametrize("north", [-300.0, 300.0])
def test_a_course_that_is_kept_is_a_loxodrome(latitude: float, north: float) -> None:
    """Within a step the latitude changes too: λ = v_E / v_N times the difference of artanh sin L."""
    state = np.zeros(strapdown.LENGTH)
    interpret_kernel(strapdown.set_position)(state, latitude, 0.1, 300.0)
    state[strapdown.MERIDIAN], state[strapdown.TRANSVERSE] = 1 / 6.3e6, 1 / 6.4e6
    interpret_kernel(strapdown.move)(state, (north, 200.0, -5.0), 10.0)
    there = latitude + 10 * north / 6.3e6
    way = (np.arctanh(np.sin(there)) - np.arctanh(np.sin(latitude))) * 200 / 6.4e6 * 6.3e6 / north
    # Of third order in a turn of 0.5 mrad.
    assert state[strapdown.LONGITUDE] - 0.1 == pytest.approx(way, rel=3e-6)
    found = state[[strapdown.LATITUDE, strapdown.HEIGHT, strapdown.SINE, strapdown.COSINE]]
    np.testing.assert_allclose(found, (there, 350.0, np.sin(there), np.cos(there)), atol=1e-9)


def northward(latitude: float, seconds: float, dt: float = 0.01) -> Imu:
    """Return the increments of a level body driven due north at 100 m/s close to a pole."""
    time = np.arange(0, seconds, dt)
    radius = earth.radii(float(np.sin(latitude)))[0] + 300.0
    g = earth.gravity(np.sin(latitude), 300.0)
    transport = np.array([0, -100 / radius, 0])
    omega = earth_rate_n(latitude) + transport
    coriolis = np.cross(omega + earth_rate_n(latitude), [100, 0, 0])
    return increments(time, steady(omega), steady(coriolis - [0, 0, g]))


def test_northward_over_a_limit_of_the_frame() -> None:
    """Due north at 100 m/s on a meridian, from the north-slaved frame into the other one."""
    latitude = np.radians(89.0 - 5e-3)  # 560 m before it
    solution = unaided(northward(latitude, 20), start(latitude, velocity_n=[100, 0, 0]))
    radius = earth.radii(float(np.sin(latitude)))[0] + 300.0
    np.testing.assert_allclose(solution.position[-1, 0], latitude + 1999 / radius, atol=1 / radius)
    np.testing.assert_allclose(solution.velocity_n[-1], [100, 0, 0], atol=0.01)
