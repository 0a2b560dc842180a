"""Candidate trials: the innovations of a run with another filter, or with a log that has another fault."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.identification.identification import HeldOut
from lab.analysis.identification.likelihood import InnovationSeries, squares
from lab.analysis.identification.log_faults import LogFault
from lab.analysis.identification.renavigation import Logged, Subject, subject
from lab.analysis.identification.withheld import held_out, outages
from lab.analysis.verdicts.finding import Change
from lab.analysis.verdicts.trial import Repeatable, apply_changes
from lab.base.arrays import Flags, FloatArray
from lab.base.parameters.setting_error import SettingError
from lab.base.processors import processors
from lab.data.log.sensor_log import SensorLog
from lab.run.experiment_settings import ExperimentSettings


class Candidate(NamedTuple):
    """A possible explanation, to be tried.

    Attributes
    ----------
    channel
        Where it is, as text.
    changes
        Changes of settings of the filter.
    fault
        The fault of the log, if it is one.
    price
        Price of its parameters, in log-likelihood.
    """

    channel: str
    changes: tuple[Change, ...] = ()
    fault: LogFault | None = None
    price: float = 0.0


class Outcome(NamedTuple):
    """The innovations with a candidate.

    Attributes
    ----------
    nis, degrees, size : (m,) arrays
        NIS of each fix, its degrees of freedom (0 without effect), and ln det S.
    price : float
        Price of the candidate.
    """

    nis: FloatArray
    degrees: NDArray[np.int64]
    size: FloatArray
    price: float

    @property
    def mean(self) -> float:
        """NIS per degree of freedom."""
        return float(self.nis.sum() / max(int(self.degrees.sum()), 1))

    def gain(self, other: Outcome) -> float:
        """Return the gain in log-likelihood over another outcome, on the fixes of both.

        Each has the scale of S that suits it best, so that an R that is wrong as a whole decides nothing.
        """
        both = (self.degrees > 0) & (other.degrees > 0)
        return self._likelihood(both) - other._likelihood(both)

    def _likelihood(self, rows: Flags) -> float:
        degrees = float(self.degrees[rows].sum())
        if not degrees:
            return -np.inf
        scale = max(float(self.nis[rows].sum()) / degrees, 1e-12)
        return -0.5 * (float(self.size[rows].sum()) + degrees * float(np.log(scale))) - self.price


class Trials:
    """The trials of a run: its innovations under candidates.

    Parameters
    ----------
    run
        A simulated run, or that of a log.
    log
        The log, or a part of it; None for a simulated run.
    """

    def __init__(self, run: Repeatable, log: SensorLog | None) -> None:
        self._run, self._log = run, log
        self._again = self._subject(log)

    def _subject(self, log: SensorLog | None) -> Subject:
        recorded = self._run.recorded
        return subject(self._run) if log is None or recorded is None else Logged(recorded._replace(log=log))

    @property
    def stamps(self) -> FloatArray:
        """Time stamps of the fixes (m,) [s]."""
        return self._again.stamps

    @cached_property
    def as_it_is(self) -> Outcome:
        """The innovations without any change.

        Raises
        ------
        ValueError
            If the run cannot be navigated again.
        """
        found = self.outcome(Candidate(""))
        if found is None:
            raise ValueError("the run cannot be navigated again")
        return found

    def seen(self, candidate: Candidate) -> InnovationSeries:
        """Return the innovations with a candidate."""
        again = self._again if candidate.fault is None else self._subject(candidate.fault.mended)
        withheld = np.zeros(self.stamps.size, np.bool_)
        return again.navigate(self.settings(candidate), withheld)[0]

    def settings(self, candidate: Candidate) -> ExperimentSettings:
        """Return the settings of a run with a candidate."""
        settings = apply_changes(self._run, candidate.changes)
        settings.set("navigator.smoother", False)
        settings.set("navigator.engine", "compiled")
        return settings

    def outcome(self, candidate: Candidate) -> Outcome | None:
        """Return the innovations with a candidate; None if the run cannot be navigated with it."""
        try:
            return summarize_innovations(self.seen(candidate), candidate.price)
        except (ValueError, SettingError, np.linalg.LinAlgError):
            return None

    def outcomes(self, candidates: Sequence[Candidate]) -> list[tuple[Candidate, Outcome]]:
        """Return the candidates with which the run can be navigated, and their innovations."""
        with ThreadPoolExecutor(max_workers=max(processors() - 1, 1)) as pool:
            found = zip(candidates, pool.map(self.outcome, candidates), strict=True)
            return [(one, outcome) for one, outcome in found if outcome is not None]

    def withheld(self, candidate: Candidate) -> HeldOut | None:
        """Return how well fixes withheld for some seconds are predicted; None without any."""
        again = self._again if candidate.fault is None else self._subject(candidate.fault.mended)
        masks = outages(self.stamps, *again.span)
        if not masks:
            return None
        try:
            return held_out(again, self.settings(candidate), masks, np.zeros(self.stamps.size, np.bool_))
        except (ValueError, np.linalg.LinAlgError):
            return None


def summarize_innovations(seen: InnovationSeries, price: float = 0.0) -> Outcome:
    """Return the outcome of innovations."""
    known = np.isfinite(seen.innovation)
    nis, degrees = squares(seen)
    at = np.arange(known.shape[1])
    S = np.where(known[:, :, None] & known[:, None, :], seen.covariance, 0.0)
    S[:, at, at] = np.where(known, S[:, at, at], 1.0)
    return Outcome(nis, degrees, np.linalg.slogdet(S)[1], price)
