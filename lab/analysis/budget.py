"""Budget: the contribution of each source of error to the errors of the solution.

This is a truth-model covariance analysis. The covariance of the true error due to each source alone is
propagated along the true flight and through the gains that the filter really used, whether its assumptions
are right or wrong. The sources are independent and the model is linear, so their variances sum to the
variance of the error.

The error e of the solution, its pending estimate x̂, and the state c of a source obey

    e⁻ = Φ e + (Φ − Φ_f) x̂ + Γ c,    x̂⁻ = Φ_f x̂                from fix to fix, Φ_f as the filter has it,
    e⁺ = (I − K H) e⁻ + K v,          x̂⁺ = x̂⁻ + K (H e⁻ − v)     with a fix of error v,

and a correction subtracts x̂ from the navigator and sets it to zero. Only the biases of x̂ matter, because Φ
and Φ_f are equal elsewhere. c is v itself, or the error of an inertial sensor with the sign of an error of
the estimated bias, because it acts as one on the navigator.

References
----------
A. Gelb (ed.), *Applied Optimal Estimation*, ch. 7.2; P. S. Maybeck, *Stochastic Models, Estimation, and
Control*, vol. 1, ch. 6.8; P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation
Systems*, 2nd ed., ch. 14.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab import ecef
from lab.analysis import feedforward
from lab.analysis.error_axes import output_map
from lab.analysis.error_sources import (
    ACCELEROMETER,
    GPS_POSITION,
    GPS_VELOCITY,
    Constant,
    Process,
    constants,
    left_out,
    processes,
)
from lab.analysis.errors import euler_sigma
from lab.analysis.known_errors import Series, known_errors
from lab.analysis.transition import BIASES, NAV, Flight, N, Processes, Transition, transition
from lab.east_north_up import NED_TO_ENU, east_north_up_sizes
from lab.navigation import blocks
from lab.navigation.checks import OTHER
from lab.navigation.error_models import ATT, MODELS, POS, STATES, VEL
from lab.rotation import euler_from_quaternion, euler_jacobian
from lab.run import Run
from lab.sensors.gps import within
from lab.sensors.imu_errors import OFF_DIAGONAL
from lab.settings import SettingError
from lab.units import TO_SI

if TYPE_CHECKING:
    import xarray as xr

FloatArray = NDArray[np.float64]

QUANTITIES = (
    *("position east", "position north", "position up"),
    *("velocity east", "velocity north", "velocity up"),
    *("roll", "pitch", "heading"),
    *STATES[9:15],
)
"""Quantities of the budget of a filter with 15 states: the error states in east, north, up and Euler
angles."""

UNITS = ("m",) * 3 + ("m/s",) * 3 + ("°",) * 3 + ("°/s",) * 3 + ("mg",) * 3
"""Units of the quantities."""


def quantities(names: Sequence[str]) -> dict[str, str]:
    """Return the quantities of the budget of a filter with some further blocks, and their units."""
    scales = (*QUANTITIES, *STATES[N:])[: blocks.count([name for name in names if name in blocks.SCALES])]
    units = (*UNITS, *("%",) * (len(STATES) - N))
    further, their_units, _ = blocks.shown_states(names)
    found = dict(zip(scales, units[: len(scales)], strict=True))
    return found | dict(zip(further, their_units, strict=True))


INTERVAL = 1.0
"""Longest time between two epochs of a budget [s]."""


def error_budget(run: Run) -> xr.Dataset:
    """Return the error budget of a run.

    Parameters
    ----------
    run
        The run. Its flight, its settings and the gains of its filter are used; its errors are not.

    Returns
    -------
    xr.Dataset
        ``sigma`` (source, time, quantity): one standard deviation due to each source alone, in the `unit` of
        the quantity; for an error given by its value, its effect. ``share`` (source, time, quantity): its
        share of the variance [%]. ``total`` and ``believed`` (time, quantity): σ of all sources together, and
        σ according to the filter. A known error counts with its square, as if its sign were random. Times are
        the start, the used fixes (after the fix), the end, and others, so that none is more than a second
        from the next. Attribute `left_out`: settings with errors that are not in the budget.

    Raises
    ------
    SettingError
        If the filter's gains do not act on these error states.
    ResultError
        If the run is that of a sensor log, whose true flight is unknown.
    """
    _, ideal = run.true_flight("budget")
    _check(run)
    experiment = run.experiment
    assert run.aligned is not None  # for a simulated run
    constant = constants(experiment, run.aligned, run.blocks)
    random = processes(experiment, ideal, float(run.time[-1]))
    known = known_errors(run)
    epochs = epochs_of(run)
    names = [source.name for part in (constant, known, random) for source in part]
    return _dataset(run, names, epochs, _Propagation(run, constant, random, known).run(epochs))


def _check(run: Run) -> None:
    """Raise `SettingError` for filters whose covariance does not give the gains on these error states."""
    model = run.experiment.navigator.model
    if model not in MODELS:
        raise SettingError(
            f"navigator.model = {model!r}: the error budget needs the gains of a linear model; accepted here "
            f"is one of {', '.join(MODELS)}"
        )
    check_gains(run)
    check_states(run)
    check_rest(run)
    check_feedforward(run)


def check_gains(run: Run) -> None:
    """Raise `SettingError` for smoothed solutions and users' algorithms, which have no gains."""
    if run.algorithm:
        raise SettingError(
            f"{run.algorithm}: this analysis needs the gains of the filter, and your own algorithm does not "
            "give them; accepted here is the navigator of the settings"
        )
    if run.experiment.navigator.smoother:
        raise SettingError(
            "navigator.smoother: this analysis needs the gains of the filter, and a smoothed solution has "
            "none; accepted here is false"
        )


