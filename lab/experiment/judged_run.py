"""Judged run: the evidence of a run about its filter, and the verdict from it."""

from __future__ import annotations

from abc import abstractmethod
from functools import cached_property
from typing import TYPE_CHECKING

from lab.analysis import feedforward
from lab.analysis.verdicts import linear_verdict, state_advice, suggestion, trial
from lab.analysis.verdicts.algorithm_verdict import judge
from lab.analysis.verdicts.evidence import Evidence
from lab.analysis.verdicts.run_evidence import collect_evidence
from lab.analysis.verdicts.run_means import NEES
from lab.analysis.verdicts.trial import Repeatable
from lab.analysis.verdicts.verdict import Verdict
from lab.base.progress import Progress
from lab.run.experiment_settings import ExperimentSettings
from lab.run.memory import give_back

if TYPE_CHECKING:
    from lab.analysis.identification.identification import Identification


class JudgedRun(Repeatable):
    """A run with its evidence, its verdict, and what its innovations identify, each made at its first use."""

    @abstractmethod
    def repeated(self, experiment: ExperimentSettings) -> JudgedRun:
        """Return the run with a changed copy of its settings."""

    @cached_property
    def free_run(self) -> feedforward.FreeRun:
        """How far the navigator runs free."""
        return feedforward.measure_free_run(self)

    @cached_property
    def verdict(self) -> Verdict:
        """The verdict on the filter, from errors and innovations."""
        if self.evidence.nees is None:
            return self.innovation_verdict
        found = self._of_linear(judge(self.evidence), self.evidence)
        return (
            found if self.algorithm else state_advice.advise_simulated(found, self.experiment, self.belief.P0)
        )

    @cached_property
    def tried_verdict(self) -> Verdict:
        """The verdict with the effect of its advice; advice that makes things worse is not given.

        It also has suggestions, for what is not wrong. This takes three runs and more; `verdict` is the same
        without trials.
        """
        found = self.verdict
        if trial.can_be_tried(found, self.algorithm):
            found = trial.try_advice(found, [self])
        return suggestion.with_suggestions(found, self)

    @cached_property
    def innovation_verdict(self) -> Verdict:
        """The verdict from the innovations alone, as for a flight with unknown truth.

        Causes with large factors are tried, beside faults of a log; see `identification.contradiction`.
        """
        found = self._judged_innovations
        if self.algorithm:
            return found
        if self.recorded is None:
            return state_advice.advise_simulated(found, self.experiment, self.belief.P0)
        from lab.analysis.identification.log_faults import name_lost_samples  # noqa: PLC0415 - a simulated run needs none of it

        return name_lost_samples(state_advice.advise_log(found, self), self.recorded.log)

    @cached_property
    def _judged_innovations(self) -> Verdict:
        """The verdict from the innovations, before advice about states is added."""
        from lab.analysis.identification.contradiction import explain_by_faults  # noqa: PLC0415 - a run needs none of it

        evidence = self.evidence.without_truth()
        judged = judge(evidence)
        found = explain_by_faults(self, judged)
        return self._of_linear(found, evidence) if found is judged else found

    def _of_linear(self, verdict: Verdict, evidence: Evidence) -> Verdict:
        """Return a verdict from evidence, with attitude errors beyond the linear model as a cause."""
        navigator = self.experiment.navigator
        found = linear_verdict.judge(verdict, evidence, navigator, self._held, self._mean_nees_with)
        return feedforward.judge(self.free_run, found, navigator, evidence.nees)

    def _held(self) -> tuple[Verdict, Evidence] | None:
        """Return verdict and evidence from the innovations of this run with a model for large errors."""
        settings = self.experiment.copy().update({"navigator.smoother": False})
        try:
            run = self.repeated(settings.update({"navigator.model": linear_verdict.HOLDING}))
        except ValueError:  # of settings, or of a run that diverges
            return None
        return run._judged_innovations, run.evidence

    def _mean_nees_with(self, model: str) -> tuple[float, float] | None:
        """Return mean NEES over its degrees of freedom of this run, as it is and with another error model."""
        try:
            other = self.repeated(self.experiment.copy().update({"navigator.model": model}))
        except ValueError:  # of settings, or of a run that diverges
            return None
        return self.evidence.means.mean_of(NEES), other.evidence.means.mean_of(NEES)

    @cached_property
    def evidence(self) -> Evidence:
        """The evidence of this run for each assumption of the filter; for a log, from its innovations."""
        if self.is_long:
            give_back()  # what tables and plots have left
        filtered = self.filtered
        if self.is_long:
            give_back()
        return collect_evidence(self, filtered)

    def identify(self, progress: Progress | None = None) -> Identification:
        """Identify the sensors from the innovations: noise, bias drive, R, latency and lever arm.

        The result has the most likely values with error bars, and the accuracy of the prediction of fixes
        withheld for 10 s, before and after; see `lab.analysis.identification.identification`.

        Parameters
        ----------
        progress
            Called with a phrase and the fraction done, from 0 to 1.

        Raises
        ------
        ResultError
            If a user's algorithm navigated, or there are too few fixes.
        """
        from lab.analysis.identification.identify import identify  # noqa: PLC0415 - a run needs none of it

        return identify(self, self.verdict, progress)
