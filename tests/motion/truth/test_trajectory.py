"""The trajectory against closed forms, inertial differences, quadrature and an independent strapdown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pyins_reference
import pymap3d
import pytest
from scipy.integrate import quad_vec, solve_ivp
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.missions import mission
from lab.motion.frames import earth, rotation
from lab.motion.recordings.recording import Recording
from lab.motion.truth.trajectory import AttitudeKind, Trajectory, Truth

LATITUDES = np.radians([-70.0, -33.9, 0.0, 45.5, 80.0])
REGULAR = np.arange(0, 205.05, 0.055)


def irregular(step: float, seed: int = 3) -> FloatArray:
    """Return time stamps that stray a third of a step from a regular grid, not beginning at zero."""
    time = 1000 + np.arange(0, 205.0, step)
    time[1:-1] += np.random.default_rng(seed).uniform(-step / 3, step / 3, len(time) - 2)
    return time


class Flight:
    """A flight in closed form: coordinates and Euler angles are sums of sines with known derivatives."""

    def __init__(self, latitude: float = 0.79, longitude: float = -1.3) -> None:
        self.latitude, self.longitude = latitude, longitude

    def position(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return latitude, longitude [rad], height [m]."""
        latitude = self.latitude + 1.2e-4 * np.sin(0.05 * t)
        longitude = self.longitude + 1.7e-4 * (1 - np.cos(0.05 * t))
        return latitude, longitude, 400 + 3 * t + 20 * np.sin(0.1 * t)

    def velocity_n(self, t: FloatArray) -> FloatArray:
        """Return the velocity [m/s], with pymap3d's radii."""
        latitude, _, height = self.position(t)
        meridian = pymap3d.rcurve.meridian(latitude, deg=False)
        transverse = pymap3d.rcurve.transverse(latitude, deg=False)
        north = 1.2e-4 * 0.05 * np.cos(0.05 * t) * (meridian + height)
        east = 1.7e-4 * 0.05 * np.sin(0.05 * t) * (transverse + height) * np.cos(latitude)
        return np.stack((north, east, -3 - 2 * np.cos(0.1 * t)), axis=-1)

    def euler(self, t: FloatArray) -> FloatArray:
        """Return roll, pitch and a yaw that turns past ±180° [rad]."""
        return np.stack((0.3 * np.sin(0.2 * t), 0.1 * np.sin(0.3 * t), rotation.wrap(0.05 * t)), axis=-1)

    def recording(self, time: FloatArray) -> Recording:
        """Return what a recorder writes at the given stamps."""
        t = time - time[0]
        latitude, longitude, height = self.position(t)
        return Recording(time, latitude, rotation.wrap(longitude), height, self.velocity_n(t), self.euler(t))


def resting(latitude: float, euler: FloatArray, time: FloatArray) -> Recording:
    """Return the record of a vehicle at rest."""
    n = len(time)
    return Recording(
        time,
        np.full(n, latitude),
        np.full(n, 2.0),
        np.full(n, 300.0),
        np.zeros((n, 3)),
        np.broadcast_to(euler, (n, 3)).copy(),
    )


def body(euler: FloatArray, v_n: FloatArray) -> FloatArray:
    """Resolve navigation-frame vectors in the body frame, by SciPy."""
    return Rotation.from_euler("ZYX", euler[..., ::-1]).apply(v_n, inverse=True)


def earth_rate_n(latitude: float | FloatArray) -> FloatArray:
    """Return the rate of the Earth, north, east, down."""
    latitude = np.asarray(latitude)
    return earth.RATE * np.stack((np.cos(latitude), 0 * latitude, -np.sin(latitude)), axis=-1)


@pytest.mark.parametrize("latitude", LATITUDES)
@pytest.mark.parametrize("curve", ["rotation", "euler"])
def test_at_rest_the_imu_feels_minus_gravity_and_the_earth_rate(latitude: float, curve: AttitudeKind) -> None:
    euler = np.array([0.3, -0.2, 2.5])
    trajectory = Trajectory.from_recording(resting(latitude, euler, np.arange(0, 5, 0.055)), 200, curve)
    omega_ib_b, f_b = trajectory.rates(np.linspace(0, trajectory.duration, 50))
    g = earth.gravity(np.sin(latitude), 300.0)
    np.testing.assert_allclose(f_b, np.tile(body(euler, np.array([0, 0, -g])), (50, 1)), atol=1e-9)
    np.testing.assert_allclose(omega_ib_b, np.tile(body(euler, earth_rate_n(latitude)), (50, 1)), atol=1e-12)


