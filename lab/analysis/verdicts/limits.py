"""Limits: every threshold of the verdict, so that they can be seen, varied and tested as one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class VerdictLimits:
    """The thresholds of the verdict.

    Factors are those of a variance, ratios are logarithms of likelihood ratios, angles are in radians.

    Attributes
    ----------
    doubt : float
        Probability that a χ² statistic of a matched filter lies outside its interval.
    wrong_factor : float
        Smallest factor of a wrong variance that is reported. In the steady state of filters of a random walk
        and of a constant velocity, an R that is wrong by it makes σ of the error at most 1.3 % larger; a
        factor of 3, up to 10 %.
    large_factor : float
        Factor on a variance from which it is tried before it is stated: noise 5 times larger than a data
        sheet or a calibration at rest says is rare, and an error of the data needs such factors.
    confidence : float
        Probability that the interval of a factor contains it. A convention.
    correlation_sigmas : float
        Smallest correlation of the innovations that is reported, in its standard deviations.
    likelihood_ratio : float
        Smallest logarithm of the likelihood ratio at which one explanation is preferred to another.
    price : float
        Required gain in log-likelihood per regressor, in addition to that of a cause; chance gives 0.5.
    unused_fixes : float
        Fraction of the fixes that a gate may reject beyond the expected number: σ of the mean of the others
        is 1 % larger.
    rightly_rejected : float
        Fraction of the rejected fixes that must differ from their neighbours for the gate to be right.
        Measured with a gate of 0.999 on Montréal and Los Angeles, five seeds each: with 5, 10 or 20 %
        outliers it is 0.93 or more; with an R, a Q or a P0 that is too small, none differs.
    stretch_values : int
        Fewest values of a stretch, more than a fix or two.
    outlier_chance : float
        Probability that an error with three Gaussian components counts as an outlier.
    outlying_fixes : float
        Largest fraction of the fixes that can be outliers: the median of all squares, which scales the
        limit, is then 1.2 times that of the good ones (1.7 times with 40 % outliers).
    cluster_chance : float
        Probability below which chance does not put fixes so close together. A convention.
    suspicious_ratio : float
        Logarithm of the likelihood ratio of latency and lever arm together above which all causes are
        tested; chance reaches it in 4 % of the runs.
    latency, lever_arm : float
        Smallest latency [s] and length of a lever arm [m] that are reported. On the mission Montréal (43
        m/s), they move the fixes by 0.4 m and 0.2 m; the default fixes have a σ of 0.7 m. The advised
        latency is rounded to 0.01 s.
    correlated_part : float
        Smallest correlated error that is reported, as a fraction of the white σ: just below √0.1 of the
        smallest of `fix_evidence.RATIOS`. At 1 Hz, with the shortest of `fix_evidence.TIMES`, that one
        doubles the variance of the mean of many fixes.
    cause_fixes : int
        Fewest fixes for an estimate of latency and lever arm.
    cause_ratio : float
        Smallest logarithm of the likelihood ratio at which a latency (8 with its price, false alarm 1 in
        16,000) or a lever arm (12, 1 in 40,000) is reported.
    white_ratio : float
        Gain in log-likelihood from which R is changed beside a slow error of the receiver.
    gate_filled : float
        Part of the largest possible mean square of accepted innovations above which it does not tell their
        σ. Noise of 3.6 times the assumed σ reaches it at a gate of 0.999.
    alike_part : float
        Fraction of the gain in log-likelihood by which the best explanation must exceed that by the other
        instrument, because the responses are of first order, and variances are tried in steps.
    far_off_factor : float
        Factor on Q above which its noise is to be identified: two decades of σ² are no detail of one sensor,
        and R and the drives of the biases, which one factor does not change, are then unknown too. A plain
        choice.
    first_order : float
        Largest misalignment [rad] or scale factor error [1] that is stated: responses are of first order,
        and at 0.5 rad the second is a tenth of it. Data with two clocks gave 350°.
    noise_part : float
        Smallest variance of an error that is reported, in windows of 1 s, relative to the noise. An error
        that depends on the motion accumulates over a manoeuvre, so it matters earlier than noise.
    lag : float
        Shortest lag of a sensor that is reported [s]: that of a latency. What a lag adds to the navigator is
        gone at the end of the manoeuvre; a bandwidth of 50 Hz lags by 3 ms, and NEES does not show it.
    remainder_part : float
        Fraction of the first cause's gain that the next cause must reach, because first-order regressors
        leave a remainder.
    together_ratio : float
        Ratio of the variances of both kinds of sensors up to which one factor on Q serves both: it is within
        √2 of each, less than `wrong_factor`.
    drive_factor : float
        Smallest factor of a wrong bias drive that is reported: σ of a bias is proportional to its fourth
        root.
    earth_rate_off : float
        Largest distance of the estimated part of the rate of the Earth from 1: it is left out or it is not.
    family_chance : float
        Probability with which the runs of a matched filter disagree in any figure. Half of it is that of
        NEES of all states over the whole flight (of NIS without the truth); the other figures share the
        rest.
    wide_attitude : float
        σ of the attitude up to which the models of `linear_verdict.PERTURBED` are linear enough [rad].
        Measured on montreal and los_angeles with such a heading at the start, 24 flights each: mean NEES is
        1.05 × too large at 20°, 1.1 to 1.2 × at 30°, 2 to 4 × at 60°; with the other models 0.97 to 1.1 × in
        all cases.
    held_attitude : float
        σ of the attitude at the start up to which a run with `linear_verdict.HOLDING` tells causes [rad].
        Measured on montreal and los_angeles, 18 flights each with R of the position right, and 4.6 and 10
        times too small: from 40°, the verdict is right in all 108; from 45° in 107, and from 60° it takes R
        too small for correlated fixes in 1 of 6.
    neglected_square : float
        Mean square of the neglected acceleration in σ of the accelerometer biases from which it is named.
        Measured on montreal: 0.05 and 1.5 with gyros of 0.017 and 0.24 °/s/√Hz, and NEES 1.02 and 1.16 × too
        large.
    neglected_part : float
        Part of the excess of NEES of these biases that it must explain. Measured there: 0.8 to 1.4.
    cured_part : float
        Part of the excess of NEES, in the runs where it is largest, that another error model must remove to
        be the cure. Measured on consumer sensors, 30 flights each: where phi is off, it removes 0.69 to
        0.81; where it is not, from the runs that are large by chance, 0.01 to 0.47.
    free_attitude : float
        Attitude error of the free-running navigator up to which the filter is linear enough [rad]. Measured
        on montreal over gyros of all qualities: at 0.8° NEES is 1.4 × too large, at 1.5° 4 ×, at 7° 20 ×.
    suspected_attitude : float
        The same, from which feedforward is named if no other cause explains the errors [rad]. Measured on
        straight flights over a pole with quiet gyros: from 0.5° to 0.8°, NEES is 1.1 to 5 × too large, with
        feedback right.
    correction_sigmas : float
        Velocity error g φ² T / 2 that the linear model neglects in a correction period T, in σ of the
        velocity of a fix, up to which the filter is linear enough. Measured on los_angeles with the default
        sensors and T from 3 to 30 s: NEES is 1.0 below, 1.4 to 2.4 from 0.5 to 3, and 2 to 120 beyond.
    worse_factor : float
        Factor by which the errors across outages may grow: 5 % are worth a filter that knows its errors.
    outage_scatter, outage_weight : float, int
        Scatter from outage to outage of the logarithm of the factor by which advice changes the error of
        one, and the number of outages as which it counts beside those of the run, which may be one to three.
    likely_errors : float
        Number of standard errors above which the mean of these logarithms is no chance.
    figure_change : float
        Largest change of NIS per degree of freedom, or of a correlation, that does not count as worse.
    figure_sigmas : float
        Number of standard deviations within which a figure counts as that of a right filter.
    closer_factor : float
        Least factor by which the errors across outages become smaller. A plain choice: less is not worth a
        condition that fails where the vehicle slips.
    shown_outages : int
        Fewest outages that show a gain of a suggestion.
    rolling_speed : float
        Speed from which the direction of the motion counts [m/s]: 0.1 m/s of error are then 2°.
    rolling_time : float
        Least time at such speeds for a vehicle on wheels [s].
    turned : float
        Least angle [rad] that the vehicle turns at such speeds, to both sides together: one street corner
        and a bit.
    slip : float
        Largest rms angle [rad] between motion and forward axis, to the right and down: 2° of attitude errors
        and 2° of an IMU that is not straight in its vehicle. No slip needs better axes, which its trial
        shows.
    turn_acceleration : float
        Least rms acceleration of the turns [m/s²]: an error of the attitude of 1° is 0.17 m/s².
    innovation_bias : float
        Smallest mean of innovations that is reported, in their σ: a quarter of their mean square is then not
        chance. A plain choice.
    gain_sigmas : float
        Correlation of all fixes together, in its σ, from which a gain is called too low or too high: one
        matched filter in a thousand, as it is one test of a log.
    settling : float
        Time from the first use of fixes in which a filter that is not ours may reset its states [s]: PX4 and
        ArduPilot align yaw and height then.
    track_gap : float
        Longest time between positions of a filter that are interpolated, and largest difference of two clocks
        of one log [s].
    stamp_error : float
        σ of the time stamps of autopilots, which stamp messages when they are written [s].
    lag_speed : float
        Root mean square speed from which positions show the difference of two clocks [m/s]: 0.1 s is then
        0.1 m.
    jump_size : float
        Smallest jump of a receiver's position that is reported, horizontally [m]: σ of a single fix is 1 to
        3 m, and from one fix to the next it changes less.
    jump_factor : float
        The same in the usual difference of positions and velocities of that receiver: noise with two
        components exceeds 8 times its median once in 10¹⁹ fixes.
    jump_interval : float
        Longest time between fixes in which the mean of their velocities is that of the way [s].
    explained_within : float
        Time before a rejection, a reset or a stretch in which a jump explains it [s]: autopilots retry for
        some seconds.
    heading_gain : float
        Growth of the log-likelihood from which innovations of a velocity name a heading error: chance and the
        ten gains that are tried make it once in a hundred thousand logs.
    over_delay : float
        Least ratio of that growth to the growth by a delay: in an even turn both explain alike.
    foreign_heading : float
        Smallest heading error that innovations name [rad]: magnetometers of autopilots err by as much.
    foreign_delay, longest_delay : float
        Smallest and largest delay that innovations name [s]: receivers have 0.05 to 0.3 s, and accelerometers
        that clip look like seconds.
    delay_gain : float
        Growth of the log-likelihood from which innovations name a delay: filters with another fault reached
        70 on three missions, and those with 0.2 s at least 120.
    delay_sigmas : float
        The same of the delay in its σ by parts of the log: 5.3, with a growth of 49, and 5.7.
    delay_over_heading : float
        Least ratio of that growth to the growth by a wrong heading: at least 1.25 with a delay, at most 0.8
        with a wrong heading.
    delay_part : float
        Growth by an antenna farther back, relative to that by a delay, from which both are named.
    upright_part : float
        Least specific force to the right, relative to the acceleration of the turns: between a coordinated
        turn, 0, and a flat one, 1. Cambered bends are in between, and bodies lean outwards.
    """

    doubt: float = 0.002
    wrong_factor: float = 1.5
    large_factor: float = 30.0
    confidence: float = 0.95
    correlation_sigmas: float = 4.0
    likelihood_ratio: float = 10.0
    price: float = 2.0
    unused_fixes: float = 0.02
    rightly_rejected: float = 0.7
    stretch_values: int = 30
    outlier_chance: float = 1e-07
    outlying_fixes: float = 0.2
    cluster_chance: float = 0.001
    suspicious_ratio: float = 5.0
    latency: float = 0.01
    lever_arm: float = 0.2
    correlated_part: float = 0.3
    cause_fixes: int = 10
    cause_ratio: float = 6.0
    white_ratio: float = 10.0
    gate_filled: float = 0.9
    alike_part: float = 0.15
    far_off_factor: float = 30.0
    first_order: float = 0.5
    noise_part: float = 0.2
    lag: float = 0.01
    remainder_part: float = 0.1
    together_ratio: float = 2.0
    drive_factor: float = 3.0
    earth_rate_off: float = 0.5
    family_chance: float = 0.01
    wide_attitude: float = float(np.radians(20.0))
    held_attitude: float = float(np.radians(42.0))
    neglected_square: float = 0.3
    neglected_part: float = 0.25
    cured_part: float = 0.6
    free_attitude: float = float(np.radians(0.8))
    suspected_attitude: float = float(np.radians(0.4))
    correction_sigmas: float = 0.5
    worse_factor: float = 1.05
    outage_scatter: float = 0.4
    outage_weight: int = 3
    likely_errors: float = 2.0
    figure_change: float = 0.05
    figure_sigmas: float = 3.0
    closer_factor: float = 1.25
    shown_outages: int = 3
    rolling_speed: float = 3.0
    rolling_time: float = 30.0
    turned: float = float(np.radians(120.0))
    slip: float = float(np.radians(4.0))
    turn_acceleration: float = 0.3
    innovation_bias: float = 0.5
    gain_sigmas: float = 3.3
    settling: float = 10.0
    track_gap: float = 1.0
    stamp_error: float = 0.05
    lag_speed: float = 1.0
    jump_size: float = 3.0
    jump_factor: float = 8.0
    jump_interval: float = 1.5
    explained_within: float = 5.0
    heading_gain: float = 12.0
    over_delay: float = 2.0
    foreign_heading: float = float(np.radians(5.0))
    foreign_delay: float = 0.05
    longest_delay: float = 0.5
    delay_gain: float = 80.0
    delay_sigmas: float = 5.0
    delay_over_heading: float = 1.1
    delay_part: float = 0.8
    upright_part: float = 0.5

    @property
    def consistent_nis(self) -> float:
        """Largest NIS per degree of freedom of innovations that are as large as the filter says."""
        return self.wrong_factor**2


VERDICT = VerdictLimits()
"""The limits in use. Each is read when it is needed, so that other limits hold as soon as they stand here."""
