"""Experiment settings: all settings of one run, and their TOML form; `lab.experiment` computes it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import param

from lab.base.parameters.setting_error import SettingError
from lab.base.parameters.setting_kinds import Quantity
from lab.base.parameters.settings import Derived, Settings, group
from lab.base.parameters.toml_file import TomlError, parse_toml, read_toml, toml_text
from lab.navigation.settings import NavigatorSettings
from lab.sensors.imu_errors import NOISE_VARIANCES, noise_variance
from lab.sensors.suite import SensorSuite


class TrajectorySettings(Settings):
    """How the recording becomes a smooth true trajectory."""

    imu_rate = Quantity(
        200.0,
        unit="Hz",
        bounds=(10, 2000),
        softbounds=(50, 1000),
        step=10,
        label="IMU rate",
        doc="Rate of the IMU samples, and of the truth.",
    )
    attitude_curve = param.Selector(
        default="rotation",
        objects=["rotation", "euler"],
        label="Attitude curve",
        doc="Rotation spline (no gimbal lock), or the classic cubic spline on the Euler angles.",
    )


class ExperimentSettings(Settings):
    """A mission, a seed, and all settings of the sensors and the navigator."""

    mission = param.String(
        default="montreal",
        label="Mission",
        doc="Name of a mission, path of a flight csv, or folder with the log of an IMU and a GPS receiver.",
    )
    seed = param.Integer(default=1, bounds=(0, 2**32 - 1), label="Seed", doc="Seed of all random draws.")
    trajectory = group(TrajectorySettings, "Trajectory.")
    sensors = group(SensorSuite, "Sensors.")
    navigator = group(NavigatorSettings, "Navigator.")

    OTHER_FORMS = NOISE_VARIANCES

    @property
    def hidden(self) -> str:
        """What changes the result besides the settings; see `lab.classroom.gallery`."""
        return ""

    @property
    def sealed(self) -> str:
        """What files have in place of hidden settings and their seed; empty if nothing is hidden."""
        return ""

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about the experiment that every result of it remarks."""
        return ()

    def check_change(self, path: str) -> None:
        """Raise `SettingError` if a person may not change a setting; see `lab.classroom.homework`."""

    def derived(self, path: str) -> Derived:
        """Return a noise density's other form: the variance of a sample at the IMU rate."""
        return noise_variance(self.get(path.rpartition(".")[0]), path, float(self.trajectory.imu_rate))

    def update(self, values: Mapping[str, Any]) -> Self:
        """Apply all settings of a nested mapping, all or nothing, and return self.

        The trajectory comes first, because variances of a sample depend on its IMU rate.

        Raises
        ------
        SettingError
            If a key does not exist or a value is not accepted; then nothing is changed.
        """
        first = {name: values[name] for name in ("trajectory",) if name in values}
        return super().update({**first, **values})

    @classmethod
    def from_toml(cls, source: str | Path) -> Self:
        """Return an experiment from a TOML file or TOML text; missing settings keep their defaults.

        Parameters
        ----------
        source
            A path, or text; text that ends with ``.toml`` is a file name.

        Raises
        ------
        SettingError
            If the file cannot be read, is not TOML, or contains an unknown setting or a value that is not
            accepted.
        """
        if isinstance(source, str) and source.endswith(".toml"):
            source = Path(source)
        name = source if isinstance(source, Path) else "settings"
        try:
            return cls().update(read_toml(source) if isinstance(source, Path) else parse_toml(source))
        except (TomlError, SettingError) as error:
            raise SettingError(f"{name}: {error}") from error

    def shared(self) -> dict[str, Any]:
        """Return the settings that are passed on: all of them; of a run that hides something, no seed."""
        return {name: value for name, value in self.to_dict().items() if name != "seed" or not self.hidden}

    def to_toml(self) -> str:
        """Return the settings that are passed on (`shared`) as TOML text."""
        return toml_text(self.shared())
