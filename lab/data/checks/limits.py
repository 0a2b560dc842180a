"""Limits: the numbers by which the checks of a log judge, to be seen, varied and tested as one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lab.base.arrays import FloatArray


@dataclass(frozen=True)
class CheckLimits:
    """What the checks of a log take for the same motion, another unit, wrong axes and a wrong clock.

    Attributes
    ----------
    reading_gap : float
        Longest time between two readings between which those at a fix are interpolated [s]: the longest
        usual period of a barometer or an odometer is 1 s.
    compared_fixes : int
        Fewest fixes that are compared: 2 s to 20 s of usual receivers, far more than one outlier.
    unit_ratio : float
        Factor within which a ratio is that of a unit: more than the scale error of wheels (5 %) or of
        pressure heights in cold or hot air (10 %).
    sure_unit_ratio : float
        Factor within which a ratio is that of one unit alone: km/h and feet per second are 1.1 apart.
    climb : float
        Range of the GPS heights from which those of a barometer are compared [m]: several σ of the vertical
        noise of consumer receivers, some metres.
    height_piece : float
        Length of the pieces whose mean heights are left out [s]: over hours, the weather and the geoid
        change heights by tens of metres.
    height_percentiles : tuple of 2 floats
        Percentiles of the GPS heights between which their range counts: single wild fixes lie outside.
    same_motion : float
        Smallest correlation at which two columns show the same motion: ratios of their sizes are then good
        to 5 %.
    compared_speed : float
        Speed from which an odometer is compared [m/s]: noise of the velocities, 0.1 to 0.3 m/s, is a tenth
        of it.
    agreeing_ratios : float
        Share of the fixes whose ratio has to be within `unit_ratio` of their median.
    heading_leg : float
        Shortest length of the legs over which turns are compared [s]: a car turns by 90° in it.
    longest_heading_leg : float
        Longest length of such a leg [s]: a longer one is a gap of the headings.
    largest_turn : float
        Largest turn of a leg that is compared [rad]: of 180°, the side cannot be told.
    turn : float
        Smallest turn beside the usual one that counts [rad]: five σ of the usual heading sensor.
    turns : int
        Fewest of these turns.
    heading_legs : int
        Fewest legs of headings: one faulty heading spoils two.
    heading_gain : float
        How much smaller the residuals have to be with another unit or sign. The rate about the axis called
        down is that of the heading times the cosine of the bank: the right sign is always the better one,
        and a wrong one is found up to a bank of 60°.
    heading_residual : float
        Largest rms of these residuals [rad]: magnetic headings beside iron are good to it.
    radians : float
        Largest number of a heading in radians, rounded up.
    octants : int
        Sectors of the course that all have to be there for an airspeed: the wind then shortens some ground
        speeds and lengthens others.
    ground_speed : float
        Mean ground speed from which airspeeds are compared [m/s]. A vehicle that holds this speed to all
        sides would need a storm of 25 m/s to look like one whose airspeeds are in knots.
    airspeed_ratio : tuple of 2 floats
        Airspeed over ground speed, as means over the octants, that is that of km/h, mph or knots. A
        constant airspeed above that of the wind makes at most π/2 (1.57), and one below it does not go to
        all sides. The smallest and the largest unit are 1.94 and 3.6; an airspeed sensor has 10 % of scale
        error.
    nose_force : float
        σ of the force along the path from which it shows where the nose points [m/s²], as in
        `lab.data.checks.log_check`.
    nose_correlation : float
        Correlation of that with the forward accelerometer from which the nose points along the course.
    fix_leg : float
        Shortest length of a leg [s]: a walker goes 7 m, ten σ of a consumer receiver's noise.
    fix_leg_intervals : int
        Shortest length of a leg, in usual intervals between fixes.
    fix_gap : float
        Longest interval between two fixes of a leg, in usual ones: velocity is unknown in longer ones.
    fix_legs : int
        Fewest legs that are judged.
    coherent : float
        Coherence from which displacements and velocities count as the same motion. Measured: 0.99 and more
        on real logs of cars and copters.
    incoherent : float
        Coherence below which they are different motions. The tests pass at 0.6 and at 0.9.
    displacement_ratio : tuple of 2 floats
        Ratio of displacement and velocity that is accepted: knots, the nearest wrong unit, are 0.51 m/s.
        Measured: 0.99 to 1.02 on real logs.
    displacement_unit_ratio : float
        Factor within which a ratio is that of a unit: the closest of these, km/h and feet, are a factor of
        1.1 apart, and the nearest is taken; noise and the latitude change a ratio by as much.
    displacement : float
        Rms displacement of legs from which the horizontal is judged [m]: several σ of the noise of consumer
        receivers.
    vertical_displacement : float
        The same of the vertical [m].
    rotation : float
        Mean angle between displacement and velocity that is accepted: swapped columns or signs make 90° or
        180°, noise some degrees.
    equal_samples : float
        Relative difference of two samples that are equal: rates are increments over their interval.
    samples_at_end : int
        Fewest samples in a row at the end: four equal rows are a sensor polled too often
        (`sensor_log.MAX_REPEAT`).
    levels : int
        Fewest different values between the median of the others and the end: coarse sensors at rest show
        two or three.
    below_end : float
        Part of the way from the median to the end in which few samples lie just below it.
    most_samples : float
        Part of the samples that is most of them.
    symmetric_range : float
        Least size of an end where most samples are, relative to the largest value on either side: a coarse
        sensor that mostly rests shows one small value, too, and a range is as wide to both sides.
    gyro_speed : float
        Speed from which fixes show a course [m/s]: a walker has 1.3.
    gyro_speed_sigmas : float
        The same in σ of the velocity: a course good to 11°.
    stretch_gap : float
        Longest interval between two fixes of a stretch [s]: the course of a longer one is ambiguous.
    shortest_stretch : float
        Shortest stretch [s]: time for a turn.
    longest_stretch : float
        Longest stretch [s], up to which a bias is constant.
    stretch_fixes : int
        Fewest fixes of a stretch: four times its unknowns.
    gyro_bias : float
        Largest gyro bias [rad/s]: consumer parts are off by a few °/s.
    course_change : float
        Rms change of the course from which gyros are judged by it [rad]: sideslip and noise change it by
        less. A drive along a highway has 0.4°, a walk 72°.
    explained_course : float
        Part of the change of the course that is left by gyros which turn with it. Measured: 0.31 on a walk,
        1.0 on a copter that flies where it likes.
    unexplained_course : float
        The same, left by gyros which turn against it. Measured: 1.96 and 1.0.
    unexplained_axis : float
        The same, left by gyros that have nothing to do with it: below they are a part of it.
    worse_fit : float
        Factor by which the velocities may fit worse with gyros that explain the course: the noise of a fit.
    gyro_misfit : float
        Mean square residual up to which the IMU as it is explains the velocities. Measured: up to 0.64, the
        mean over the windows, on real logs.
    much_better : float
        Part of the misfit as it is that other axes may leave to be the right ones.
    better : float
        The same in each window.
    gyro_windows : int
        Fewest windows that have to agree.
    largest_lag : float
        Largest clock offset that is tried [s].
    imu_interval : float
        Longest usual interval between samples of an IMU [s]: loggers of phones take 10 to 1000 Hz, and
        between slower samples the motion of a vehicle is unknown.
    gravity_ratio : tuple of 2 floats
        Median specific force of a log [g]: every vehicle has about 1; a wrong unit is a factor of 9.8 or
        the rate.
    gravity_unit_ratio : tuple of 2 floats
        Median specific force over a unit's factor at which that unit is named: the motion adds to gravity.
    leg : float
        Length of the legs in which turns and changes of speed are compared [s]: fixes of 1 Hz have it.
    longest_leg : float
        Longest of these legs, over `leg`: a longer one has a gap in it.
    course_speed : float
        Speed from which fixes show a course [m/s]: with velocities good to 0.1 m/s to 3°.
    course_step : float
        Largest change of the course in a leg that is believed [rad]: a larger one is noise, or a turn on
        the spot.
    tumbling : float
        Largest mean rate about a horizontal axis [rad/s]: five σ of the bias of consumer gyros; a rate of
        0.5 °/s, its numbers read as radians, is 29 °/s.
    pitch_of_turn : float
        Pitch rate of banked turns over their yaw rate, from which axes are judged by it: the sine of a bank
        of 9°. The tests, on real logs too, pass at half and at twice it.
    lively_turn : float
        σ of the rate of the course from which turns are compared [rad/s]: gyros of 1 °/s of noise still
        show it. The tests pass at half; at twice it, swapped axes and degrees for radians on a shipped
        flight are missed.
    lively_speed : float
        σ of the acceleration along the path from which it is compared [m/s²]: noise of fixes at 1 Hz is
        0.1. The tests pass at half; at twice it, swapped axes of the car of comma2k19 are missed.
    axis_correlation : float
        Smallest correlation at which an axis agrees with the fixes.
    correlation_lead : float
        By how much the right axis may follow the speed better than the forward one.
    degree_ratio : tuple of 2 floats
        Ratio of a factor to 57 (degrees to a radian) at which that unit is named.
    refused_lag : float
        Smallest clock offset that refuses a log [s]: receivers are up to 0.3 s late by themselves, which a
        navigator is told or finds.
    lag_step : float
        Step of the clock offsets tried with each axis [s]: a tenth of a leg.
    around_leap : float
        Offsets around it that are tried [s]: the receiver's latency and the recorder's delay add to it.
    unlike_turns : float
        Largest correlation of the turns near zero offset at which they do not belong together.
    legs : int
        Fewest legs by which an axis is judged. At one of the offsets, noise of 0.45 m/s reached the
        correlation in 12 % of rests with 11 legs, and in 0.1 % with 20.
    lag_windows : int
        Largest number of windows for the estimate of the clock offset: each is fitted eight times or more.
    fewest_lag_windows : int
        Fewest windows that have to show an offset.
    lag_starts : tuple of 2 floats
        Offsets from which it is fitted too [s]: within one of them the fit finds its way to `largest_lag`
        and to zero.
    lag_sigma : float
        σ of an offset up to which a window shows it [s]: a quarter of the smallest that refuses a log. The
        tests pass at twice it; at half, an offset of 1 s on a shipped flight is missed.
    lag_apart : float
        Distance from the median at which windows agree on an offset [s]: two σ. The tests pass at half and
        at twice it.
    agreeing_windows : float
        Part of the windows that has to agree on it.
    misfit : float
        Mean square residual, in σ, up to which a window shows an offset: residuals of three σ.
    explained_misfit : float
        Mean square residual, in σ, up to which the IMU as it is explains the velocities. Measured: up to
        0.6 on real logs, from 1.2 on with two axes swapped.
    heading_sigma : float
        σ of the heading up to which a window shows where the nose points [rad].
    off_course : float
        Mean angle between nose and course up to which the axes are right [rad]: wrong ones turn it by 90°
        or 180°.
    wandering : float
        Spread of that angle from which a vehicle goes where it likes [rad]. Measured: up to 4° on
        aeroplanes and cars.
    match_fixes : int
        Fewest fixes of a window: with two velocities each they exceed its thirteen unknowns.
    liveliness : float
        σ of the velocity beside a straight line from which a window is fitted [m/s]: twice a receiver's
        noise.
    liveliness_noise : int
        The same over the σ of the receiver.
    velocity_sigma : float
        Least σ of velocities by their noise [m/s]: a receiver's own is what it was configured with.
    noise_fixes : int
        Fewest velocities that show their noise: a median of a few is chance.
    unit_slope : float
        Relative distance of a slope from a unit's factor at which it is named: half of what parts the
        nearest two.
    same_slope : float
        Relative distance of a slope from 1 within which noise explains it. Over 200 seeds of the walk in
        `tests/missions/test_flight_import.py`, the slope over r² is at most 9 % from 1; the nearest unit,
        the knot, 49 %.
    """

    reading_gap: float = 3.0
    compared_fixes: int = 20
    unit_ratio: float = 1.15
    sure_unit_ratio: float = 1.04
    climb: float = 30.0
    height_piece: float = 600.0
    height_percentiles: tuple[float, float] = (5.0, 95.0)
    same_motion: float = 0.95
    compared_speed: float = 3.0
    agreeing_ratios: float = 0.8
    heading_leg: float = 4.0
    longest_heading_leg: float = 10.0
    largest_turn: float = float(np.radians(120.0))
    turn: float = float(np.radians(10.0))
    turns: int = 4
    heading_legs: int = 10
    heading_gain: float = 3.0
    heading_residual: float = float(np.radians(10.0))
    radians: float = 2 * np.pi * 1.001
    octants: int = 8
    ground_speed: float = 15.0
    airspeed_ratio: tuple[float, float] = (1.7, 4.2)
    nose_force: float = 0.3
    nose_correlation: float = 0.8
    fix_leg: float = 5.0
    fix_leg_intervals: int = 10
    fix_gap: float = 2.5
    fix_legs: int = 4
    coherent: float = 0.95
    incoherent: float = 0.8
    displacement_ratio: tuple[float, float] = (0.75, 1.33)
    displacement_unit_ratio: float = 1.2
    displacement: float = 3.0
    vertical_displacement: float = 5.0
    rotation: float = float(np.radians(30.0))
    equal_samples: float = 1e-9
    samples_at_end: int = 5
    levels: int = 20
    below_end: float = 0.02
    most_samples: float = 0.5
    symmetric_range: float = 0.8
    gyro_speed: float = 1.0
    gyro_speed_sigmas: float = 5.0
    stretch_gap: float = 2.5
    shortest_stretch: float = 15.0
    longest_stretch: float = 120.0
    stretch_fixes: int = 10
    gyro_bias: float = float(np.radians(5.0))
    course_change: float = float(np.radians(5.0))
    explained_course: float = 0.5
    unexplained_course: float = 1.3
    unexplained_axis: float = 0.9
    worse_fit: float = 1.5
    gyro_misfit: float = 0.8
    much_better: float = 0.2
    better: float = 0.5
    gyro_windows: int = 2
    largest_lag: float = 3.0
    imu_interval: float = 0.5
    gravity_ratio: tuple[float, float] = (0.7, 1.5)
    gravity_unit_ratio: tuple[float, float] = (0.7, 1.4)
    leg: float = 1.0
    longest_leg: float = 2.5
    course_speed: float = 2.0
    course_step: float = np.pi / 2
    tumbling: float = float(np.radians(25.0))
    pitch_of_turn: float = 0.15
    lively_turn: float = float(np.radians(2.0))
    lively_speed: float = 0.3
    axis_correlation: float = 0.8
    correlation_lead: float = 0.3
    degree_ratio: tuple[float, float] = (0.5, 2.0)
    refused_lag: float = 0.4
    lag_step: float = 0.1
    around_leap: float = 1.5
    unlike_turns: float = 0.5
    legs: int = 20
    lag_windows: int = 4
    fewest_lag_windows: int = 2
    lag_starts: tuple[float, float] = (-1.5, 1.5)
    lag_sigma: float = 0.1
    lag_apart: float = 0.2
    agreeing_windows: float = 0.6
    misfit: float = 9.0
    explained_misfit: float = 1.0
    heading_sigma: float = float(np.radians(10.0))
    off_course: float = float(np.radians(30.0))
    wandering: float = float(np.radians(10.0))
    match_fixes: int = 8
    liveliness: float = 0.2
    liveliness_noise: int = 2
    velocity_sigma: float = 0.1
    noise_fixes: int = 10
    unit_slope: float = 0.05
    same_slope: float = 0.15

    @property
    def tried_lags(self) -> FloatArray:
        """Offsets that are tried with each axis [s]."""
        return np.arange(-self.largest_lag, self.largest_lag + self.lag_step / 2, self.lag_step)


LOG = CheckLimits()
"""The limits in use. Each is read when it is needed, so that other limits hold as soon as they stand here."""
