"""Stream settings: what of the settings holds for a stream, whoever navigates with it, live or as a batch."""

from __future__ import annotations

from typing import Final

from lab.navigation.settings import NavigatorSettings
from lab.sensors.suite import OTHER_SENSORS, SensorSuite

OTHER_STATES: Final = (
    "estimate_misalignments",
    "estimate_bias_drift",
    "estimate_gps_drift",
    "estimate_lever_arm",
    "estimate_latency",
    "no_slip",
    "zero_velocity",
)
"""Settings of the navigator for further states and measurements, which have no effect on a stream."""


def stream_settings(
    sensors: SensorSuite, navigator: NavigatorSettings
) -> tuple[SensorSuite, NavigatorSettings]:
    """Return copies of the settings without what a stream does not have.

    That is other sensors than IMU and GPS, further states, outages at times of a flight, and a part of a log.
    The smoother is off, because it looks into the future.

    Parameters
    ----------
    sensors, navigator
        Settings of a flight or of a log.
    """
    sensors, navigator = sensors.copy(), navigator.copy()
    for sensor in OTHER_SENSORS:
        sensors.set(f"{sensor}.fitted", False)
    sensors.gps.outages = []
    for path in (*OTHER_STATES, "smoother"):
        navigator.set(path, False)
    navigator.own_states = ""
    navigator.log_from = navigator.log_to = None
    return sensors, navigator
