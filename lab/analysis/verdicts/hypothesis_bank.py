"""Hypothesis bank: Kalman filters under hypotheses, eight side by side, from fix to fix.

P is symmetric, and few elements of the transition are not zero; neither is multiplied in vain. S is factored
as L D Lᵀ, which takes no root.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.navigation.kernels.compilation import entry_kernel, inline_kernel, kernel
from lab.navigation.kernels.lane_views import LANES, wide, wide_vectors

CHANNELS, AXES = 6, 3
"""Components of a fix: position, then velocity; and those of either."""
PARTS = 5
"""Parts of the noise that have factors of their own; see `imu_causes.Steps`."""
TOGETHER = 3
"""Rows or columns of P that are computed together: states come in threes."""


class Place(NamedTuple):
    """Where the numbers of a hypothesis begin in the buffer; P is first. Its states are N."""

    N: int
    PRODUCT: int  # Φ P
    APART: int  # error relative to that of the filter that ran
    MOVED: int  # the same after Φ
    SEEN: int  # P Hᵀ, row by row, then its product with the inverse of Lᵀ
    S: int  # covariance of the innovation, then L below the diagonal and D
    INVERSE: int  # of D
    INNOVATION: int  # then its product with the inverse of L
    Q: int  # factors on the parts of the noise
    RATIO: int  # roots of the factors on R
    VARIANCE: int  # of a correlated position error [m²]
    SQUARE: int  # normalised square of the innovation
    TOTAL: int  # log-likelihood
    END: int

    @classmethod
    def of(cls, N: int) -> Place:
        """Return the places for N states."""
        sizes = (N * N, N * N, N, N, N * CHANNELS, CHANNELS**2, CHANNELS, CHANNELS, PARTS, CHANNELS, 1, 1, 1)
        return cls(N, *np.cumsum(sizes).tolist())


class Offered(NamedTuple):
    """The m fixes of some intervals, and the propagation of the error over these."""

    transition: FloatArray  # (m, n, n)
    noise: FloatArray  # (m, PARTS, n, n)
    H: FloatArray  # (m, CHANNELS, n)
    R: FloatArray  # (m, CHANNELS, CHANNELS)
    innovation: FloatArray  # (m, CHANNELS), of the filter that ran
    correction: FloatArray  # (m, n), likewise
    skipped: NDArray[np.bool_]  # (m,), to which those beyond the limit are added


class Found(NamedTuple):
    """Innovations under the first hypothesis (m, 6), their covariances and gains, (m, 6, 6) and (m, n, 6)."""

    innovation: FloatArray
    covariance: FloatArray
    gains: FloatArray


class Terms(NamedTuple):
    """The elements of matrices that are not zero: in each row (r,), their number and columns (r, n).

    One element of each row is not among them: the one that a sum over the row begins with.
    """

    number: NDArray[np.int64]
    column: NDArray[np.int64]

    @classmethod
    def of(cls, matrices: FloatArray, begin: NDArray[np.intp]) -> Terms:
        """Return those of some matrices (m, r, n), whose sums begin with the columns (r,)."""
        some = (matrices != 0).any(axis=0)
        some[np.arange(begin.size), begin] = False
        return cls(some.sum(axis=1), np.argsort(~some, axis=1, kind="stable"))


@inline_kernel
def _propagate_element(w: Any, first: int, apart: int, transition: FloatArray, i: int, terms: Terms) -> Any:
    """Return element i of the product of the transition and the numbers from `first` on, each `apart`."""
    total = transition[i, i] * w[first + i * apart]
    for t in range(terms.number[i]):
        m = terms.column[i, t]
        total = total + transition[i, m] * w[first + m * apart]
    return total


@kernel
def _move(w: Any, place: Place, transition: FloatArray, decay: Any, terms: Terms) -> None:
    """Write the product of the transition and P, and propagate the errors."""
    n, N = transition.shape[0], place.N
    for i in range(n):
        own = transition[i, i]
        for j in range(0, N, TOGETHER):  # three sums at a time share the search for what is not zero
            at = i * N + j
            a, b, c = own * w[at], own * w[at + 1], own * w[at + 2]
            for t in range(terms.number[i]):
                m = terms.column[i, t]
                factor, at = transition[i, m], m * N + j
                a, b, c = a + factor * w[at], b + factor * w[at + 1], c + factor * w[at + 2]
            at = place.PRODUCT + i * N + j
            w[at], w[at + 1], w[at + 2] = a, b, c
        w[place.MOVED + i] = _propagate_element(w, place.APART, 1, transition, i, terms)
    for i in range(n):
        w[place.APART + i] = w[place.MOVED + i]
    for i in range(n, N):
        w[place.APART + i] = decay * w[place.APART + i]
        for j in range(N):
            w[place.PRODUCT + i * N + j] = decay * w[i * N + j]


@kernel
def _propagate(
    w: Any,
    place: Place,
    transition: FloatArray,
    noise: FloatArray,
    decay: Any,
    terms: Terms,
    driven: NDArray[np.bool_],
) -> None:
    """Propagate P and the errors to the next fix."""
    n, N = transition.shape[0], place.N
    _move(w, place, transition, decay, terms)
    for i in range(0, N, TOGETHER):
        row = place.PRODUCT + i * N
        for j in range(min(i + TOGETHER, n)):
            own, at = transition[j, j], row + j
            a, b, c = own * w[at], own * w[at + N], own * w[at + 2 * N]
            for t in range(terms.number[j]):
                m = terms.column[j, t]
                factor, at = transition[j, m], row + m
                a, b, c = a + factor * w[at], b + factor * w[at + N], c + factor * w[at + 2 * N]
            for part in range(PARTS if i < n else 0):
                if driven[part, i // TOGETHER, j]:
                    drive = w[place.Q + part]
                    a = a + noise[part, i, j] * drive
                    b = b + noise[part, i + 1, j] * drive
                    c = c + noise[part, i + 2, j] * drive
            w[i * N + j], w[(i + 1) * N + j], w[(i + 2) * N + j] = a, b, c
            w[j * N + i], w[j * N + i + 1], w[j * N + i + 2] = a, b, c
    for i in range(n, N):
        row = place.PRODUCT + i * N
        for j in range(n, i + 1):
            w[i * N + j] = decay * w[row + j]
            w[j * N + i] = w[i * N + j]
        w[i * N + i] = w[i * N + i] + w[place.VARIANCE] * (1.0 - decay * decay)


@inline_kernel
def _observe_component(w: Any, first: int, apart: int, H: FloatArray, c: int, N: int, seen: Terms) -> Any:
    """Return component c of the product of H and the numbers from `first` on, each `apart`."""
    n = H.shape[1]
    total = w[first] * H[c, 0]
    for t in range(seen.number[c]):
        m = seen.column[c, t]
        total = total + w[first + m * apart] * H[c, m]
    if n + c < N and c < AXES:  # the slow error of a position is a part of the fix
        total = total - w[first + (n + c) * apart]
    return total


@kernel
def _predict(
    w: Any,
    place: Place,
    H: FloatArray,
    R: FloatArray,
    innovation: FloatArray,
    correction: FloatArray,
    seen: Terms,
) -> None:
    """Predict a fix, given innovation and correction of the filter that ran."""
    N = place.N
    for i in range(N):
        for c in range(CHANNELS):
            w[place.SEEN + i * CHANNELS + c] = _observe_component(w, i * N, 1, H, c, N, seen)
    for c in range(CHANNELS):
        for d in range(c + 1):
            noise = w[place.RATIO + c] * w[place.RATIO + d] * R[c, d]
            w[place.S + c * CHANNELS + d] = noise + _observe_component(
                w, place.SEEN + d, CHANNELS, H, c, N, seen
            )
        w[place.INNOVATION + c] = innovation[c] - _observe_component(w, place.APART, 1, H, c, N, seen)
    for i in range(correction.size):
        # The filter that ran takes its correction here; that of the hypothesis is added in the update.
        w[place.APART + i] = w[place.APART + i] - correction[i]


@kernel
def _update(w: Any, place: Place) -> None:
    """Use the predicted fix."""
    N = place.N
    w[place.SQUARE] = 0.0
    for c in range(CHANNELS):
        for d in range(c):
            # Row c of L, times D so far.
            total = w[place.S + c * CHANNELS + d]
            for e in range(d):
                total = total - w[place.S + c * CHANNELS + e] * w[place.S + d * CHANNELS + e]
            w[place.S + c * CHANNELS + d] = total
        diagonal, nu = w[place.S + c * CHANNELS + c], w[place.INNOVATION + c]
        for d in range(c):
            entry = w[place.S + c * CHANNELS + d]
            part = entry * w[place.INVERSE + d]
            diagonal = diagonal - part * entry
            nu = nu - part * w[place.INNOVATION + d]
            w[place.S + c * CHANNELS + d] = part
        inverse = 1.0 / diagonal
        w[place.S + c * CHANNELS + c], w[place.INVERSE + c] = diagonal, inverse
        w[place.INNOVATION + c] = nu
        w[place.SQUARE] = w[place.SQUARE] + nu * nu * inverse
    for i in range(N):
        at = place.SEEN + i * CHANNELS
        for c in range(CHANNELS):
            total = w[at + c]
            for d in range(c):
                total = total - w[place.S + c * CHANNELS + d] * w[at + d]
            w[at + c] = total
    for i in range(N):
        at = place.SEEN + i * CHANNELS
        a, b, c = w[at] * w[place.INVERSE], w[at + 1] * w[place.INVERSE + 1], w[at + 2] * w[place.INVERSE + 2]
        d, e = w[at + 3] * w[place.INVERSE + 3], w[at + 4] * w[place.INVERSE + 4]
        f, nu = w[at + 5] * w[place.INVERSE + 5], place.INNOVATION
        w[place.APART + i] = (
            w[place.APART + i]
            + (a * w[nu] + b * w[nu + 1] + c * w[nu + 2])
            + (d * w[nu + 3] + e * w[nu + 4] + f * w[nu + 5])
        )
        for j in range(i + 1):
            on = place.SEEN + j * CHANNELS
            total = w[i * N + j] - (a * w[on] + b * w[on + 1] + c * w[on + 2])
            total = total - (d * w[on + 3] + e * w[on + 4] + f * w[on + 5])
            w[i * N + j] = total
            w[j * N + i] = total


@kernel
def _add_likelihood(buffer: FloatArray, first: int, place: Place) -> None:
    """Add the log-likelihood of a fix to that of each hypothesis; -inf without a covariance."""
    for lane in range(LANES):
        size, proper = 1.0, True
        for c in range(CHANNELS):
            diagonal = buffer[(first + place.S + c * (CHANNELS + 1)) * LANES + lane]
            proper = proper and diagonal > 0
            # det S is the product of D: one logarithm instead of six.
            size *= diagonal
        square = buffer[(first + place.SQUARE) * LANES + lane]
        at = (first + place.TOTAL) * LANES + lane
        if proper:
            buffer[at] -= 0.5 * (square + math.log(size))
        else:
            buffer[at] = -math.inf


@kernel
def _note(buffer: FloatArray, place: Place, nu: FloatArray, S: FloatArray) -> None:
    """Write the innovation under the first hypothesis, and its covariance."""
    for c in range(CHANNELS):
        nu[c] = buffer[(place.INNOVATION + c) * LANES]
        for d in range(c + 1):
            S[c, d] = S[d, c] = buffer[(place.S + c * CHANNELS + d) * LANES]


@kernel
def _note_gain(buffer: FloatArray, place: Place, gain: FloatArray) -> None:
    """Write the gain under the first hypothesis."""
    for i in range(gain.shape[0]):
        # K L = (P Hᵀ L⁻ᵀ) D⁻¹, solved from the last column back.
        for c in range(CHANNELS - 1, -1, -1):
            total = buffer[(place.SEEN + i * CHANNELS + c) * LANES] * buffer[(place.INVERSE + c) * LANES]
            for d in range(c + 1, CHANNELS):
                total -= gain[i, d] * buffer[(place.S + d * CHANNELS + c) * LANES]
            gain[i, c] = total


@inline_kernel
def _square_of_three(nu: FloatArray, S: FloatArray, at: int) -> float:
    """Return the normalised square of three components from `at` on."""
    a, d, e = S[at, at], S[at + 1, at], S[at + 2, at]
    # L D Lᵀ of three components, written out: a, b and c are D.
    b = S[at + 1, at + 1] - d * d / a
    f = S[at + 2, at + 1] - d * e / a
    c = S[at + 2, at + 2] - e * e / a - f * f / b
    x = nu[at]
    y = nu[at + 1] - d / a * x
    z = nu[at + 2] - e / a * x - f / b * y
    return float(x * x / a + y * y / b + z * z / c)


@entry_kernel
def follow(
    buffer: FloatArray,
    decays: FloatArray,
    groups: int,
    place: Place,
    offered: Offered,
    terms: Terms,
    seen: Terms,
    driven: NDArray[np.bool_],
    limit: float,
    found: Found,
) -> None:
    """Use the fixes of some intervals.

    Parameters
    ----------
    buffer
        The numbers of all hypotheses: group by group, of eight side by side.
    decays : (m · groups · LANES,) array
        What is left of a correlated error from fix to fix.
    groups
        Number of groups.
    place
        Where the numbers of a hypothesis begin.
    offered, terms, seen
        The fixes, and the elements of their transitions and of their H that are not zero.
    driven : (PARTS, n / TOGETHER, n) array
        Mask of the elements of the noise that are not zero, of rows that are computed together.
    limit
        As of `hypotheses.likelihoods`.
    found
        Receives what the very first hypothesis says.
    """
    wide_vectors()
    for g in range(groups):
        w = wide(buffer, g * place.END)
        for k in range(offered.skipped.size):
            decay = wide(decays, k * groups + g)[0]
            _propagate(w, place, offered.transition[k], offered.noise[k], decay, terms, driven)
            nu, correction = offered.innovation[k], offered.correction[k]
            _predict(w, place, offered.H[k], offered.R[k], nu, correction, seen)
            if g == 0:
                own, S = found.innovation[k], found.covariance[k]
                _note(buffer, place, own, S)
                if limit < math.inf:
                    most = max(_square_of_three(own, S, 0), _square_of_three(own, S, 3))
                    offered.skipped[k] = offered.skipped[k] or most > limit
            if offered.skipped[k]:
                continue
            _update(w, place)
            _add_likelihood(buffer, g * place.END, place)
            if g == 0:
                _note_gain(buffer, place, found.gains[k])