def check_states(run: Run) -> None:
    """Raise `SettingError` for filters with other measurements, or states for other errors than the IMU's."""
    if run.aids.time.size or set(run.blocks) - {*blocks.SCALES, *blocks.MISALIGNMENTS}:
        raise SettingError(
            f"{OTHER}: the error budget follows the errors of IMU and GPS through a filter with states for "
            "errors of the IMU, and this one uses other measurements or has states for other errors; "
            "accepted here are navigator.states and navigator.estimate_misalignments"
        )


def check_rest(run: Run) -> None:
    """Raise `SettingError` for runs with updates at rest, whose gains are not kept."""
    if run.solution_arrays.rest.any():
        raise SettingError(
            "navigator.rest_updates: the error budget needs the gains of all updates, and those of the "
            "updates at rest are not kept; accepted here is false"
        )


def check_feedforward(run: Run) -> None:
    """Raise `SettingError` for a feedforward run whose free navigator is beyond the linear model."""
    drift = feedforward.drift_of(run)
    if drift > feedforward.LINEAR:
        raise SettingError(
            "navigator.correction: the error budget is linear, and the attitude error of the free-running "
            f"navigator reaches {np.degrees(drift):.3g}° in this feedforward run; accepted are up to "
            f"{np.degrees(feedforward.LINEAR):g}°, or feedback"
        )


class Epochs(NamedTuple):
    """Epochs of a flight: IMU samples (e,), the fix at each or −1, and whether it is the sample's last."""

    sample: NDArray[np.int64]
    fix: NDArray[np.int64]
    last: NDArray[np.bool_]


def epochs_of(run: Run) -> Epochs:
    """Return the epochs: start, used fixes, end, and samples between, so that none is far from the next."""
    end = run.time.size - 1
    used = np.flatnonzero(run.solution_arrays.fix_sample >= 0)
    at_fix = run.solution_arrays.fix_sample[used]
    grid = np.append(np.arange(0, end, max(1, round(INTERVAL / _step(run)))), end)
    grid = np.setdiff1d(grid, at_fix)
    sample = np.concatenate((at_fix, grid))
    order = np.argsort(sample, kind="stable")
    sample = sample[order]
    fix = np.concatenate((used, np.full(grid.size, -1)))[order]
    return Epochs(sample, fix, np.append(np.diff(sample) > 0, True))


def _step(run: Run) -> float:
    """Return the usual time from IMU sample to IMU sample [s]."""
    return float(np.median(np.diff(run.time))) if run.ideal is None else run.ideal.dt