@pytest.mark.parametrize("latitude", LATITUDES)
def test_flight_along_a_parallel_is_a_circle_about_the_axis_of_the_earth(latitude: float) -> None:
    time = np.arange(0, 60, 0.055)
    height, speed, euler = 2000.0, 150.0, np.array([0.1, 0.05, 1.4])
    radius = (pymap3d.rcurve.transverse(latitude, deg=False) + height) * np.cos(latitude)
    n = len(time)
    recording = Recording(
        time,
        np.full(n, latitude),
        0.5 + speed / radius * time,
        np.full(n, height),
        np.tile([0, speed, 0.0], (n, 1)),
        np.tile(euler, (n, 1)),
    )
    omega_ib_b, f_b = Trajectory.from_recording(recording).rates(np.linspace(0, 59, 40))
    rate = earth.RATE + speed / radius
    to_axis = np.array([np.sin(latitude), 0, np.cos(latitude)])
    # Centripetal acceleration of the inertial circle, minus gravitation; gravity holds the Earth's own
    # centrifugal part.
    f_n = (rate**2 - earth.RATE**2) * radius * to_axis
    f_n[2] -= earth.gravity(np.sin(latitude), height)
    omega_n = rate * np.array([np.cos(latitude), 0, -np.sin(latitude)])
    np.testing.assert_allclose(f_b, np.tile(body(euler, f_n), (40, 1)), atol=1e-6)
    np.testing.assert_allclose(omega_ib_b, np.tile(body(euler, omega_n), (40, 1)), atol=1e-12)


@pytest.mark.parametrize("latitude", LATITUDES)
def test_coordinated_turn(latitude: float) -> None:
    time, speed, turn, height = np.arange(0, 160, 0.05), 200.0, 0.03, 1000.0
    heading = turn * time
    velocity_n = speed * np.stack((np.cos(heading), np.sin(heading), 0 * time), axis=-1)

    def coordinates_rate(t: float, x: FloatArray) -> list[float]:
        meridian = pymap3d.rcurve.meridian(x[0], deg=False) + height
        transverse = pymap3d.rcurve.transverse(x[0], deg=False) + height
        return [speed * np.cos(turn * t) / meridian, speed * np.sin(turn * t) / transverse / np.cos(x[0])]

    start = [latitude, -2.0]
    lat, lon = solve_ivp(coordinates_rate, (0, 160), start, "DOP853", time, rtol=1e-13, atol=1e-15).y
    bank = np.arctan(speed * turn / earth.gravity(np.sin(latitude), height))
    euler = np.stack((np.full_like(time, bank), 0 * time, rotation.wrap(heading)), axis=-1)
    recording = Recording(time, lat, lon, np.full_like(time, height), velocity_n, euler)
    omega_ib_b, f_b = Trajectory.from_recording(recording).rates(time[50:-50])

    meridian = pymap3d.rcurve.meridian(lat, deg=False) + height
    transverse = pymap3d.rcurve.transverse(lat, deg=False) + height
    east = velocity_n[:, 1] / transverse
    omega_en_n = np.stack((east, -velocity_n[:, 0] / meridian, -east * np.tan(lat)), axis=-1)
    f_n = speed * turn * np.stack((-np.sin(heading), np.cos(heading), 0 * time), axis=-1)
    f_n += np.cross(2 * earth_rate_n(lat) + omega_en_n, velocity_n)
    f_n[:, 2] -= earth.gravity(np.sin(lat), np.full_like(lat, height))
    omega_nb_b = turn * np.array([0, np.sin(bank), np.cos(bank)])
    expected = omega_nb_b + body(euler, earth_rate_n(lat) + omega_en_n)
    np.testing.assert_allclose(f_b, body(euler, f_n)[50:-50], atol=2e-6)
    np.testing.assert_allclose(omega_ib_b, expected[50:-50], atol=1e-9)
    assert np.abs(f_b[:, 1]).max() < 0.05, "coordinated: the ball stays in the middle but for Coriolis"


