"""Limits: thresholds and assumed σ of the alignment of a log, to be seen, varied and tested as one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class AlignmentLimits:
    """What the alignment of a log takes for rest, straight motion, a course and a known heading.

    Attributes
    ----------
    rest_speed : float
        Speed below which a vehicle may be at rest [m/s].
    rest_sigmas : float
        The same in σ of a receiver's velocity in an axis: at rest, the speed is larger in 0.2 % of the fixes.
    largest_rest_speed : float
        Largest such speed, however poor the receiver is [m/s]: that of a fast walker.
    rest_rate : float
        Largest σ of the gyros within a second of rest [rad/s]: above that of engines and noise, below that
        of handling.
    rest_force : float
        Largest σ of the accelerometers within a second of rest, and twice the largest change of their mean
        [m/s²].
    longest_rest : float
        Longest part of a rest that is used [s].
    rest_noise : float
        σ of a mean rate at rest over 1 s: the white noise of a MEMS gyro, about its density [rad/s/√Hz].
    vertical_speed_sigma : float
        σ of the initial vertical velocity if none is measured [m/s].
    levelling_time : float
        Averaging time of the specific force that gives the vertical in motion [s].
    acceleration_sigma : float
        σ of the mean acceleration over `levelling_time` if no velocity shows it [m/s²]: a car turns and
        brakes so.
    tilt_in_motion : float
        σ of roll and pitch after levelling in motion [rad]: an unknown acceleration of 0.5 m/s².
    margin : float
        Margin around the alignment within which fixes are used [s]: enough for a receiver at 1 Hz.
    slope_fixes : int
        Fewest fixes by which an acceleration is taken: a line through two has no redundancy.
    straight_rate : float
        Largest rate of the course in straight motion [rad/s].
    straight_bias_sigma : float
        σ of a gyro bias from straight motion, and smallest σ of one from velocity matching [rad/s].
    straight_seconds : int
        Fewest seconds of straight motion for a gyro bias.
    hidden_turn : float
        Part of a turn that an IMU does not see about its own vertical: a bank of 30° hides a seventh.
    course_scatter : float
        Largest scatter of a course about the turns of the gyros that shows their bias [rad]: the noise of
        fixes that just show a course is 1/3 (`course_sigmas`), a change from one side to straight ahead 0.4.
    fast_part : float
        Part of the fixes about a second that must show a course, for the second to be judged.
    reported_latency : float
        Smallest lateness of the fixes that is reported [s].
    latency_sigmas : int
        The same in its σ: beyond doubt, because people then change the log.
    course_speed : float
        Speed above which a vehicle has a course, if it also exceeds `course_sigmas` [m/s].
    course_sigmas : int
        The same in σ of its speed: the course is then known within 1/3 rad.
    forward_speed : float
        Speed above which no vehicle moves backwards [m/s]: aeroplanes are pushed back, models carried to the
        runway tail first, and cars reversed, at 1 to 3 m/s.
    magnetic_sigma : float
        σ of a magnetometer's heading [rad]: iron and currents of the vehicle after one calibration.
    antenna_sigma : float
        σ of a heading from two antennas if the log gives none [rad]: 1 cm over 0.3 m.
    heading_age : float
        Largest age of a heading or a field at the first sample of the IMU [s].
    weak_field : float
        Horizontal field [µT] below which compasses are unreliable (World Magnetic Model 2025).
    contradiction_sigmas : float
        Difference of two headings, in σ, above which they contradict each other.
    bias_at_rest : float
        σ of a gyro bias taken at rest, before a match [rad/s]: noise and temperature, five times the drift.
    drift_at_rest : float
        Drift of a heading that gyros carry back, if their bias was measured at rest [rad/s].
    drift : float
        The same for an unknown bias [rad/s].
    match_time : float
        Time from the start within which velocities are matched [s]: over longer times, gyros cannot carry a
        heading back.
    match_windows : int
        Largest number of windows that are matched.
    match_sigma : float
        σ of the errors that the model of the match omits [rad].
    match_misfit : float
        Largest mean square residual, in σ, of an accepted match: residuals of three σ.
    sure_heading : float
        σ of a heading below which no further windows are matched [rad].
    worth_heading : float
        Largest σ of a heading from velocity matching that is used [rad].
    """

    rest_speed: float = 0.5
    rest_sigmas: float = 3.5
    largest_rest_speed: float = 2.0
    rest_rate: float = float(np.radians(2.0))
    rest_force: float = 0.4
    longest_rest: float = 60.0
    rest_noise: float = float(np.radians(0.02))
    vertical_speed_sigma: float = 1.0
    levelling_time: float = 2.0
    acceleration_sigma: float = 2.0
    tilt_in_motion: float = float(np.radians(3.0))
    margin: float = 1.1
    slope_fixes: int = 3
    straight_rate: float = float(np.radians(2.0))
    straight_bias_sigma: float = float(np.radians(0.3))
    straight_seconds: int = 10
    hidden_turn: float = 0.15
    course_scatter: float = 0.35
    fast_part: float = 0.5
    reported_latency: float = 0.05
    latency_sigmas: int = 5
    course_speed: float = 1.0
    course_sigmas: int = 3
    forward_speed: float = 5.0
    magnetic_sigma: float = float(np.radians(10.0))
    antenna_sigma: float = float(np.radians(2.0))
    heading_age: float = 1.0
    weak_field: float = 6.0
    contradiction_sigmas: float = 3.5
    bias_at_rest: float = float(np.radians(0.1))
    drift_at_rest: float = float(np.radians(0.02))
    drift: float = float(np.radians(1.0))
    match_time: float = 1800.0
    match_windows: int = 8
    match_sigma: float = float(np.radians(2.0))
    match_misfit: float = 9.0
    sure_heading: float = float(np.radians(6.0))
    worth_heading: float = float(np.radians(30.0))


ALIGNMENT = AlignmentLimits()
"""The limits in use. Each is read when it is needed, so that other limits hold as soon as they stand here."""
