"""Heading sensor: the true heading from a magnetometer or from two antennas.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 6.1.1
and 10.2.5.
"""

from __future__ import annotations

import numpy as np
import param
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.base.parameters.setting_error import SettingError
from lab.base.parameters.setting_kinds import QuantityOrNone
from lab.motion.frames.magnetic_field import magnetic_field
from lab.motion.frames.rotation import wrap
from lab.motion.truth.trajectory import Trajectory
from lab.sensors import readings
from lab.sensors.draws import Seed
from lab.sensors.readings import AidSensor, Readings, measure

__all__ = ["HEADING", "MAGNETOMETER", "HeadingErrors", "check_field", "measure"]

HEADING, MAGNETOMETER = "heading", "magnetometer"
"""What the sensor measures, as in the settings."""


class HeadingErrors(AidSensor):
    """Errors and timing of a heading sensor. Defaults: a magnetometer with its iron calibrated."""

    NAME = "heading"
    IDLE_IN_A_LOG = ("outages",)
    fitted = readings.fitted(
        "a sensor of the heading: two antennas, a compass, or a magnetometer. A filter that uses it has a "
        "state for its bias."
    )
    source = param.Selector(
        default=HEADING,
        objects=[HEADING, MAGNETOMETER],
        label="Measures",
        doc="heading: the true heading, as two antennas or a compass do. magnetometer: the magnetic field in "
        "the axes of the IMU, which the filter levels with its own attitude. Noise and bias are those of the "
        "heading with both.",
    )
    declination = QuantityOrNone(
        unset="model",
        unit="°",
        bounds=(-180, 180),
        label="Declination the filter assumes",
        doc="Magnetic declination, positive east, for a magnetometer. model: that of the World Magnetic "
        "Model at the start, or of the log.",
    )
    period = readings.period(1.0)
    noise = readings.noise(1.0, unit="°", bounds=(1e-4, 90), softbounds=(0.01, 10), step=0.01)
    bias_sigma = readings.bias_sigma(2.0, unit="°", bounds=(0, 90), softbounds=(0, 10), step=0.1)
    drift_sigma = readings.drift_sigma(0.0, unit="°", bounds=(0, 90), softbounds=(0, 10), step=0.1)
    correlation_time = readings.correlation_time(300.0)
    outages = readings.outages()

    def truth(self, trajectory: Trajectory, seed: Seed, times: FloatArray) -> FloatArray:
        """Return the true headings (a,) at times (a,) [rad]."""
        return trajectory.at(times).euler[:, 2]

    def shown(self, trajectory: Trajectory, found: Readings) -> Readings:
        """Return true headings from −π to π [rad], or the magnetic fields that show them."""
        if self.source == HEADING:
            return found._replace(value=np.asarray(wrap(found.value)))
        return _of_field(trajectory, found)


WEAKEST_FIELD = 2.0
"""Horizontal field below which a magnetic heading is refused [µT]: the blackout zones of the World Magnetic
Model, about the magnetic poles and up to the geographic north pole."""
LARGEST_CHANGE = np.radians(10.0)
"""Change of the declination along a flight up to which that at the start stands for the flight [rad]: five
times the default σ of the sensor's bias, and ten times the change along 100 km elsewhere."""
CALM_LATITUDE = np.radians(50.0)
"""Latitude below which there is neither, on flights of some hundred kilometres [rad]."""
_PLACES = 8
"""Places along a flight at which the field is computed, and that closest to a pole."""


def check_field(position: FloatArray) -> None:
    """Raise `SettingError` if a magnetometer does not show the heading on a flight.

    Parameters
    ----------
    position : (n, 3) array
        Latitude, longitude [rad] and height [m] along the flight.
    """
    latitude = np.abs(position[:, 0])
    if latitude.max() < CALM_LATITUDE:
        return
    places = np.append(np.linspace(0, latitude.size - 1, _PLACES).astype(np.int64), np.argmax(latitude))
    north, east, _ = np.array([magnetic_field(position[place]) for place in places]).T
    weakest = float(np.hypot(north, east).min())
    declination = np.arctan2(east, north)
    change = float(np.abs(wrap(declination - declination[0])).max())
    if weakest < WEAKEST_FIELD:
        reason = (
            f"the horizontal magnetic field is {weakest:.1f} µT on this flight, and the World Magnetic Model "
            f"calls regions below {WEAKEST_FIELD:g} µT blackout zones of the compass"
        )
    elif change > LARGEST_CHANGE:
        reason = (
            f"the magnetic declination changes by {np.degrees(change):.0f}° on this flight, and the filter "
            f"assumes one value; accepted are up to {np.degrees(LARGEST_CHANGE):.0f}°"
        )
    else:
        return
    raise SettingError(
        f"sensors.heading.source: {reason}; accepted here is source = {HEADING}, which two antennas measure"
    )


def _of_field(trajectory: Trajectory, found: Readings) -> Readings:
    """Return readings of the magnetic field that show some headings [rad].

    The field is that at the start: it turns by 1° in some 100 km.
    """
    field = magnetic_field(trajectory.at(np.zeros(1)).position[0])
    truth = trajectory.at(found.time)
    if found.time.size:
        check_field(truth.position)
    error = np.zeros((found.time.size, 3))
    error[:, 2] = truth.euler[:, 2] - found.value
    seen = Rotation.from_rotvec(error).apply(field / np.linalg.norm(field))
    of_body = Rotation.from_quat(truth.q_nb, scalar_first=True).inv().apply(seen)
    declination = np.full(found.time.size, np.arctan2(field[1], field[0]))
    return found._replace(value=declination, field=np.asarray(of_body))