def test_coning_motion() -> None:
    cone, frequency, latitude = np.radians(2.0), 2 * np.pi, -0.6
    time = np.arange(0, 10, 0.005)
    phase = frequency * time
    s, c = np.sin(cone / 2), np.cos(cone / 2)
    q_nb = np.stack((np.full_like(time, c), s * np.cos(phase), s * np.sin(phase), 0 * time), axis=-1)
    euler = Rotation.from_quat(q_nb, scalar_first=True).as_euler("ZYX")[:, ::-1]
    recording = resting(latitude, euler, time)
    imu = Trajectory.from_recording(recording).increments()

    # Body rate of the classical coning motion (Savage part 1, eq. 26): 2 q* q̇ of the quaternion above.
    def rate(t: float) -> FloatArray:
        p = frequency * t
        q = Rotation.from_quat([c, s * np.cos(p), s * np.sin(p), 0], scalar_first=True)
        cone_b = frequency * np.array([-np.sin(cone) * np.sin(p), np.sin(cone) * np.cos(p), -2 * s * s])
        return cone_b + q.apply(earth_rate_n(latitude), inverse=True)

    for k in (0, 1, 700, 1500, 1998):
        expected, _ = quad_vec(rate, imu.time[k], imu.time[k + 1], epsabs=1e-14)
        np.testing.assert_allclose(imu.dtheta[k], expected, atol=3e-8)
    drift = imu.dtheta[:1800, 2].sum() / imu.time[1800]
    assert drift == pytest.approx(-2 * s * s * frequency - earth.RATE * np.sin(latitude), abs=1e-6)


