"""Hidden experiment: an experiment of a homework, whose sensors are other than its settings say.

What the filter assumes is made of the settings that the student sees and changes. What the sensors measure,
and the true error at the start, are made of those of the homework, whatever the student changes. Datasets and
files of the result have no true errors of the sensors, as if the flight had been flown.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import reduce
from typing import Self

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.parameters.setting_error import SettingError
from lab.base.parameters.units import si
from lab.base.progress import Progress
from lab.classroom.homework.scenario import Scenario
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.experiment.sensor_stages import SampledFlight, SensorStages
from lab.experiment.simulated_result import SimulatedResult
from lab.experiment.stages import Stages, start
from lab.missions import LogMission, Mission, mission
from lab.motion.truth.trajectory import Truth
from lab.navigation.algorithm import Algorithm
from lab.navigation.alignment import rest_alignment
from lab.navigation.alignment.rest_alignment import Aligned
from lab.navigation.belief import assumed_latency, assumed_lever_arm
from lab.navigation.solution import NO_VECTOR, Belief, Start
from lab.run.experiment_settings import ExperimentSettings
from lab.sensors import gps
from lab.sensors.imu import Measured
from lab.sensors.readings import Readings

NO_BUDGET = "The error budget needs the true errors of the sensors, which are hidden in this homework."


class HiddenExperiment(Experiment):
    """An experiment of a homework; its copies are of it too.

    Parameters
    ----------
    scenario
        The settings of the homework.
    """

    def __init__(self, scenario: Scenario) -> None:
        super().__init__()
        self._scenario = scenario

    @property
    def scenario(self) -> Scenario:
        """The settings of the homework."""
        return self._scenario

    @property
    def hidden(self) -> str:
        """What changes the result besides the settings: a digest."""
        return self._scenario.key

    @property
    def sealed(self) -> str:
        """The name of the homework, and another seed than its own, sealed for the teacher."""
        return self._scenario.sealed(self.seed)

    @property
    def notes(self) -> tuple[str, ...]:
        """What every result of this experiment remarks."""
        return (f"Some settings of this run are hidden. It is of the homework “{self._scenario.title}”.",)

    def check_change(self, path: str) -> None:
        """Raise `SettingError` if the homework does not let a person change a setting."""
        self._scenario.check_change(path)

    def to_toml(self) -> str:
        """Return the shown settings as TOML text, with a comment that files of a result contain too."""
        return f"# {self.notes[0]}\n{super().to_toml()}"

    def copy(self) -> Self:
        """Return an independent copy."""
        twin = type(self)(self._scenario)
        twin._accept(self)
        return twin

    def run(self, progress: Progress | None = None, *, algorithm: Algorithm | None = None) -> Result:
        """Compute this experiment with what is hidden; see `lab.experiment.experiment.Experiment.run`."""
        settings, tell = self.copy(), progress or (lambda _stage, _fraction: None)
        self._scenario.check_fixed(settings)
        found = mission(settings.mission)
        if isinstance(found, LogMission):
            raise SettingError(
                f"mission = {settings.mission!r}: settings are hidden in simulated sensors only; accepted "
                "is a flight recording"
            )
        return _HiddenStages(settings, found, tell, algorithm).result()


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class HiddenResult(SimulatedResult):
    """The result of a run of a homework.

    Attributes
    ----------
    actual : ExperimentSettings
        The settings of the sensors as they are, with the student's navigator.
    """

    actual: ExperimentSettings

    @property
    def simulated_settings(self) -> ExperimentSettings:
        """The settings with which the sensors were simulated."""
        return self.actual

    @property
    def shows_sensor_errors(self) -> bool:
        """Always False: constant errors of the sensors are hidden settings."""
        return False

    def missing_reason(self, name: str) -> str:
        """Return why the error budget is unknown; nothing else is."""
        return NO_BUDGET if name in {"budget", "observability"} else super().missing_reason(name)


class _HiddenStages(Stages):
    """A computation whose sensors are other than the filter assumes."""

    experiment: HiddenExperiment

    def __init__(
        self, experiment: HiddenExperiment, found: Mission, progress: Progress, algorithm: Algorithm | None
    ) -> None:
        super().__init__(experiment, found, progress, algorithm)
        self.hidden = experiment.hidden
        self._faults = experiment.scenario.hidden.found
        self._real = SensorStages(experiment.scenario.real(experiment), found)

    def result(self) -> HiddenResult:
        """Compute the stages in order."""
        plain = super().result()
        values = {one.name: getattr(plain, one.name) for one in fields(plain)}
        return HiddenResult(**values, actual=self._real_sensors())

    def _real_sensors(self) -> Experiment:
        """Return the real sensors, with what the filter assumes of lever arm and latency as a number."""
        actual, navigator, receiver = self._real.experiment.copy(), self.navigator, self.sensors.gps
        actual.set("navigator", navigator.to_dict())
        arm = assumed_lever_arm(navigator, si(receiver, "lever_arm"))
        actual.set("navigator.lever_arm", [float(value) for value in arm])
        actual.set("navigator.latency", assumed_latency(navigator, receiver.latency))
        return actual

    def begin(self, truth: Truth) -> Aligned:
        """Return the start of the navigator: its true error is that of the homework."""
        real, nothing = self._real.experiment, np.zeros(3)
        return rest_alignment.align_simulated(
            start(truth, real.navigator, real.seed),
            Start.off(truth, nothing, nothing, nothing),
            self.sensors,
            self.navigator,
            real.seed,
            real.sensors,
        )

    def triad(self, sensor: str, flight: SampledFlight, found: FloatArray = NO_VECTOR) -> Measured:
        """Simulate the gyros or the accelerometers as they are."""
        measured = self._real.triad(sensor, flight, found)
        for fault in self._faults:
            spoil = fault.gyro if sensor == "gyro" else fault.accelerometer
            if spoil is not None:
                increments = spoil(measured.increments, flight.truth, flight.ideal.dt)
                measured = measured._replace(increments=increments)
        return measured

    def fixes(self, flight: SampledFlight) -> gps.GpsFixes:
        """Simulate the GPS receiver as it is."""
        seed = self._real.experiment.seed
        return reduce(
            lambda fixes, fault: fault.restamped(fixes, seed), self._faults, self._real.fixes(flight)
        )

    def readings(self, flight: SampledFlight) -> dict[str, Readings]:
        """Simulate the other sensors as they are."""
        return self._real.readings(flight)

    def belief(self, aligned: Aligned) -> Belief:
        """Return what the filter assumes; a fault may change it without the settings showing it."""
        assumed = super().belief(aligned)
        factor = float(np.prod([fault.r_factor for fault in self._faults]))
        return assumed._replace(R=factor * assumed.R)
