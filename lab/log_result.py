"""Log result: what the run of a log of real sensors gave, with a reference or without one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lab.datasets import tables
from lab.result import Result
from lab.run import Recorded
from lab.trajectory import Truth

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]

NEEDS_TRUTH = frozenset(("truth", "errors", "summary"))
"""What is not known of a log without a reference."""
NEEDS_SIMULATION = frozenset(("consistency", "coverage", "budget", "temperature"))
"""What is not known of any log: a reference knows neither the biases nor its own errors."""

_KNOWN = "the innovations and the verdict on them tell whether the filter is right."
_SPOKEN = {
    "consistency": "NEES",
    "coverage": "the coverage of the errors",
    "budget": "the error budget",
    "temperature": "a simulated temperature",
}


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
    def time(self) -> FloatArray:
        """Times of the IMU samples (n + 1,) [s]."""
        return self.recorded.time

    @property
    def flown(self) -> Truth:
        """The flight as the navigator estimated it: a reference may not be known everywhere."""
        solution = self.solution_arrays
        latitude, longitude, height = solution.position.T
        return Truth(self.time, latitude, longitude, height, solution.velocity_n, solution.q_nb, self.euler)

    @property
    def true_word(self) -> str:
        """What precedes a true quantity in a label."""
        return "reference"

    @property
    def own_latency(self) -> float:
        """The latency of the fixes, as the log says [s]."""
        return float(self.recorded.log.gnss.latency)

    @property
    def own_lever_arm(self) -> FloatArray:
        """The lever arm (3,) of the antenna, as the log says [m]."""
        return self.recorded.log.gnss.lever_arm

    @property
    def fix_validity(self) -> FloatArray:
        """Times (m,) of the fixes [s], which are stored without the latency."""
        return self.fixes.time

    def lacks(self, name: str) -> str:
        """Return why something is not known of this log, in a sentence; see `Run.lacks`."""
        if name in NEEDS_SIMULATION:
            return (
                "Nobody knows the true flight and the true biases of a log of real sensors, which "
                f"{_SPOKEN.get(name, name)} needs; {_KNOWN}"
            )
        if name in NEEDS_TRUTH and self.truth_arrays is None:
            return f"This log of real sensors has no reference, so its errors are not known; {_KNOWN}"
        return ""

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
