"""Live start: when the samples and fixes so far suffice to start the navigator, and the start they give.

The batch looks at a whole log and carries the first heading back to its first sample. The live navigator
waits for that heading, starts at the same sample, and then processes what has waited.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from lab.base.arrays import FloatArray
from lab.data.checks.velocity_matching import WINDOW
from lab.data.log.auxiliary_data import AuxiliaryData
from lab.data.log.sensor_log import MIN_OVERLAP
from lab.data.streams.live_log import make_headings, make_magnetometer
from lab.data.streams.rolling import Rolling
from lab.live.live_state import imu_between
from lab.navigation.alignment import limits
from lab.navigation.alignment.alignment import Alignment, align
from lab.navigation.alignment.initial_heading import Hints, shows_course
from lab.navigation.log_navigation import start_fixes
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import Belief, Fixes
from lab.navigation.standstill import SHORTEST

AGAIN: Final = 10.0
"""Time between two attempts to find the heading from the change of the velocity [s]: one takes 0.1 s and
more, and looks at windows that are as long."""
_LATEST_GIVEN: Final = 1.0  # time of the first sample at which a given heading still holds [s]
_ROUNDING: Final = 1e-6  # of time stamps, as in `log_navigation` [s]


class Sought(NamedTuple):
    """The result of an attempt to start.

    Attributes
    ----------
    alignment : Alignment or None
        The start, if it was found.
    first : int
        Number of the sample at which it is.
    why : str
        What is missing; empty if nothing is.
    """

    alignment: Alignment | None
    first: int
    why: str


class LiveStart:
    """The search for a start, once a second.

    Parameters
    ----------
    navigator
        The settings, with the vehicle and a given heading.
    assumed
        The filter's assumptions.
    """

    def __init__(self, navigator: NavigatorSettings, assumed: Belief) -> None:
        self._navigator = navigator
        self._assumed = assumed
        self._tried = -np.inf  # time of the last attempt by the change of the velocity
        self._is_slow_course = False  # whether a course gave the heading, and none above `forward_speed` yet

    def seek(
        self,
        samples: Rolling,
        fixes: Rolling,
        shown: tuple[float, float, str] | None = None,
        headings: Rolling | None = None,
    ) -> Sought:
        """Return the start, if the data so far give one.

        Parameters
        ----------
        samples, fixes
            Rows as of `live_filter`.
        shown
            Heading at the first sample with a fix that the IMU alone shows, its σ [rad] and its source; None
            if it shows none.
        headings
            Measured headings, with the columns of `lab.live.live_aids.HEADINGS`; None without any.
        """
        if len(fixes) < 2:
            return Sought(
                None, 0, "No GPS fix has come yet." if not len(fixes) else "A second fix is missing."
            )
        times = fixes.column("time")
        first = samples.number("time", float(times[0]) - _ROUNDING)
        now = float(samples.column("time")[-1])
        overlap = min(now, float(times[-1])) - max(float(times[0]), float(samples.column("time")[0]))
        if overlap < MIN_OVERLAP:
            return Sought(None, first, f"IMU and GPS have {max(overlap, 0.0):.0f} s in common; it takes "
                          f"{MIN_OVERLAP:g} s.")  # fmt: skip
        imu = imu_between(samples, first, samples.end - 1)
        known, sigma = _fixes_with_velocity(fixes)
        magnetometer = make_magnetometer(imu.time, samples.rows("magnetic", first, samples.end))
        hints = Hints.of(
            AuxiliaryData(
                magnetometer=magnetometer,
                headings=None
                if headings is None
                else make_headings(*(headings.column(name) for name in ("time", "value", "sigma"))),
            ),
            self._navigator.vehicle,
            self._navigator.initial_heading,
            self._navigator.initial_heading_uncertainty,
            fixes.column("velocity_n"),
        )
        if samples.first > 0 or imu.time[0] > _LATEST_GIVEN:
            hints = hints._replace(given=np.nan)
        by_imu = np.isnan(hints.given) and shown is not None and hints.headings is None
        if by_imu and shown is not None:
            hints = hints._replace(given=shown[0], given_sigma=shown[1])
        why = self._not_yet(hints, known, sigma, now)
        if why:
            return Sought(None, first, why)
        made = align(imu, known, sigma, hints, self._assumed)
        if not made.heading.source:
            return Sought(None, first, f"The heading is unknown: {HOW}.")
        at_rest_still = made.rest >= int(now - imu.time[0]) - 1
        if made.rest and at_rest_still and made.rest < SHORTEST:
            return Sought(None, first, f"At rest for {made.rest:.0f} s; levelling takes {SHORTEST} s.")
        if by_imu and shown is not None:
            made = made._replace(heading=made.heading._replace(source=shown[2]))
        self._is_slow_course = made.heading.is_course and not _moves_forward(known, sigma)
        return Sought(made, first, "")

    def seek_again(self, samples: Rolling, fixes: Rolling, headings: Rolling | None = None) -> Sought:
        """Return the start by the kept data, once the first fast course can contradict that of a slow start.

        Parameters
        ----------
        samples, fixes, headings
            As in `seek`.
        """
        if not self._is_slow_course or not _moves_forward(*_fixes_with_velocity(fixes)):
            return Sought(None, 0, "")
        return self.seek(samples, fixes, None, headings)

    def _not_yet(self, hints: Hints, fixes: Fixes, sigma: FloatArray, now: float) -> str:
        """Return why an attempt cannot succeed yet, empty if it may: it costs too much to try each second."""
        if np.isfinite(hints.given) or hints.magnetometer is not None or hints.headings is not None:
            return ""
        fast = shows_course(fixes, sigma)
        course = np.flatnonzero(fast[1:] & fast[:-1])
        if course.size and np.isfinite(hints.vehicle.sideslip):
            # The motion may contradict the course of an unknown vehicle.
            wait = 0.0 if hints.vehicle.name else WINDOW
            left = wait - (now - float(fixes.time[course[0]]))
            return "" if left <= 0 else f"{COMPARED}, for {left:.0f} s more."
        speed = np.linalg.norm(fixes.velocity_n[:, :2], axis=1)
        moves = bool((speed[fixes.time > now - AGAIN] > limits.ALIGNMENT.rest_speed).any())
        if moves and now - self._tried >= AGAIN:
            self._tried = now
            return ""
        return f"The heading is unknown: {HOW}."


def _fixes_with_velocity(fixes: Rolling) -> tuple[Fixes, FloatArray]:
    """Return the fixes for a start, with velocities where none are measured, and the σ of these [m/s]."""
    known = Fixes(*(fixes.column(name) for name in ("time", "position", "known_velocity")))
    return start_fixes(known, fixes.column("velocity_n"), fixes.column("variances"))


def _moves_forward(fixes: Fixes, sigma: FloatArray) -> bool:
    """Return whether two fixes in a row are so fast that no vehicle moves backwards."""
    fast = shows_course(fixes, sigma) & (
        np.linalg.norm(fixes.velocity_n[:, :2], axis=1) > limits.ALIGNMENT.forward_speed
    )
    return bool((fast[1:] & fast[:-1]).any())


COMPARED: Final = (
    "The fixes show a course; whether it is the heading of an unknown vehicle (navigator.vehicle) is "
    "compared with its acceleration"
)
"""What the navigator does with the course of an unknown vehicle."""


HOW: Final = (
    "the vehicle must move faster than 1 m/s (and be known, by navigator.vehicle, if only positions come), "
    "or the heading be given (navigator.initial_heading), or a magnetometer or better gyros show it"
)
"""What gives a heading."""
