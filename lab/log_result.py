"""Log result: the result of a run of a sensor log, with or without a reference."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from lab.datasets import tables
from lab.result import Result
from lab.run import Recorded

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class LogResult(Result):
    """The result of a run of a log; `lacks` names the unknown data.

    Attributes
    ----------
    truth_arrays : Truth or None
        The reference of the log.
    ideal, aligned : None
        None, because nothing is simulated.
    recorded : Recorded
        The log and further data of its run.
    """

    ideal: None = None
    recorded: Recorded
    aligned: None = None

    @property
    def truth_word(self) -> str:
        """Word for the data to which errors are differences."""
        return "reference"

    @property
    def epoch(self) -> float:
        """Time 0 in the clock of the log's file, which outages use [s]."""
        return self.recorded.log.epoch

    @property
    def realisation(self) -> str:
        """Empty, because a log has no random draws."""
        return ""

    @property
    def has_temperature(self) -> bool:
        """False, because no temperature is simulated."""
        return False

    @property
    def _origin(self) -> tuple[float, float]:
        latitude, longitude, _ = self.solution_arrays.position[0]
        return float(latitude), float(longitude)

    @cached_property
    def summary(self) -> pd.DataFrame:
        """Table of the errors over the whole flight: rms, maximum, and 95 % quantile.

        Only for quantities in the reference; with mean and standard deviation, since a reference may have a
        constant error.
        """
        return tables.summary(self, None if self.is_long else self.errors, moments=True)

    @cached_property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on the reliability of the result: repairs, assumptions, and problems of the filter."""
        assumed = self.experiment.sensors.assumed_remark()
        return (*self.recorded.notes, *self._run_remarks(), *((assumed,) if assumed else ()))