class _Propagation:
    """Propagates the covariance of each source from epoch to epoch."""

    def __init__(
        self,
        run: Run,
        constants: list[Constant],
        processes: list[Process],
        known: Sequence[Series] = (),
    ) -> None:
        (truth, ideal), belief = run.true_flight("budget"), run.belief
        self.flight = Flight(
            truth.latitude,
            truth.longitude,
            truth.height,
            truth.velocity_n,
            truth.q_nb,
            ideal.dtheta,
            ideal.dvelocity,
            ideal.dt,
        )
        self.time = ideal.time
        self.processes = processes
        self.inertial = [source for source in processes if source.channel <= ACCELEROMETER]
        self.fade = np.exp(-belief.decay[:BIASES] * ideal.dt)
        self.sampled = Processes(
            np.array([source.channel for source in self.inertial], dtype=np.int64),
            np.array([source.decay(ideal.dt) for source in self.inertial]),
            np.array([source.drive(ideal.dt) for source in self.inertial]).reshape(-1, 3),
        )
        self.solution = solution = run.solution_arrays
        self.corrected = _corrections(run)
        n = self.states = solution.states
        self.blocks = run.blocks
        self.waiting = slice(n, n + BIASES)  # the biases of x̂
        self.own = slice(n + BIASES, n + BIASES + 3)  # c
        self.widths = [source.start.shape[1] for source in constants]
        self.coupling = np.concatenate([source.coupling for source in constants])
        self.known = known
        self.series = np.zeros((len(known), ideal.dtheta.shape[0], BIASES))
        for room, series in zip(self.series, known, strict=True):
            room[:] = series.inertial
        self.drawn = sum(self.widths)
        self.widths += [1] * len(known)
        self.columns = np.zeros((self.waiting.stop, sum(self.widths)))
        self.columns[:n, : self.drawn] = np.concatenate([source.start for source in constants], axis=1)
        self.columns[:NAV] = np.linalg.solve(self._maps(np.zeros(1, dtype=np.int64))[0], self.columns[:NAV])
        self.fix_axes = ecef.axes(*run.fixes.position[:, :2].T)
        errors = run.experiment.sensors.gps
        bad = within(errors.quality_steps, run.fixes.time)
        self.grade = np.where(bad, errors.quality_factor, 1.0)
        self.P = np.zeros((len(processes), self.own.stop, self.own.stop))
        for P, source in zip(self.P, processes, strict=True):
            if source.settled:
                P[self.own, self.own] = np.diag(source.variance)

    def run(self, epochs: Epochs) -> FloatArray:
        """Return the variances (source, kept epoch, quantity) in SI units."""
        out = np.zeros((len(self.widths) + len(self.processes), int(epochs.last.sum()), self.states))
        room = Transition.empty(len(self.inertial), len(self.known))
        before, row = 0, 0
        self.map = dict(zip(epochs.sample.tolist(), self._quantities(epochs.sample), strict=True))
        for sample, fix, last in zip(*(part.tolist() for part in epochs), strict=True):
            self._propagate(before, sample, room)
            if fix >= 0:
                self._update(fix)
            if last:
                out[:, row] = self._variances(sample)
                row += 1
            before = sample
        return out

    def _maps(self, samples: NDArray[np.int64]) -> FloatArray:
        """Return the maps (m, 9, 9) from errors in e to output errors at some samples of the true flight."""
        flight = self.flight
        place = (flight.latitude[samples], flight.longitude[samples], flight.height[samples])
        return output_map(np.stack(place, axis=-1), flight.velocity_n[samples])

    def _quantities(self, samples: NDArray[np.int64]) -> FloatArray:
        """Return the maps (m, 9, 9) from errors in e to the quantities at some samples."""
        T = np.zeros((samples.size, NAV, NAV))
        T[:, POS, POS] = T[:, VEL, VEL] = NED_TO_ENU
        T[:, ATT, ATT] = euler_jacobian(euler_from_quaternion(self.flight.q_nb[samples]))
        return np.asarray(T @ self._maps(samples))

    def _propagate(self, first: int, last: int, step: Transition) -> None:
        """Go from one sample to another."""
        there = self.flight.between(first, last)
        series = np.ascontiguousarray(self.series[:, first:last])
        transition(there, 0, last - first, self.fade, self.sampled, series, step)
        waiting, own = self.waiting, self.own
        A = np.eye(waiting.stop)
        A[:NAV, :NAV] = step.navigation
        A[:NAV, NAV:N] = step.bias
        # An error of a scale factor acts as one of the bias, times the measured quantity; a misalignment,
        # times that of another axis.
        for state, of, by in coupled_states(self.blocks):
            A[:NAV, state] = step.coupled[:, of, by]
        fade = np.diag(self.fade ** (last - first))
        A[:NAV, waiting] = step.bias - step.fading
        A[NAV:N, waiting] = np.eye(BIASES) - fade
        A[waiting, waiting] = fade
        self.columns = A @ self.columns
        self.columns[:NAV, : self.drawn] += np.einsum("iab,cab->ic", step.coupled, self.coupling)
        self.columns[:NAV, self.drawn :] += step.driven.T
        B = np.zeros_like(self.P)
        B[:, : waiting.stop, : waiting.stop] = A
        Q = np.zeros_like(self.P)
        imu = len(self.inertial)
        B[:imu, :NAV, own] = self.sampled.decay[:, None, None] * step.process
        Q[:imu, :NAV, :NAV] = step.covariance
        Q[:imu, :NAV, own] = step.cross
        Q[:imu, own, :NAV] = step.cross.mT
        elapsed = (last - first) * self.flight.dt
        for p, source in enumerate(self.processes):
            B[p, own, own] = source.decay(elapsed) * np.eye(3)
            Q[p, own, own] = np.diag(source.drive(elapsed))
        self.P = B @ self.P @ B.mT + Q

    def _update(self, fix: int) -> None:
        """Take a fix."""
        solution, waiting, own = self.solution, self.waiting, self.own
        H, n, sample = solution.fix_H[fix].copy(), self.states, int(solution.fix_sample[fix])
        # The filter's H is for errors along the axes of the fix, its P⁺ for output errors at its estimate.
        C_fe = self.fix_axes[fix].T
        for block in (POS, VEL, ATT):
            H[:, block] = H[:, block] @ C_fe
        here = output_map(solution.position[sample, None], solution.velocity_n[sample, None])[0]
        back = np.eye(n)
        back[:NAV, :NAV] = np.linalg.inv(here)
        P = back @ solution.fix_covariance[fix] @ back.T
        # K = P⁺ Hᵀ R⁻¹, even if P⁺ and R are wrong (Gelb 4.2-16b).
        K = P @ H.T @ np.linalg.inv(solution.fix_R[fix])
        U = np.eye(waiting.stop)
        U[:n, :n] -= K @ H
        U[waiting, :n] = K[NAV:N] @ H
        # Errors of a fix are along north, east and down of the true place.
        turned = C_fe @ ecef.axes(self.flight.latitude[sample], self.flight.longitude[sample])
        K = np.concatenate((K[:, :3] @ turned, K[:, 3:] @ turned), axis=1)
        noise = np.concatenate((K, -K[NAV:N]))
        if self.corrected[fix]:
            U[waiting] = noise[waiting] = 0.0
        self.columns = U @ self.columns
        for column, series in enumerate(self.known, self.drawn):
            self.columns[:, column] += noise @ series.fixes[fix]
        B = np.zeros_like(self.P)
        B[:, : waiting.stop, : waiting.stop] = U
        B[:, own, own] = np.eye(3)
        for p, source in enumerate(self.processes):
            grade = self.grade[fix] if source.graded else 1.0
            if source.channel == GPS_POSITION:
                B[p, : waiting.stop, own] = grade * noise[:, :3]
            elif source.channel == GPS_VELOCITY:
                B[p, : waiting.stop, own] = grade * noise[:, 3:]
        self.P = B @ self.P @ B.mT

    def _variances(self, sample: int) -> FloatArray:
        """Return the variances (source, quantity) at a sample."""
        n = self.states
        T = np.eye(n)
        T[:NAV, :NAV] = self.map[sample]
        states = self.columns[:n].copy()
        for column, series in enumerate(self.known, self.drawn):
            if series.is_bias:
                states[NAV:N, column] += series.inertial[max(sample - 1, 0)]
        squares = (T @ states) ** 2
        parts = np.split(squares, np.cumsum(self.widths)[:-1], axis=1)
        constant = np.stack([part.sum(axis=1) for part in parts])
        seen = np.zeros((len(self.processes), n, self.own.stop))
        seen[:, :, :n] = T
        for p, source in enumerate(self.inertial):
            # The true bias includes the instability, but not white noise.
            if source.time:
                seen[p, NAV + 3 * source.channel : NAV + 3 * source.channel + 3, self.own] = np.eye(3)
        random = np.einsum("pqi,pij,pqj->pq", seen, self.P, seen, optimize=True)
        # Roundoff of the turned axes may make a zero variance slightly negative.
        return np.concatenate((constant, np.maximum(random, 0)))


