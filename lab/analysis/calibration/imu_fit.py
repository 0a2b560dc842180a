"""IMU fit: bias, scale factors and misalignments of both triads by one least squares over rests and turns.

The unknown attitude of each rest is the direction u of gravity's reaction in the device. At rest, the
accelerometers measure K_a g u + b_a, and the gyros b_g and the Earth's rate. Over a turn, the rates that the
gyros measured, less their errors, carry u and the unknown Earth's rate from one rest to the next. The common
rotation of all axes against the vehicle does not show: the axes of the device are those for which K_a is
symmetric, and the gyros are aligned to them.

A weak knowledge of each term (`PRIOR`) keeps the solution finite where rests and turns show nothing. The
sizes of the three kinds of errors follow from their own residuals and redundancy.

References
----------
S. Bonnet et al., *Calibration methods for inertial and magnetic sensors*, Sensors and Actuators A 156, 2009,
for rests; D. Tedaldi, A. Pretto, E. Menegatti, *A robust and easy to implement method for IMU calibration
without external equipments*, ICRA 2014, for turns between them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lab.analysis.calibration.rests import Rests, Turn
from lab.base.arrays import FloatArray
from lab.motion.frames import earth
from lab.motion.frames.rotation import skew

BIAS_A, SHAPE_A, BIAS_G, MATRIX_G = slice(0, 3), slice(3, 9), slice(9, 12), slice(12, 21)
"""The terms: accelerometer bias, its matrix (xx, yy, zz, xy, xz, yz), gyro bias, its matrix by rows."""
TERMS = 21
"""Number of terms."""
ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""The entries of the symmetric matrix in their order."""
PRIOR = np.concatenate(
    (
        np.full(3, 1.0),
        np.full(3, 0.1),
        np.full(3, 0.05),
        np.full(3, 0.1),
        np.where(np.eye(3), 0.1, 0.05).ravel(),
    )
)
"""σ of each term before the log is seen: biases of 1 m/s² and 6 °/s, scale factors of 10 %, misalignments of
3°. Consumer sensors have a fifth of it."""
OUTER = 5
"""Passes over the samples of the turns: with 10 % of scale factor, the fourth changes nothing."""
INNER = 6
"""Steps for the sizes of the errors on one linearisation."""
FEWEST_DEGREES = 4.0
"""Redundancy of a kind of errors from which their size is taken from the residuals."""
REPEATED = 1e-5
"""Least σ of a carried direction [rad]: a micrometre under a box of ten centimetres."""


class Fit(NamedTuple):
    """A solution.

    Attributes
    ----------
    terms : (21,) array
        The terms, as `BIAS_A` and the others name them, in SI units.
    covariance : (21, 21) array
        Their covariance.
    degrees : (3,) array
        Degrees of freedom behind the sizes of the errors of forces, turns and rates at rest.
    sizes : (3,) array
        Those sizes, in the σ that noise alone would make.
    """

    terms: FloatArray
    covariance: FloatArray
    degrees: FloatArray
    sizes: FloatArray

    @property
    def sigma(self) -> FloatArray:
        """σ (21,) of the terms."""
        return np.sqrt(np.diagonal(self.covariance))


