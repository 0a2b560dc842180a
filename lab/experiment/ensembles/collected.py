"""Collected: the sums of runs, added run by run, and block by block.

A block is a fixed piece of the seeds, and its sums are made in the order of its seeds, by a thread here or by
a process elsewhere. The blocks are then joined in their order. Rounding is therefore always the same.
"""

from __future__ import annotations

import numpy as np

from lab.analysis import feedforward
from lab.analysis.verdicts.evidence import Evidence
from lab.experiment.ensembles.ensemble import QUANTITIES, Ensemble
from lab.experiment.ensembles.epoch_sums import EpochSums
from lab.experiment.ensembles.error_histogram import ErrorHistogram
from lab.experiment.ensembles.run_at_fixes import ChannelSums, RunAtFixes, mean_of_known
from lab.experiment.experiment import Experiment
from lab.navigation.checks import DivergedError

OF_RUN = np.dtype(
    [
        ("rms", np.float64, 9),
        ("largest", np.float64, 9),
        ("most", np.float64),
        ("at_outage_ends", np.float32, (2, 9)),
        ("mean_nees", np.float64),
        ("mean_nis", np.float64),
        ("seconds", np.float64),
    ]
)
"""What is kept of each run: 250 bytes, and 3 MB of 10,000 runs."""


class Collected:
    """The sums of the runs of an ensemble, and what is kept of each."""

    def __init__(self) -> None:
        self._seeds: list[int] = []
        self._degrees = 0, 0, 0
        self._algorithm = ""
        self._at_fixes, self._between = EpochSums(), EpochSums()
        self._histogram: ErrorHistogram | None = None
        self._innovations: ChannelSums | None = None
        self._of_runs = bytearray()
        self._evidence: list[Evidence] = []
        self._free: list[feedforward.FreeRun] = []
        self._diverged: dict[int, str] = {}
        self._count = 0

    def leave_out(self, seed: int, reason: str) -> None:
        """Note that the run of a seed diverged."""
        self._diverged[seed] = reason
        self._count += 1

    def add(self, seed: int, run: RunAtFixes) -> None:
        """Add the run of a seed; runs are added in the order of the ensemble's seeds."""
        if self._histogram is None or self._innovations is None:
            self._histogram = ErrorHistogram.over(*run.span, len(QUANTITIES))
            self._innovations = run.innovations
        else:
            self._innovations += run.innovations
        error, sigma = run.error, run.sigma
        with np.errstate(divide="ignore", invalid="ignore"):
            normalised = error / sigma
        unknown = np.isnan(error)
        within = {
            f"within {factor}": np.where(unknown, np.nan, np.abs(error) <= factor * sigma)
            for factor in (1, 3)
        }
        self._at_fixes.add(
            run.time,
            {
                "nees": run.nees,
                "nis": run.nis,
                "error": error,
                "product": error[:, :, None] * error[:, None, :],
                "variance": sigma**2,
                "normalised": normalised,
                **within,
            },
        )
        self._histogram.add(run.time, normalised)
        self._between.add(run.grid, {"nees": run.between})
        means = mean_of_known(run.nees), mean_of_known(run.nis)
        of_run = run.rms, run.largest, run.most, run.at_outage_ends, *means, run.seconds
        self._of_runs += np.array(of_run, OF_RUN).tobytes()
        if run.evidence is not None:
            self._evidence.append(run.evidence)
            self._free.append(run.free)
        self._seeds.append(seed)
        self._count += 1
        self._degrees, self._algorithm = (run.degrees, run.nis_degrees, run.between_degrees), run.algorithm

    def join(self, block: Collected) -> None:
        """Add the sums of the next block of runs, which stay as they are."""
        self._diverged |= block._diverged
        self._count += block._count
        if block._histogram is None or block._innovations is None:
            return
        if self._histogram is None or self._innovations is None:
            self._histogram, self._innovations = block._histogram.copy(), block._innovations
        else:
            self._histogram.join(block._histogram)
            self._innovations += block._innovations
        self._at_fixes.join(block._at_fixes)
        self._between.join(block._between)
        self._of_runs += block._of_runs
        self._evidence += block._evidence
        self._free += block._free
        self._seeds += block._seeds
        self._degrees, self._algorithm = block._degrees, block._algorithm

    def copy(self) -> Collected:
        """Return the sums so far, which further runs do not change."""
        twin = Collected()
        twin.join(self)
        return twin

    def __len__(self) -> int:
        """Return the number of runs so far, with those that diverged."""
        return self._count

    @property
    def has_evidence(self) -> bool:
        """Whether there is evidence for a verdict: not if all runs so far have diverged, or there is none."""
        return bool(self._evidence)

    def ensemble(self, experiment: Experiment, ended: str = "") -> Ensemble:
        """Return the ensemble of the runs so far, of which there must be one.

        Parameters
        ----------
        experiment
            The experiment.
        ended
            Why further runs are missing; see `Ensemble`.

        Raises
        ------
        DivergedError
            If all of them diverged.
        """
        if self._histogram is None or self._innovations is None:
            raise DivergedError(next(iter(self._diverged.values())))
        degrees, nis_degrees, between_degrees = self._degrees
        of_runs = np.frombuffer(self._of_runs, OF_RUN)
        return Ensemble(
            experiment=experiment.copy(),
            seeds=tuple(self._seeds),
            at_fixes=self._at_fixes.copy(),
            between=self._between.copy(),
            histogram=self._histogram.copy(),
            innovations=self._innovations,
            degrees=degrees,
            nis_degrees=nis_degrees,
            between_degrees=between_degrees,
            **{name: np.ascontiguousarray(of_runs[name]) for name in OF_RUN.names or ()},
            evidence=tuple(self._evidence),
            free=tuple(self._free),
            algorithm=self._algorithm,
            diverged=dict(self._diverged),
            ended=ended,
            whole=True,
        )
