"""Finding names: every quantity that a finding of a verdict may have, for checks that name one."""

from __future__ import annotations

from lab.analysis.verdicts import aid_verdict, linear_verdict
from lab.analysis.verdicts.evidence import BLOCKS
from lab.analysis.verdicts.imu_causes import CAUSES
from lab.analysis.verdicts.innovation_verdict import EITHER
from lab.analysis.verdicts.pattern import AXES
from lab.analysis.verdicts.sensor_verdict import EARTH_RATE

_FIXES = ("position", "velocity")
GYRO_AXES, ACCEL_AXES, IMU_AXES = "gyro axes", "accelerometer axes", "IMU axes"
CLOCK, LOSSES, HEADINGS = "IMU clock", "IMU losses", "headings"
CONTRADICTION = "contradiction"
"""What findings call faults of a log as a whole, the last one if nothing of it is known but its channel."""

FINDING_NAMES: tuple[str, ...] = tuple(
    dict.fromkeys(
        (
            *("R", *(f"R {what}" for what in _FIXES)),
            *(f"R {what} {axis}" for what in _FIXES for axis in AXES),
            *aid_verdict.QUANTITIES,
            *("Q", *(f"Q {sensor}{what}" for sensor in ("gyro", "accelerometer") for what in ("", " bias"))),
            *("P0", *(f"P0 {block}" for block in BLOCKS)),
            *(f"GPS {what}" for what in ("latency", "lever arm", "correlation", "outliers")),
            EITHER,
            *CAUSES,
            *(f"gyro {what}" for what in ("temperature", "range")),
            *(f"accelerometer {what}" for what in ("temperature", "g-sensitivity", "range")),
            EARTH_RATE,
            *(GYRO_AXES, ACCEL_AXES, IMU_AXES, CLOCK, LOSSES, HEADINGS, CONTRADICTION),
            *("feedforward", "correction period", linear_verdict.NAME, "gate", "gain"),
            *linear_verdict.UNEXPLAINED,
            *("covariance", "innovation covariance"),
        )
    )
)
"""The quantities of findings: of the lab's filter, and at the end those of a user's algorithm."""