def inertial_inputs(truth: Callable[[FloatArray], Truth], t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ω_ib,b and f_b by differencing inertial positions and attitudes; the Earth by pymap3d."""
    step = 0.01

    def inertial(t: FloatArray) -> tuple[FloatArray, Rotation, Rotation, FloatArray]:
        now = truth(t)
        spin = Rotation.from_rotvec(np.outer(earth.RATE * t, [0, 0, 1]))
        ecef = np.stack(pymap3d.geodetic2ecef(now.latitude, now.longitude, now.height, deg=False), axis=-1)
        # NED to ECEF: turn by the longitude about z, then by −(90° + latitude) about the new y.
        C_en = Rotation.from_euler("ZY", np.stack((now.longitude, -np.pi / 2 - now.latitude), axis=-1))
        C_nb = Rotation.from_quat(now.q_nb, scalar_first=True)
        g = earth.gravity(np.sin(now.latitude), now.height)
        centrifugal = earth.RATE**2 * ecef * [1, 1, 0]
        gravitation = C_en.apply(np.outer(g, [0, 0, 1])) - centrifugal
        return spin.apply(ecef), spin * C_en * C_nb, spin, spin.apply(gravitation)

    before, now, after = (inertial(t + shift) for shift in (-step, 0, step))
    acceleration = (before[0] - 2 * now[0] + after[0]) / step**2
    omega_ib_b = (before[1].inv() * after[1]).as_rotvec() / (2 * step)
    return omega_ib_b, now[1].apply(acceleration - now[3], inverse=True)


@pytest.mark.parametrize("latitude", LATITUDES)
@pytest.mark.parametrize("curve", ["rotation", "euler"])
def test_rates_are_those_of_the_inertial_motion(latitude: float, curve: AttitudeKind) -> None:
    trajectory = Trajectory.from_recording(Flight(latitude).recording(REGULAR), 200, curve)
    t = np.linspace(1, 204, 300)
    omega_ib_b, f_b = trajectory.rates(t)
    omega_expected, f_expected = inertial_inputs(trajectory.at, t)
    # An ulp of 6 400 km over the squared step is 1e-5 m/s².
    np.testing.assert_allclose(f_b, f_expected, atol=1e-4)
    np.testing.assert_allclose(omega_ib_b, omega_expected, atol=2e-7)


@pytest.mark.proof
@pytest.mark.parametrize("latitude", LATITUDES)
def test_velocity_is_the_derivative_of_position(latitude: float) -> None:
    trajectory = Trajectory.from_recording(Flight(latitude).recording(REGULAR))
    t, step = np.linspace(1, 204, 300), 0.002
    truth, before, after = trajectory.at(t), trajectory.at(t - step), trajectory.at(t + step)
    origin = (truth.latitude, truth.longitude, truth.height)
    ahead, behind = (
        np.stack(pymap3d.geodetic2ned(x.latitude, x.longitude, x.height, *origin, deg=False), axis=-1)
        for x in (after, before)
    )
    np.testing.assert_allclose(truth.velocity_n, (ahead - behind) / (2 * step), atol=2e-6)


@pytest.mark.proof
@pytest.mark.parametrize("stamps", [REGULAR, np.arange(0, 205, 0.01), irregular(0.055), irregular(0.01)])
@pytest.mark.parametrize("imu_rate", [100.0, 128.0, 200.0])
def test_curve_is_the_flight_between_the_samples(stamps: FloatArray, imu_rate: float) -> None:
    flight = Flight()
    trajectory = Trajectory.from_recording(flight.recording(stamps), imu_rate)
    assert trajectory.duration * imu_rate == pytest.approx(round(trajectory.duration * imu_rate))
    assert 0 <= stamps[-1] - stamps[0] - trajectory.duration < 1 / imu_rate
    t = np.linspace(0, trajectory.duration, 1999)
    truth = trajectory.at(t)
    latitude, longitude, height = flight.position(t)
    east_of = earth.SEMI_MAJOR_AXIS * np.cos(latitude)
    np.testing.assert_allclose((truth.latitude - latitude) * earth.SEMI_MAJOR_AXIS, 0, atol=1e-3)
    np.testing.assert_allclose((truth.longitude - longitude) * east_of, 0, atol=1e-3)
    np.testing.assert_allclose(truth.height, height, atol=1e-3)
    np.testing.assert_allclose(truth.velocity_n, flight.velocity_n(t), atol=1e-3)
    np.testing.assert_allclose(rotation.wrap(truth.euler - flight.euler(t)), 0, atol=1e-6)


@pytest.mark.proof
def test_increments_are_integrals_of_the_rates() -> None:
    trajectory = Trajectory.from_recording(Flight(-0.6).recording(irregular(0.055)), 200)
    for rate in (50.0, 200.0, 600.0):
        imu = trajectory.increments(rate)
        assert imu.dt == pytest.approx(1 / rate)
        assert len(imu.time) == len(imu.dtheta) + 1 == len(imu.dvelocity) + 1
        for k in (0, 17, len(imu.dtheta) // 2, len(imu.dtheta) - 1):
            for which, found in enumerate((imu.dtheta, imu.dvelocity)):
                expected, _ = quad_vec(
                    lambda t, which=which: trajectory.rates(t)[which][0],
                    imu.time[k],
                    imu.time[k + 1],
                    epsabs=1e-13,
                    points=trajectory.time[
                        (trajectory.time > imu.time[k]) & (trajectory.time < imu.time[k + 1])
                    ],
                )
                np.testing.assert_allclose(found[k], expected, rtol=0, atol=1e-12)


def closure(trajectory: Trajectory) -> tuple[float, float]:
    """Return how far python-ins ends from the truth, at worst over the flight: [m], [deg]."""
    imu, truth = trajectory.increments(), trajectory.at(trajectory.time)
    expected = np.stack((truth.latitude, truth.longitude, truth.height), axis=-1)
    start = (expected[0], truth.velocity_n[0], truth.euler[0])
    found = pyins_reference.integrate(imu.time, imu.dtheta, imu.dvelocity, start)
    metres = found.position - expected
    metres[:, :2] = rotation.wrap(metres[:, :2]) * earth.SEMI_MAJOR_AXIS
    degrees = np.degrees(rotation.wrap(found.euler - truth.euler))
    return float(np.abs(metres).max()), float(np.abs(degrees).max())


def noisy(recording: Recording) -> Recording:
    """Return the record with 5 mm/s and 0.01° of noise, which bends the curve hard at every sample."""
    random, n = np.random.default_rng(5), len(recording.time)
    velocity_n = recording.velocity_n + random.normal(0, 5e-3, (n, 3))
    return replace(recording, velocity_n=velocity_n, euler=recording.euler + random.normal(0, 2e-4, (n, 3)))


FLIGHTS = {
    "montreal": lambda: mission("montreal").recording,
    "los_angeles": lambda: mission("los_angeles").recording,
    "10 ms": lambda: Flight().recording(np.arange(0, 205, 0.01)),
    "south": lambda: Flight(-0.9).recording(REGULAR),
    "irregular and noisy": lambda: noisy(Flight().recording(irregular(0.055))),
    "across the date line": lambda: Flight(longitude=np.pi - 1e-4).recording(REGULAR),
}


@pytest.mark.proof
@pytest.mark.parametrize("curve", ["rotation", "euler"])
@pytest.mark.parametrize("name", FLIGHTS)
def test_pyins_fed_with_the_increments_returns_to_the_truth(name: str, curve: AttitudeKind) -> None:
    trajectory = Trajectory.from_recording(FLIGHTS[name](), 200, curve)
    metres, degrees = closure(trajectory)
    assert metres < 5e-3
    assert degrees < 1e-6


@pytest.mark.proof
@pytest.mark.parametrize("imu_rate", [100.0, 128.0, 500.0])
def test_closure_improves_with_the_imu_rate(imu_rate: float) -> None:
    trajectory = Trajectory.from_recording(Flight().recording(irregular(0.055)), imu_rate)
    metres, degrees = closure(trajectory)
    # What is left is first of all pyins' own: it takes Coriolis at the start of each interval.
    assert metres < 5e-3 * 200 / imu_rate
    assert degrees < 1e-6


def test_positions_in_five_decimals_of_a_degree_do_not_shake_the_imu() -> None:
    exact = Flight().recording(REGULAR)
    latitude, longitude = (np.radians(np.round(np.degrees(x), 5)) for x in (exact.latitude, exact.longitude))
    coarse = Recording(exact.time, latitude, longitude, exact.height, exact.velocity_n, exact.euler)
    t = np.linspace(0, 205, 4001)
    smooth, shaken = (Trajectory.from_recording(r).rates(t)[1] for r in (exact, coarse))
    assert np.sqrt(np.mean((shaken - smooth) ** 2)) < 0.01
    assert Trajectory.from_recording(coarse).position_residual[0] == pytest.approx(
        np.radians(1e-5) * earth.SEMI_MAJOR_AXIS / np.sqrt(12), rel=0.1
    ), "the residual is the rounding of the fixes"


def test_drifting_velocity_is_held_by_the_fixes() -> None:
    exact = Flight().recording(REGULAR)
    drift = 0.2 + 0.3 * np.sin(2 * np.pi * REGULAR / 60)
    drifting = replace(exact, velocity_n=exact.velocity_n + drift[:, None])
    truth = Trajectory.from_recording(drifting).at(REGULAR[:-1])
    north = (truth.latitude - exact.latitude[:-1]) * earth.SEMI_MAJOR_AXIS
    assert np.abs(north).max() < 0.01
    np.testing.assert_allclose(truth.velocity_n, exact.velocity_n[:-1], atol=0.01)


def test_crossing_the_date_line_is_no_event() -> None:
    far, near = (
        Trajectory.from_recording(Flight(longitude=x).recording(REGULAR)) for x in (np.pi - 1e-4, 0.0)
    )
    longitude = far.at(far.time).longitude
    assert longitude.min() < -3 < 3 < longitude.max()
    np.testing.assert_allclose(far.increments().dvelocity, near.increments().dvelocity, atol=1e-8)


@pytest.mark.parametrize("times", [[-0.1], [205.1], [float("nan")], [1.0, 1e9]])
def test_times_outside_the_flight_are_refused(times: list[float]) -> None:
    trajectory = Trajectory.from_recording(Flight().recording(REGULAR))
    with pytest.raises(ValueError, match="outside the flight; accepted: 0 to 20"):
        trajectory.at(times)


@pytest.mark.parametrize(
    ("recording", "settings", "message"),
    [
        (
            Flight(np.radians(89.95)).recording(REGULAR),
            {"attitude_curve": "euler"},
            "closer than 1° to a pole.*accepted here: rotation",
        ),
        (Flight().recording(REGULAR[:3]), {}, "3 samples; at least 4"),
        (Flight().recording(REGULAR), {"imu_rate": 0.0}, "positive and finite"),
        (Flight().recording(REGULAR), {"imu_rate": 0.01}, "at least 4 intervals"),
        (
            Flight().recording(REGULAR),
            {"attitude_curve": "linear"},
            "'linear' is unknown; accepted: rotation, euler",
        ),
    ],
)
def test_what_no_curve_can_be_made_of_is_refused(
    recording: Recording, settings: dict[str, object], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        Trajectory.from_recording(recording, **settings)


@pytest.mark.parametrize("rate", [0.0, -5.0, 150.0, float("nan")])
def test_increments_at_a_rate_off_the_grid_are_refused(rate: float) -> None:
    trajectory = Trajectory.from_recording(Flight().recording(REGULAR))
    with pytest.raises(ValueError, match="divisors and multiples"):
        trajectory.increments(rate)
