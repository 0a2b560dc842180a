"""Simulated result: the result of a run with simulated sensors, whose truth is known."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from lab.analysis.verdicts.run_evidence import Filtered
from lab.base.arrays import FloatArray
from lab.base.parameters.units import si
from lab.experiment.result import Result
from lab.motion.kinematics.ideal_imu import IdealImu
from lab.motion.truth.trajectory import Truth
from lab.navigation.alignment.rest_alignment import Aligned


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class SimulatedResult(Result):
    """The result of a simulated run.

    Attributes
    ----------
    truth_arrays : Truth
        The true flight.
    ideal : IdealImu
        Output of a perfect IMU.
    aligned : Aligned
        The start of the navigator.
    """

    truth_arrays: Truth
    ideal: IdealImu
    aligned: Aligned

    @property
    def time(self) -> FloatArray:
        """Times of the IMU samples (n + 1,) [s]."""
        return self.truth_arrays.time

    @property
    def flown(self) -> Truth:
        """The true flight."""
        return self.truth_arrays

    @property
    def own_latency(self) -> float:
        """The latency of the fixes, as simulated [s]."""
        return float(self.experiment.sensors.gps.latency)

    @property
    def own_lever_arm(self) -> FloatArray:
        """The lever arm (3,) of the antenna, as simulated [m]."""
        return si(self.experiment.sensors.gps, "lever_arm")

    @property
    def fix_validity(self) -> FloatArray:
        """Times of validity (m,) of the fixes, as the filter assumed them [s]."""
        return self.fixes.time - self.latency

    def missing_reason(self, name: str) -> str:
        """Return an empty text: a simulated run lacks nothing."""
        return ""

    @property
    def truth_word(self) -> str:
        """Word for the data to which errors are differences."""
        return "truth"

    @property
    def epoch(self) -> float:
        """Time 0 in the clock of the outages [s], which is the same clock."""
        return 0.0

    @property
    def realisation(self) -> str:
        """Text that distinguishes this run from others with the same settings, such as ``"seed 1"``.

        The seed of a run that hides something is hidden, too: with it, one could find what.
        """
        return "hidden seed" if self.experiment.hidden else f"seed {self.experiment.seed}"

    @property
    def has_temperature(self) -> bool:
        """Whether a temperature profile is simulated; without one the IMU is at 25 °C."""
        return bool(self.experiment.sensors.temperature.profile != "none")

    @property
    def _origin(self) -> tuple[float, float]:
        return float(self.truth_arrays.latitude[0]), float(self.truth_arrays.longitude[0])

    @property
    def filtered(self) -> Filtered:
        """The filter's own run; see `Result.filtered`."""
        is_smoothed = self.experiment.navigator.smoother and not self.algorithm
        if not is_smoothed:
            return super().filtered
        from lab.analysis.identification import renavigation  # noqa: PLC0415 - most runs need none of it

        return renavigation.filter_run(self)

    @cached_property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on the reliability of the result, such as a saturated sensor, rejected or missing fixes."""
        remarks, navigator = self._run_remarks(), self.experiment.navigator
        alignment = float(navigator.alignment)
        if alignment:
            remarks.append(
                f"An alignment of {alignment:g} s at rest before the flight (navigator.alignment) levelled "
                "the navigator and removed the constant gyro biases. The gyro biases shown, true and "
                "estimated, are the remaining ones."
            )
        stated = {"misalignment": navigator.estimate_misalignments}
        stated["g_sensitivity"] = navigator.estimate_g_sensitivity
        of_sensors = self.experiment.sensors.remarks(
            navigator.states, [name for name, has_states in stated.items() if has_states]
        )
        return (*self.experiment.notes, *remarks, *of_sensors)
