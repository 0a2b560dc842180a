"""Lane results: what is kept of each run abreast, and the evidence of its filter.

The samples that are stored are those of all runs: a second apart, at the fixes, and at both ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.analysis import consistency, fix_causes, fix_figures
from lab.analysis.budget import sigma_of_quantities
from lab.analysis.errors import choose_path_samples, compute_errors, error_state, outage_ends
from lab.analysis.feedforward import CORRECTED
from lab.analysis.fix_figures import FixFigures, TruthArrays
from lab.analysis.verdicts.evidence import Evidence, between_fixes, evidence, whole_seconds
from lab.analysis.verdicts.innovation_evidence import may_have_outliers, offered
from lab.analysis.verdicts.lane_evidence import Abreast, evidence_abreast, uncertain_states
from lab.analysis.verdicts.sensor_evidence import sensor_errors, sensor_errors_abreast
from lab.analysis.verdicts.true_motion import Exact, Reference, exact_motion_in_windows, window_means
from lab.base.arrays import FloatArray
from lab.experiment.ensembles.lane_runs import (
    Judged,
    Navigated,
    Places,
    Samples,
    Sensed,
    channel_sums,
    diverged,
    used_fixes,
)
from lab.experiment.ensembles.run_at_fixes import (
    WIDE,
    WITHOUT_ENDS,
    ChannelSums,
    RunAtFixes,
    figures_of_run,
    quantile_of_horizontal,
    rms_at_ends,
)
from lab.experiment.result import Runnable
from lab.experiment.sensor_stages import SampledFlight
from lab.motion.frames.rotation import euler_from_quaternion
from lab.navigation.belief import assumed_latency, bias_processes, hidden_by_fixes, of_bias_states
from lab.navigation.filters.blocks import GYRO_G, SCALES
from lab.navigation.filters.error_models import POS, ErrorModel
from lab.navigation.filters.kalman import MEASUREMENTS
from lab.navigation.filters.schedule import SLACK
from lab.navigation.kernels.lanes import LaneSolution
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import Imu, Solution
from lab.run.further_truth import errors_of_states, felt_by_gyros, further_truth
from lab.run.run import at_samples
from lab.sensors import temperature as thermal
from lab.sensors.suite import SensorSuite


class LaneResults:
    """What is kept of the runs abreast of one experiment.

    Parameters
    ----------
    experiment
        The settings; the seed has no effect.
    model
        The model of the filter.
    flight
        The flight of all runs.
    fix_time : (m,) array
        True times of the fixes [s].
    along
        Whether σ of the filter is asked for along the path.

    Attributes
    ----------
    stored, path : arrays
        The samples whose solution is stored, and those whose motion is.
    """

    def __init__(
        self,
        experiment: Runnable,
        model: ErrorModel,
        flight: SampledFlight,
        fix_time: FloatArray,
        *,
        along: bool = False,
    ) -> None:
        self._model = model
        sensors: SensorSuite = experiment.sensors
        navigator: NavigatorSettings = experiment.navigator
        self._sensors, self._navigator = sensors, navigator
        self._further = further_truth(experiment, model.blocks, np.zeros(1))[0]
        # What gyros feel of the specific force depends on the seed, as their scale factors do.
        self._feels = GYRO_G in model.blocks
        same = tuple(name for name in model.blocks if name != GYRO_G)
        self._of_states = errors_of_states(experiment, same, flight.ideal)
        self._of_bias_states = of_bias_states(sensors, navigator)
        self._truth, self._ideal = flight.truth, flight.ideal
        self._latency = assumed_latency(navigator, sensors.gps.latency)
        self._drive = bias_processes(self._of_bias_states)[0]
        self._hidden = hidden_by_fixes(sensors)
        self._exact: tuple[Exact, Exact] | None = None
        self._span = float(self._truth.time[0]), float(self._truth.time[-1])
        time = self._truth.time
        fixed = self._find_due_samples(fix_time - self._latency)
        seconds = whole_seconds(time)
        self._before = np.maximum(seconds - 1, 1)
        ends = np.array([0, min(1, time.size - 1), time.size - 1])
        self._outage_ends = outage_ends(time, sensors.gps.outages)
        self._grid = choose_path_samples(time, float(self._sensors.gps.period))
        stored = (
            ends,
            fixed - 1,
            fixed,
            seconds,
            self._before,
            self._outage_ends,
            self._grid[: along * time.size],
        )
        self.stored = np.unique(np.concatenate(stored))
        self._width = fix_causes.window_width(time)
        first = np.maximum(fixed - 1 - self._width, 0)
        self.path = np.unique(np.concatenate((self._grid, self.stored, first)))
        self._of_outage_ends = np.searchsorted(self.stored, self._outage_ends)
        self._true_ends = self._truth.taken(self._outage_ends)
        self._of_grid = np.searchsorted(self.path, self._grid)
        self._of_before = np.searchsorted(self.stored, self._before)
        self._there = self._truth.taken(self.stored)
        self._true_there = TruthArrays.of(self._there)
        self._on_grid = self._truth.taken(self._grid)
        self._true_path = TruthArrays.of(self._on_grid)
        profile = self._sensors.temperature
        self._temperature = (
            thermal.temperature(profile, time[1:], self._truth.height[1:] - self._truth.height[0])
            if profile.profile != "none"
            else None
        )

    def means(self, increments: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the mean increments (windows, 6, LANES) in the windows of the tests of the sensors."""
        short, long = self._true_motion()
        means = window_means(increments, short)
        return means, means if long is short else window_means(increments, long)

    def kept(self, runs: Sequence[Navigated], seconds: float) -> list[RunAtFixes | None]:
        """Return what is kept of runs that are not judged; None of one that diverged, for a run alone.

        Parameters
        ----------
        runs
            The lane, sensors and solution of each run.
        seconds
            Computing time of each [s].
        """
        found = list[RunAtFixes | None]([None] * len(runs))
        shown = {
            place: self._in_stored(navigated.solution)
            for place, (_, _, navigated) in enumerate(runs)
            if not diverged(navigated)
        }
        sums = channel_sums([used_fixes(solution) for solution in shown.values()])
        for (place, solution), own in zip(shown.items(), sums, strict=True):
            _, one, navigated = runs[place]
            figures = self._figures(one, solution, navigated.motion, self._of_before)
            found[place] = self._run(one, solution, figures, seconds, own)
        return found

    def judged(
        self, runs: Sequence[Navigated], seconds: float, increments: FloatArray
    ) -> list[RunAtFixes | None]:
        """Return what is kept of runs that are judged; None of one that must be run alone.

        That is one that diverged, or whose innovations may have outliers, which need all samples.

        Parameters
        ----------
        runs
            The lane, sensors and solution of each run.
        seconds
            Computing time of each [s].
        increments : (n, 6, LANES) array
            What the sensors measured.
        """
        whole, places = self.means(increments), self._places(runs[0][1])
        judged = list[Judged]()
        for place, (lane, one, navigated) in enumerate(runs):
            if not diverged(navigated):
                solution = self._in_stored(navigated.solution)
                figures = self._figures(one, solution, navigated.motion, places.judged)
                means = whole[0][..., lane], whole[1][..., lane]
                judged.append(Judged(place, lane, one, navigated, solution, figures, means))
        alike = dict[bytes, list[Judged]]()
        for run in judged:
            alike.setdefault(self._common_key(run, places), []).append(run)
        alone = [[run] for run in alike.pop(b"", [])]
        doubtful = set[int]().union(*(self._find_doubtful_runs(group) for group in (*alike.values(), *alone)))
        evidences = dict[int, Evidence | None]()
        for group in alike.values():
            sure = [run for run in group if run.place not in doubtful]
            found = self._judge_abreast(sure, places, increments) if sure else []
            if len(sure) > 1 and None in found:  # one of them may have spoilt the others
                found = [one for run in sure for one in self._judge_abreast([run], places, increments)]
            evidences |= zip((run.place for run in sure), found, strict=True)
        kept = list[RunAtFixes | None]([None] * len(runs))
        for run in judged:
            if run.place not in doubtful:
                own = evidences.get(run.place) or self._evidence(run)
                sums = ChannelSums.of(own.innovations)
                kept[run.place] = self._run(run.one, run.solution, run.figures, seconds, sums, own)
        return kept

    def _find_due_samples(self, times: FloatArray) -> Samples:
        """Return the samples at which fixes valid at some times are due."""
        samples = np.searchsorted(self._truth.time, times - SLACK * self._ideal.dt)
        return samples[(samples > 0) & (samples < self._truth.time.size)]

    def _places(self, one: Sensed) -> Places:
        """Return where a run with all of its fixes is judged."""
        fixes = np.searchsorted(self.stored, self._find_due_samples(one.seen.time))
        between = between_fixes(self._there.time, fixes)
        return Places(fixes, np.concatenate((self._of_before, between)))

    def _find_doubtful_runs(self, runs: Sequence[Judged]) -> set[int]:
        """Return the places of the runs that may have outliers; all have as many used or rejected fixes."""
        if not runs:
            return set()
        seen = (run.solution.fix_rejected | (run.solution.fix_sample >= 0) for run in runs)
        pairs = [
            (run.solution.innovation[own], run.solution.innovation_covariance[own])
            for run, own in zip(runs, seen, strict=True)
        ]
        doubtful = may_have_outliers(*(np.stack(part) for part in zip(*pairs, strict=True)))
        return {run.place for run, is_one in zip(runs, doubtful, strict=True) if is_one}

    def _run(
        self,
        one: Sensed,
        solution: Solution,
        found: FixFigures,
        seconds: float,
        sums: ChannelSums,
        judged: Evidence | None = None,
    ) -> RunAtFixes:
        """Return what is kept of a run."""
        P, nu, S = used_fixes(solution)
        # Where P is singular, the compiled figures are NaN, and the pseudoinverse decides.
        nees = found.nees if np.isfinite(found.nees).all() else consistency.normalised_squares(found.x, P)
        nis = found.nis if np.isfinite(found.nis).all() else consistency.normalised_squares(nu, S)
        return RunAtFixes(
            time=one.fixes.time[solution.fix_sample >= 0],
            nees=nees,
            nis=nis,
            grid=self._truth.time[self._before],
            between=found.between[: self._before.size],
            between_degrees=3,
            error=found.error,
            sigma=found.sigma,
            rms=found.rms,
            largest=found.largest,
            most=quantile_of_horizontal(found.horizontal),
            at_outage_ends=self._errors_at_outage_ends(solution),
            degrees=int(consistency.find_uncertain_states(P).size) if P.size else 0,
            nis_degrees=MEASUREMENTS,
            innovations=sums,
            span=self._span,
            evidence=judged,
            free=CORRECTED,
            seconds=seconds,
            algorithm="",
        )

    def _common_key(self, run: Judged, places: Places) -> bytes:
        """Return what runs that are judged abreast have in common; empty for a run that is judged alone."""
        solution, fixes = run.solution, places.fixes
        regular = (
            run.one.constants is None
            and solution.fix_sample.size == fixes.size > 1
            and bool((solution.fix_sample == fixes).all())
            and bool((solution.variance[places.judged][:, POS] > 0).all())
        )
        return uncertain_states(solution) if regular else b""

    def _judge_abreast(
        self, runs: Sequence[Judged], places: Places, increments: FloatArray
    ) -> list[Evidence | None]:
        """Return the evidence of runs that are alike; None of one that is judged alone."""
        ones = [run.one for run in runs]
        solutions = [run.solution for run in runs]
        short, long = ([run.means[part] for run in runs] for part in range(2))
        sensors = sensor_errors_abreast(
            ones[0].belief,
            [one.imu(self._truth.time) for one in ones],
            [self._whole_reference(one) for one in ones],
            self._true_motion(),
            (np.stack(short), np.stack(long)),
        )
        found = Abreast(
            solutions,
            ones[0].belief,
            [one.seen for one in ones],
            self._there.time[places.fixes],
            self._motions(runs, places.fixes, increments),
            self._begun(runs),
            np.stack([run.figures.x for run in runs]),
            np.stack([run.figures.nees for run in runs]),
            np.stack([run.figures.nis for run in runs]),
            self._there.time[places.judged[self._before.size :]],
            np.stack([run.figures.between[self._before.size :] for run in runs]),
            sensors,
            self._model.blocks,
            float(self._navigator.gate),
            self._latency,
        )
        return evidence_abreast(found, self._truth)

    def _begun(self, runs: Sequence[Judged]) -> FloatArray:
        """Return the errors of all states at the start, (runs, n)."""
        shown = {
            name: np.stack([getattr(run.solution, name)[0] for run in runs])
            for name in ("position", "velocity_n", "q_nb", "bias", "scale", "further")
        }
        errors = zip(*(self._true_errors(run.one) for run in runs), strict=True)
        bias, scale = (np.stack([values[0] for values in one]) for one in errors)
        there = self._there.taken(np.zeros(len(runs), dtype=np.int64))
        further = np.tile(self._further, (len(runs), 1))
        begun = runs[0].solution._replace(**shown)
        return error_state(begun, np.arange(len(runs)), there, bias, scale, further)

    def _figures(self, one: Sensed, solution: Solution, motion: FloatArray, before: Samples) -> FixFigures:
        """Return the figures of a run, with NEES of the position at some of the stored samples."""
        bias, scale = self._true_errors(one)
        path = np.ascontiguousarray(motion[self._of_grid])
        return fix_figures.fix_figures(
            solution, before, self._true_there, bias, scale, self._further, path, self._true_path
        )

    def figures(self, runs: Sequence[Navigated], seconds: float) -> list[FloatArray | None]:
        """Return the figures of runs that a sweep keeps; None of one that must be run alone."""
        at = np.searchsorted(self.stored, self._grid)
        return [
            None if run is None else figures_of_run(run, self._sigma(navigated.solution, at))
            for run, (_, _, navigated) in zip(self.kept(runs, seconds), runs, strict=True)
        ]

    def _errors_at_outage_ends(self, solution: Solution) -> NDArray[Any]:
        """Return the root mean square (2, 9) of errors and σ of a run at the ends of the outages."""
        at = self._of_outage_ends
        if not at.size:
            return WITHOUT_ENDS
        error = compute_errors(
            solution.position[at], solution.velocity_n[at], solution.q_nb[at], self._true_ends
        )
        return rms_at_ends(error, self._sigma(solution, at))

    def _sigma(self, solution: Solution, at: NDArray[np.intp]) -> FloatArray:
        """Return σ (k, 9) of the errors at some of the stored samples."""
        euler, covariance = euler_from_quaternion(solution.q_nb[at]), solution.covariance[at]
        return sigma_of_quantities(euler, solution.variance[at], covariance, self._model.blocks)[:, :WIDE]

    def _in_stored(self, solution: Solution) -> Solution:
        """Return a solution whose fixes tell their places among the stored samples."""
        at = np.searchsorted(self.stored, solution.fix_sample)
        return solution._replace(fix_sample=np.where(solution.fix_sample >= 0, at, -1))

    def _evidence(self, run: Judged) -> Evidence:
        """Return the evidence of a run that is judged alone."""
        one, solution = run.one, run.solution
        stored = Imu(self._truth.time[self.stored], one.gyro.increments[:0], one.accelerometer.increments[:0])
        _, samples = offered(solution, one.seen, stored)
        window = self._window(samples)
        turned = fix_causes.sums_between(one.gyro.increments, *window)
        flown = self._motion_in_window(solution, run.navigated, samples, window)
        return evidence(
            solution,
            one.belief,
            one.seen,
            stored,
            self._reference(one),
            gate=float(self._navigator.gate),
            latency=self._latency,
            explain=False,
            names=self._model.blocks,
            motion=self._motion_at_fixes(samples, window, turned, *flown),
            sensors=sensor_errors(
                one.belief,
                one.imu(self._truth.time),
                self._whole_reference(one),
                self._true_motion(),
                run.means,
            ),
        )

    def _motions(
        self, runs: Sequence[Judged], samples: Samples, increments: FloatArray
    ) -> fix_causes.MotionAtFixes:
        """Return the motion of runs that are alike at the fixes, (runs, m, …) each."""
        window = self._window(samples)
        turned = fix_causes.sums_between(increments[:, :3], *window)[..., [run.lane for run in runs]]
        flown = [self._motion_in_window(run.solution, run.navigated, samples, window) for run in runs]
        return self._motion_at_fixes(
            samples,
            window,
            np.moveaxis(turned, -1, 0),
            *(np.stack(parts) for parts in zip(*flown, strict=True)),
        )

    def _window(self, samples: Samples) -> tuple[Samples, Samples]:
        """Return the first and the last sample of the window before stored samples, given their places."""
        last = np.maximum(self.stored[samples] - 1, 0)
        return np.maximum(last - self._width, 0), last

    def _motion_in_window(
        self, solution: Solution, navigated: LaneSolution, samples: Samples, window: tuple[Samples, Samples]
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return velocities at both ends of the windows before samples, attitudes, and velocities gained."""
        here = np.searchsorted(self.stored, window[1])
        before = navigated.motion[np.searchsorted(self.path, window[0]), 3:6]
        gained = navigated.force[np.append(samples, self.stored.size - 1)]
        return before, solution.velocity_n[here], solution.q_nb[here], gained

    def _motion_at_fixes(
        self,
        samples: Samples,
        window: tuple[Samples, Samples],
        turned: FloatArray,
        before: FloatArray,
        velocity_n: FloatArray,
        q_nb: FloatArray,
        gained: FloatArray,
    ) -> fix_causes.MotionAtFixes:
        """Return the motion at stored samples, whose places are given."""
        ends = np.append(self.stored[samples], self.stored[-1])
        return fix_causes.motion_of(
            self._truth.time, window, (before, velocity_n), q_nb, turned, ends, gained
        )

    def _reference(self, one: Sensed) -> Reference:
        """Return the truth at the stored samples, with that of the flight to interpolate in."""
        bias, scale = self._true_errors(one)
        return Reference(
            self._there,
            bias,
            self._ideal.dtheta,
            self._ideal.dvelocity,
            scale,
            further=np.broadcast_to(self._further, (self.stored.size, self._further.size)),
            flight=self._truth,
        )

    def _true_errors(self, one: Sensed) -> tuple[FloatArray, FloatArray]:
        """Return true biases and scale factors (k, 6) at the stored samples; without states, (k, 0)."""
        at = np.maximum(self.stored - 1, 0)
        gyro, accelerometer = one.gyro, one.accelerometer
        bias = np.concatenate((gyro.bias[at], accelerometer.bias[at]), axis=1)
        if self._feels:
            ideal = self._ideal
            bias[:, :3] -= felt_by_gyros(self._sensors.gyro, one.seed, ideal.dvelocity[at], ideal.dt)
        if not set(self._model.blocks) & set(SCALES):
            return bias, np.zeros((at.size, 0))
        return bias, np.concatenate((gyro.scale[at], accelerometer.scale[at]), axis=1)

    def _true_motion(self) -> tuple[Exact, Exact]:
        """Return the true motion in windows, which is that of all runs."""
        if self._exact is None:
            ideal = self._ideal
            true = Reference(
                self._truth,
                self._truth.time[:0],
                ideal.dtheta,
                ideal.dvelocity,
                temperature=self._temperature,
            )
            self._exact = exact_motion_in_windows(true, self._truth.time)
        return self._exact

    def _whole_reference(self, one: Sensed) -> Reference:
        """Return the truth at all samples."""
        scaled = set(self._model.blocks) & set(SCALES)
        gyro, of_states, ideal = one.gyro.bias, self._of_states, self._ideal
        if self._feels:
            felt = felt_by_gyros(self._sensors.gyro, one.seed, ideal.dvelocity, ideal.dt)
            gyro, of_gyros = gyro - felt, np.concatenate((felt, np.zeros_like(felt)), axis=1)
            of_states = of_gyros if of_states is None else of_states + of_gyros
        return Reference(
            self._truth,
            at_samples(gyro, one.accelerometer.bias),
            self._ideal.dtheta,
            self._ideal.dvelocity,
            at_samples(one.gyro.scale, one.accelerometer.scale) if scaled else None,
            self._temperature,
            (one.gyro.saturated, one.accelerometer.saturated),
            self._drive if one.constants is None else bias_processes(self._of_bias_states, one.constants)[0],
            of_states=of_states,
            hidden=self._hidden,
        )
