"""Log result: what the run of a sensor log gave, with a reference or without one."""

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
    """What the run of a log gave; `lacks` says what is not known of it.

    Attributes
    ----------
    truth_arrays : Truth or None
        The reference of the log.
    ideal, aligned : None
        Nothing is simulated.
    recorded : Recorded
        What the log has beside.
    """

    ideal: None = None
    recorded: Recorded
    aligned: None = None

    @property
    def truth_word(self) -> str:
        """What errors are differences to."""
        return "reference"

    @property
    def epoch(self) -> float:
        """What time 0 is in the clock of the log's file, in which outages are given [s]."""
        return self.recorded.log.epoch

    @property
    def realisation(self) -> str:
        """Empty: nothing of a log is drawn."""
        return ""

    @property
    def has_temperature(self) -> bool:
        """False: no temperature is simulated."""
        return False

    @property
    def _origin(self) -> tuple[float, float]:
        latitude, longitude, _ = self.solution_arrays.position[0]
        return float(latitude), float(longitude)

    @cached_property
    def summary(self) -> pd.DataFrame:
        """Table of the errors over the whole flight: rms, largest, and what 95 % stay below.

        Of what the reference knows; with mean and standard deviation, since a reference may be off by a
        constant.
        """
        return tables.summary(self, None if self.is_long else self.errors, moments=True)

    @cached_property
    def remarks(self) -> tuple[str, ...]:
        """What to know before believing the result: repairs, assumptions, and how the filter got on."""
        assumed = self.experiment.sensors.assumed_remark()
        return (*self.recorded.notes, *self._run_remarks(), *((assumed,) if assumed else ()))
