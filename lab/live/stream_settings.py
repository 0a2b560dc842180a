"""Stream settings: what of the settings holds for a stream, whoever navigates with it, live or as a batch."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from lab.base.aid_table import AIDS
from lab.navigation.settings import NavigatorSettings
from lab.sensors.suite import OTHER_SENSORS, SensorSuite

OTHER_STATES: Final = (
    "estimate_bias_drift",
    "estimate_gps_drift",
    "estimate_lever_arm",
    "estimate_latency",
    "no_slip",
)
"""Settings of the navigator for further states and measurements, which have no effect on a stream."""


def leave_out_sensors(sensors: SensorSuite, others: Iterable[str] = OTHER_SENSORS) -> SensorSuite:
    """Return a copy of the sensors in which some besides IMU and GPS, by default all, are not fitted."""
    sensors = sensors.copy()
    for sensor in others:
        sensors.set(f"{sensor}.fitted", False)
    return sensors


def stream_settings(
    sensors: SensorSuite, navigator: NavigatorSettings
) -> tuple[SensorSuite, NavigatorSettings]:
    """Return copies of the settings without what a stream does not have.

    That is airspeed, further states, outages at times of a flight, and a part of a log. The smoother is off,
    because it looks into the future.

    Parameters
    ----------
    sensors, navigator
        Settings of a flight or of a log.
    """
    navigator = navigator.copy()
    sensors = leave_out_sensors(sensors, (aid.name for aid in AIDS if not aid.live))
    sensors.gps.outages = []
    for path in (*OTHER_STATES, "smoother"):
        navigator.set(path, False)
    navigator.own_states = ""
    navigator.log_from = navigator.log_to = None
    return sensors, navigator