def coupled_states(names: Sequence[str]) -> list[tuple[int, int, int]]:
    """Return the states that act as a bias of one axis times the output of one: state, bias, output."""
    pairs = [("xyz".index(pair[0]), "xyz".index(pair[1])) for pair in OFF_DIAGONAL]
    found = []
    for triad, (scale, misalignment) in enumerate(zip(blocks.SCALES, blocks.MISALIGNMENTS, strict=True)):
        for name, couplings in ((scale, [(i, i) for i in range(3)]), (misalignment, pairs)):
            if name in names:
                first = blocks.first_state(names, name)
                found += [(first + k, 3 * triad + i, 3 * triad + j) for k, (i, j) in enumerate(couplings)]
    return found


def _corrections(run: Run) -> NDArray[np.bool_]:
    """Return after which fixes (m,) the navigator was corrected."""
    navigator = run.experiment.navigator
    sample = run.solution_arrays.fix_sample
    corrected = np.zeros(sample.shape, dtype=np.bool_)
    if navigator.correction != "feedback":
        return corrected
    last, slack = run.time[0], 1e-6 * _step(run)
    for m in np.flatnonzero(sample >= 0):
        if run.time[sample[m]] - last >= navigator.correction_period - slack:
            corrected[m], last = True, run.time[sample[m]]
    return corrected


