"""Live view: what a stream shows now, in numbers and in sentences."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from lab.base.arrays import FloatArray
from lab.live.attitude_only import NORTH, AttitudeOnly
from lab.live.live_state import (
    ALIGNING,
    ATTITUDE_ONLY,
    COASTING,
    NAVIGATING,
    WAITING,
    LiveState,
    symmetric,
)
from lab.live.live_stream import POSITION_LIMIT, Sample, Stream
from lab.motion.frames.displacement import metres_per_radian
from lab.navigation.standstill import SHORTEST

COASTS_AFTER: Final = 3.0
"""Time without a fix after which the navigator coasts [s]: two missing ones of a receiver at 1 Hz."""
DISPLACEMENT_LIMIT: Final = 10.0
"""Largest σ north or east with which a displacement without fixes is shown [m]."""


def describe_phase(stream: Stream) -> tuple[str, str]:
    """Return the phase of a stream, and a sentence why it is that one."""
    if not len(stream.samples):
        return WAITING, "The navigator waits for samples of the IMU, and for the time between them."
    if stream.attitude is not None:
        return _without_fixes(stream, stream.attitude)
    age, sigma = stream.fix_age, stream.position_sigma
    if not stream.has_position:
        return ATTITUDE_ONLY, (
            f"The last fix is {age:.0f} s old, and the σ of the position has grown to {sigma:.0f} m: a "
            f"position is shown up to {POSITION_LIMIT:g} m."
        )
    if age > COASTS_AFTER:
        return COASTING, f"The last fix is {age:.0f} s old: the position drifts, and its σ grows."
    return NAVIGATING, f"IMU and GPS: the position has a σ of {sigma:.2g} m."


def read_state(stream: Stream, counted: dict[str, Any]) -> LiveState:
    """Return the state of a stream.

    Parameters
    ----------
    stream
        The stream.
    counted
        The numbers of rows and fixes, and the remarks, as fields of `LiveState`.
    """
    phase, reason = describe_phase(stream)
    shown: dict[str, Any] = counted | {"phase": phase, "reason": reason}
    if phase == WAITING:
        return LiveState(**shown)
    shown["time"] = stream.now + stream.epoch
    if len(stream.fixes):
        shown["fix_time"] = float(stream.fixes.column("time")[-1]) + stream.epoch
    if stream.attitude is not None:
        shown |= _of_fix(stream)
    if phase == ALIGNING:
        return LiveState(**shown)
    here = stream.sample(stream.end - 1)
    sigma = np.sqrt(np.maximum(here.variance, 0.0))
    position, attitude = symmetric(here.variance[[[0, 1, 2], [6, 7, 8]]], here.covariance)
    shown |= {
        "euler": here.euler,
        "euler_sigma": here.euler_sigma,
        "bias": here.bias,
        "bias_sigma": sigma[9:15],
        "attitude_covariance": attitude,
        "rate": _rate(stream) - here.bias[:3],
        "is_at_rest": stream.is_at_rest,
    }
    if stream.attitude is not None:
        shown["heading_source"] = stream.attitude.heading_source
        shown |= _displacement(stream.attitude, here, sigma)
        return LiveState(**shown)
    if stream.alignment is not None:
        shown["heading_source"] = stream.alignment.heading.source
    shown |= _innovation(stream)
    if stream.has_position:
        shown |= {
            "position": here.position,
            "position_sigma": sigma[:3],
            "position_covariance": position,
            "velocity_n": here.velocity_n,
            "velocity_sigma": sigma[3:6],
        }
    return LiveState(**shown)


def _without_fixes(stream: Stream, attitude: AttitudeOnly) -> tuple[str, str]:
    """Return the phase of a stream whose full navigator did not start."""
    if not attitude.begun:
        still = f"it stands still for {attitude.still} s so far" if attitude.still else "it moves"
        return ALIGNING, attitude.refused or (
            f"The IMU must stand still for {SHORTEST} s to find the vertical; {still}."
        )
    of_fix = len(stream.fixes) and stream.fix_age <= COASTS_AFTER
    whose = "The position is that of the last fix." if of_fix else "There is no position."
    sentences = [f"{whose} {stream.missing}"]
    if not attitude.heading_is_known:
        sentences.append(_on_north(attitude))
    if attitude.refused:
        sentences.append(attitude.refused)
    return ATTITUDE_ONLY, " ".join(sentences)


def _on_north(attitude: AttitudeOnly) -> str:
    """Return a sentence about what gyro-compassing can reach."""
    reach = attitude.reachable()
    at = "at this latitude" if attitude.place is not None else "at a latitude of 45° (it is unknown)"
    if reach > NORTH:
        return (
            "The heading is relative: these gyros cannot find north, gyro-compassing would have a σ of "
            f"{'more than 180' if reach > np.pi else f'{np.degrees(reach):.0f}'}° {at}."
        )
    wanted = "" if attitude.place is not None else "; it needs the latitude"
    return (
        f"The heading is relative: gyro-compassing at rest reaches a σ of {np.degrees(reach):.2g}° "
        f"{at}{wanted}."
    )


def _of_fix(stream: Stream) -> dict[str, FloatArray]:
    """Return position and velocity of a recent fix, for a stream without a position of its own."""
    if stream.fix_age > COASTS_AFTER:
        return {}
    end = stream.fixes.end
    row = {
        name: stream.fixes.rows(name, end - 1, end)[0].copy()
        for name in ("position", "velocity_n", "variances")
    }
    sigma = np.sqrt(row["variances"])
    return {
        "position": row["position"],
        "position_sigma": sigma[:3],
        "position_covariance": np.diag(row["variances"][:3]),
        "velocity_n": row["velocity_n"],
        "velocity_sigma": np.where(np.isnan(row["velocity_n"]), np.nan, sigma[3:]),
    }


def _rate(stream: Stream) -> FloatArray:
    """Return the mean angular rate over the last step [rad/s]; NaN at the first sample."""
    start = max(stream.end - 2, stream.samples.first)
    time = stream.samples.rows("time", start, stream.end)
    if time.size < 2 or not time[-1] > time[0]:
        return np.full(3, np.nan)
    turn = stream.samples.rows("dtheta", stream.end - 1, stream.end)[0]
    return np.asarray(turn / (time[-1] - time[0]), dtype=np.float64)


def _innovation(stream: Stream) -> dict[str, FloatArray]:
    """Return the last innovation and its σ."""
    # The last fix that the filter used may be forgotten already.
    if stream.filter is None or stream.filter.next_fix <= max(stream.first_fix, stream.fixes.first):
        return {}
    last = stream.filter.next_fix
    S = stream.fixes.rows("innovation_covariance", last - 1, last)[0]
    return {
        "innovation": stream.fixes.rows("innovation", last - 1, last)[0].copy(),
        "innovation_sigma": np.sqrt(np.diagonal(S)),
    }


def _displacement(attitude: AttitudeOnly, here: Sample, sigma: FloatArray) -> dict[str, FloatArray]:
    """Return the displacement since the last rest, as long as it means something."""
    if sigma[:2].max() > DISPLACEMENT_LIMIT:
        return {}
    per_latitude, per_longitude = metres_per_radian(here.position[0], here.position[2])
    step = here.position - attitude.rest_place
    return {
        "displacement": np.array([step[0] * per_latitude, step[1] * per_longitude, -step[2]]),
        "displacement_sigma": sigma[:3],
    }
