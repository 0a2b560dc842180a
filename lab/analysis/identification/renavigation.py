"""Renavigation: a run navigated again with other settings of the filter, and with withheld fixes.

The sensor output does not change: it is that of the simulated run or of the log.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lab.analysis.fix_causes import Ends, gains, motion_at_fixes, windows
from lab.analysis.identification.likelihood import InnovationSeries
from lab.analysis.verdicts.innovation_evidence import offered
from lab.analysis.verdicts.run_evidence import Filtered
from lab.base.arrays import Flags, FloatArray
from lab.navigation import navigator as linear
from lab.navigation.alignment.alignment import Alignment
from lab.navigation.belief import assumed_latency, assumed_lever_arm, belief, schedule_filter
from lab.navigation.filters import unscented
from lab.navigation.filters.kalman import MEASUREMENTS
from lab.navigation.kernels.flight_piece import FlightPiece
from lab.navigation.log_navigation import WITHHELD, navigate_log
from lab.navigation.model_choice import chosen_model
from lab.navigation.solution import Fixes, Imu, Solution
from lab.navigation.standstill import at_rest
from lab.run.experiment_settings import ExperimentSettings
from lab.run.memory import release_pages
from lab.run.run import Recorded, Run

UNSMOOTHED = ("innovation", "innovation_covariance", "fix_sample", "fix_rejected", "fix_H", "fix_R")
"""Arrays of a solution that a smoother does not change."""
_ROUNDING = 1e-9  # of time stamps [s]


class Subject(Protocol):
    """A run that can be navigated again.

    Attributes
    ----------
    stamps : (m,) array
        Time stamps of all its fixes [s].
    span : (float, float)
        Start and end of the IMU data [s].
    """

    stamps: FloatArray
    span: tuple[float, float]

    def navigate(
        self, experiment: ExperimentSettings, withheld: Flags
    ) -> tuple[InnovationSeries, InnovationSeries]:
        """Return the innovations of all fixes twice: with the S of the filter, and with H P Hᵀ + R.

        Parameters
        ----------
        experiment
            Settings; only the filter's assumptions are used.
        withheld : (m,) array
            Mask of the fixes without effect on the filter.
        """


class Simulated:
    """A simulated run."""

    def __init__(self, run: Run) -> None:
        run.true_flight("identification")
        self.stamps = run.fixes.time
        self.span = (float(run.time[0]), float(run.time[-1]))
        self._fixes = run.fixes
        settings = run.experiment
        navigator = settings.navigator
        assert run.aligned is not None  # of a simulated run
        self._start = run.aligned.start
        self._constants = run.aligned.P if navigator.alignment else None
        self._imu, _ = sensor_data_of_run(run)
        self._aids = run.aids

    def navigate(
        self, experiment: ExperimentSettings, withheld: Flags
    ) -> tuple[InnovationSeries, InnovationSeries]:
        """Return the innovations of all fixes; see `Subject`."""
        navigator, imu = experiment.navigator, self._imu
        assumed = belief(experiment.sensors, navigator, self._constants)
        R = np.broadcast_to(assumed.R, (self.stamps.size, MEASUREMENTS, MEASUREMENTS))
        given = R + WITHHELD**2 * np.eye(MEASUREMENTS) * withheld[:, None, None]
        latency = assumed_latency(navigator, experiment.sensors.gps.latency)
        fixes = Fixes(self.stamps - latency, self._fixes.position, self._fixes.velocity_n)
        schedule = schedule_filter(navigator, imu.step, imu.dtheta.shape[0])
        model, aids = chosen_model(navigator, experiment.sensors), self._aids
        arguments = (imu, fixes, self._start, assumed._replace(R=given), schedule)
        if navigator.model == "nonlinear":
            dtheta, dvelocity = (
                values.astype(np.float64, copy=False) for values in (imu.dtheta, imu.dvelocity)
            )
            imu = imu._replace(dtheta=dtheta, dvelocity=dvelocity)
            solution = unscented.navigate(imu, *arguments[1:], aids=aids, names=model.blocks)
        else:
            solution = linear.navigate(*arguments, model, aids=aids)
        return _read_innovations(solution), _predict_innovations(solution, R)


class Logged:
    """A sensor log.

    The start is determined once for each latency, because matching velocities takes longer than navigating.
    Another lever arm only shifts it.
    """

    def __init__(self, recorded: Recorded) -> None:
        self._log = recorded.log
        self._starts: dict[float, tuple[Alignment, FloatArray]] = {}  # with its lever arm
        self.stamps = recorded.log.gnss.time
        self.span = (float(recorded.time[0]), float(recorded.time[-1]))

    def navigate(
        self, experiment: ExperimentSettings, withheld: Flags
    ) -> tuple[InnovationSeries, InnovationSeries]:
        """Return the innovations of all fixes; see `Subject`."""
        sensors, navigator = experiment.sensors, experiment.navigator
        latency = assumed_latency(navigator, self._log.gnss.latency)
        arm = assumed_lever_arm(navigator, self._log.gnss.lever_arm)
        start = None
        if latency in self._starts:
            found, of = self._starts[latency]
            start = found.with_longer_arm(arm - of)
        run = navigate_log(self._log, sensors, navigator, sensors.gps.outages, withheld, start)
        self._starts.setdefault(latency, (run.alignment, arm))
        rows = np.searchsorted(self.stamps - latency, run.fixes.time - _ROUNDING)
        return (
            self._spread_over_fixes(_read_innovations(run.solution), rows),
            self._spread_over_fixes(_predict_innovations(run.solution, run.belief.R), rows),
        )

    def _spread_over_fixes(self, seen: InnovationSeries, rows: NDArray[np.intp]) -> InnovationSeries:
        """Return the innovations of all fixes, with NaN for those outside the time of the run."""
        innovation = np.full((self.stamps.size, MEASUREMENTS), np.nan)
        covariance = np.tile(np.eye(MEASUREMENTS), (self.stamps.size, 1, 1))
        innovation[rows], covariance[rows] = seen
        return InnovationSeries(innovation, covariance)


def subject(run: Run) -> Subject:
    """Return the object that navigates a run again."""
    return Logged(run.recorded) if run.recorded else Simulated(run)


class _Gathered:
    """What the evidence needs of a filter's own run besides its attitude, gathered piece by piece.

    P, H, R and S of a fix are forgotten once its gain is known: in four hours they take 75 MB.

    Parameters
    ----------
    fixes, samples : (m,) arrays
        Indices and samples of the offered fixes.
    time : (n + 1,) array
        Times of the samples [s].
    states
        Number of states of the filter.

    Attributes
    ----------
    gains : (m, states, 6) array
        As of `fix_causes.gains`.
    """

    def __init__(
        self, fixes: NDArray[np.intp], samples: NDArray[np.intp], time: FloatArray, states: int
    ) -> None:
        self.gains = np.zeros((fixes.size, states, MEASUREMENTS))
        self._fixes, self._samples = fixes, samples
        self._ends = windows(samples, time)
        self._wanted = np.unique(np.concatenate(self._ends))
        self._velocity_n = np.empty((self._wanted.size, 3))

    @property
    def velocity(self) -> Ends:
        """Velocities (m, 3) at the ends of the windows before the fixes [m/s]."""
        first, last = (self._velocity_n[np.searchsorted(self._wanted, end)] for end in self._ends)
        return first, last

    def __call__(self, piece: FlightPiece, written: slice) -> None:
        """Take what is wanted of a piece."""
        edges = piece.before + written.start, piece.before + written.stop
        rows = slice(*np.searchsorted(self._wanted, edges))
        self._velocity_n[rows] = piece.out.velocity_n[self._wanted[rows] - piece.before]
        done = slice(*np.searchsorted(self._samples, edges))
        fixes = self._fixes[done]
        if fixes.size:
            self.gains[done] = gains(piece.out, fixes)
            for name in ("fix_covariance", "fix_H", "fix_R", "innovation_covariance"):
                release_pages(getattr(piece.out, name)[: fixes[-1] + 1])


def filter_run(run: Run) -> Filtered:
    """Return the filter's own run for a simulated run that was smoothed; a long one has few histories.

    Only the navigation is computed again; see `navigator.navigate_to_fixes`.
    """
    assert run.aligned is not None  # of a simulated run
    assert run.ideal is not None
    navigator = run.experiment.navigator
    imu, fixes = sensor_data_of_run(run)
    schedule = schedule_filter(navigator, run.ideal.dt, imu.dtheta.shape[0])
    model = chosen_model(navigator, run.experiment.sensors)
    if not run.is_long:
        given = imu, fixes, run.aligned.start, run.belief, schedule, model
        return Filtered(linear.navigate(*given, aids=run.aids))
    seen, samples = offered(run.solution_arrays, fixes, imu)
    gathered = _Gathered(seen, samples, imu.time, run.solution_arrays.states)
    found = linear.navigate_to_fixes(
        imu, fixes, run.aligned.start, run.belief, schedule, model, run.aids, gathered
    )
    # A smoother leaves the other data of the fixes as they are.
    same = {name: getattr(run.solution_arrays, name) for name in UNSMOOTHED}
    solution = found._replace(fix_covariance=found.fix_covariance[:0].copy(), **same)
    return Filtered(solution, motion_at_fixes(solution, samples, imu, gathered.velocity), gathered.gains)


def sensor_data_of_run(run: Run) -> tuple[Imu, Fixes]:
    """Return the increments and the fixes of a simulated run as its filter got them."""
    imu = Imu(run.time, run.gyro.increments, run.accelerometer.increments)
    fixes = Fixes(run.fix_validity, run.fixes.position, run.fixes.velocity_n)
    if run.experiment.navigator.rest_updates:
        imu = imu._replace(rest=at_rest(imu, fixes, run.belief))
    return imu, fixes


def _read_innovations(solution: Solution) -> InnovationSeries:
    return InnovationSeries(solution.innovation, solution.innovation_covariance)


def _predict_innovations(solution: Solution, R: FloatArray) -> InnovationSeries:
    """Return innovations with their covariance H P Hᵀ + R by the P after each fix.

    A withheld fix does not change P. The filter's own S for it would be the difference of large numbers.
    """
    H = solution.fix_H
    S = H @ solution.fix_covariance @ np.swapaxes(H, 1, 2) + R
    known: Flags = np.asarray(np.isfinite(S).all(axis=(1, 2)))
    S[~known] = np.eye(MEASUREMENTS)
    return InnovationSeries(np.where(known[:, None], solution.innovation, np.nan), S)
