"""Calibration: constant errors of sensors from a log, each judged on data that it did not see.

In come samples of an IMU with rests and turns, fields of a magnetometer, or a drive; out come terms with σ,
and a judgement of each group: what is left of the errors in withheld data, before and after.

Read first: `terms`, `rests`, `imu_calibration`.
"""
