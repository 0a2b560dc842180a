"""Log result: the result of a run of a sensor log, with or without a reference."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from lab.base.arrays import FloatArray
from lab.experiment.result import Result
from lab.motion.truth.trajectory import Truth
from lab.run.run import Recorded

NEEDS_TRUTH = frozenset(("truth", "errors", "summary"))
"""Data that are unknown for a log without a reference."""
NEEDS_SIMULATION = frozenset(("consistency", "coverage", "budget", "temperature"))
"""Data that are unknown for any log: a reference has neither the biases nor its own errors."""

_KNOWN = "See Innovations or the Verdict."
_SPOKEN = {
    "consistency": "NEES",
    "coverage": "the coverage of the errors",
    "budget": "the error budget",
    "temperature": "a simulated temperature",
}


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class LogResult(Result):
    """The result of a run of a log; `missing_reason` names the unknown data.

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

    def missing_reason(self, name: str) -> str:
        """Return in a sentence why this log lacks a quantity; see `Run.missing_reason`."""
        if name in NEEDS_SIMULATION:
            return (
                "The true flight and the true biases of a sensor log are unknown, and "
                f"{_SPOKEN.get(name, name)} needs them. {_KNOWN}"
            )
        if name in NEEDS_TRUTH and self.truth_arrays is None:
            return f"This log has no reference, so its errors are unknown. {_KNOWN}"
        return ""

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
    def remarks(self) -> tuple[str, ...]:
        """Remarks on the reliability of the result: repairs, assumptions, and problems of the filter."""
        of_card = self.experiment.sensors.card_remark()
        return (*self.recorded.notes, *self._run_remarks(), *((of_card,) if of_card else ()))
