"""Live algorithm: an attitude filter of the user's own, which gets a stream piece by piece.

It is an object, or is loaded from a Python file that the user names. The file is executed, so only whoever
runs the laboratory may name it.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.python_file import PythonFileError, describe_error, load_object

FORM: Final = "FILE.py:Name, such as my_filter.py:MyFilter"
OFF_UNIT: Final = 1e-3
"""Largest deviation of the length of a quaternion from one, as of `lab.navigation.algorithm.OFF_UNIT`."""


class LiveAlgorithmError(ValueError):
    """A user's live algorithm failed or did not return attitudes; the message says which one, and why."""


class ImuPiece(NamedTuple):
    """Samples of the IMU since the last call, in the axes of the vehicle: forward, right, down.

    Attributes
    ----------
    time : (n,) array
        Time at which each sample ends, in the clock of the computer [s].
    dt : (n,) array
        Time since the sample before [s]; long after a gap.
    rate : (n, 3) array
        Angular rate [rad/s].
    force : (n, 3) array
        Specific force [m/s²]: at rest it points up and has the size of gravity.
    magnetic : (n, 3) array
        Magnetic field [T]; NaN without a magnetometer.
    """

    time: FloatArray
    dt: FloatArray
    rate: FloatArray
    force: FloatArray
    magnetic: FloatArray


class FixPiece(NamedTuple):
    """Fixes of the receiver since the last call; often none.

    Attributes
    ----------
    time : (m,) array
        Time of validity, in the clock of the computer [s].
    position : (m, 3) array
        Latitude, longitude [rad], height [m].
    velocity_n : (m, 3) array
        Velocity north, east, down [m/s]; NaN where it is not measured.
    position_sigma : (m, 3) array
        σ north, east, down [m]; NaN where it is not given.
    """

    time: FloatArray
    position: FloatArray
    velocity_n: FloatArray
    position_sigma: FloatArray


@runtime_checkable
class LiveAlgorithm(Protocol):
    """Any object that follows a stream."""

    def step(self, imu: ImuPiece, fixes: FixPiece) -> Any:
        """Return the attitude after a piece of the stream.

        Parameters
        ----------
        imu
            The samples since the last call, one or more.
        fixes
            The fixes since then.

        Returns
        -------
        (4,) or (n, 4) array, or None
            `q_nb` after the last sample, or after each: unit quaternions, scalar first, whose rotation takes
            the axes of the vehicle to north, east and down. None while there is no attitude yet.
        """


class Piece(NamedTuple):
    """A piece of a stream as it travels to the process of an algorithm."""

    imu: ImuPiece
    fixes: FixPiece


def step_algorithm(algorithm: LiveAlgorithm, name: str, piece: Piece) -> FloatArray:
    """Return the attitudes (k, 4) that an algorithm gives for a piece: k is n, or 1, or 0 for none yet.

    Raises
    ------
    LiveAlgorithmError
        If it raises an exception, which is the error's cause, or if what it returns is no attitude.
    """
    try:
        found = algorithm.step(*piece)
    except (Exception, SystemExit, KeyboardInterrupt) as error:
        raise LiveAlgorithmError(f"{name}: raised an exception: {describe_error(error)}") from error
    if found is None:
        return np.zeros((0, 4))
    try:
        q_nb = np.array(found, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise LiveAlgorithmError(
            f"{name}: step returned {type(found).__name__}; accepted is q_nb, (4,) or (n, 4), or None"
        ) from error
    count = piece.imu.time.size
    if q_nb.shape not in ((4,), (count, 4)):
        raise LiveAlgorithmError(
            f"{name}: step returned an array of the shape {q_nb.shape}; accepted is (4,) or ({count}, 4)"
        )
    q_nb = q_nb.reshape(-1, 4)
    length = np.linalg.norm(q_nb, axis=1, keepdims=True)
    if not np.isfinite(length).all():
        raise LiveAlgorithmError(f"{name}: step returned an attitude that is not finite")
    if not (np.abs(length - 1) < OFF_UNIT).all():
        raise LiveAlgorithmError(f"{name}: step returned a q_nb that is no unit quaternion")
    return np.asarray(q_nb / length)


def load_live_algorithm(place: str) -> LiveAlgorithm:
    """Execute a Python file and return its live algorithm.

    Parameters
    ----------
    place
        ``FILE.py:Name``. The name is that of a class, which is called without arguments, or of an object.

    Raises
    ------
    LiveAlgorithmError
        If the file or the name does not exist, fails, or has no method `step`.
    """
    try:
        found: LiveAlgorithm = load_object(place, FORM, "step(imu, fixes)", "live algorithms in the file")
    except PythonFileError as error:
        raise LiveAlgorithmError(str(error)) from (error.__cause__ or error)
    return found


def cut_pieces(imu: NDArray[np.void], fixes: FixPiece, before: float, longest: float) -> list[Piece]:
    """Return samples and fixes in pieces; each fix is in the first piece that ends after it.

    Parameters
    ----------
    imu : (n,) array of `lab.data.clock.timed_samples.TIMED_IMU`
        Samples with rate and force, in the order of their times.
    fixes
        Fixes in the order of their times; those later than the last sample are in the last piece.
    before
        Time of the sample before the first one; NaN if there is none [s].
    longest
        Longest time of a piece [s].
    """
    time = imu["time"]
    if not time.size:
        return []
    usual = float(np.median(np.diff(time))) if time.size > 1 else 0.0
    dt = np.diff(time, prepend=before if np.isfinite(before) else time[0] - usual)
    cuts = np.flatnonzero(np.diff(np.floor((time - time[0]) / longest)) > 0) + 1
    edges = [0, *cuts.tolist(), time.size]
    ends = np.searchsorted(fixes.time, time[np.array(edges[1:]) - 1], side="right")
    ends[-1] = fixes.time.size
    begins = [0, *ends[:-1].tolist()]
    return [
        Piece(
            ImuPiece(
                time[a:b].copy(), dt[a:b], *(imu[name][a:b].copy() for name in ("rate", "force", "magnetic"))
            ),
            FixPiece(*(part[c:d].copy() for part in fixes)),
        )
        for a, b, c, d in zip(edges[:-1], edges[1:], begins, ends.tolist(), strict=True)
    ]
