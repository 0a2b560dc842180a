"""Suite: the settings of all sensors of a vehicle together."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np
import param

from lab.base.aid_table import AIDS
from lab.base.parameters.settings import Settings, group
from lab.base.parameters.units import si
from lab.sensors.gps import GpsErrors
from lab.sensors.imu import AccelerometerErrors, GyroErrors
from lab.sensors.imu_errors import SensorNoise
from lab.sensors.readings import AidSensor
from lab.sensors.temperature import TemperatureSettings

if TYPE_CHECKING:
    from lab.sensors.airspeed import AirspeedErrors
    from lab.sensors.barometer import BarometerErrors
    from lab.sensors.heading_sensor import HeadingErrors
    from lab.sensors.odometer import OdometerErrors

TRIADS = ("gyro", "accelerometer")
"""Groups of the settings of an IMU."""
OTHER_SENSORS = tuple(aid.name for aid in AIDS)
"""Groups of the settings of sensors besides IMU and GPS, which may be fitted."""
_WORDS = {
    "noise_density": "white noise",
    "flicker": "flicker",
    "bias_sigma": "turn-on bias",
    "scale_factor_sigma": "scale factor",
    "misalignment": "misalignment",
    "g_sensitivity": "g-sensitivity",
    "bias_temperature": "temperature",
    "scale_temperature": "temperature",
}
"""Words for terms in a sentence."""

_REMEDIES = {
    "scale_factor": ("navigator.states 21", "scale factors"),
    "misalignment": ("navigator.estimate_misalignments", "misalignments"),
    "g_sensitivity": ("navigator.estimate_g_sensitivity", "g-sensitivity"),
}
"""The setting that adds states for an error, and the errors in words."""


class SensorSuite(Settings):
    """The errors of all sensors. Defaults: MEMSense AccelRate3D and receiver of the classic experiment.

    Noise, range and receiver are those of the experiment. It states no biases: the turn-on biases of 0.1 °/s
    and 2 mg (1σ) are this lab's choice, a typical size after a calibration at rest.
    """

    gyro = group(GyroErrors, "Gyro errors.")
    accelerometer = group(AccelerometerErrors, "Accelerometer errors.")
    temperature = group(TemperatureSettings, "Temperature of the IMU.")
    gps = group(GpsErrors, "GPS errors.")
    barometer: BarometerErrors
    heading: HeadingErrors
    odometer: OdometerErrors
    airspeed: AirspeedErrors
    vars().update({aid.name: group(aid.settings, aid.about) for aid in AIDS})
    own_errors = param.String(
        default="",
        label="Own errors",
        doc="Names of errors of the IMU, separated by commas, that a notebook declared with "
        "lab.declare_states. They are simulated, on top of the others.",
    )
    assumed = param.String(
        default="",
        label="Assumed terms",
        doc="Terms without a source, which a card set to values typical of its grade, each with its value, "
        "such as gyro.flicker=4.6. A term that was changed later no longer counts.",
    )
    lacking = param.String(
        default="",
        label="Lacking terms",
        doc="Terms that a card neither gives nor assumes, so that they are zero, such as gyro.bias_sigma. A "
        "term that was changed later no longer counts.",
    )

    def aids(self) -> dict[str, AidSensor]:
        """Return the sensors besides IMU and GPS, by name."""
        return {name: getattr(self, name) for name in OTHER_SENSORS}

    def remarks(self, states: int | None = None, stated: Collection[str] = ()) -> tuple[str, ...]:
        """Return remarks on settings without effect, errors without a filter state, and gaps of a card.

        Parameters
        ----------
        states
            Number of states of the filter, 15 or 21; None omits remarks on scale factors.
        stated
            Settings of a triad, besides scale factors, for which the filter has states.
        """
        found = (
            self._idle_temperature(),
            self._without_state(states, stated),
            self.card_remark(),
        )
        return tuple(remark for remark in found if remark)

    def assumed_terms(self) -> dict[str, list[str]]:
        """Return by triad the settings that still have the value that a card assumed for them."""
        found: dict[str, list[str]] = {}
        for mark in self.assumed.split(","):
            path, _, text = mark.strip().partition("=")
            triad, _, name = path.partition(".")
            if triad in TRIADS and _has_value(self._triad(triad), name, text):
                found.setdefault(triad, []).append(name)
        return found

    def assumed_remark(self) -> str:
        """Return a sentence with the assumed terms; empty if there are none."""
        terms = _in_words(self.assumed_terms())
        return f"Assumed as typical of the grade, since the card has no source: {terms}." if terms else ""

    def lacking_terms(self) -> dict[str, list[str]]:
        """Return by triad the settings that a card lacks and that still are zero."""
        found: dict[str, list[str]] = {}
        for path in self.lacking.split(","):
            triad, _, name = path.strip().partition(".")
            if triad in TRIADS and name in _WORDS and not np.any(self._triad(triad).get(name)):
                found.setdefault(triad, []).append(name)
        return found

    def card_remark(self) -> str:
        """Return what a card assumed and what it lacks, as sentences; empty if it is complete."""
        lacking = _in_words(self.lacking_terms())
        zero = (
            f"The card has no number for {lacking}. These errors are zero here, so the sensor appears better "
            "than any real one."
        )
        return " ".join(part for part in (self.assumed_remark(), zero if lacking else "") if part)

    def _triad(self, name: str) -> Settings:
        triad = getattr(self, name)
        assert isinstance(triad, Settings)
        return triad

    def _idle_temperature(self) -> str:
        assumed = self.assumed_terms()
        sensitive = [
            (sensor, name)
            for sensor in TRIADS
            for name in ("bias_temperature", "scale_temperature")
            if any(getattr(self._triad(sensor), name))
        ]
        wanted = [
            f"sensors.{sensor}.{name}" for sensor, name in sensitive if name not in assumed.get(sensor, ())
        ]
        profile = self.temperature.profile
        if wanted and profile == "none":
            return (
                f"There is no temperature profile (sensors.temperature.profile), so {wanted[0]} has no "
                "effect."
            )
        if profile != "none" and not sensitive:
            return (
                f"No sensor depends on the temperature (sensors.temperature.profile is {profile}): all "
                "coefficients, such as sensors.gyro.bias_temperature, are zero."
            )
        return ""

    def _without_state(self, states: int | None, stated: Collection[str]) -> str:
        """Return a sentence with the errors for which the filter has no state."""
        scales = ("scale_factor", "scale_factor_sigma") if states == 15 else ()
        paths = [
            f"sensors.{sensor}.{name}"
            for sensor in TRIADS
            for name in (*scales, "misalignment", "g_sensitivity", "bandwidth")
            if name not in stated
            and name in self._triad(sensor).param
            and any(getattr(self._triad(sensor), name))
        ]
        if not paths:
            return ""
        remedies = [
            f"{setting} it has states for {errors}"
            for name, (setting, errors) in _REMEDIES.items()
            if any(f".{name}" in path for path in paths)
        ]
        more = "; with " + ", and with ".join(remedies) if remedies else ""
        return (
            f"The filter has no state for {', '.join(paths)}: where these matter, its errors exceed the σ it "
            f"gives{more}."
        )


def _in_words(terms: dict[str, list[str]]) -> str:
    """Return settings by triad in words."""
    return "; ".join(
        f"{triad} {', '.join(dict.fromkeys(_WORDS.get(name, name) for name in names))}"
        for triad, names in terms.items()
    )


def _has_value(triad: Settings, name: str, text: str) -> bool:
    """Return whether a setting exists and has the value of a text: one number, or one for each axis."""
    if name not in (leaf for _, _, leaf in triad.leaves()):
        return False
    value = getattr(triad, name)
    numbers = value if isinstance(value, tuple) else (value,)
    parts = text.split("|")
    try:
        wanted = [float(part) for part in parts]
    except ValueError:
        return False
    return len(wanted) in (1, len(numbers)) and all(
        float(f"{number:.12g}") == wanted[index % len(wanted)] for index, number in enumerate(numbers)
    )


def white_noise(sensors: SensorSuite, name: str) -> SensorNoise:
    """Return the white noise of an IMU, rms over its axes, for comparison with the noise of a recording.

    Parameters
    ----------
    sensors
        The errors of the IMU.
    name
        Name of the IMU.
    """
    gyro, accelerometer = (
        float(np.sqrt(np.mean(si(triad, "noise_density") ** 2)))
        for triad in (sensors.gyro, sensors.accelerometer)
    )
    return SensorNoise(name, gyro, accelerometer)
