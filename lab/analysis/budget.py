"""Budget: which source of error contributes how much to the errors of the solution.

Truth-model covariance analysis: the covariance that each source alone gives the true error is propagated
along the true flight and through the gains the filter really used, whether what it believes is right or
wrong. The sources are independent and all is linear, so their variances sum to the variance of the error.

The error e of the solution, its estimate x̂ that still waits to be corrected, and a source's own state c obey

    e⁻ = Φ e + (Φ − Φ_f) x̂ + Γ c,    x̂⁻ = Φ_f x̂                from fix to fix, Φ_f as the filter has it,
    e⁺ = (I − K H) e⁻ + K v,          x̂⁺ = x̂⁻ + K (H e⁻ − v)     with a fix of error v,

and a correction takes x̂ out of the navigator and sets it to zero. Only the biases of x̂ matter: elsewhere Φ
and Φ_f are the same. c is v itself, or the error of an inertial sensor with the sign of an error of the
estimated bias, which it is to the navigator.

References
----------
A. Gelb (ed.), *Applied Optimal Estimation*, ch. 7.2; P. S. Maybeck, *Stochastic Models, Estimation, and
Control*, vol. 1, ch. 6.8; P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation
Systems*, 2nd ed., ch. 14.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.errors import NED_TO_ENU
from lab.analysis.transition import BIASES, NAV, Flight, N, Processes, Transition, transition
from lab.navigation.error_models import ACCEL_BIAS, ATT, GYRO_BIAS, MODELS, POS, STATES, VEL
from lab.rotation import euler_jacobian
from lab.sensors.imu_errors import OFF_DIAGONAL
from lab.settings import SettingError
from lab.units import TO_SI, si

if TYPE_CHECKING:
    import xarray as xr

    from lab.experiment import Experiment
    from lab.result import Result

FloatArray = NDArray[np.float64]

QUANTITIES = (
    *("position east", "position north", "position up"),
    *("velocity east", "velocity north", "velocity up"),
    *("roll", "pitch", "heading"),
    *STATES[9:15],
)
"""What the budget is made for: the error states as a person reads them."""

UNITS = ("m",) * 3 + ("m/s",) * 3 + ("°",) * 3 + ("°/s",) * 3 + ("mg",) * 3
"""Units of the quantities."""

INTERVAL = 1.0
"""Longest time between two epochs of a budget [s]."""

STAGE = 1.0
"""Width of the processes flicker is made of, in the logarithm of their correlation times."""

WAITING = slice(15, 21)  # the biases of x̂
OWN = slice(21, 24)  # c
SIZE = 24

IN_BUDGET = frozenset(
    (
        *("noise_density", "bias", "bias_sigma", "instability", "correlation_time"),
        *("flicker", "rate_random_walk", "vibration_density"),
        *("scale_factor", "scale_factor_sigma", "misalignment", "g_sensitivity", "range"),
        *("position_variance", "velocity_variance", "correlated_sigma", "period", "outages"),
    )
)
"""Settings of the sensors that the budget knows, or that are no errors as long as all is linear."""

GYRO, ACCELEROMETER, GPS_POSITION, GPS_VELOCITY = range(4)


class Constant(NamedTuple):
    """An error that stays as it is during a flight: independent numbers, one column each.

    Attributes
    ----------
    name
        Name of the source.
    start : (15, c) array
        Initial error states, one standard deviation of each number.
    coupling : (c, 6, 6) array
        Takes angular rate and specific force in b to the errors of gyros and accelerometers.
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
        What it disturbs: `GYRO`, `ACCELEROMETER`, `GPS_POSITION` or `GPS_VELOCITY`.
    variance : (3,) array
        Variance it settles at, body axes or north, east, down; of a random walk, its growth per second.
    time
        Correlation time [s]: 0 is white, from sample to sample or from fix to fix; infinite is a walk.
    settled
        Whether it has its variance from the start, or starts from zero.
    """

    name: str
    channel: int
    variance: FloatArray
    time: float = 0.0
    settled: bool = True

    def decay(self, elapsed: float) -> float:
        """Return what is left of a value after some time [s]."""
        return float(np.exp(-elapsed / self.time)) if self.time else 0.0

    def drive(self, elapsed: float) -> FloatArray:
        """Return the variance (3,) that is new after some time [s]."""
        if np.isinf(self.time):
            return self.variance * elapsed
        return self.variance * (1 - self.decay(elapsed) ** 2)


def error_budget(result: Result) -> xr.Dataset:
    """Return the error budget of a run.

    Parameters
    ----------
    result
        The run: its flight, its settings and the gains of its filter are used, its errors are not.

    Returns
    -------
    xr.Dataset
        ``sigma`` (source, time, quantity): one standard deviation that each source alone gives, in the
        `unit` of the quantity; of an error given by its value, its effect. ``share`` (source, time,
        quantity): its part of the variance [%]. ``total`` and ``believed`` (time, quantity): σ of all
        sources together, and σ according to the filter. Times are the start, the fixes used (after the fix),
        the end, and others so that none is more than a second from the next. Attribute `left_out`: settings
        that err and are not in the budget.

    Raises
    ------
    SettingError
        If the filter is not one whose gains act on these error states.
    """
    _check(result)
    experiment = result.experiment
    constants, processes = _constants(experiment), _processes(experiment, result.ideal.dt, result.time[-1])
    epochs = epochs_of(result)
    covariance = _Propagation(result, constants, processes).run(epochs)
    names = [*(source.name for source in constants), *(source.name for source in processes)]
    return _dataset(result, names, epochs, covariance)


def _check(result: Result) -> None:
    """Refuse filters whose covariance says nothing of the gains on these error states."""
    model = result.experiment.navigator.model
    if model not in MODELS:
        raise SettingError(
            f"navigator.model = {model!r}: the error budget needs the gains of a linear model; accepted here "
            f"is one of {', '.join(MODELS)}"
        )
    check_states(result)


def check_states(result: Result) -> None:
    """Refuse smoothed solutions, users' algorithms, and filters that estimate more than 15 states.

    Raises
    ------
    SettingError
        If this is one.
    """
    if result.algorithm:
        raise SettingError(
            f"{result.algorithm}: this analysis follows the gains of the filter, which an algorithm of your "
            "own does not give; accepted here is the navigator of the settings"
        )
    if result.experiment.navigator.smoother:
        raise SettingError(
            "navigator.smoother: this analysis follows the gains of the filter, which a smoothed solution "
            "does not have; accepted here is false"
        )
    states = result.belief.P0.shape[0]
    if states != N:
        raise SettingError(
            f"this analysis knows filters of {N} states, and this one has {states}; accepted here are those "
            "that estimate position, velocity, attitude and the biases"
        )


def _left_out(experiment: Experiment) -> list[str]:
    """Return the settings of the sensors that err and are not in the budget."""
    return [
        path
        for path, owner, name in experiment.sensors.leaves("sensors.")
        if name not in IN_BUDGET
        and not path.startswith("sensors.temperature.")
        and getattr(owner, name) != owner.param[name].default
    ]


def _constants(experiment: Experiment) -> list[Constant]:
    """Return the constant errors that are not zero."""
    navigator, sensors = experiment.navigator, experiment.sensors
    found: list[Constant] = []
    for name, block in (("position", POS), ("velocity", VEL), ("attitude", ATT)):
        found.append(_initial(f"initial {name}", block, np.diag(si(navigator, f"{name}_sigma"))))
    for number, (name, block) in enumerate((("gyro", GYRO_BIAS), ("accelerometer", ACCEL_BIAS))):
        errors = sensors.groups()[name]
        own = slice(3 * number, 3 * number + 3)
        # The estimate starts with zero: the error is the bias, with the other sign.
        found.append(_initial(f"{name} turn-on bias σ", block, -np.diag(si(errors, "bias_sigma"))))
        found.append(_initial(f"{name} turn-on bias, given", block, -si(errors, "bias")[None]))
        scale, M = np.diag(si(errors, "scale_factor")), np.zeros((3, 3))
        for axes, value in zip(OFF_DIAGONAL, si(errors, "misalignment"), strict=True):
            M["xyz".index(axes[0]), "xyz".index(axes[1])] = value
        drawn = np.einsum("c,ci,cj->cij", si(errors, "scale_factor_sigma"), np.eye(3), np.eye(3))
        found.append(_coupled(f"{name} scale factor σ", own, own, drawn))
        found.append(_coupled(f"{name} scale factor, given", own, own, scale[None]))
        found.append(_coupled(f"{name} misalignment", own, own, M[None]))
    sensitivity = np.diag(si(sensors.gyro, "g_sensitivity"))
    found.append(_coupled("gyro g-sensitivity", slice(0, 3), slice(3, 6), sensitivity[None]))
    return [source for source in found if source.start.any() or source.coupling.any()]


def _initial(name: str, block: slice, columns: FloatArray) -> Constant:
    """Return a source that is there at the start, from (c, 3) values of one block of states."""
    start = np.zeros((N, columns.shape[0]))
    start[block] = columns.T
    return Constant(name, start, np.zeros((columns.shape[0], 6, 6)))


def _coupled(name: str, rows: slice, columns: slice, matrices: FloatArray) -> Constant:
    """Return a source in proportion to rate or force, from (c, 3, 3) matrices."""
    coupling = np.zeros((matrices.shape[0], 6, 6))
    coupling[:, rows, columns] = matrices
    return Constant(name, np.zeros((N, matrices.shape[0])), coupling)


def _processes(experiment: Experiment, dt: float, duration: float) -> list[Process]:
    """Return the random processes that are not zero, those of the IMU first."""
    sensors = experiment.sensors
    found: list[Process] = []
    for channel, name in ((GYRO, "gyro"), (ACCELEROMETER, "accelerometer")):
        errors = sensors.groups()[name]
        time, instability = float(si(errors, "correlation_time")), si(errors, "instability") ** 2
        walk = si(errors, "rate_random_walk") ** 2
        found += [
            Process(f"{name} white noise", channel, si(errors, "noise_density") ** 2 / dt),
            Process(f"{name} bias instability", channel, instability, time),
            *_flicker(f"{name} flicker", channel, si(errors, "flicker"), dt, duration),
            Process(f"{name} random walk", channel, walk, np.inf, settled=False),
        ]
    vibration = si(sensors.accelerometer, "vibration_density") ** 2 / dt
    found.append(Process("vibration", ACCELEROMETER, vibration))
    for channel, name in ((GPS_POSITION, "position"), (GPS_VELOCITY, "velocity")):
        variance = si(sensors.gps, f"{name}_variance")[[1, 0, 2]]
        found.append(Process(f"GPS {name} noise", channel, variance))
    correlated = si(sensors.gps, "correlated_sigma")[[1, 0, 2]] ** 2
    time = float(si(sensors.gps, "correlation_time"))
    found.append(Process("GPS correlated position", GPS_POSITION, correlated, time))
    return [source for source in found if source.variance.any()]


def _flicker(name: str, channel: int, coefficient: FloatArray, dt: float, duration: float) -> list[Process]:
    """Return flicker that begins with nothing before it as first-order processes, one for each `STAGE`.

    Half an integral of white noise has the covariance (B² / π) ln((√t + √s)² / |t − s|). Processes of all
    correlation times that start from zero, B² / π for each unit of ln T, have (B² / π) ln((t + s) / |t − s|);
    what is missing hardly changes with time and is ln 2 where t and s are alike. The shortest correlation
    time, a quarter of a sample, gives the variance of the sampled process (Kasdin, Proc. IEEE 83, eq. 104).
    """
    density = coefficient**2 / np.pi
    times = np.exp(np.arange(np.log(dt / 4) + STAGE / 2, np.log(30 * duration), STAGE))
    constant = Process(name, channel, density * np.log(2), 1e6 * duration)
    return [constant, *(Process(name, channel, density * STAGE, time, settled=False) for time in times)]


class Epochs(NamedTuple):
    """Steps of a flight: IMU samples (e,), the fix at each or −1, and whether it is the last one there."""

    sample: NDArray[np.int64]
    fix: NDArray[np.int64]
    last: NDArray[np.bool_]


def epochs_of(result: Result) -> Epochs:
    """Return the start, the fixes used, the end, and samples between so that none is far from the next."""
    end = result.time.size - 1
    used = np.flatnonzero(result.solution_arrays.fix_sample >= 0)
    at_fix = result.solution_arrays.fix_sample[used]
    grid = np.append(np.arange(0, end, max(1, round(INTERVAL / result.ideal.dt))), end)
    grid = np.setdiff1d(grid, at_fix)
    sample = np.concatenate((at_fix, grid))
    order = np.argsort(sample, kind="stable")
    sample = sample[order]
    fix = np.concatenate((used, np.full(grid.size, -1)))[order]
    return Epochs(sample, fix, np.append(np.diff(sample) > 0, True))


class _Propagation:
    """Propagates the covariance of each source from epoch to epoch."""

    def __init__(self, result: Result, constants: list[Constant], processes: list[Process]) -> None:
        truth, ideal, belief = result.truth_arrays, result.ideal, result.belief
        self.flight = Flight(
            truth.latitude,
            truth.height,
            truth.velocity_n,
            truth.q_nb,
            ideal.dtheta,
            ideal.dvelocity,
            ideal.dt,
        )
        self.time = ideal.time
        self.jacobian = euler_jacobian(truth.euler)
        self.processes = processes
        self.inertial = [source for source in processes if source.channel <= ACCELEROMETER]
        self.fade = np.exp(-belief.bias_decay * ideal.dt)
        self.sampled = Processes(
            np.array([source.channel for source in self.inertial], dtype=np.int64),
            np.array([source.decay(ideal.dt) for source in self.inertial]),
            np.array([source.drive(ideal.dt) for source in self.inertial]).reshape(-1, 3),
        )
        # K = P⁺ Hᵀ R⁻¹, whatever P⁺ and R are worth (Gelb 4.2-16b).
        self.gain = result.solution_arrays.fix_covariance[:, :, :6] @ np.linalg.inv(belief.R)
        self.corrected = _corrections(result)
        self.widths = [source.start.shape[1] for source in constants]
        self.coupling = np.concatenate([source.coupling for source in constants])
        self.columns = np.zeros((WAITING.stop, sum(self.widths)))
        self.columns[:N] = np.concatenate([source.start for source in constants], axis=1)
        self.P = np.zeros((len(processes), SIZE, SIZE))
        for P, source in zip(self.P, processes, strict=True):
            if source.settled:
                P[OWN, OWN] = np.diag(source.variance)

    def run(self, epochs: Epochs) -> FloatArray:
        """Return the variances (source, kept epoch, quantity) in SI units."""
        out = np.zeros((len(self.widths) + len(self.processes), int(epochs.last.sum()), len(QUANTITIES)))
        room = Transition.empty(len(self.inertial))
        before, row = 0, 0
        for sample, fix, last in zip(*(part.tolist() for part in epochs), strict=True):
            self._propagate(before, sample, room)
            if fix >= 0:
                self._update(self.gain[fix], bool(self.corrected[fix]))
            if last:
                out[:, row] = self._variances(sample)
                row += 1
            before = sample
        return out

    def _propagate(self, first: int, last: int, step: Transition) -> None:
        """Go from one sample to another."""
        transition(self.flight, first, last, self.fade, self.sampled, step)
        A = np.eye(WAITING.stop)
        A[:NAV, :NAV] = step.navigation
        A[:NAV, NAV:N] = step.bias
        fade = np.diag(self.fade ** (last - first))
        A[:NAV, WAITING] = step.bias - step.fading
        A[NAV:N, WAITING] = np.eye(BIASES) - fade
        A[WAITING, WAITING] = fade
        self.columns = A @ self.columns
        self.columns[:NAV] += np.einsum("iab,cab->ic", step.coupled, self.coupling)
        B = np.zeros_like(self.P)
        B[:, : WAITING.stop, : WAITING.stop] = A
        Q = np.zeros_like(self.P)
        imu = len(self.inertial)
        B[:imu, :NAV, OWN] = self.sampled.decay[:, None, None] * step.process
        Q[:imu, :NAV, :NAV] = step.covariance
        Q[:imu, :NAV, OWN] = step.cross
        Q[:imu, OWN, :NAV] = step.cross.mT
        elapsed = (last - first) * self.flight.dt
        for p, source in enumerate(self.processes):
            B[p, OWN, OWN] = source.decay(elapsed) * np.eye(3)
            Q[p, OWN, OWN] = np.diag(source.drive(elapsed))
        self.P = B @ self.P @ B.mT + Q

    def _update(self, K: FloatArray, corrected: bool) -> None:
        """Take a fix with a gain K (15, 6)."""
        U = np.eye(WAITING.stop)
        U[:N, :6] -= K
        U[WAITING, :6] = K[NAV:]
        noise = np.concatenate((K, -K[NAV:]))
        if corrected:
            U[WAITING] = noise[WAITING] = 0.0
        self.columns = U @ self.columns
        B = np.zeros_like(self.P)
        B[:, : WAITING.stop, : WAITING.stop] = U
        B[:, OWN, OWN] = np.eye(3)
        for p, source in enumerate(self.processes):
            if source.channel == GPS_POSITION:
                B[p, : WAITING.stop, OWN] = noise[:, :3]
            elif source.channel == GPS_VELOCITY:
                B[p, : WAITING.stop, OWN] = noise[:, 3:]
        self.P = B @ self.P @ B.mT

    def _variances(self, sample: int) -> FloatArray:
        """Return the variances (source, quantity) at a sample."""
        T = np.zeros((len(QUANTITIES), N))
        T[0:3, POS] = T[3:6, VEL] = NED_TO_ENU
        T[6:9, ATT] = self.jacobian[sample]
        T[NAV:, NAV:] = np.eye(BIASES)
        squares = (T @ self.columns[:N]) ** 2
        parts = np.split(squares, np.cumsum(self.widths)[:-1], axis=1)
        constant = np.stack([part.sum(axis=1) for part in parts])
        seen = np.zeros((len(self.processes), len(QUANTITIES), SIZE))
        seen[:, :, :N] = T
        for p, source in enumerate(self.inertial):
            # The true bias includes the instability; white noise is none.
            if source.time:
                seen[p, NAV + 3 * source.channel : NAV + 3 * source.channel + 3, OWN] = np.eye(3)
        random = np.einsum("pqi,pij,pqj->pq", seen, self.P, seen, optimize=True)
        return np.concatenate((constant, random))


def _corrections(result: Result) -> NDArray[np.bool_]:
    """Return after which fixes (m,) the navigator was corrected."""
    navigator = result.experiment.navigator
    sample = result.solution_arrays.fix_sample
    corrected = np.zeros(sample.shape, dtype=np.bool_)
    if navigator.correction != "feedback":
        return corrected
    last, slack = result.time[0], 1e-6 * result.ideal.dt
    for m in np.flatnonzero(sample >= 0):
        if result.time[sample[m]] - last >= navigator.correction_period - slack:
            corrected[m], last = True, result.time[sample[m]]
    return corrected


def _dataset(result: Result, sources: list[str], epochs: Epochs, variance: FloatArray) -> xr.Dataset:
    """Return what `error_budget` returns."""
    import xarray as xr  # noqa: PLC0415 - takes a while to import, and a run does without

    names = list(dict.fromkeys(sources))
    variance = np.stack([variance[[name == source for source in sources]].sum(axis=0) for name in names])
    scale = np.array([1 / TO_SI[unit] for unit in UNITS])
    kept = epochs.sample[epochs.last]
    total = variance.sum(axis=0)
    share = 100 * np.divide(variance, total, out=np.zeros_like(variance), where=total > 0)
    dims = ("source", "time", "quantity")
    return xr.Dataset(
        {
            "sigma": (dims, np.sqrt(variance) * scale, {"long_name": "σ due to the source alone"}),
            "share": (dims, share, {"units": "%", "long_name": "part of the variance"}),
            "total": (dims[1:], np.sqrt(total) * scale, {"long_name": "σ of all sources together"}),
            "believed": (dims[1:], believed_sigma(result)[kept], {"long_name": "σ according to the filter"}),
        },
        coords={
            "source": names,
            "time": ("time", result.time[kept], {"units": "s", "long_name": "time"}),
            "quantity": list(QUANTITIES),
            "unit": ("quantity", list(UNITS)),
        },
        attrs={"left_out": ", ".join(_left_out(result.experiment))},
    )


def believed_sigma(result: Result) -> FloatArray:
    """Return σ of all `QUANTITIES` (n + 1, 15) according to the filter, in their `UNITS`."""
    sets = (*(result.sigma[name] for name in ("position", "velocity", "attitude")),)
    biases = (result.sensor_errors[f"{name}_bias_sigma"] for name in ("gyro", "accelerometer"))
    return np.concatenate([data.values for data in (*sets, *biases)], axis=1)
