"""Magnetometer calibration: hard and soft iron from the fields of a log with turns, judged on withheld parts.

Without iron, the fields in the axes of the device lie on a sphere about zero. Hard iron moves its centre;
soft iron makes an ellipsoid of it. Three models are tried, each with the size of the field: ellipsoid,
sphere, and, if the device only turned about one axis, an ellipse in its plane. The richest one is taken that
the log shows and that predicts withheld parts better than the poorer ones.

References
----------
T. Ozyagcilar, *Calibrating an eCompass in the Presence of Hard- and Soft-Iron Interference*, Freescale
AN4246, 2015. M. J. Caruso, *Applications of Magnetic Sensors for Low Cost Compass Systems*, IEEE PLANS 2000.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from lab.analysis.calibration.terms import Judgement, Term, judge
from lab.base.arrays import FloatArray
from lab.base.files.mission_error import MissionError
from lab.base.parameters.counted import count_noun
from lab.data.log.calibration import MOST_SHAPE, Calibration, Linear


@dataclass(frozen=True)
class FieldLimits:
    """What a log must show of the fields."""

    most: int = 4000
    """Most fields that are used: at 50 Hz neighbours in a log of minutes say the same."""
    fewest: int = 100
    """Fewest fields: nine numbers and their σ are sought."""
    shortest: float = 10.0
    """Shortest log [s]: a turn by hand about one axis takes some seconds."""
    depth: float = 0.12
    """Least spread of the fields along each direction, in their size, for a sphere: a cap of 60° has 0.14."""
    arc: float = np.radians(270.0)
    """Least arc in its plane that an ellipse needs [rad]: of half an ellipse, centre and shape are alike."""
    flat: float = 0.4
    """Least spread of the fields along each direction, in their size, for an ellipse: 270° have 0.6."""
    sector: float = np.radians(20.0)
    """Sector of the plane that must hold a field to count [rad]."""
    hard: float = 0.05
    """σ of hard iron, in the field, from which it counts as unknown: 3° of heading."""
    soft: float = 0.05
    """σ of an entry of the soft iron from which it counts as unknown: 3° of heading too."""
    weakest: float = 5.0
    """Smallest size of a field [µT]: level, it has 5 µT in the north of Canada; in all, 22 µT."""
    strongest: float = 80.0
    """Largest size of a field [µT]: that of the Earth is up to 67 µT, and sensors err by some percent."""
    round: float = 0.15
    """Largest scatter about the surface, in the size of the field: with more, it is no surface."""
    within: float = 0.5
    """Part of an axis of the device in the plane, squared, from which the plane shows iron along it."""
    rounds: int = 50
    """Most rounds of a fit: an ellipsoid takes some ten, and fields that lie on none would never end."""
    folds: int = 12
    """Parts of the log that are withheld in turn."""
    no_worse: float = 1.0
    """Ratio of the withheld errors of a richer model to those of a poorer one below which it is taken."""


LIMITS = FieldLimits()
"""The limits in use."""
ELLIPSOID, SPHERE, PLANE = "ellipsoid", "sphere", "ellipse in a plane"
"""The models."""
GROUP = "magnetometer"
_PAIRS = ((0, 1), (0, 2), (1, 2))
"""The entries off the diagonal of a symmetric matrix."""
_AXES = "xyz"


class _Model(NamedTuple):
    """A model: the directions (3, d) in which it looks, whether they may have a shape, its start (k,)."""

    name: str
    basis: FloatArray
    shaped: bool

    @property
    def d(self) -> int:
        """Number of directions."""
        return int(self.basis.shape[1])

    def parts(self, p: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """Return centre (d,), shape T (d, d) and size of parameters."""
        d, T = self.d, np.eye(self.d)
        if self.shaped:
            shape = p[d:-1]
            T += np.einsum("k,kij->ij", shape, _traceless(d))
        return p[:d], T, float(p[-1])

    def residual(self, p: FloatArray, fields: FloatArray) -> FloatArray:
        """Return the distances (n,) of fields from the surface."""
        centre, T, size = self.parts(p)
        return np.asarray(np.linalg.norm((fields @ self.basis - centre) @ T.T, axis=1) - size)

    def jacobian(self, p: FloatArray, fields: FloatArray) -> FloatArray:
        """Return its derivatives (n, k)."""
        centre, T, _ = self.parts(p)
        off = fields @ self.basis - centre
        along = off @ T.T
        along /= np.linalg.norm(along, axis=1)[:, None]
        # ∂|T (x − c)| / ∂c = −Tᵀ u with the unit vector u, and T is symmetric.
        columns = [-along @ T]
        if self.shaped:
            columns.append(
                np.stack([((off @ one.T) * along).sum(axis=1) for one in _traceless(self.d)], axis=-1)
            )
        columns.append(-np.ones((len(fields), 1)))
        return np.concatenate(columns, axis=1)

    def fit(self, fields: FloatArray) -> FloatArray:
        """Return the parameters of fields (n, 3)."""
        seen = fields @ self.basis
        middle = seen.mean(axis=0)
        # |x|² = 2 c·x + r² − |c|² is linear in the centre c: a start without iterations.
        A = np.column_stack((2 * (seen - middle), np.ones(len(seen))))
        found = np.linalg.lstsq(A, ((seen - middle) ** 2).sum(axis=1), rcond=None)[0]
        size = np.sqrt(max(found[-1] + found[:-1] @ found[:-1], np.finfo(np.float64).tiny))
        start = np.concatenate((middle + found[:-1], np.zeros(len(_traceless(self.d)) * self.shaped), [size]))
        scale = np.concatenate((np.full(self.d, size), np.ones(start.size - self.d - 1), [size]))
        solved = scipy.optimize.least_squares(
            self.residual, start, self.jacobian, x_scale=scale, args=(fields,), max_nfev=LIMITS.rounds
        )
        return np.asarray(solved.x)


def _traceless(d: int) -> FloatArray:
    """Return a basis (k, d, d) of the symmetric matrices without trace: of shapes that change no volume."""
    found = []
    for k in range(1, d):
        one = np.zeros((d, d))
        # 1, …, 1, −k: each of these is orthogonal to those before.
        one[np.arange(k), np.arange(k)], one[k, k] = 1.0, -float(k)
        found.append(one / np.sqrt(k * (k + 1) / 2))
    for row in range(d):
        for column in range(row):
            one = np.zeros((d, d))
            one[row, column] = one[column, row] = 1.0
            found.append(one)
    return np.array(found)


@dataclass(frozen=True, eq=False)
class MagnetometerCalibration:
    """Hard and soft iron.

    Attributes
    ----------
    model : str
        The model that was taken; empty if none.
    terms : tuple of Term
        Its terms.
    judgement : Judgement
        What withheld parts say: the scatter of the size of the field.
    sentences : tuple of str
        What was found, each with what it rests on.
    calibration : Calibration
        What gains, ready to apply; empty if nothing does.
    """

    model: str
    terms: tuple[Term, ...]
    judgement: Judgement
    sentences: tuple[str, ...]
    calibration: Calibration

    @property
    def judgements(self) -> tuple[Judgement, ...]:
        """The judgement, as of an IMU."""
        return (self.judgement,)

    @property
    def stated(self) -> tuple[Term, ...]:
        """The terms, if they gain."""
        return self.terms if self.judgement.gains else ()


class _Found(NamedTuple):
    model: _Model
    p: FloatArray
    covariance: FloatArray
    degrees: float
    residual: FloatArray
    before: FloatArray
    after: FloatArray


def calibrate(time: FloatArray, fields: FloatArray, source: str) -> MagnetometerCalibration:
    """Return hard and soft iron from the fields of a log.

    Parameters
    ----------
    time : (n,) array
        Times [s].
    fields : (n, 3) array
        Fields in the axes of the device [µT].
    source
        The log, for the calibration.

    Raises
    ------
    MissionError
        If there are too few fields, or the device turned too little.
    """
    known = np.isfinite(fields).all(axis=1) & fields.any(axis=1) & np.isfinite(time)
    known[1:] &= (np.diff(fields, axis=0) != 0).any(axis=1)  # a driver that reads faster than the sensor
    time, fields = time[known], fields[known]
    if time.size < LIMITS.fewest or np.ptp(time) < LIMITS.shortest:
        length = float(np.ptp(time)) if time.size else 0.0
        raise MissionError(
            f"the magnetometer has {count_noun(time.size, 'field')} in {length:.3g} s; accepted are at least "
            f"{LIMITS.fewest} in {LIMITS.shortest:g} s or more, while the device turns in all directions"
        )
    stride = -(-time.size // LIMITS.most)
    fields = fields[::stride]
    models, covered = _models(fields)
    tried: list[_Found] = []
    for model in models:
        found = _fit_model(model, fields)
        if _shows_all_terms(found):
            tried.append(found)
    if models and not tried:
        raise MissionError(
            f"the fields show no {models[0].name}: {covered}, but {_missing_reason(models[0], fields)}"
        )
    if not tried:
        raise MissionError(
            f"the magnetometer turned too little: {covered}; accepted is a log in which it turns in all "
            "directions, or at least once round"
        )
    best = tried[0]
    for richer in tried[1:]:
        if richer.model.d == best.model.d and _rms(richer.after) < LIMITS.no_worse * _rms(best.after):
            best = richer
    judgement = judge(GROUP, "size of the field", "µT", best.before, best.after)
    return _result(best, judgement, covered, source)


def _missing_reason(model: _Model, fields: FloatArray) -> str:
    """Return what a model is like that the fields do not show, and what is accepted."""
    found = _fit_model(model, fields)
    size = abs(float(found.p[-1]))
    hard = float(np.sqrt(np.diagonal(found.covariance)[: model.d].max()))
    scatter = _rms(model.residual(found.p, fields))
    return (
        f"the best one has a size of {size:.3g} µT, a scatter of {scatter:.2g} µT and a centre with a σ of "
        f"{hard:.2g} µT; accepted are sizes of the Earth's field, {LIMITS.weakest:g} to {LIMITS.strongest:g} "
        f"µT, a scatter of {100 * LIMITS.round:g} % and a σ of {100 * LIMITS.hard:g} % of it. Motors, "
        "currents and iron nearby change the field, and a device that does not turn shows its noise alone"
    )


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _models(fields: FloatArray) -> tuple[list[_Model], str]:
    """Return the models that the fields cover, the poorer first, and what they cover in words."""
    middle = fields.mean(axis=0)
    _, spread, axes = np.linalg.svd(fields - middle, full_matrices=False)
    spread /= np.sqrt(len(fields))
    if spread[2] > LIMITS.depth * _Model(SPHERE, np.eye(3), False).fit(fields)[-1]:
        return [
            _Model(SPHERE, np.eye(3), False),
            _Model(ELLIPSOID, np.eye(3), True),
        ], "the fields cover all directions"
    seen = (fields - middle) @ axes[:2].T
    normal = ", ".join(f"{one:+.2f}" for one in axes[2]).replace("-", "−")
    circle = _Model(PLANE, axes[:2].T, False).fit(fields)
    around = circle[:2] - middle @ axes[:2].T
    angles = np.arctan2(*(seen - around).T[::-1])
    sectors = np.unique(np.floor(angles / LIMITS.sector)).size * LIMITS.sector
    if spread[1] < LIMITS.flat * circle[-1] or sectors < LIMITS.arc:
        # Evenly spread over an arc, fields have a σ of its length over √12.
        turned = np.degrees(min(sectors, spread[0] / circle[-1] * np.sqrt(12), 2 * np.pi))
        return [], f"the fields cover some {turned:.0f}° of a circle"
    covered = f"the fields lie near a plane, perpendicular to x, y, z = {normal}"
    return [_Model(PLANE, axes[:2].T, False), _Model(PLANE, axes[:2].T, True)], covered


def _fit_model(model: _Model, fields: FloatArray) -> _Found:
    """Return the fit of a model with its covariance, and the errors of withheld parts, before and after."""
    p = model.fit(fields)
    residual, J = model.residual(p, fields), model.jacobian(p, fields)
    together = _correlated(residual)
    degrees = max(len(fields) / together - p.size, 1.0)
    variance = float(residual @ residual) / together / degrees
    covariance = np.asarray(np.linalg.pinv(J.T @ J / together, hermitian=True) * variance, dtype=np.float64)
    before, after = [], []
    for part in np.array_split(np.arange(len(fields)), LIMITS.folds):
        others = np.delete(fields, part, axis=0)
        sizes = np.linalg.norm(fields[part] @ model.basis, axis=1)
        usual = float(np.mean(np.linalg.norm(others @ model.basis, axis=1)))
        before.append(_rms(sizes - usual))
        after.append(_rms(model.residual(model.fit(others), fields[part])))
    return _Found(model, p, covariance, degrees, residual, np.array(before), np.array(after))


def _correlated(residual: FloatArray) -> float:
    """Return over how many samples residuals say the same: 1 + 2 Σ ρ up to the first unclear ρ."""
    n = residual.size
    centred = residual - residual.mean()
    power = np.abs(np.fft.rfft(centred, 2 * n)) ** 2
    rho = np.fft.irfft(power)[:n]
    rho /= max(float(rho[0]), np.finfo(np.float64).tiny)
    end = np.flatnonzero(rho < 2 / np.sqrt(n))
    return float(1 + 2 * rho[1 : end[0] if end.size else n].sum())


def _shows_all_terms(found: _Found) -> bool:
    """Return whether the log shows every term of a model."""
    centre, T, size = found.model.parts(found.p)
    sigma = np.sqrt(np.diagonal(found.covariance))
    d = found.model.d
    inverse = np.linalg.inv(T) if np.linalg.det(T) > 0 else np.full((d, d), np.inf)
    return bool(
        LIMITS.weakest < size < LIMITS.strongest
        and _rms(found.residual) < LIMITS.round * size
        and (sigma[:d] < LIMITS.hard * size).all()
        and (sigma[d:-1] < LIMITS.soft).all()
        and (np.abs(inverse - np.eye(d)) < MOST_SHAPE).all()
        and np.isfinite(centre).all()
    )


def _result(best: _Found, judgement: Judgement, covered: str, source: str) -> MagnetometerCalibration:
    model, d = best.model, best.model.d
    centre, T, size = model.parts(best.p)
    off, basis = np.eye(3) - model.basis @ model.basis.T, model.basis
    K = basis @ np.linalg.inv(T) @ basis.T + off
    hard = basis @ centre
    terms = []
    of_hard = np.sqrt(np.diagonal(basis @ best.covariance[:d, :d] @ basis.T))
    in_plane = (basis**2).sum(axis=1) > LIMITS.within
    for k, axis in enumerate(_AXES):
        value, sigma = (float(hard[k]), float(of_hard[k])) if in_plane[k] else (0.0, np.inf)
        terms.append(Term(GROUP, "hard iron", axis, value, sigma, "µT", best.degrees, bool(in_plane[k])))
    if model.shaped:
        inverse = np.linalg.inv(T)
        derivatives = np.array([-(basis @ inverse @ one @ inverse @ basis.T) for one in _traceless(d)])
        spread = np.einsum("aij,ab,bij->ij", derivatives, best.covariance[d:-1, d:-1], derivatives)
        for row, column in ((0, 0), (1, 1), (2, 2), *_PAIRS):
            if in_plane[row] and in_plane[column]:
                value = 100 * float(K[row, column] - (row == column))
                sigma = 100 * float(np.sqrt(max(spread[row, column], 0.0)))
                name = _AXES[row] + _AXES[column]
                terms.append(Term(GROUP, "soft iron", name, value, sigma, "%", best.degrees, True))
    linear = Linear(hard, K) if judgement.gains else None
    sentences = [
        f"Of the log, {covered}; the model is: {model.name}{'' if model.shaped else ', without soft iron'}.",
        str(judgement),
    ]
    if judgement.gains and d == 2:
        sentences.append(
            "Only the iron in this plane is known, since the device turned about one axis. It holds while "
            "the device turns about that axis, as a level vehicle does."
        )
    if judgement.gains:
        sentences.append(
            f"The field {'in the plane ' if d == 2 else ''}is {size:.1f} µT; iron of the vehicle that turns "
            "with the device is what this removes, and currents that change are not."
        )
    return MagnetometerCalibration(
        model.name, tuple(terms), judgement, tuple(sentences), Calibration(source=source, magnetometer=linear)
    )
