"""Solution: the input and the output of a navigator as plain arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.motion.frames.displacement import displaced
from lab.motion.truth.trajectory import Truth
from lab.navigation.aids import Aids
from lab.navigation.filters import blocks
from lab.navigation.filters.kalman import MEASUREMENTS

HISTORIES = ("position", "velocity_n", "q_nb", "bias", "scale", "further", "variance", "covariance", "rest")
"""Arrays of a solution with one row for each sample."""


def _block(samples: int, widths: dict[str, int], dtype: DTypeLike) -> dict[str, FloatArray]:
    """Return flat arrays with given numbers of values per sample, by name, in one block of memory."""
    block = np.empty(samples * sum(widths.values()), dtype=dtype)
    cuts = np.cumsum([samples * width for width in widths.values()])[:-1]
    return dict(zip(widths, np.split(block, cuts), strict=True))


def _zeros(count: int) -> FloatArray:
    """Return read-only zeros."""
    values = np.zeros(count)
    values.setflags(write=False)
    return values


NO_VECTOR = _zeros(3)
"""Zero vector (3,), read-only: no lever arm, no bias."""
NO_GAPS = _zeros(0).reshape(0, 8)
"""No gap of the IMU (0, 8), read-only."""
NO_REST = _zeros(0).astype(np.bool_)
"""No sample at rest."""
NO_REST.setflags(write=False)


STEP_OVER = 4.0
"""Time over which the usual interval of an IMU is found [s]: a live navigator may start after 5 s, and must
schedule its steps as a batch run does."""


class Imu(NamedTuple):
    """Increments of the inertial sensors.

    Attributes
    ----------
    time : (n + 1,) array
        Ends of the sample intervals; the first value is the start of the first interval [s].
    dtheta, dvelocity : (n, 3) arrays
        Integrals of angular rate [rad] and specific force [m/s] over each interval, in b.
    rest : (n,) array
        Samples at rest that the filter may use; empty if it must not.
    """

    time: FloatArray
    dtheta: FloatArray
    dvelocity: FloatArray
    rest: NDArray[np.bool_] = NO_REST

    @property
    def step(self) -> float:
        """Usual interval between samples: the median in the first `STEP_OVER` [s]."""
        last = int(np.searchsorted(self.time, self.time[0] + STEP_OVER, side="right"))
        return float(np.median(np.diff(self.time[: max(last, 2)])))

    def until(self, sample: int) -> Imu:
        """Return the increments up to a sample."""
        if sample == self.dtheta.shape[0]:
            return self
        return Imu(self.time[: sample + 1], self.dtheta[:sample], self.dvelocity[:sample], self.rest[:sample])


class Fixes(NamedTuple):
    """GPS fixes, of the antenna.

    Attributes
    ----------
    time : (m,) array
        Time of validity, increasing: the time stamp less the latency of the receiver [s].
    position : (m, 3) array
        Latitude, longitude [rad], height [m].
    velocity_n : (m, 3) array
        Velocity north, east, down [m/s].
    """

    time: FloatArray
    position: FloatArray
    velocity_n: FloatArray


Input = TypeVar("Input", Imu, Fixes, Aids)


def read_only(given: Input) -> Input:
    """Return increments or fixes as read-only views.

    A kernel is compiled separately, for 20 s, for each combination of writable and read-only arrays. Every
    array can be passed as read-only, so all are.
    """
    return given._replace(**{name: _read_only(values) for name, values in given._asdict().items()})


def _read_only(values: NDArray[Any]) -> NDArray[Any]:
    view = np.ascontiguousarray(values).view()
    view.flags.writeable = False
    return view


class Start(NamedTuple):
    """The assumed start of a navigator.

    Attributes
    ----------
    position : (3,) array
        Latitude, longitude [rad], height [m].
    velocity_n : (3,) array
        Velocity north, east, down [m/s].
    q_nb : (4,) array
        Attitude, scalar first.
    gyro_bias : (3,) array
        Gyro bias from an alignment [rad/s].
    """

    position: FloatArray
    velocity_n: FloatArray
    q_nb: FloatArray
    gyro_bias: FloatArray = NO_VECTOR

    @classmethod
    def off(cls, truth: Truth, position: FloatArray, velocity: FloatArray, attitude: FloatArray) -> Start:
        """Return the first sample of the truth plus an error, as a start.

        Parameters
        ----------
        truth
            The flight.
        position, velocity, attitude : (3,) arrays
            Errors north, east, down [m], [m/s], and φ of Ĉ_nb = exp(−[φ×]) C_nb [rad].
        """
        return cls.each_off(truth, position[None], velocity[None], attitude[None])[0]

    @classmethod
    def each_off(
        cls, truth: Truth, position: FloatArray, velocity: FloatArray, attitude: FloatArray
    ) -> list[Start]:
        """Return the starts with some errors (k, 3) each; see `off`."""
        places = displaced(truth.taken(slice(1)).position, position)
        q_nb = Rotation.from_rotvec(-attitude) * Rotation.from_quat(truth.q_nb[0], scalar_first=True)
        both = zip(places, truth.velocity_n[0] + velocity, q_nb.as_quat(scalar_first=True), strict=True)
        return [cls(*one) for one in both]


class Belief(NamedTuple):
    """The assumptions of the filter.

    Attributes
    ----------
    P0 : (states, states) array
        Covariance of the initial error; its size is the filter's number of states.
    R : (6, 6) or (m, 6, 6) array
        Covariance of a fix, or of each: position north, east, down [m²], then velocity [(m/s)²].
    noise : (6 + k,) array
        Power spectral densities of gyro noise [rad²/s], accelerometer noise [(m/s)²/s], gyro bias drive
        [rad²/s³], accelerometer bias drive [(m/s²)²/s], and if the filter has further blocks the drive of all
        their states. k is 6 without further blocks.
    decay : (k,) array
        Decay rates of gyro and accelerometer biases, and of the states of further blocks: one over their
        correlation times [1/s].
    lever_arm : (3,) array
        Place of the antenna, from the IMU forward, right, down [m].
    gaps : (g, 8) array
        Start and end of filled gaps of the IMU [s], and the densities that they add to the noise of gyros
        [rad²/s] and accelerometers [(m/s)²/s].
    """

    P0: FloatArray
    R: FloatArray
    noise: FloatArray
    decay: FloatArray
    lever_arm: FloatArray = NO_VECTOR
    gaps: FloatArray = NO_GAPS

    def fix_covariance(self, fixes: NDArray[np.intp]) -> FloatArray:
        """Return R of some fixes, (6, 6) or (m, 6, 6)."""
        return self.R if self.R.ndim == 2 else np.asarray(self.R[fixes])


class Solution(NamedTuple):
    """The solution of a navigator: n + 1 samples at the IMU times, m fixes.

    Attributes
    ----------
    position : (n + 1, 3) array
        Latitude, longitude [rad], height [m].
    velocity_n : (n + 1, 3) array
        Velocity north, east, down [m/s].
    q_nb : (n + 1, 4) array
        Attitude, scalar first.
    bias : (n + 1, 6) array
        Estimated gyro [rad/s] and accelerometer [m/s²] biases.
    scale : (n + 1, 6) array, or (n + 1, 0) of a filter without these states
        Estimated scale factor errors of gyros and accelerometers.
    further : (n + 1, k) array
        Estimates of the further states of the filter (`blocks`), in their order.
    variance : (n + 1, states) array
        Diagonal of P: the 15 states of every filter in the order of `error_models.STATES`, then those of its
        blocks. For a long flight, all arrays over the samples except for the position are float32
        (`lab.base.histories`).
    covariance : (n + 1, 2, 3) array
        Elements (0, 1), (0, 2), (1, 2) of P's position and attitude blocks.
    innovation : (m, 6) array
        Innovation of each fix, position [m] and velocity [m/s] north, east, down: navigator minus GPS.
    innovation_covariance : (m, 6, 6) array
        Its covariance S.
    fix_covariance : (m, states, states) array
        P after each fix.
    fix_sample : (m,) array
        Sample after which each fix was used; −1 for fixes that are outside the IMU data or rejected.
    fix_rejected : (m,) array
        Whether the fix was rejected by the gate; its innovation is kept.
    fix_recovered : (m,) array
        Whether the filter used the fix after it took itself to be wrong and raised P; the innovation and its
        covariance are those before.
    fix_held : (m, 3) array
        The vertical in b, if heading and vertical gyro bias kept their estimates at the fix, which showed
        them at most by chance (`heading_observability`); else zero.
    fix_H : (m, 6, states) array
        Measurement matrix of the fix: the innovation is H times the error of the navigator, plus noise.
    fix_R : (m, 6, 6) array
        Covariance of the fix as used: divided by the weight of a robust update, and including the noise of
        the gyros on the lever arm.
    rest : (n + 1,) array
        Mask of the samples after which the filter made an update at rest.
    aid_innovation, aid_variance : (a,) arrays
        Innovation of each measurement of the aids, navigator minus measurement, and its variance; NaN for
        those outside the IMU data, and for headings of a nose that is too steep (`aids.LEAST_LEVEL`).
    aid_sample : (a,) array
        Sample after which each was used; −1 for those without an innovation, and for rejected ones.
    aid_H, aid_gain : (a, states) arrays
        Row of H of each, and the gain with which it was used, for errors in north, east, down; NaN where the
        filter has none: not used, or by a nonlinear filter.
    """

    position: FloatArray
    velocity_n: FloatArray
    q_nb: FloatArray
    bias: FloatArray
    scale: FloatArray
    further: FloatArray
    variance: FloatArray
    covariance: FloatArray
    innovation: FloatArray
    innovation_covariance: FloatArray
    fix_covariance: FloatArray
    fix_sample: NDArray[np.int64]
    fix_rejected: NDArray[np.bool_]
    fix_recovered: NDArray[np.bool_]
    fix_held: FloatArray
    fix_H: FloatArray
    fix_R: FloatArray
    rest: NDArray[np.bool_]
    aid_innovation: FloatArray
    aid_variance: FloatArray
    aid_sample: NDArray[np.int64]
    aid_H: FloatArray
    aid_gain: FloatArray

    @property
    def states(self) -> int:
        """Number of error states of the filter."""
        return int(self.variance.shape[1])

    @classmethod
    def empty(
        cls,
        samples: int,
        fixes: int,
        names: Sequence[str] = (),
        shown: DTypeLike = np.float64,
        aids: int = 0,
    ) -> Solution:
        """Return a solution with room for `samples` samples and `fixes` fixes.

        Parameters
        ----------
        samples, fixes
            How many there are.
        names
            Names of the further blocks of the filter.
        shown
            Type of the arrays, except for the position, which needs float64.
        aids
            How many measurements other than fixes there are.
        """
        scales = sum(blocks.block(name).size for name in names if name in blocks.SCALES)
        return cls._empty(samples, fixes, blocks.count(names), scales, shown, aids)

    def room(self, samples: int) -> Solution:
        """Return a solution with room for some samples of the same filter, in float64, and no fixes."""
        return self._empty(samples, 0, self.states, self.scale.shape[1], np.float64, 0)

    @classmethod
    def _empty(
        cls, samples: int, fixes: int, states: int, scales: int, shown: DTypeLike, aids: int
    ) -> Solution:
        """Return an empty solution.

        The histories share one block: the system allocates large blocks in large pages, which saves a fifth
        of the time of a run.
        """
        further = states - blocks.CORE - scales
        motion = {"position": 3, "velocity_n": 3, "q_nb": 4}
        others = {"bias": 6, "scale": scales, "further": further, "variance": states, "covariance": 6}
        if shown == np.float64:
            parts = _block(samples, motion | others, shown)
        else:
            position = {"position": motion.pop("position")}
            parts = _block(samples, position, np.float64) | _block(samples, motion | others, shown)
        return cls(
            position=parts["position"].reshape(samples, 3),
            velocity_n=parts["velocity_n"].reshape(samples, 3),
            q_nb=parts["q_nb"].reshape(samples, 4),
            bias=parts["bias"].reshape(samples, 6),
            scale=parts["scale"].reshape(samples, scales),
            further=parts["further"].reshape(samples, further),
            variance=parts["variance"].reshape(samples, states),
            covariance=parts["covariance"].reshape(samples, 2, 3),
            innovation=np.full((fixes, MEASUREMENTS), np.nan),
            innovation_covariance=np.full((fixes, MEASUREMENTS, MEASUREMENTS), np.nan),
            fix_covariance=np.full((fixes, states, states), np.nan),
            fix_sample=np.full(fixes, -1, dtype=np.int64),
            fix_rejected=np.zeros(fixes, dtype=np.bool_),
            fix_recovered=np.zeros(fixes, dtype=np.bool_),
            fix_held=np.zeros((fixes, 3)),
            fix_H=np.full((fixes, MEASUREMENTS, states), np.nan),
            fix_R=np.full((fixes, MEASUREMENTS, MEASUREMENTS), np.nan),
            rest=np.zeros(samples, dtype=np.bool_),
            aid_innovation=np.full(aids, np.nan),
            aid_variance=np.full(aids, np.nan),
            aid_sample=np.full(aids, -1, dtype=np.int64),
            aid_H=np.full((aids, states), np.nan),
            aid_gain=np.full((aids, states), np.nan),
        )
