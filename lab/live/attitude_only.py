"""Attitude only: the navigator without fixes, levelled at rest and carried by the gyros in motion.

At rest, the means of the sensors since the rest began update the estimate with which it began
(`lab.navigation.alignment.rest_alignment`): tilt as good as the accelerometer biases, gyro biases, and north
where the gyros are good enough. During the rest the attitude is held, so the noise of the gyros counts once.
In motion, the compiled step of the navigator carries attitude and covariance.

Position and velocity count from the last rest. They mean something for a few seconds only.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.base.parameters.units import STANDARD_GRAVITY, si
from lab.data.streams.rolling import Rolling
from lab.live.live_state import Anchor, imu_between, with_heading
from lab.live.stream_settings import leave_out_sensors
from lab.motion.frames import earth
from lab.motion.frames.rotation import euler_from_quaternion, quaternion_from_euler, wrap
from lab.navigation.alignment.alignment import level
from lab.navigation.alignment.rest_alignment import Means, align, induced_variance
from lab.navigation.belief import belief, constant_errors
from lab.navigation.filters.error_models import ACCEL_BIAS, ATT, GYRO_BIAS, PHI, POS, VEL
from lab.navigation.filters.filter import Filter
from lab.navigation.filters.kalman import MEASUREMENTS
from lab.navigation.filters.schedule import EVERY_FIX
from lab.navigation.frames import choose_model_here, shown
from lab.navigation.log_navigation import AROUND, gap_noise
from lab.navigation.navigator import PIECE, advance
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import Belief, Fixes, Solution, Start
from lab.navigation.standstill import SHORTEST, SPAN, still_seconds
from lab.sensors.imu import misalignment
from lab.sensors.suite import SensorSuite

LONGEST_MEAN: Final = 60.0
"""Longest time over which the sensors are averaged at rest if the heading is known [s]: then the estimate
becomes the prior of the next mean, and the biases may have drifted in between."""
LONGEST_SEARCH: Final = 600.0
"""The same while north is sought [s]: the noise of the gyros falls with the time."""
NORTH: Final = np.radians(20.0)
"""Largest σ of a heading from the Earth's rate that is claimed [rad]: the update is linear about it, and
`rest_alignment` converges from there."""
UNKNOWN_HEADING: Final = np.pi
"""σ that stands for an unknown heading [rad], as in `initial_heading`."""
FOUND_RATIO: Final = 3.0
"""Ratio of `UNKNOWN_HEADING` to the σ from which the heading counts as found: between that of a heading that
no field has corrected and that of `NORTH`."""
REST_VELOCITY: Final = 0.02
"""σ of the velocity at rest [m/s]: an idling engine of 0.15 m/s² at 10 Hz moves by 2 mm/s."""
START_POSITION: Final = 0.01
"""σ of the place at which positions begin to count [m]."""
TOO_FAST: Final = 30.7
"""Largest squared mean rate at rest, in its σ: the quantile of 1 − 10⁻⁶ for three components; beyond it, the
IMU turns steadily."""
TOO_STRONG: Final = 5.0
"""Largest difference of the mean specific force and gravity at rest, in its σ."""
RETURNED: Final = 0.1
"""Part of the rotation of swings that return on which the scale factors act: they do to second order. With
it, roll and pitch of five suites, turned by hand for 30 s, err by 0.2 to 1.2 σ (rms of 30 seeds)."""
SOMEWHERE: Final = np.array([np.pi / 4, 0.0, 0.0])
"""Place that stands for an unknown one: latitude, longitude [rad], height [m]."""
GRAVITY_SIGMA: Final = 0.02
"""σ of gravity at an unknown place [m/s²]: from the equator to a pole it changes by 0.05."""
LOST_SPEED: Final = 300.0
"""Velocity, or σ of it, that only an unaided navigator shows [m/s]: it is taken back to zero with this σ, so
that the attitude does not suffer."""

_VELOCITY, _ATTITUDE, _BIAS = slice(3, 6), slice(6, 10), slice(10, 16)
"""Columns of a row of the estimate."""
_NO_FIXES: Final = Fixes(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
"""No fixes."""


class AttitudeOnly:
    """Attitude, gyro bias and, for a short time, displacement, from an IMU alone.

    Parameters
    ----------
    samples
        Rows of the IMU, with the columns of `live_filter.SAMPLES`; rows are appended from outside.
    sensors
        The assumptions about the sensors.
    place : (3,) array or None
        Latitude, longitude [rad] and height [m], as far as they are known; north is sought only then.
    heading, heading_sigma
        A given heading, or NaN, and its σ [rad].
    prior
        The estimate of a navigator that stopped; None to begin with a rest.
    """

    def __init__(
        self,
        samples: Rolling,
        sensors: SensorSuite,
        place: FloatArray | None = None,
        heading: float = np.nan,
        heading_sigma: float = np.nan,
        prior: Anchor | None = None,
    ) -> None:
        self.samples, self.place = samples, place
        settings = NavigatorSettings()
        constants = constant_errors(sensors, settings)
        constants[np.diag_indices(21)] += np.concatenate(
            (np.zeros(9), induced_variance(sensors), np.zeros(6))
        )
        # Scale factors and misalignments look like biases as long as the attitude is the same.
        g = STANDARD_GRAVITY
        shape = np.sum(misalignment(sensors.accelerometer) ** 2, axis=1)
        shape = shape + si(sensors.accelerometer, "scale_factor") ** 2
        shape = shape + si(sensors.accelerometer, "scale_factor_sigma") ** 2
        at = np.arange(ACCEL_BIAS.start, ACCEL_BIAS.stop)
        constants[at, at] += shape * g * g
        shape = np.sum(misalignment(sensors.gyro) ** 2, axis=1) + si(sensors.gyro, "scale_factor") ** 2
        self._scale = float(np.sqrt((shape + si(sensors.gyro, "scale_factor_sigma") ** 2).max()))
        assumed = belief(leave_out_sensors(sensors), settings, constants)
        # As for a log: the settings do not describe the biases found, so these do not decay.
        self.assumed = assumed._replace(decay=np.zeros(6), lever_arm=np.zeros(3), R=np.eye(MEASUREMENTS))
        self.heading_source = "" if np.isnan(heading) else "given"
        self.rest = 0.0
        """Length of the rest so far [s]."""
        self.still = 0
        """Seconds without vibration and rotation so far; a rest if they are ten."""
        self.refused = ""
        """Why a stillness is not taken for a rest; empty if it is."""
        self.begun = False
        """Whether there is an attitude."""
        self.rest_place = SOMEWHERE if place is None else place
        """Place from which the displacement counts."""
        self._given = heading, heading_sigma
        self._at = samples.first  # sample that the filter has reached
        self._origin = self._time(samples.first)
        self._second = 0  # seconds judged
        self._anchor: Anchor | None = None
        self._second_start: Anchor | None = None  # estimate at the beginning of the second
        self._turned, self._swung, self._scaled = np.zeros(3), 0.0, 0.0  # since the rest, see `_scale_up`
        self._sums = np.zeros(7)  # over the mean: increments, time
        self._gaps: list[tuple[float, float]] = []  # filled ones that are ahead
        self._run: Filter | None = None
        if prior is not None:
            self._begin(prior)

    @property
    def heading_is_known(self) -> bool:
        """Whether the heading is known better than `NORTH` by its own σ."""
        return self._run is not None and bool(self.P[8, 8] < NORTH**2)

    @property
    def P(self) -> FloatArray:  # noqa: N802
        """Covariance (15, 15) of the errors now."""
        assert self._run is not None
        T = choose_model_here(self._run.state, PHI).map(self._run.state)
        return np.asarray(T @ self._run.P[:, :15] @ T.T)

    @property
    def solution(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Position, velocity, attitude q_nb and biases now."""
        assert self._run is not None
        return *shown(self._run.state), self._run.state[_BIAS]

    @property
    def _where(self) -> FloatArray:
        """The place, or the one taken while it is unknown."""
        return SOMEWHERE if self.place is None else self.place

    def reachable(self) -> float:
        """Return the σ of the heading that the gyros can reach by the Earth's rate [rad]; infinite at a pole.

        Their turn-on bias looks like the rate of another heading: only its σ and the latitude count.
        """
        level_rate = earth.RATE * float(np.cos(self._where[0]))
        sigma = float(np.sqrt(np.diag(self.assumed.P0)[GYRO_BIAS].max()))
        return sigma / level_rate if level_rate > 0 else float(np.inf)

    def give_heading(self, heading: float, sigma: float, source: str) -> None:
        """Set the heading now, if it is better than the known one.

        Parameters
        ----------
        heading, sigma
            The heading and its σ [rad].
        source
            What shows it.
        """
        self._given = heading, sigma
        if self._run is None or sigma >= np.sqrt(self.P[8, 8]):
            return
        here = self._now()
        self.heading_source = source
        turn = float(wrap(heading - euler_from_quaternion(here.q_nb)[2]))
        self._begin(here.turned(turn, sigma))
        if self._second_start is not None:
            self._second_start = self._second_start.turned(turn, sigma)
        if self._anchor is not None:
            self._anchor = self._now()
            self._sums[:] = 0.0

    def add_gaps(self, gaps: Iterable[tuple[float, float]]) -> None:
        """Take note of filled gaps ahead, by their times [s]; the samples are there."""
        if self._run is not None:
            self._gaps += gaps

    def advance(self) -> None:
        """Advance to the last sample."""
        last = self.samples.end - 1
        while (edge := self._origin + SPAN * (self._second + 1)) <= self._time(last) + 1e-9:
            # The sample nearest the edge ends the second.
            end = self.samples.number("time", edge - 1e-9)
            self._advance_to(end)
            self._judge(end)
            self._second += 1
        self._advance_to(last)

    def _time(self, sample: int) -> float:
        return float(self.samples.rows("time", sample, sample + 1)[0])

    def _advance_to(self, end: int) -> None:
        """Advance the filter to a sample."""
        while self._run is not None and self._at < end:
            ends = [self.samples.number("time", gap[1] - 1e-9) for gap in self._gaps]
            stop = min(end, self._at + PIECE, *(at for at in ends if at > self._at))
            before = max(self._at - 1, self.samples.first)
            first = self._at - before
            imu = imu_between(self.samples, before, stop)
            out = Solution.empty(stop - before + 1, 0)
            advance(self._run, imu, _NO_FIXES, out, first, EVERY_FIX)
            for name in ("position", "velocity_n", "q_nb", "bias", "variance", "covariance"):
                part = getattr(out, name)[first + 1 :]  # without the variances of scale factors
                self.samples.rows(name, self._at + 1, stop + 1)[..., : part.shape[-1]] = part
            self._at = stop
            for gap, at in zip(self._gaps, ends, strict=True):
                if at == stop:
                    self._raise_covariance_by_gap(*gap)
            self._gaps = [gap for gap, at in zip(self._gaps, ends, strict=True) if at > stop]
            self._hold_speed()
        self._at = max(self._at, end)

    def _raise_covariance_by_gap(self, start: float, end: float) -> None:
        """Raise P by the unknown motion in a filled gap that has just ended, by its times [s]."""
        assert self._run is not None
        first = max(self.samples.number("time", start - AROUND - 1e-9), self.samples.first)
        # Densities of white noise, times the time over which it acts.
        variance = gap_noise(imu_between(self.samples, first, self.samples.end - 1), start, end) * (
            end - start
        )
        C_nb = Rotation.from_quat(self._run.state[_ATTITUDE], scalar_first=True).as_matrix()
        for block, part in ((ATT, variance[:3]), (VEL, variance[3:])):
            self._run.P[block, block] += C_nb * part @ C_nb.T

    def _hold_speed(self) -> None:
        """Take an impossible velocity back to zero."""
        assert self._run is not None
        speed, variance = np.linalg.norm(self._run.state[_VELOCITY]), np.diag(self.P)[VEL].max()
        if speed < LOST_SPEED and variance < LOST_SPEED**2:
            return
        P = self.P
        P[:6, :] = P[:, :6] = 0.0
        P[POS, POS] = P[VEL, VEL] = LOST_SPEED**2 * np.eye(3)
        self._begin(self._now()._replace(position=self._where, P=P))

    def _judge(self, end: int) -> None:
        """Decide whether the second that ends with a sample was still, and update with the rest so far."""
        edge = self._origin + SPAN * self._second
        before = max(self.samples.number("time", edge - SPAN - 1e-9), self.samples.first)
        start = max(self.samples.number("time", edge - 1e-9), before)
        edges = (
            np.array([start, end] if self.still == 0 or before == start else [before, start, end]) - before
        )
        imu = imu_between(self.samples, before, end)
        still = start < end and bool(still_seconds(imu, self.assumed, edges)[-1])
        if not still:
            self._stop()
        if self._run is not None and not self.rest:
            self._scale_up(imu.dtheta[edges[-2] :])
        if not still:
            if self._run is not None:
                self._second_start = self._now()
            return
        dt = np.diff(imu.time[edges[-2] :])[:, None]
        steps = np.concatenate((imu.dtheta[edges[-2] :], imu.dvelocity[edges[-2] :], dt), axis=1)
        if self.still == 0:
            self._anchor = None if self._run is None else self._second_start
            self._sums[:] = 0.0
        self.still += 1
        self._sums += steps.sum(axis=0)
        if self.still >= SHORTEST:
            self._update(end)
        if self._run is not None:
            self._second_start = self._now()

    def _stop(self) -> None:
        """Take note that the IMU moves."""
        if self.rest:
            self._turned, self._swung, self._scaled = np.zeros(3), 0.0, 0.0
        self.still, self.rest, self.refused = 0, 0.0, ""
        self._anchor = None
        self._sums[:] = 0.0

    def _scale_up(self, dtheta: FloatArray) -> None:
        """Raise P by what scale factors and misalignments of the gyros make of a second of rotation.

        The filter has no states for them. They act on the net rotation, and little on swings that return.
        """
        assert self._run is not None
        self._turned += dtheta.sum(axis=0)
        self._swung += float(np.linalg.norm(dtheta, axis=1).sum())
        angle = self._scale * (float(np.linalg.norm(self._turned)) + RETURNED * self._swung)
        if angle > self._scaled:
            at = np.arange(ATT.start, ATT.stop)
            # Only the growth is added: the angle is that since the rest, and its square is in P already up
            # to `_scaled`.
            self._run.P[at, at] += angle**2 - self._scaled**2
            self._scaled = angle

    def _update(self, end: int) -> None:
        """Update the estimate at the beginning of the mean with the mean, and hold it until now."""
        length = float(self._sums[6])
        mean = self._sums[:6] / length
        now = self._time(end)
        anchor = self._anchor
        if anchor is None or not self.rest:
            anchor = self._new_anchor(mean, now - length, anchor)
        variance = np.maximum(self.assumed.noise[:6], self._noise_densities(end)) / length
        variance += self.assumed.noise[6:] * length / 3  # of the mean of a random walk
        why = self._why_moving(anchor, mean, variance)
        if why:
            self._stop()
            self.refused = why
            return
        self._anchor, self.refused = anchor, ""
        found, searching = self._aligned(anchor, mean, variance)
        P = found.P.copy()
        at = np.arange(GYRO_BIAS.start, ACCEL_BIAS.stop)
        P[at, at] += self.assumed.noise[6:] * length
        P[:6, :] = P[:, :6] = 0.0
        P[POS, POS] = START_POSITION**2 * np.eye(3)
        P[VEL, VEL] = REST_VELOCITY**2 * np.eye(3)
        # The seconds before the rest was long enough to count belong to it as well.
        self.rest += SPAN if self.rest else length
        self.rest_place = self._where
        self._begin(found._replace(time=now, position=self._where, P=P))
        self._at = end
        if length >= (LONGEST_SEARCH if searching else LONGEST_MEAN):
            self._anchor = self._now()
            self._sums[:] = 0.0

    def _noise_densities(self, end: int) -> FloatArray:
        """Return the densities (6,) of the noise that the last second shows, if larger than assumed."""
        start = max(self.samples.number("time", self._time(end) - SPAN - 1e-9), self.samples.first)
        dt = np.diff(self.samples.rows("time", start, end + 1))[:, None]
        steps = np.concatenate(
            [self.samples.rows(name, start + 1, end + 1) / dt for name in ("dtheta", "dvelocity")], axis=1
        )
        return np.asarray(steps.var(axis=0) * float(dt.mean()))

    def _new_anchor(self, mean: FloatArray, time: float, before: Anchor | None) -> Anchor:
        """Return the estimate before a rest: level by the accelerometers, heading as before or given.

        The tilt is found anew. What looked like an accelerometer bias in the attitude of the last rest was
        in part a scale factor or misalignment, and looks different in this one.
        """
        heading, sigma = self._given
        if before is not None:
            heading, sigma = float(euler_from_quaternion(before.q_nb)[2]), float(np.sqrt(before.P[8, 8]))
        roll, pitch = level(mean[3:], np.array([0.0, 0.0, -1.0]), 0.0 if np.isnan(heading) else heading)
        P = self.assumed.P0[:15, :15].copy()
        P[POS, POS] = START_POSITION**2 * np.eye(3)
        P[VEL, VEL] = REST_VELOCITY**2 * np.eye(3)
        tilt = 1.0  # before the accelerometers are used: the update is linear in it, about the level attitude
        P[ATT, ATT] = np.diag([tilt**2, tilt**2, (UNKNOWN_HEADING if np.isnan(heading) else sigma) ** 2])
        q_nb = quaternion_from_euler(np.array([roll, pitch, 0.0 if np.isnan(heading) else heading]))
        bias = np.zeros(6)
        if before is not None:
            P[GYRO_BIAS, GYRO_BIAS] = before.P[GYRO_BIAS, GYRO_BIAS]
            bias[:3] = before.bias[:3]
        return Anchor(time, self._where.copy(), q_nb, bias, P)

    def _why_moving(self, anchor: Anchor, mean: FloatArray, variance: FloatArray) -> str:
        """Return why a still IMU does not rest; empty if it does."""
        g = float(earth.gravity(np.sin(anchor.position[0]), anchor.position[2]))
        sigma_force = float(
            np.sqrt(np.diag(anchor.P)[ACCEL_BIAS].max() + variance[3:].max() + GRAVITY_SIGMA**2)
        )
        excess = float(np.linalg.norm(mean[3:] - anchor.bias[3:])) - g
        if abs(excess) > TOO_STRONG * sigma_force:
            return (
                f"The specific force differs from gravity by {excess:.2f} m/s², more than accelerometer "
                f"biases of σ {sigma_force:.2f} m/s² explain: the IMU accelerates, or its scale is wrong."
            )
        # The Earth's rate in unknown directions: the heading may not be known yet.
        S = anchor.P[GYRO_BIAS, GYRO_BIAS] + np.diag(variance[:3]) + earth.RATE**2 * np.eye(3)
        rate = mean[:3] - anchor.bias[:3]
        if rate @ np.linalg.solve(S, rate) > TOO_FAST:
            return (
                f"The gyros show a steady rate of {np.degrees(np.linalg.norm(rate)):.3g} °/s, more than "
                f"their biases of σ {np.degrees(np.sqrt(np.trace(S) / 3)):.2g} °/s explain: the IMU "
                "turns, or its bias is larger than the settings state."
            )
        return ""

    def _aligned(self, anchor: Anchor, mean: FloatArray, variance: FloatArray) -> tuple[Anchor, bool]:
        """Return the estimate after an update with a mean, and whether north is still sought."""
        unknown = anchor.P[8, 8] > (UNKNOWN_HEADING / FOUND_RATIO) ** 2
        north, sigma = np.nan, np.inf
        if unknown and self.place is not None:
            north, sigma = self._north(anchor, mean, variance)
        sine = float(np.sin(anchor.position[0]))
        level_rate = earth.RATE * np.sqrt(1 - sine * sine)
        rate = mean[:3] - anchor.bias[:3]
        P, q_nb = anchor.P, anchor.q_nb
        if unknown and sigma < NORTH:
            roll, pitch, _ = euler_from_quaternion(q_nb)
            q_nb = quaternion_from_euler(np.array([roll, pitch, north]))
            self.heading_source = "by gyro-compassing"
        elif unknown:
            # Which part of the mean is the level rate of the Earth is unknown: the heading learns nothing,
            # and the bias is uncertain by it.
            P = with_heading(P, 1e-9)
            C_nb = Rotation.from_quat(q_nb, scalar_first=True).as_matrix()
            rate = rate + C_nb.T @ np.array([level_rate, 0.0, 0.0])
        wide = np.zeros((21, 21))
        wide[:15, :15] = P
        start = Start(anchor.position, np.zeros(3), q_nb)
        means = Means(mean[3:] - anchor.bias[3:], rate, np.diag(variance[3:]), np.diag(variance[:3]))
        made = align(start, wide, means)
        P = made.P[:15, :15].copy()
        if unknown and sigma >= NORTH:
            P = with_heading(P, float(np.sqrt(anchor.P[8, 8])))
            at = np.arange(GYRO_BIAS.start, GYRO_BIAS.stop)
            # Of a vector in an unknown level direction, each axis has half of the square.
            P[at, at] += np.maximum(0.0, level_rate**2 / 2 - np.diag(P)[GYRO_BIAS])
        bias = anchor.bias.copy()
        bias[:3] += made.gyro_bias
        found = Anchor(anchor.time, anchor.position, made.start.q_nb, bias, P)
        return found, bool(unknown and sigma >= NORTH)

    def _north(self, anchor: Anchor, mean: FloatArray, variance: FloatArray) -> tuple[float, float]:
        """Return the heading that the Earth's rate shows, and its σ [rad]."""
        roll, pitch, _ = euler_from_quaternion(anchor.q_nb)
        levelled = Rotation.from_euler("YX", [pitch, roll]).apply(mean[:3] - anchor.bias[:3])
        latitude = float(anchor.position[0])
        level_rate = earth.RATE * np.cos(latitude)
        tilt = np.diag(anchor.P)[ACCEL_BIAS].max() / STANDARD_GRAVITY**2
        noise = np.diag(anchor.P)[GYRO_BIAS].max() + variance[:3].max()
        # A tilt brings a part of the vertical rate of the Earth into the level one.
        noise += tilt * (earth.RATE * np.sin(latitude)) ** 2
        if not level_rate > 0:
            return np.nan, np.inf
        # In level axes with a heading of zero, north is at minus the heading.
        return float(np.arctan2(-levelled[1], levelled[0])), float(np.sqrt(noise) / level_rate)

    def _begin(self, here: Anchor) -> None:
        """Begin the filter with an estimate."""
        start = Start(here.position, np.zeros(3), here.q_nb, here.bias[:3])
        P0 = (here.P + here.P.T) / 2
        self._run = Filter.begin(start, Belief(P0, *self.assumed[1:]), here.time, PHI)
        self._run.state[_BIAS] = here.bias
        self.begun = True

    def _now(self) -> Anchor:
        position, _, q_nb, bias = (np.array(part) for part in self.solution)
        return Anchor(self._time(self._at), position, q_nb, bias, self.P)
