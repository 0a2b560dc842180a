"""Flight curves: position and velocity on a regular grid, from the quantities of a file.

Three methods: the recorded velocity, integrated and anchored to the positions; a smoothing spline through the
positions; the velocity through the air plus the wind.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy

from lab.base.arrays import FloatArray
from lab.data.rebuild import air_data
from lab.data.rebuild.derived_motion import SmoothAxes, roughness, spline_rates
from lab.data.rebuild.import_settings import AUTO, ImportSettings
from lab.data.rebuild.quantisation import value_steps
from lab.data.rebuild.raw_flight import JUDGED_SAMPLES, RawFlight
from lab.data.rebuild.sample_times import prediction_error
from lab.data.rebuild.smoothing import (
    WIDEST_STEPS,
    best_smoothing,
    evaluate_smoothed,
    slope_noise,
    smoothing_of_steps,
    smoothing_spline,
)
from lab.motion.frames import ecef
from lab.motion.frames.displacement import longer_above
from lab.motion.kinematics.anchoring import anchored_cartesian, anchored_offsets

NOISE_THAT_MATTERS = 0.5
"""Roughness of the acceleration from which a velocity is smoothed [m/s²]."""

_MIN_HEADING_SPEED = 1.0
"""Speed below which smoothed positions show no heading, for any remaining noise [m/s]."""
_NOISE_FACTOR = 3
"""The same speed over σ of the velocity's noise."""
_PREDICTED_BY = 5
"""Fewest samples by which the noise is judged: one and two neighbours on each side."""
_MISS_QUANTILE, _MAX_OFF_CURVE = 0.9, 1.0
"""A curve may leave the samples, rms, by this multiple of that quantile of what neighbours do not explain.
Noise is 1.39 times as large in that, and its 90 % quantile 1.64 σ: the bound is 2.3 σ of the samples."""
_MAX_CALMED = 10.0
"""Roughness to which noise is calmed, over that which matters: copters and walkers are rough themselves,
but not as much as this."""
_MIN_CALMING = 0.5
"""Part of the roughness to which smoothing has to bring it, to be worthwhile."""
_RAISES = 24
"""Most times that λ is raised: enough from the least to the widest."""
_RAISE = 4.0
"""Factor by which λ is raised: it widens the smoothing by √2."""
_LEAST_WIDTH = 0.3
"""Width from which λ is raised, in steps: narrower, it changes nothing."""