def matrices(terms: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return K_a and K_g (3, 3) of terms (21,): measured = K true + bias."""
    K_a = np.eye(3)
    for value, (row, column) in zip(terms[SHAPE_A], ENTRIES, strict=True):
        K_a[row, column] = K_a[column, row] = (row == column) + value
    return K_a, np.eye(3) + terms[MATRIX_G].reshape(3, 3)


class Carried(NamedTuple):
    """What a turn does with a direction: v = R u, and how v depends on the terms of the gyros.

    Attributes
    ----------
    R : (3, 3) array
        Resolves a direction in the axes after the turn.
    bias : (3, 3) array
        Derivative of the rotation after the turn by the bias.
    matrix : (3, 9) array
        The same by the matrix.
    """

    R: FloatArray
    bias: FloatArray
    matrix: FloatArray


def integrate_turn(turn: Turn, K_g: FloatArray, bias: FloatArray) -> Carried:
    """Return the rotation of a turn by its rates less their errors."""
    inverse = np.linalg.inv(K_g)
    rate = (turn.rate - bias) @ inverse.T
    steps = Rotation.from_rotvec(rate * turn.dt[:, None]).as_quat()
    # From the axes after each sample to those before the turn: products of all steps so far, doubling.
    done = 1
    while done < len(steps):
        steps[done:] = (Rotation.from_quat(steps[:-done]) * Rotation.from_quat(steps[done:])).as_quat()
        done *= 2
    D = Rotation.from_quat(steps).as_matrix() if len(steps) else np.eye(3)[None]
    R = D[-1].T
    dt = turn.dt[:, None, None] if len(steps) else np.zeros((1, 1, 1))
    if not len(steps):
        rate = np.zeros((1, 3))
    # A bias takes its turn off every step; D resolves the axes after a step in those before the turn.
    of_bias = -R @ (D * dt).sum(axis=0) @ inverse
    of_matrix = np.empty((3, 3, 3))
    for column in range(3):
        of_matrix[:, :, column] = -R @ (D * dt * rate[:, column, None, None]).sum(axis=0) @ inverse
    return Carried(R, of_bias, of_matrix.reshape(3, 9))


class _State(NamedTuple):
    """A solution while it is found: terms (21,), directions (n, 3), the Earth's rate (c, 3) of each chain."""

    terms: FloatArray
    up: FloatArray
    earth: FloatArray


@dataclass(frozen=True, eq=False)
class Problem:
    """The whitened equations about one solution: residuals and their derivatives by terms and others.

    Attributes
    ----------
    residual : (m,) array
        Measured minus predicted, in σ.
    jacobian : (m, w) array
        Derivatives of the prediction by the terms, by the Earth's rate of each chain, and by two turns of the
        direction of each rest.
    kind : (m,) array
        0 for forces, 1 for turns, 2 for rates at rest.
    rests : (m, 2) array
        The rests that an equation is of, the same twice for forces and rates.
    about, prior : (w,) arrays
        The unknowns about which the equations are, and their σ beforehand; directions have none.
    """

    residual: FloatArray
    jacobian: FloatArray
    kind: NDArray[np.int64]
    rests: NDArray[np.int64]
    about: FloatArray
    prior: FloatArray

    def without(self, withheld: NDArray[np.int64]) -> Problem:
        """Return the equations that no withheld rest is in."""
        kept = ~np.isin(self.rests, withheld).any(axis=1)
        return replace(
            self,
            residual=self.residual[kept],
            jacobian=self.jacobian[kept],
            kind=self.kind[kept],
            rests=self.rests[kept],
        )


def solve(rests: Rests, gravity: float) -> tuple[Fit, Problem]:
    """Return the solution for rests and turns, and the equations about it.

    Parameters
    ----------
    rests
        The rests and turns.
    gravity
        Gravity at the place [m/s²].
    """
    terms = np.zeros(TERMS)
    terms[BIAS_G] = np.median(rests.rate, axis=0)
    chain = _chains(rests)
    up = rests.force / np.linalg.norm(rests.force, axis=1)[:, None]
    state = _State(terms, up, np.zeros((chain[-1] + 1, 3)))
    for _ in range(OUTER):
        problem, bases = _equations(rests, state, chain, gravity)
        fit, others = solve_linear(problem)
        turned = others[state.earth.size :].reshape(-1, 2)
        up = state.up + np.einsum("nij,nj->ni", bases, turned)
        up /= np.linalg.norm(up, axis=1)[:, None]
        state = _State(fit.terms, up, state.earth + others[: state.earth.size].reshape(-1, 3))
    problem, _ = _equations(rests, state, chain, gravity)
    return solve_linear(problem)[0], problem


def solve_linear(problem: Problem) -> tuple[Fit, FloatArray]:
    """Return the solution of equations, and the changes of the other unknowns."""
    J, r, kind = problem.jacobian, problem.residual, problem.kind
    weight = 1 / problem.prior**2
    # Directions of withheld rests are in no equation.
    weight[(weight == 0) & ~(J != 0).any(axis=0)] = 1.0
    parts = [J[kind == k].T @ J[kind == k] for k in range(3)]
    sides = [J[kind == k].T @ r[kind == k] for k in range(3)]
    sizes, degrees = np.ones(3), np.zeros(3)
    for _ in range(INNER):
        normal, side = np.diag(weight), -weight * problem.about
        for k in range(3):
            normal, side = normal + parts[k] / sizes[k] ** 2, side + sides[k] / sizes[k] ** 2
        inverse = np.linalg.inv(normal)
        change = inverse @ side
        left = r - J @ change
        for k in range(3):
            # Redundancy: the number of equations less what they determine, tr(N⁻¹ Nₖ).
            degrees[k] = (kind == k).sum() - np.sum(inverse * parts[k]) / sizes[k] ** 2
            if degrees[k] > FEWEST_DEGREES:
                sizes[k] = np.sqrt(np.sum(left[kind == k] ** 2) / degrees[k])
    covariance = np.asarray(inverse[:TERMS, :TERMS], dtype=np.float64)
    fit = Fit(problem.about[:TERMS] + change[:TERMS], covariance, degrees, sizes)
    return fit, change[TERMS:]


def _chains(rests: Rests) -> NDArray[np.int64]:
    """Return the number of the chain (n,) of each rest: turns join the rests of one."""
    joined = {turn.last for turn in rests.turns}
    begins = [number not in joined for number in range(rests.count)]
    return np.asarray(np.cumsum(begins) - 1)


def _equations(
    rests: Rests, state: _State, chain: NDArray[np.int64], gravity: float
) -> tuple[Problem, FloatArray]:
    """Return the equations about a solution, and two tangents (n, 3, 2) of each direction."""
    n, terms, up = rests.count, state.terms, state.up
    K_a, K_g = matrices(terms)
    bases = np.stack([_tangents(one) for one in up])
    first_turned = TERMS + state.earth.size
    width = first_turned + 2 * n
    places = [slice(first_turned + 2 * i, first_turned + 2 * i + 2) for i in range(n)]
    of_earth = [slice(TERMS + 3 * c, TERMS + 3 * c + 3) for c in chain]
    equations = _Equations(width)
    since = np.tile(np.eye(3), (n, 1, 1))  # from the first rest of the chain to each
    for turn in rests.turns:
        first, last = turn.first, turn.last
        found = integrate_turn(turn, K_g, terms[BIAS_G])
        since[last] = found.R @ since[first]
        v, B = found.R @ up[first], bases[last].T
        # A rotation δ after the turn, in the axes of the device, takes v to v + v × δ.
        turned = -turn.duration * found.R @ since[first]
        v = v + np.cross(v, turned @ state.earth[chain[first]])
        # σ of a mean over T is density / √T: hence the density of the noise.
        walk = float(np.mean(rests.rate_sigma * np.sqrt(rests.end - rests.begin)[:, None]))
        sigma = np.hypot(walk * np.sqrt(turn.duration), REPEATED)
        J = np.zeros((2, width))
        J[:, BIAS_G] = B @ skew(v) @ found.bias
        J[:, MATRIX_G] = B @ skew(v) @ found.matrix
        J[:, of_earth[first]] = B @ skew(v) @ turned
        J[:, places[first]] = B @ found.R @ bases[first]
        J[:, places[last]] = -np.eye(2)
        equations.add(J, B @ (up[last] - v), np.full(2, sigma), 1, (first, last))
    for i in range(n):
        J = np.zeros((3, width))
        J[:, BIAS_A] = np.eye(3)
        for place, (row, column) in enumerate(ENTRIES, SHAPE_A.start):
            J[row, place], J[column, place] = gravity * up[i, column], gravity * up[i, row]
        J[:, places[i]] = gravity * K_a @ bases[i]
        left = rests.force[i] - gravity * K_a @ up[i] - terms[BIAS_A]
        equations.add(J, left, rests.force_sigma[i], 0, (i, i))
        J = np.zeros((3, width))
        J[:, BIAS_G] = np.eye(3)
        J[:, of_earth[i]] = since[i]
        left = rests.rate[i] - terms[BIAS_G] - since[i] @ state.earth[chain[i]]
        equations.add(J, left, rests.rate_sigma[i], 2, (i, i))
    prior = np.full(width, np.inf)
    prior[:TERMS], prior[TERMS:first_turned] = PRIOR, earth.RATE / np.sqrt(3)
    about = np.concatenate((terms, state.earth.ravel(), np.zeros(2 * n)))
    return equations.problem(about, prior), bases


class _Equations:
    """Collects equations."""

    def __init__(self, width: int) -> None:
        self._width = width
        self._rows: list[FloatArray] = []
        self._sides: list[FloatArray] = []
        self._kinds: list[int] = []
        self._rests: list[tuple[int, int]] = []

    def add(
        self, J: FloatArray, left: FloatArray, sigma: FloatArray, kind: int, rests: tuple[int, int]
    ) -> None:
        """Take some of one kind, with the σ of each."""
        self._rows.append(J / sigma[:, None])
        self._sides.append(left / sigma)
        self._kinds += [kind] * left.size
        self._rests += [rests] * left.size

    def problem(self, about: FloatArray, prior: FloatArray) -> Problem:
        """Return them."""
        return Problem(
            np.concatenate(self._sides),
            np.concatenate(self._rows),
            np.array(self._kinds),
            np.array(self._rests),
            about,
            prior,
        )


def _tangents(up: FloatArray) -> FloatArray:
    """Return two directions (3, 2) that are perpendicular to one and to each other."""
    _, _, basis = np.linalg.svd(up[None])
    return np.asarray(basis[1:].T)
