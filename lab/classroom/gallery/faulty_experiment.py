"""Faulty experiment: an experiment in which one fault of the gallery is hidden.

This is the only way to a fault: no setting, file, address or option names one. The settings of the result are
those that the student sees; the arrays are those of the fault.
"""

from __future__ import annotations

from typing import Self

from lab.base.arrays import FloatArray
from lab.base.parameters.setting_error import SettingError
from lab.base.progress import Progress
from lab.classroom.gallery.faults import Fault
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.experiment.sensor_stages import SampledFlight, SensorStages
from lab.experiment.stages import Stages
from lab.missions import LogMission, Mission, mission
from lab.navigation.algorithm import Algorithm
from lab.navigation.alignment.rest_alignment import Aligned
from lab.navigation.solution import NO_VECTOR, Belief
from lab.sensors import gps
from lab.sensors.imu import Measured

NOTE = "A fault of the gallery is hidden in this run."


class FaultyExperiment(Experiment):
    """An experiment with a fault; its copies have it too.

    Parameters
    ----------
    fault
        The fault.
    """

    def __init__(self, fault: Fault) -> None:
        super().__init__()
        self._fault = fault

    @property
    def hidden(self) -> str:
        """What changes the result besides the settings."""
        return self._fault.title

    @property
    def sealed(self) -> str:
        """That a fault is hidden, but not which."""
        return "gallery"

    @property
    def notes(self) -> tuple[str, ...]:
        """What every result of this experiment remarks."""
        return (NOTE,)

    def to_toml(self) -> str:
        """Return all settings as TOML text, with a comment that files of a result contain too."""
        return f"# {NOTE}\n{super().to_toml()}"

    def copy(self) -> Self:
        """Return an independent copy."""
        twin = type(self)(self._fault)
        twin._accept(self)
        return twin

    def run(self, progress: Progress | None = None, *, algorithm: Algorithm | None = None) -> Result:
        """Compute this experiment with its fault; see `lab.experiment.experiment.Experiment.run`."""
        settings, tell = self.copy(), progress or (lambda _stage, _fraction: None)
        found = mission(settings.mission)
        if isinstance(found, LogMission):
            raise SettingError(
                f"mission = {settings.mission!r}: a fault is hidden in simulated sensors only; accepted is a "
                "flight recording"
            )
        return _Faulty(settings, found, tell, self._fault, algorithm).result()


class _Faulty(Stages):
    """A computation whose sensors, or whose filter, have a fault."""

    def __init__(
        self,
        experiment: Experiment,
        found: Mission,
        progress: Progress,
        fault: Fault,
        algorithm: Algorithm | None,
    ) -> None:
        super().__init__(experiment, found, progress, algorithm)
        real = Experiment().update(experiment.to_dict())
        for path, value in fault.sensors.items():
            real.set(f"sensors.{path}", value)
        self._real = SensorStages(real, found)
        self._fault = fault
        self.hidden = fault.title

    def triad(self, sensor: str, flight: SampledFlight, found: FloatArray = NO_VECTOR) -> Measured:
        """Simulate the gyros or the accelerometers with the fault."""
        measured = self._real.triad(sensor, flight, found)
        spoil = self._fault.gyro if sensor == "gyro" else self._fault.accelerometer
        if spoil is None:
            return measured
        return measured._replace(increments=spoil(measured.increments, flight.truth, flight.ideal.dt))

    def fixes(self, flight: SampledFlight) -> gps.GpsFixes:
        """Simulate the GPS receiver with the fault."""
        return self._fault.restamped(self._real.fixes(flight), self.experiment.seed)

    def belief(self, aligned: Aligned) -> Belief:
        """Return what the filter assumes, with the fault."""
        assumed = super().belief(aligned)
        return assumed._replace(R=self._fault.r_factor * assumed.R)
