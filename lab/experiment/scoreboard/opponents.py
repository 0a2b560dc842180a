"""Opponents: other programs that navigate the same increments and fixes, from the same start.

Each gets what our filter has: the increments, the fixes with their covariances, the start with its σ, and the
densities of noise and of the random walk of the biases. Everything else is that program's own default. They
are imported only here, when a row is computed.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lab.base.arrays import Flags, FloatArray, interpolate_columns, running_sums
from lab.motion.frames import ecef
from lab.motion.frames.rotation import euler_from_quaternion
from lab.navigation.log_navigation import UNKNOWN
from lab.navigation.solution import Fixes, Imu, Start
from lab.run.run import Run

_STEP = 0.1
"""Time over which python-ins propagates its covariance [s]: its default."""
_WARM = 50
"""Samples that python-ins navigates before its time is taken, so that it has compiled its loop."""
_SATELLITES = 8
"""Number of satellites that sidereon is told of each fix; it does not change its weight."""
_FROZEN = 1e-6
"""σ of the gyro biases of sidereon [rad/s], and their drive over a second: they stay what the start found.
If it estimates them, version 3.0.4 diverges within a minute, also at rest with perfect sensors."""
_ROUNDING = 1e-9  # of time stamps [s]
GYRO, ACCEL, GYRO_DRIVE, ACCEL_DRIVE = (slice(3 * at, 3 * at + 3) for at in range(4))
"""Places of the densities of noise, and of the drives of the biases, in `Belief.noise`."""


class Given(NamedTuple):
    """What every program is given.

    Attributes
    ----------
    imu : Imu
        The increments.
    fixes : Fixes
        The fixes, at their times of validity.
    R : (m, 6, 6) array
        Their covariances.
    lever_arm : (3,) array
        From the IMU to the antenna, in b [m].
    start : Start
        Position, velocity, attitude and gyro bias at the first sample.
    sigma : (15,) array
        σ of the start: position [m], velocity [m/s], attitude [rad] north, east, down; biases of gyros
        [rad/s] and accelerometers [m/s²].
    noise : (12,) array
        Densities, as in `Belief.noise`.
    correlation : (2,) array
        Correlation times of the biases [s]; infinite for random walks.
    """

    imu: Imu
    fixes: Fixes
    R: FloatArray
    lever_arm: FloatArray
    start: Start
    sigma: FloatArray
    noise: FloatArray
    correlation: FloatArray

    @classmethod
    def of(cls, run: Run) -> Given:
        """Return what the filter of a run was given."""
        assumed, fixes = run.belief, run.fixes
        count = fixes.time.size
        R = np.broadcast_to(assumed.R, (count, 6, 6)).copy()
        velocity = fixes.velocity_n
        # An unmeasured velocity has no weight.
        R[:, range(3, 6), range(3, 6)] += np.where(np.isnan(velocity), UNKNOWN**2, 0.0)
        if run.recorded is not None:
            start = run.recorded.alignment.start._replace(gyro_bias=run.recorded.alignment.gyro_bias)
        else:
            assert run.aligned is not None  # of a simulated run
            start = run.aligned.start
        with np.errstate(divide="ignore"):
            correlation = 1 / assumed.decay[[0, 3]]
        return cls(
            Imu(
                run.time,
                run.gyro.increments.astype(np.float64, copy=False),
                run.accelerometer.increments.astype(np.float64, copy=False),
            ),
            Fixes(run.fix_validity, fixes.position, np.nan_to_num(velocity)),
            R,
            assumed.lever_arm,
            start,
            np.sqrt(np.diag(assumed.P0)[:15]),
            assumed.noise[:12],
            correlation,
        )


class Navigated(NamedTuple):
    """Where a program believes the IMU to be, at the times of the samples.

    Attributes
    ----------
    position : (n + 1, 3) array
        Latitude, longitude [rad], height [m].
    q_nb : (n + 1, 4) array
        Attitude, scalar first.
    """

    position: FloatArray
    q_nb: FloatArray

    def antenna(self, time: FloatArray, at: FloatArray, lever_arm: FloatArray) -> FloatArray:
        """Return the position (k, 3) of the antenna between samples.

        Parameters
        ----------
        time : (n + 1,) array
            Times of the samples [s].
        at : (k,) array
            Times within them [s].
        lever_arm : (3,) array
            From the IMU to the antenna, in b [m].
        """
        r_e = ecef.position(self.position)
        C_en = ecef.axes(self.position[:, 0], self.position[:, 1])
        C_nb = Rotation.from_quat(self.q_nb, scalar_first=True).as_matrix()
        r_e = r_e + np.einsum("nij,njk,k->ni", C_en, C_nb, lever_arm)
        return ecef.geodetic(interpolate_columns(at, time, r_e))


def installed(program: str) -> str:
    """Return the version of a program, empty where it is not installed or cannot be imported."""
    try:
        found = version(program)
        for module in MODULES[program]:
            importlib.import_module(module)
    except (ImportError, PackageNotFoundError):
        return ""
    return found


def python_ins(given: Given, withheld: Flags) -> Callable[[], Navigated]:
    """Return what navigates with the feedback filter of python-ins, without the withheld fixes."""
    import pandas as pd  # noqa: PLC0415 - takes a while to import
    from pyins import filters, inertial_sensor, measurements, strapdown, util  # noqa: PLC0415 - optional

    class Each:
        """A measurement with a covariance of its own."""

        def __init__(self, data: Any, rows: NDArray[np.intp], block: slice) -> None:
            super().__init__(data, 1.0, given.lever_arm)  # type: ignore[call-arg]
            self.each = dict(zip(data.index, given.R[rows, block, block], strict=True))

        def compute_matrices(self, time: float, pva: Any, error_model: Any) -> Any:
            if time not in self.each:
                return None
            self.R = self.each[time]
            return super().compute_matrices(time, pva, error_model)  # type: ignore[misc]

    imu, start, noise = given.imu, given.start, np.sqrt(given.noise)
    rows = np.flatnonzero(~withheld)
    times = given.fixes.time[rows]
    place = given.fixes.position[rows] * (np.degrees(1), np.degrees(1), 1)
    position = pd.DataFrame(place, times, util.LLA_COLS)
    velocity = pd.DataFrame(given.fixes.velocity_n[rows], times, util.VEL_COLS)
    kinds = [
        type("Position", (Each, measurements.Position), {})(position, rows, slice(0, 3)),
        type("NedVelocity", (Each, measurements.NedVelocity), {})(velocity, rows, slice(3, 6)),
    ]
    samples = np.hstack((imu.dtheta - start.gyro_bias * np.diff(imu.time)[:, None], imu.dvelocity))
    # Coning and sculling want the sample before the first one: it is taken to be equal.
    frame = pd.DataFrame(np.vstack((samples[:1], samples)), imu.time, [*util.GYRO_COLS, *util.ACCEL_COLS])
    increments = strapdown.compute_increments_from_imu(frame, "increment")
    euler = np.degrees(euler_from_quaternion(start.q_nb))
    first = np.concatenate((np.degrees(start.position[:2]), start.position[2:], start.velocity_n, euler))
    pva = pd.Series(first, util.TRAJECTORY_COLS, name=imu.time[0])
    sigma = given.sigma.reshape(5, 3)
    models = [
        inertial_sensor.EstimationModel(sigma[3 + at], noise[white], noise[drive])
        for at, (white, drive) in enumerate(((GYRO, GYRO_DRIVE), (ACCEL, ACCEL_DRIVE)))
    ]
    strapdown.Integrator(pva).integrate(increments.iloc[:_WARM])

    def navigate() -> Navigated:
        found = filters.run_feedback_filter(
            pva,
            _mean(sigma[0]),
            _mean(sigma[1]),
            np.degrees(_mean(sigma[2, :2])),
            np.degrees(sigma[2, 2]),
            increments,
            *models,
            measurements=kinds,
            time_step=_STEP,
        ).trajectory
        values = np.array(found.reindex(imu.time, method="nearest"))
        values[:, [0, 1, 6, 7, 8]] *= np.radians(1.0)
        q_nb = Rotation.from_euler("ZYX", values[:, [8, 7, 6]]).as_quat(scalar_first=True)
        return Navigated(values[:, :3], q_nb)

    return navigate


def sidereon(given: Given, withheld: Flags) -> Callable[[], Navigated]:
    """Return what navigates with the loosely coupled filter of sidereon, without the withheld fixes."""
    import sidereon as program  # noqa: PLC0415 - optional

    imu, start = given.imu, given.start
    rows = np.flatnonzero(~withheld)
    fix_e, C_fix = _resolve_in_e(given.fixes.position[rows])
    turn = np.zeros((rows.size, 6, 6))
    turn[:, :3, :3] = turn[:, 3:, 3:] = C_fix
    covariance = turn @ given.R[rows] @ np.swapaxes(turn, 1, 2)
    velocity_e = np.einsum("nij,nj->ni", C_fix, given.fixes.velocity_n[rows])
    measured = [
        program.GnssFixMeasurement.position_velocity(
            time, list(place), list(velocity), R, _SATELLITES, fix_status=program.GnssFixStatus.FIXED
        )
        for time, place, velocity, R in zip(
            given.fixes.time[rows].tolist(), fix_e, velocity_e, covariance, strict=True
        )
    ]
    time, dtheta, dvelocity, updates = _split(imu, given.fixes.time[rows], start.gyro_bias)
    samples = [
        program.ImuSample.increment(*one)
        for one in zip(
            time[1:].tolist(), dvelocity.tolist(), dtheta.tolist(), np.diff(time).tolist(), strict=True
        )
    ]
    begin_e, C_begin = _resolve_in_e(start.position[None])
    C_eb = C_begin[0] @ Rotation.from_quat(start.q_nb, scalar_first=True).as_matrix()
    nominal = program.NavState(float(time[0]), list(begin_e[0]), list(C_begin[0] @ start.velocity_n), C_eb)
    P = np.zeros((15, 15))
    variances = given.sigma.reshape(5, 3) ** 2
    for at in range(3):
        P[3 * at : 3 * at + 3, 3 * at : 3 * at + 3] = C_begin[0] @ np.diag(variances[at]) @ C_begin[0].T
    P[9:12, 9:12], P[12:, 12:] = np.diag(variances[4]), _FROZEN**2 * np.eye(3)
    state = program.InsFilterState.from_covariance(nominal, program.ErrorStateLayout.FIFTEEN, P)
    white = [float(np.sqrt(given.noise[part].mean())) for part in (ACCEL, GYRO)]
    drives = [float(given.noise[ACCEL_DRIVE].mean()), _FROZEN**2]
    taus = given.correlation[::-1].tolist()
    # A correlated bias has the drive 2 σ² / τ; sidereon takes σ, or √q where τ is infinite.
    sizes = [
        float(np.sqrt(q * tau / 2 if np.isfinite(tau) else q)) for q, tau in zip(drives, taus, strict=True)
    ]
    spec = program.ImuSpec(*white, *sizes, *taus)
    coupling = program.LooseCouplingConfig(given.lever_arm.tolist())
    engine = program.InertialFilter.with_config(state, program.InertialFilterConfig(spec, loose=coupling))

    def navigate() -> Navigated:
        places, attitudes = np.empty((time.size, 3)), np.empty((time.size, 3, 3))
        places[0], attitudes[0] = begin_e[0], C_eb
        for number, sample in enumerate(samples, 1):
            engine.propagate(sample)
            if number in updates:
                engine.update_loose(measured[updates[number]])
            now = engine.state.nominal
            places[number], attitudes[number] = now.position_ecef_m, now.attitude_body_to_ecef
        kept = np.searchsorted(time, imu.time - _ROUNDING)
        geodetic = ecef.geodetic(places[kept])
        C_ne = np.swapaxes(ecef.axes(geodetic[:, 0], geodetic[:, 1]), 1, 2)
        q_nb = Rotation.from_matrix(C_ne @ attitudes[kept]).as_quat(scalar_first=True)
        return Navigated(geodetic, q_nb)

    return navigate


def _mean(sigma: FloatArray) -> float:
    """Return one σ for several axes."""
    return float(np.sqrt(np.mean(sigma**2)))


def _resolve_in_e(position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return places in e (n, 3) [m], and C_en (n, 3, 3)."""
    return ecef.position(position), ecef.axes(position[:, 0], position[:, 1])


def _split(
    imu: Imu, fixes: FloatArray, gyro_bias: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, dict[int, int]]:
    """Return increments that also end at each fix, without a bias, and the fix at the end of some."""
    time = np.union1d(imu.time, fixes)
    time = time[np.append(True, np.diff(time) > _ROUNDING)]
    dtheta, dvelocity = (
        np.diff(interpolate_columns(time, imu.time, running_sums(values)), axis=0)
        for values in (imu.dtheta - gyro_bias * np.diff(imu.time)[:, None], imu.dvelocity)
    )
    ends = np.searchsorted(time, fixes - _ROUNDING)
    return time, dtheta, dvelocity, {int(end): row for row, end in enumerate(ends) if end}


OPPONENTS: dict[str, Callable[[Given, Flags], Callable[[], Navigated]]] = {
    "python-ins": python_ins,
    "sidereon": sidereon,
}
"""What navigates, by program."""
MODULES = {"python-ins": ("pyins", "pyins.filters"), "sidereon": ("sidereon",)}
"""What is imported of each."""
