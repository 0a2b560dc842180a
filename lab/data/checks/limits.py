"""Limits: the numbers by which the checks of flights, logs and streams judge, and what vehicles can do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lab.base.parameters.units import DEGREE


@dataclass(frozen=True)
class CheckLimits:
    """What the checks take for the same motion, another unit, wrong axes and a wrong clock.

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

    fix_leg : float
        Shortest length of a leg [s]: a walker goes 7 m, ten σ of a consumer receiver's noise.
    fix_leg_intervals : int
        Shortest length of a leg, in usual intervals between fixes.
    fix_gap : float
        Longest interval between two fixes of a leg, in usual ones: velocity is unknown in longer ones.
    fix_legs : int
        Fewest legs that are judged.
    coherent : float
        Coherence or correlation from which two columns show the same motion: ratios of their sizes are then
        good to 5 %. Measured: 0.99 and more for displacements and velocities of cars and copters.
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
        (`ClockLimits.polled`).
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
    axes_compared : int
        Axes that explain one window best and are compared in all.
    alike_misfit : float
        Misfit of other axes over that of the best ones up to which they are named, too.
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
    parts : int
        Parts of a log whose median specific forces are compared. A plain choice.
    part_ratio : float
        Factor to 9.8 within which the largest step between these, in order of size, is a change of the unit:
        the motion adds to gravity.
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
    rate_step : float
        Median step from sample to sample up to which such a mean is a bias [rad/s]: those of an MPU-6000 are
        up to 20 °/s. Degrees read as radians make 0.02 °/s of noise larger than this.
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
    lively_across : float
        σ of the acceleration across the path from which it is compared [m/s²]: bends of a road at 50 km/h.
    felt_across : float
        Part of it that a vehicle feels that does not lean: bodies of cars roll by some degrees at 1 g.
    axis_correlation : float
        Smallest correlation at which an axis agrees with the fixes, and a slope means a unit: with random
        errors as large as 3/4 of the motion it is 0.8.
    correlation_lead : float
        By how much the right axis may follow the speed better than the forward one.
    degree_ratio : float
        Factor to 57 (degrees to a radian) within which that unit is named.
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
        Relative distance of a slope from 1 within which noise explains it: the nearest unit, the knot, is
        49 % from it.
    crab : float
        Median angle between heading and course that wind explains [rad]: 17 m/s across an airspeed of 30 m/s.
    heading_left : float
        Part of that angle that another reading of the heading may leave to be the right one.
    lean : float
        Coherence of specific force and lean from which a vehicle accelerates where it leans. Measured: 0.93
        to 0.99 on the shipped flights, 0.88 and 0.98 on logs of copters in motion, 0.2 of hovering ones.
    lean_ratio : tuple of 2 floats
        Specific force over lean that is accepted: a car leans a twentieth of it in its springs.
    steepest_lean : float
        Largest pitch and roll that are compared [rad]: beyond, their tangent has no scale.
    course_of_flight : float
        Speed from which the attitude of a flight is compared with its course [m/s]: an error of 0.5 m/s
        across turns the course by 6°, and no vehicle moves backwards so fast by itself (`forward_speed` of
        `lab.navigation.alignment.limits`).
    banking, climbing : float
        σ of the bank of coordinated turns, and of the slope of the path, from which roll and pitch are judged
        [rad].
    attitude_correlation : float
        Correlation of roll and pitch with the path from which their slope is judged: sideslip and changes of
        the angle of attack leave it above 0.6.
    same_roll, same_pitch : tuple of 2 floats
        Slopes of roll against the coordinated bank, and of pitch against the path, that are no wrong unit
        (57).
    same_rate : tuple of 2 floats
        Slopes of attitude against recorded rates that are no wrong unit: the nearest factor is 57. On the
        shipped flights, an attitude that lags behind with a time constant of 0.5 s has slopes of 0.87 or
        more, with 1 s 0.73 or more.
    unlike_rate : float
        Correlation below which a recorded rate has little to do with the attitude.
    rate_stride : int
        Samples over which the increments of attitude and rates are compared: jitter of one sample averages
        out.
    rate_turn : float
        Largest turn over these samples [rad]: they are fewer in a tumble, since a turn is known up to half a
        turn.
    increment : float
        Rms increment of an axis over these from which it is judged [rad]: less is noise of the attitude.
    airspeed_of_flight : float
        Airspeed or speed from which their ratio is judged [m/s]: at lower ones, a wind of 6 m/s takes the
        ratio beyond `same_airspeed`.
    same_airspeed : tuple of 2 floats
        Median airspeed over speed that wind and density of the air explain; a knot is 0.51 m/s.
    gravity_of_flight : tuple of 2 floats
        Median specific force of a flight [g]: level flight and cruise have 1; a wrong unit is a factor of 2
        and more.
    reached : float
        Quantile of a quantity that is compared with the limits of its vehicle: single samples may be wrong in
        a good recording.
    curve_residual, air_residual : float
        Rms distance of a plausible curve from the positions [m]: of one from velocity or positions, where a
        receiver is off by a few metres; and of one from air data, where the wind changes.
    implausible_residual : float
        Multiple of these from which a flight is implausible. On the shipped flights, velocities in a wrong
        unit leave 2 to 39 m, and velocities that are 5 s late 8 to 23 m: 200 m is another motion than that of
        the positions.
    """

    reading_gap: float = 3.0
    compared_fixes: int = 20
    unit_ratio: float = 1.15
    sure_unit_ratio: float = 1.04
    climb: float = 30.0
    height_piece: float = 600.0
    height_percentiles: tuple[float, float] = (5.0, 95.0)
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
    axes_compared: int = 6
    alike_misfit: float = 1.1
    gyro_windows: int = 2
    largest_lag: float = 3.0
    imu_interval: float = 0.5
    gravity_ratio: tuple[float, float] = (0.7, 1.5)
    gravity_unit_ratio: tuple[float, float] = (0.7, 1.4)
    parts: int = 10
    part_ratio: float = 1.4
    leg: float = 1.0
    longest_leg: float = 2.5
    course_speed: float = 2.0
    course_step: float = np.pi / 2
    tumbling: float = float(np.radians(25.0))
    rate_step: float = float(np.radians(1.0))
    pitch_of_turn: float = 0.15
    lively_turn: float = float(np.radians(2.0))
    lively_speed: float = 0.3
    lively_across: float = 0.5
    felt_across: float = 0.5
    axis_correlation: float = 0.8
    correlation_lead: float = 0.3
    degree_ratio: float = 2.0
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
    crab: float = float(np.radians(35.0))
    heading_left: float = 1 / 3
    lean: float = 0.8
    lean_ratio: tuple[float, float] = (0.5, 2.0)
    steepest_lean: float = float(np.radians(75.0))
    course_of_flight: float = 5.0
    banking: float = float(np.radians(4.0))
    climbing: float = float(np.radians(1.5))
    attitude_correlation: float = 0.6
    same_roll: tuple[float, float] = (0.5, 2.0)
    same_pitch: tuple[float, float] = (0.2, 5.0)
    same_rate: tuple[float, float] = (0.8, 1.25)
    unlike_rate: float = 0.5
    rate_stride: int = 5
    rate_turn: float = float(np.radians(90.0))
    increment: float = float(np.radians(0.2))
    airspeed_of_flight: float = 15.0
    same_airspeed: tuple[float, float] = (0.6, 1.6)
    gravity_of_flight: tuple[float, float] = (0.6, 1.6)
    reached: float = 0.999
    curve_residual: float = 10.0
    air_residual: float = 500.0
    implausible_residual: float = 20.0


LOG = CheckLimits()
"""The limits in use. Each is read when it is needed, so that other limits hold as soon as they stand here."""


class Range(NamedTuple):
    """The usual and the possible maximum of a quantity of a vehicle."""

    usual: float
    possible: float


class VehicleLimits(NamedTuple):
    """What a vehicle can do.

    Attributes
    ----------
    specific_force, body_rate, climb, speed : Range
        Lengths of the specific force [m/s²] and the body rate [rad/s]; vertical and whole speed [m/s].
    shows_heading : bool
        Whether its course is its heading, but for wind.
    """

    specific_force: Range
    body_rate: Range
    climb: Range
    speed: Range
    shows_heading: bool = True


VEHICLES: Mapping[str, VehicleLimits] = {
    "aircraft": VehicleLimits(
        Range(50.0, 120.0), Range(150 * DEGREE, 500 * DEGREE), Range(80.0, 250.0), Range(350.0, 1000.0)
    ),
    "car": VehicleLimits(
        Range(30.0, 100.0), Range(120 * DEGREE, 500 * DEGREE), Range(10.0, 50.0), Range(80.0, 200.0)
    ),
    "boat": VehicleLimits(
        Range(25.0, 100.0), Range(90 * DEGREE, 500 * DEGREE), Range(3.0, 20.0), Range(40.0, 120.0)
    ),
    "copter": VehicleLimits(
        Range(50.0, 200.0), Range(500 * DEGREE, 2500 * DEGREE), Range(25.0, 100.0),
        Range(100.0, 150.0), False,
    ),
    "rocket": VehicleLimits(
        Range(400.0, 2000.0), Range(1500 * DEGREE, 7200 * DEGREE), Range(800.0, 1000.0),
        Range(800.0, 1000.0), False,
    ),
    "pedestrian": VehicleLimits(
        Range(40.0, 200.0), Range(400 * DEGREE, 2000 * DEGREE), Range(5.0, 20.0), Range(10.0, 30.0), False
    ),
}  # fmt: skip
"""For each vehicle of a flight. A plain choice: aerobatic aeroplanes, rally cars and racing boats reach what
is usual, and no crew bears more than what is possible. Helicopters are as fast as small aeroplanes, and
racing copters tumble at 1000 °/s and more; model rockets burn out at 40 g and may spin several times a
second; a sprinter runs at 12 m/s, and a fast lift takes him up at 10 m/s."""
