"""Late fixes are named from the innovations of a filter that shares no code with ours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lab.analysis.verdicts.foreign_delay import fix_delay, of_delay
from lab.analysis.verdicts.foreign_evidence import Measurement, measure_innovations
from lab.base.arrays import FloatArray
from lab.data.log.filter_log import Measured, innovations_of
from lab.data.log.sensor_log import GnssLog

PERIOD, NOISE, DRIFT = 0.2, (0.7, 0.2), 0.1
TIME: FloatArray = np.asarray(PERIOD * np.arange(1200), dtype=float)
AXES = ("north", "east", "down")


def path(time: FloatArray) -> FloatArray:
    """Return the velocity (m, 3) of a vehicle that turns, climbs and changes its speed."""
    phase, speed = 0.15 * time + 2 * np.sin(0.11 * time), 15 + 4 * np.sin(0.07 * time)
    return np.column_stack((speed * np.cos(phase), speed * np.sin(phase), 2 * np.sin(0.2 * time)))


def innovations(
    seed: int, *, late: float = 0.0, q: float = 1.0, r: float = 1.0, turned: float = 0.0, sign: float = 1.0
) -> tuple[list[Measurement], GnssLog]:
    """Return the innovations of a filter of position and velocity for each axis, and the fixes of its log.

    Accelerations are those of the path, turned by an error of the heading, with white noise.
    """
    rng = np.random.default_rng(seed)
    fine = np.arange(-5.0, TIME[-1] + 0.01, 0.01)
    place = np.cumsum(path(fine), axis=0) * 0.01
    at = np.column_stack([np.interp(TIME - late, fine, one) for one in place.T])
    fixes = np.hstack((at, path(TIME - late))) + np.repeat(NOISE, 3) * rng.normal(size=(len(TIME), 6))
    cosine, sine = np.cos(turned), np.sin(turned)
    wrong = np.array(((cosine, sine, 0), (-sine, cosine, 0), (0, 0, 1)))
    gained = np.diff(path(TIME), axis=0) @ wrong + DRIFT * PERIOD**0.5 * rng.normal(size=(len(TIME) - 1, 3))
    F, R = np.array(((1, PERIOD), (0, 1))), np.diag(r * np.square(NOISE))
    Q = q * DRIFT**2 * np.array(((PERIOD**3 / 3, PERIOD**2 / 2), (PERIOD**2 / 2, PERIOD)))
    P, x = np.diag(np.square(NOISE)), np.stack((at[0], path(TIME)[0]))
    found, variances = [], []
    for k in range(len(TIME)):
        S = P + R
        nu = fixes[k].reshape(2, 3) - x
        found.append(nu.ravel())
        variances.append(np.repeat(np.diag(S), 3))
        K = P @ np.linalg.inv(S)
        x, P = x + K @ nu, P - K @ S @ K.T
        if k < len(TIME) - 1:
            x = F @ x + np.outer((PERIOD / 2, 1), gained[k])
            P = F @ P @ F.T + Q
    judged = []
    for name, unit, own in (("position", "m", slice(0, 3)), ("velocity", "m/s", slice(3, 6))):
        one = innovations_of(
            Measured(f"GPS {name}", AXES, unit), TIME, sign * np.array(found)[:, own], "made",
            variance=np.array(variances)[:, own],
        )  # fmt: skip
        assert one is not None
        judged.append(measure_innovations(one))
    ones = np.ones((len(TIME), 3))
    return judged, GnssLog(TIME, np.zeros_like(ones), fixes[:, 3:], ones, ones, np.zeros(3), 0.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("late", [0.2, 0.3])
def test_late_fixes_are_named_with_their_delay_whatever_the_sign_of_innovations(
    late: float, sign: float
) -> None:
    for seed in range(2):
        judged, gnss = innovations(seed, late=late, sign=sign)
        (named,) = of_delay(judged, gnss, 0.0)
        assert named.finding.factor == pytest.approx(late, rel=0.35)
        assert "later than the filter assumes" in named.finding.sentence
        assert "fixes (made, made)" in named.finding.evidence


def test_fixes_that_are_earlier_than_assumed_are_named_so() -> None:
    judged, gnss = innovations(1, late=-0.2)
    (named,) = of_delay(judged, gnss, 0.0)
    assert "earlier than the filter assumes" in named.finding.sentence


@pytest.mark.parametrize(
    "fault", [{}, {"q": 0.1}, {"q": 10.0}, {"r": 0.1}, {"r": 10.0}, {"turned": np.radians(5.0)}]
)
def test_no_delay_is_named_without_one(fault: dict[str, float]) -> None:
    assert not any(of_delay(*innovations(seed, **fault), 0.0) for seed in range(3))


def test_a_log_that_does_not_show_it_gives_no_delay() -> None:
    judged, gnss = innovations(1, late=0.2)
    unknown = replace(gnss, velocity_n=np.full((len(TIME), 3), np.nan))
    still = replace(gnss, velocity_n=np.zeros((len(TIME), 3)))
    without_time = replace(gnss, time=np.zeros(len(TIME)))
    for other in (unknown, still, without_time):
        assert fix_delay(judged, other, 0.0) is None
    assert fix_delay([], gnss, 0.0) is None
    assert fix_delay(judged, gnss, 1e6) is None
