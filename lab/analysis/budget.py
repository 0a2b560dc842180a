"""Budget: the contribution of each source of error to the errors of the solution.

This is a truth-model covariance analysis. The covariance of the true error due to each source alone is
propagated along the true flight and through the gains that the filter really used, whether its assumptions
are right or wrong. The sources are independent and the model is linear, so their variances sum to the
variance of the error.

The error e of the solution, its estimate b̂ of the sensor errors that the filter believes to decay, and the
state c of a source obey

    e⁻ = Φ e + (Φ_f − Φ) b̂ + Γ c,    b̂⁻ = Φ_f b̂          from one measurement to the next,
    e⁺ = (I − K H) e⁻ + K v,          b̂⁺ = b̂⁻ − K (H e⁻ − v)     with a measurement of error v.

Φ_f is the transition as the filter has it: estimates decay, while constant errors do not. It does not matter
when the navigator is corrected, but F of the filter has the attitude and the forces that it estimates: a bias
that it has taken for a tilt is along the axes of its estimate, which may be degrees off at the start. Errors
turn by half of each correction (`strapdown.reset_rate`). c is v itself, or the error of an inertial sensor
with the sign of an error of the estimated bias, because it acts as one on the navigator.

References
----------
A. Gelb (ed.), *Applied Optimal Estimation*, ch. 7.2; P. S. Maybeck, *Stochastic Models, Estimation, and
Control*, vol. 1, ch. 6.8; P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation
Systems*, 2nd ed., ch. 14.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lab.analysis import feedforward
from lab.analysis.error_sources import (
    ACCELEROMETER,
    INSTABILITY,
    SLOW_ERRORS,
    Constant,
    Process,
    constants,
    left_out,
    processes,
)
from lab.analysis.errors import euler_sigma, output_map
from lab.analysis.gains import Epochs, Update, choose_epochs, is_corrected, iterate_updates
from lab.analysis.known_errors import Series, known_errors
from lab.analysis.transition import BIASES, NAV, FlightArrays, N, Processes, Transition, transition
from lab.base.arrays import FloatArray
from lab.base.blas_threads import OneBlasThread
from lab.base.parameters.setting_error import SettingError
from lab.base.parameters.units import TO_SI
from lab.motion.frames.east_north_up import NED_TO_ENU, east_north_up_sizes
from lab.motion.frames.rotation import euler_from_quaternion, euler_jacobian
from lab.navigation.filters import blocks
from lab.navigation.filters.error_models import ATT, MODELS, POS, STATES, VEL
from lab.run.run import Run
from lab.sensors.gps import mask_within
from lab.sensors.imu_errors import OFF_DIAGONAL

if TYPE_CHECKING:
    import xarray as xr


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


def shown_scales(names: Sequence[str]) -> FloatArray:
    """Return the values of one SI unit in the units of all `quantities`."""
    units = list(quantities(names).values())
    _, further, scales = blocks.shown_states(names)
    own = len(units) - len(further)
    return np.array([*(1 / TO_SI[unit] for unit in units[:own]), *scales])


@OneBlasThread()
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
        the start, the used fixes (after all measurements of the sample), the end, and others, so that none is
        more than a second from the next. Attribute `left_out`: settings with errors that are not in the
        budget.

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
    epochs = choose_epochs(run)
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
    """Raise `SettingError` for filters with states that a user declared."""
    if set(run.blocks) & set(blocks.OWN):
        raise SettingError(
            "navigator.own_states: the error budget follows the errors of the sensors through the states of "
            "the filter, and does not know the effect of your own; accepted here are none"
        )


def check_rest(run: Run) -> None:
    """Raise `SettingError` for runs with updates at rest, whose gains are not kept."""
    if run.solution_arrays.rest.any():
        raise SettingError(
            "navigator.rest_updates: the error budget needs the gains of all updates, and those of the "
            "updates at rest are not kept; accepted here is false"
        )


def check_feedforward(run: Run) -> None:
    """Raise `SettingError` for a run whose navigator runs free beyond the linear model."""
    drift, limit = feedforward.measure_free_run(run)
    if drift > limit:
        waits = run.experiment.navigator.correction == "feedback"
        raise SettingError(
            f"navigator.correction{'_period' if waits else ''}: the error budget is linear, and the attitude "
            f"error of the free-running navigator reaches {np.degrees(drift):.3g}°; accepted are up to "
            f"{np.degrees(limit):.2g}°, or {'a period of 0' if waits else 'feedback'}"
        )


class _Propagation:
    """Propagates the covariance of each source from epoch to epoch: of errors, decaying estimates, and c."""

    def __init__(
        self,
        run: Run,
        constants: list[Constant],
        processes: list[Process],
        known: Sequence[Series] = (),
    ) -> None:
        (truth, ideal), belief = run.true_flight("budget"), run.belief
        self.corrected = is_corrected(run)
        self.flight = FlightArrays(
            truth.latitude,
            truth.longitude,
            truth.height,
            truth.velocity_n,
            run.solution_arrays.q_nb if self.corrected else truth.q_nb,
            ideal.dtheta,
            ideal.dvelocity,
            ideal.dt,
        )
        self.result, self.time, self.processes = run, ideal.time, processes
        self.inertial = [source for source in processes if source.channel <= ACCELEROMETER]
        self.sampled = Processes(
            np.array([source.channel for source in self.inertial], dtype=np.int64),
            np.array([source.decay(ideal.dt) for source in self.inertial]),
            np.array([source.drive(ideal.dt) for source in self.inertial]).reshape(-1, 3),
        )
        n = self.states = run.solution_arrays.states
        self.blocks = run.blocks
        decay = np.append(belief.decay, np.zeros(n - NAV - belief.decay.size))
        self.acting = acting_as_biases(run.blocks)
        self.fade = np.exp(-decay[self.acting - NAV] * ideal.dt)
        self.decaying = NAV + np.flatnonzero(decay)
        self.kept = np.exp(-decay[self.decaying - NAV] * ideal.dt)
        self.estimates = slice(n, n + self.decaying.size)  # b̂
        self.own = slice(self.estimates.stop, self.estimates.stop + 3)  # c
        self.widths = [source.start.shape[1] for source in constants]
        self.coupling = np.concatenate([source.coupling for source in constants])
        self.known = known
        self.series = np.zeros((len(known), ideal.dtheta.shape[0], BIASES))
        for room, series in zip(self.series, known, strict=True):
            room[:] = series.inertial
        self.drawn = sum(self.widths)
        self.widths += [1] * len(known)
        self.columns = np.zeros((self.estimates.stop, sum(self.widths)))
        self.columns[:n, : self.drawn] = np.concatenate([source.start for source in constants], axis=1)
        # The sources are errors of the output, north, east, down; what is propagated are errors in e.
        self.columns[:NAV] = np.linalg.solve(self._maps(np.zeros(1, dtype=np.int64))[0], self.columns[:NAV])
        errors = run.experiment.sensors.gps
        bad = mask_within(errors.quality_steps, run.fixes.time)
        self.own_steps: dict[int, tuple[FloatArray, FloatArray]] = {}  # by the number of samples
        self.grade = np.where(bad, errors.quality_factor, 1.0)
        self.shown = [find_affected_states(source, run.blocks) for source in processes]
        self.P = np.zeros((len(processes), self.own.stop, self.own.stop))
        for P, source in zip(self.P, processes, strict=True):
            if source.settled:
                P[self.own, self.own] = np.diag(source.variance)

    def run(self, epochs: Epochs) -> FloatArray:
        """Return the variances (source, shown epoch, quantity) in SI units."""
        out = np.zeros((len(self.widths) + len(self.processes), int(epochs.shown.sum()), self.states))
        room = Transition.empty(len(self.inertial), len(self.known), self.fade.size)
        before, row = 0, 0
        self.map = dict(zip(epochs.sample.tolist(), self._quantities(epochs.sample), strict=True))
        place = np.column_stack((self.flight.latitude[epochs.sample], self.flight.longitude[epochs.sample]))
        updates = iterate_updates(self.result, epochs, place)
        for sample, fix, aid, shown, update in zip(*(part.tolist() for part in epochs), updates, strict=True):
            self._propagate(before, sample, room)
            if update is not None:
                known = [
                    series.fixes[fix] if fix >= 0 else series.aids[aid : aid + 1] for series in self.known
                ]
                self._update(update, known, fix)
            if shown:
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
        if self.corrected:
            there = there._replace(dvelocity=self._velocity_increments(slice(first, last)))
        series = np.ascontiguousarray(self.series[:, first:last])
        transition(there, 0, last - first, self.fade, self.sampled, series, step)
        estimates, own = self.estimates, self.own
        A = np.eye(estimates.stop)
        A[:NAV, :NAV] = step.navigation
        response = np.zeros((NAV, self.states))
        response[:, self.acting] = np.tile(step.bias, self.acting.size // BIASES)
        A[:NAV, NAV : self.states] = response[:, NAV:]
        # An error of a scale factor acts as one of the bias, times the measured quantity; a misalignment,
        # times that of another axis; a g-sensitivity, times the force.
        for state, of, by in coupled_states(self.blocks):
            A[:NAV, state] = step.coupled[:, of, by]
        kept = self.kept ** (last - first)
        # Φ_f − Φ: what a decaying estimate does, less what a constant error does.
        response[:, self.acting] = step.fading - response[:, self.acting]
        A[:NAV, estimates] = response[:, self.decaying]
        # b̂ − b shrinks with b̂; what the true bias does is c.
        A[self.decaying, estimates] = np.diag(kept - 1)
        A[estimates, estimates] = np.diag(kept)
        self.columns = A @ self.columns
        self.columns[:NAV, : self.drawn] += np.einsum("iab,cab->ic", step.coupled, self.coupling)
        self.columns[:NAV, self.drawn :] += step.driven.T
        B = np.zeros_like(self.P)
        B[:, : estimates.stop, : estimates.stop] = A
        Q = np.zeros_like(self.P)
        imu = len(self.inertial)
        # c in P is that of the last sample before, one decay from the first one here.
        B[:imu, :NAV, own] = self.sampled.decay[:, None, None] * step.process
        Q[:imu, :NAV, :NAV] = step.covariance
        Q[:imu, :NAV, own] = step.cross
        Q[:imu, own, :NAV] = step.cross.mT
        decay, drive = self._own_step(last - first)
        B[:, own, own], Q[:, own, own] = decay, drive
        self.P = B @ self.P @ B.mT + Q

    def _velocity_increments(self, samples: slice) -> FloatArray:
        """Return the increments of velocity (k, 3) that the filter takes for true."""
        run, solution = self.result, self.result.solution_arrays
        parts = solution.bias[samples], solution.scale[samples], solution.further[samples]
        estimates = np.concatenate(parts, axis=1, dtype=np.float64)
        measured = np.concatenate((run.gyro.increments[samples], run.accelerometer.increments[samples]), 1)
        found = measured[:, 3:].astype(np.float64)
        biases = [(state, place % BIASES) for place, state in enumerate(self.acting)]
        for state, of, by in [*((*bias, -1) for bias in biases), *coupled_states(self.blocks)]:
            triad, axis = divmod(of, 3)
            if triad == ACCELEROMETER:
                effect = self.flight.dt if by < 0 else measured[:, by]
                found[:, axis] -= effect * estimates[:, state - NAV]
        return found

    def _own_step(self, samples: int) -> tuple[FloatArray, FloatArray]:
        """Return the transition and the noise (process, 3, 3) of c over some samples."""
        if samples not in self.own_steps:  # most steps are alike
            elapsed = samples * self.flight.dt
            decay = np.array([source.decay(elapsed) for source in self.processes])
            drive = np.array([source.drive(elapsed) for source in self.processes]).reshape(-1, 3)
            self.own_steps[samples] = decay[:, None, None] * np.eye(3), drive[:, None] * np.eye(3)
        return self.own_steps[samples]

    def _update(self, update: Update, known: Sequence[FloatArray], fix: int = -1) -> None:
        """Take a measurement, given what known errors (r,) add to it, and the number of a fix."""
        H, n = update.H, self.states
        G = np.concatenate((update.K, update.K[self.decaying]))
        self.columns = self.columns - G @ (H @ self.columns[:n])
        for column, added in enumerate(known, self.drawn):
            self.columns[:, column] += G @ added
        G = np.concatenate((G, np.zeros((3, H.shape[0]))))
        F = np.zeros((len(self.processes), H.shape[0], self.own.stop))
        F[:, :, :n] = H
        for p, source in enumerate(self.processes):
            if source.channel in update.noise:
                grade = self.grade[fix] if source.graded else 1.0
                # The innovation sees H e − v, and v is c of this source.
                F[p, :, self.own] = -grade * update.noise[source.channel]
        # (I − G F) P (I − G F)ᵀ
        self.P = self.P - G @ (F @ self.P)
        self.P = self.P - (self.P @ F.mT) @ G.T
        half = np.eye(3) + 0.5 * np.cross(np.eye(3), update.turn)  # I + ½ [x ×]
        self.columns[ATT] = half @ self.columns[ATT]
        self.P[:, ATT] = half @ self.P[:, ATT]
        self.P[:, :, ATT] = self.P[:, :, ATT] @ half.T

    def _variances(self, sample: int) -> FloatArray:
        """Return the variances (source, quantity) at a sample."""
        n = self.states
        T = np.eye(n)
        T[:NAV, :NAV] = self.map[sample]
        states = self.columns[:n].copy()
        for column, series in enumerate(self.known, self.drawn):
            # b̂ − b has minus the bias itself, that of the sample that ends here.
            if series.is_bias:
                states[NAV:N, column] += series.inertial[max(sample - 1, 0)]
        squares = (T @ states) ** 2
        parts = np.split(squares, np.cumsum(self.widths)[:-1], axis=1)
        constant = np.stack([part.sum(axis=1) for part in parts])
        seen = np.zeros((len(self.processes), n, self.own.stop))
        seen[:, :, :n] = T
        for p, (states_of_c, sign) in enumerate(self.shown):
            seen[p, states_of_c, self.own] = sign * np.eye(states_of_c.stop - states_of_c.start, 3)
        random = ((seen @ self.P) * seen).sum(axis=2)
        # Roundoff of the rotated axes may make a zero variance slightly negative.
        return np.concatenate((constant, np.maximum(random, 0)))


def find_affected_states(source: Process, names: Sequence[str]) -> tuple[slice, float]:
    """Return the states whose error includes c of a process, and its sign there; none for white noise.

    The true bias includes the instability, but not white noise. An error of a measurement is one of the state
    that stands for it, with the other sign.
    """
    if not source.time:
        return slice(0, 0), 0.0
    if source.channel <= ACCELEROMETER:
        drift = blocks.DRIFTS[source.channel]
        if source.name.endswith(INSTABILITY) and drift in names:
            return blocks.find_states(names, drift), 1.0
        return slice(NAV + 3 * source.channel, NAV + 3 * source.channel + 3), 1.0
    block = SLOW_ERRORS[source.channel]
    return (blocks.find_states(names, block), -1.0) if block in names else (slice(0, 0), 0.0)


def acting_as_biases(names: Sequence[str]) -> NDArray[np.int64]:
    """Return the states that act on the navigator as biases do: biases, and the states of their drift."""
    drifts = [blocks.find_states(names, name) for name in blocks.DRIFTS if name in names]
    return np.asarray(np.r_[NAV:N, *drifts], dtype=np.int64)


def coupled_states(names: Sequence[str]) -> list[tuple[int, int, int]]:
    """Return the states that act as a bias of one axis times the output of one: state, bias, output."""
    pairs = [("xyz".index(pair[0]), "xyz".index(pair[1])) for pair in OFF_DIAGONAL]
    found = []
    for triad, (scale, misalignment) in enumerate(zip(blocks.SCALES, blocks.MISALIGNMENTS, strict=True)):
        for name, couplings in ((scale, [(i, i) for i in range(3)]), (misalignment, pairs)):
            if name in names:
                first = blocks.first_state(names, name)
                found += [(first + k, 3 * triad + i, 3 * triad + j) for k, (i, j) in enumerate(couplings)]
    if blocks.GYRO_G in names:
        first = blocks.first_state(names, blocks.GYRO_G)
        found += [(first + i, i, 3 + i) for i in range(3)]
    return found


def _dataset(run: Run, sources: list[str], epochs: Epochs, variance: FloatArray) -> xr.Dataset:
    """Return the result of `error_budget`."""
    import xarray as xr  # noqa: PLC0415 - takes a while to import, and a run does without

    names = list(dict.fromkeys(sources))
    if len(names) < len(sources):
        # Processes of one name are one source: the stages of flicker, or both effects of vibration.
        variance = np.stack([variance[[name == source for source in sources]].sum(axis=0) for name in names])
    units = quantities(run.blocks)
    scale = shown_scales(run.blocks)
    kept = epochs.sample[epochs.shown]
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
    return sigma * shown_scales(names)