def _dataset(run: Run, sources: list[str], epochs: Epochs, variance: FloatArray) -> xr.Dataset:
    """Return the result of `error_budget`."""
    import xarray as xr  # noqa: PLC0415 - takes a while to import, and a run does without

    names = list(dict.fromkeys(sources))
    if len(names) < len(sources):
        variance = np.stack([variance[[name == source for source in sources]].sum(axis=0) for name in names])
    units = quantities(run.blocks)
    scale = np.array([1 / TO_SI[unit] for unit in units.values()])
    kept = epochs.sample[epochs.last]
    total = variance.sum(axis=0)
    share = np.divide(variance, total, out=np.zeros_like(variance), where=total > 0)
    share *= 100
    # In the place of the variances: with all sources, they take 50 MB in four hours.
    sigma = np.sqrt(variance, out=variance)
    sigma *= scale
    dims = ("source", "time", "quantity")
    return xr.Dataset(
        {
            "sigma": (dims, sigma, {"long_name": "σ due to the source alone"}),
            "share": (dims, share, {"units": "%", "long_name": "part of the variance"}),
            "total": (dims[1:], np.sqrt(total) * scale, {"long_name": "σ of all sources together"}),
            "believed": (dims[1:], believed_sigma(run, kept), {"long_name": "σ according to the filter"}),
        },
        coords={
            "source": names,
            "time": ("time", run.time[kept], {"units": "s", "long_name": "time"}),
            "quantity": list(units),
            "unit": ("quantity", list(units.values())),
        },
        attrs={"left_out": ", ".join(left_out(run.experiment))},
    )


def believed_sigma(run: Run, samples: NDArray[np.int64]) -> FloatArray:
    """Return σ of all `quantities` (m, states) at samples (m,) according to the filter, in their units."""
    solution = run.solution_arrays
    euler = euler_from_quaternion(solution.q_nb[samples])
    return sigma_of_quantities(euler, solution.variance[samples], solution.covariance[samples], run.blocks)


def sigma_of_quantities(
    euler: FloatArray, variance: FloatArray, covariance: FloatArray, names: Sequence[str]
) -> FloatArray:
    """Return σ (n, states) of all `quantities`, in their units.

    Parameters
    ----------
    euler : (n, 3) array
        Roll, pitch, heading [rad].
    variance, covariance
        As of `Solution`.
    names
        The further blocks of the filter.
    """
    sigma = np.sqrt(variance)
    sigma[:, POS], sigma[:, VEL] = east_north_up_sizes(sigma[:, POS]), east_north_up_sizes(sigma[:, VEL])
    sigma[:, ATT] = euler_sigma(euler, variance[:, ATT], covariance[:, 1])
    return sigma / [TO_SI[unit] for unit in quantities(names).values()]