@dataclass(eq=False)
class FlightCurves:
    """The curves of one flight, and how they were made.

    Parameters
    ----------
    raw
        Samples at increasing times from 0.
    settings
        How to rebuild it.
    grid : (m,) array
        Times asked for [s].

    Attributes
    ----------
    smoothing : dict of float
        λ by the name of what was smoothed [s³].
    wind : (3,) array or None
        Velocity of the air that was added, north, east, down [m/s].
    slowest : float
        Speed below which the noise of the positions hides the heading [m/s].
    remarks : list of str
        Remarks on assumptions.
    """

    raw: RawFlight
    settings: ImportSettings
    grid: FloatArray
    smoothing: dict[str, float] = field(default_factory=dict)
    wind: FloatArray | None = None
    slowest: float = 0.0
    remarks: list[str] = field(default_factory=list)

    def of_velocity(self) -> tuple[FloatArray, FloatArray]:
        """Return latitude, longitude, height and velocity_n on the grid, by the recorded velocity."""
        assert self.raw.velocity_n is not None
        if self.raw.latitude is None:
            return self._integrated(self.raw.velocity_n, self._given_start())
        at = self.recorded_positions()
        axes = SmoothAxes(at[:, 0])
        velocity_f = self._smoothed_velocity(axes.vectors(self.raw.velocity_n, at))
        return self._held(at, axes, velocity_f)

    def of_positions(self) -> tuple[FloatArray, FloatArray]:
        """Return the same by a smoothing spline through the positions.

        The displacement over the ellipsoid in Earth-fixed axes and the height have separate splines: their
        resolutions differ.
        """
        position = self.recorded_positions()
        r_e = ecef.position(position * (1.0, 1.0, 0.0))
        # From the first position on: the radius of the Earth would take seven of the sixteen digits.
        steps = value_steps(self.raw)
        displacement = self._spline("position", r_e - r_e[0], steps["position"][0])
        if "position" in self.smoothing:
            off = float(np.sqrt(np.mean((displacement(self.raw.time) - r_e + r_e[0]) ** 2)))
            noise = slope_noise(self.raw.time, off, self.smoothing["position"])
            self.slowest = max(_MIN_HEADING_SPEED, _NOISE_FACTOR * noise)
        climb = self._spline("height", position[:, 2:], steps.get("height", (0.0, "m"))[0])
        there = ecef.geodetic(displacement(self.grid) + r_e[0])
        there[:, 2] = climb(self.grid)[:, 0]
        velocity_n = np.einsum("nji,nj->ni", ecef.axes(there[:, 0], there[:, 1]), displacement(self.grid, 1))
        # The spline runs on the ellipsoid; at a height, the same change of angle is a longer way.
        velocity_n[:, :2] *= np.stack(longer_above(there[:, 0], there[:, 2]), axis=-1)
        velocity_n[:, 2] = -climb(self.grid, 1)[:, 0]
        return there, velocity_n

    def of_air_data(self) -> tuple[FloatArray, FloatArray]:
        """Return the same by the velocity through the air and the wind."""
        time, kind = self.raw.time, self.settings.wind
        through_air = air_velocity(self.raw)
        self.wind = np.zeros(3)
        if kind == "constant":
            # A wind is named by where it comes from.
            blows = np.radians(self.settings.wind_from) + np.pi
            self.wind = self.settings.wind_speed * np.array([np.cos(blows), np.sin(blows), 0.0])
        if self.raw.latitude is None:
            start = self._given_start()
            if kind == "fitted":
                self.remarks.append("There are no positions to fit a wind, so still air is assumed.")
        else:
            recorded = self.recorded_positions()
            start = recorded[0]
            if kind == "fitted":
                self.wind, start = air_data.fit_wind(time, through_air, recorded)
        return self._integrated(through_air + self.wind, start)

    def recorded_positions(self) -> FloatArray:
        """Return the recorded latitude, longitude, height (n, 3); without heights, with a substitute."""
        assert self.raw.latitude is not None
        assert self.raw.longitude is not None
        height = self.raw.height
        if height is None:
            height = np.full(len(self.raw.time), float(self.settings.start_height))
            sentence = f"No height is recorded: {height[0]:g} m is assumed"
            if self.raw.velocity_n is not None:
                # Down is positive in n.
                climb = scipy.interpolate.CubicSpline(
                    self.raw.time, -self.raw.velocity_n[:, 2]
                ).antiderivative()
                height += climb(self.raw.time)
                sentence += " at the start, and then the integral of the vertical velocity"
            self._add_remark(f"{sentence} (setting start_height).")
        return np.stack((self.raw.latitude, self.raw.longitude, height), axis=-1)

    def _given_start(self) -> FloatArray:
        latitude, longitude = self.settings.start_latitude, self.settings.start_longitude
        height = self.settings.start_height
        self._add_remark(
            f"No position is recorded: the flight starts at {latitude:g}° latitude, {longitude:g}° "
            f"longitude, {height:g} m (settings start_latitude, start_longitude, start_height)."
        )
        return np.array([np.radians(latitude), np.radians(longitude), height])

    def _add_remark(self, sentence: str) -> None:
        if sentence not in self.remarks:
            self.remarks.append(sentence)

    def _integrated(self, velocity_n: FloatArray, start: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return position and velocity on the grid that a velocity gives from a start."""
        velocity = self._smoothed_velocity(velocity_n)
        at = air_data.integrate_velocity(self.raw.time, velocity, start)
        axes = SmoothAxes(at[:, 0])
        return self._held(at, axes, axes.vectors(velocity, at))

    def _held(
        self, at: FloatArray, axes: SmoothAxes, velocity_f: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return position and velocity on the grid: the integral of a velocity, anchored to positions."""
        time = self.raw.time
        if axes.polar:
            # About a pole, offsets in longitude have no bound: these are Cartesian.
            offsets = anchored_cartesian(time, at, axes.vectors_n(velocity_f, at), self.grid)
            position = ecef.geodetic(offsets + ecef.position(at[:1]))
        else:
            position = at[0] + anchored_offsets(time, at, velocity_f, self.grid)
        return position, axes.vectors_n(scipy.interpolate.CubicSpline(time, velocity_f)(self.grid), position)

    def _given_smoothing(self) -> float:
        return float(self.settings.smoothing_parameter) if self.settings.smoothing == "given" else 0.0

    def _spline(
        self, name: str, values: FloatArray, step: float
    ) -> scipy.interpolate.CubicSpline[np.float64]:
        """Return the spline through values recorded in steps, smoothed as the settings say."""
        parameter = self._given_smoothing()
        if self.settings.smoothing == AUTO:
            asked_for = best_smoothing(self.raw.time, values)
            parameter = max(asked_for, smoothing_of_steps(self.raw.time, values, step))
            parameter = calming_smoothing(self.raw.time, values, parameter, 2)
        if parameter:
            self.smoothing[name] = parameter
        return smoothing_spline(self.raw.time, values, parameter)

    def _smoothed_velocity(self, velocity: FloatArray) -> FloatArray:
        """Return a velocity smoothed as the settings say."""
        parameter = self._given_smoothing()
        if self.settings.smoothing == AUTO:
            own = slice(None, None, self.raw.every("velocity"))
            time = self.raw.time[own]
            parameter = worthwhile_smoothing(time, velocity[own], NOISE_THAT_MATTERS)
            if parameter and own.step > 1:
                # Interpolated values have no noise of their own, so smoothing uses the measured ones.
                self.smoothing["velocity"] = parameter
                curve = smoothing_spline(time, velocity[own], parameter)
                # Samples after the last measured value keep it: a spline that is extrapolated runs away.
                return np.asarray(curve(np.minimum(self.raw.time, time[-1])))
        if parameter:
            self.smoothing["velocity"] = parameter
        return evaluate_smoothed(self.raw.time, velocity, parameter)


def worthwhile_smoothing(time: FloatArray, values: FloatArray, matters: float) -> float:
    """Return the λ [s³] by which samples are smoothed best, zero where smoothing gains little.

    Parameters
    ----------
    time : (n,) array
        Increasing times [s].
    values : (n, m) array
        Samples.
    matters
        Roughness of their derivative below which they are left unchanged.
    """
    window = middle_stretch(len(time))
    at, samples = time[window], values[window]
    before = roughness(spline_rates(at, samples, 1))
    if before < matters:
        return 0.0
    parameter = calming_smoothing(time, values, best_smoothing(time, values), 1, _MAX_CALMED * matters)
    after = roughness(spline_rates(at, evaluate_smoothed(at, samples, parameter), 1))
    return parameter if after < _MIN_CALMING * before else 0.0


def calming_smoothing(
    time: FloatArray, values: FloatArray, parameter: float, order: int, matters: float = NOISE_THAT_MATTERS
) -> float:
    """Return a λ [s³], at least the given one, that leaves little roughness, as far as noise explains it.

    Cross-validation takes correlated errors for motion, such as those of stamps that were spread evenly
    over bursts of packets. No vehicle has so rough a derivative: λ is raised until it is smooth, or until
    the curve departs from the samples by more than their prediction errors.

    Parameters
    ----------
    time : (n,) array
        Increasing times [s].
    values : (n, m) array
        Samples.
    parameter
        λ to begin with [s³].
    order
        Which derivative has to be smooth.
    matters
        Roughness of that derivative that counts as smooth.
    """
    window = middle_stretch(len(time))
    at, samples = time[window], values[window]
    if len(at) <= _PREDICTED_BY:
        return parameter
    misses = np.linalg.norm(prediction_error(at, samples), axis=1)
    most_off = _MAX_OFF_CURVE * float(np.quantile(misses, _MISS_QUANTILE))
    step = float(np.median(np.diff(at)))
    found, tried = parameter, parameter
    for _ in range(_RAISES):
        curve = evaluate_smoothed(at, samples, tried)
        if float(np.sqrt(np.mean(np.sum((curve - samples) ** 2, axis=1)))) > most_off:
            break
        found = tried
        if roughness(spline_rates(at, curve, order)) < matters:
            break
        # λ = w⁴ step³ smooths over w steps; from none at all, raising begins at the least width.
        tried = max(_RAISE * tried, _LEAST_WIDTH**4 * step**3)
        if tried > WIDEST_STEPS**4 * step**3:
            break
    return found


def middle_stretch(samples: int) -> slice:
    """Return the middle stretch of a long record, enough to judge it by, or the whole of a short one."""
    start = max(samples - JUDGED_SAMPLES, 0) // 2
    return slice(start, start + JUDGED_SAMPLES)


def air_velocity(raw: RawFlight) -> FloatArray:
    """Return the velocity through the air (n, 3) of a flight with airspeed and attitude [m/s].

    Angles of the air flow that are not recorded are taken to be zero.
    """
    assert raw.airspeed is not None
    assert raw.euler is not None
    none = np.zeros_like(raw.airspeed)
    alpha = none if raw.alpha is None else raw.alpha
    beta = none if raw.beta is None else raw.beta
    return air_data.air_velocity(raw.airspeed, alpha, beta, raw.euler)


def offered(raw: RawFlight) -> dict[str, float]:
    """Return the curves that a flight's samples allow, with the roughness of their acceleration [m/s²].

    It is the `lab.data.rebuild.derived_motion.roughness` of splines through every sample, before any
    smoothing.
    """
    window = middle_stretch(len(raw.time))
    time = raw.time[window]
    curves: dict[str, float] = {}
    if raw.velocity_n is not None:
        own = slice(window.start, window.stop, raw.every("velocity"))
        curves["velocity"] = roughness(spline_rates(raw.time[own], raw.velocity_n[own], 1))
    position = raw.position
    if position is not None:
        own = slice(window.start, window.stop, raw.every("position"))
        places = ecef.position(position[own])
        curves["position"] = roughness(spline_rates(raw.time[own], places - places[0], 2))
    if raw.airspeed is not None and raw.euler is not None:
        curves["air data"] = roughness(spline_rates(time, air_velocity(raw)[window], 1))
    return curves
