"""Axis units: whether the axes of a triad are in different units, as a sketch with a slip prints them.

The specific force of what is at rest or turned by hand is 1 g long in every attitude. Where it is not, and
another unit of some axes makes it so whether they feel gravity or not, they are in that unit. The rates of
each axis turn the direction of gravity (`lab.data.streams.unit_question`): the factor of each, by least
squares, is that to its right unit.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.protocols.column_map import IGNORED, UNITS_OF, ColumnMap
from lab.data.streams.unit_question import LIMITS as TURNS


@dataclass(frozen=True)
class AxisUnitLimits:
    """Limits of what is said.

    Attributes
    ----------
    held : float
        Time over which samples are kept before they are looked at [s].
    near : float
        Largest part by which the square of the length of the force differs from that of gravity: biases of
        0.05 g and scale factors of 3 % make 0.1 together.
    low, high : float
        Parts of the squared length of gravity that an axis feels at most and at least in the two attitudes
        that show its unit: tilts by 14° and 23°.
    blocks : int
        Fewest blocks in each of them, and by which units are ahead of all others: a second.
    in_a_row : int
        Fewest blocks in a row that show another unit of all axes: 5 s.
    against : float
        Largest part of blocks that speak against it: hands push the device.
    memory : float
        Time after which blocks have lost 63 % of their weight [s].
    explained : float
        Least part of the turns of gravity that the rates explain.
    sigma : float
        Largest σ of the factor of an axis, in the factor. The units are 57 times apart.
    """

    held: float = 1.0
    near: float = 0.1
    low: float = 0.06
    high: float = 0.15
    blocks: int = 5
    in_a_row: int = 25
    against: float = 0.1
    memory: float = 60.0
    explained: float = 0.8
    sigma: float = 0.1


LIMITS = AxisUnitLimits()
"""The limits of all streams."""
_ALIKE = {"force": ("m/s²", "g", "mg"), "rate": ("rad/s", "°/s")}
"""Units between which a sketch may slip, by quantity."""


class AxisUnits:
    """Looks at the samples of one text.

    Attributes
    ----------
    columns : ColumnMap
        What its columns are read as.
    sentence : str
        Which axes are in which units; empty while nothing contradicts the columns.
    said : dict of str to str
        The columns by number as they should be read; empty while nothing contradicts them.
    """

    def __init__(self, columns: ColumnMap) -> None:
        self.columns = columns
        self.sentence = ""
        self.said: dict[str, str] = {}
        self._held: list[FloatArray] = []
        units = {one.quantity: one.unit for one in columns.columns}
        self._force, self._rate = (
            [units.get(f"{kind}_{axis}", "") for axis in "xyz"] for kind in ("force", "rate")
        )
        known = all(unit in _ALIKE["force"] for unit in self._force)
        # Of each axis, the units that it may have; one axis at least is read right, or all are as wrong.
        units_of_axes = [
            (unit, *(one for one in _ALIKE["force"] if one != unit)) for unit in self._force if known
        ]
        self._others = [
            one
            for one in product(*units_of_axes)
            if known and (len(set(one)) == 1 or any(a == b for a, b in zip(one, self._force, strict=True)))
        ]
        self._factors = np.array([_factors("force", one, self._force) for one in self._others]).reshape(-1, 3)
        self._wins = np.zeros(len(self._others))
        self._losses = np.zeros(len(self._others))
        self._run = np.zeros(len(self._others))  # blocks in a row that speak for it
        self._shown = np.zeros((2, len(self._others), 3))  # blocks in which an axis feels little and much
        self._last: FloatArray | None = None  # number, direction and turn of the last block
        self._normal, self._right = np.zeros((3, 3)), np.zeros(3)
        self._made, self._terms = 0.0, 0.0

    def add(self, time: FloatArray, rate: FloatArray, force: FloatArray) -> None:
        """Take samples, in SI as they were read, and in the axes of the device.

        Parameters
        ----------
        time : (n,) array
            Times [s].
        rate, force : (n, 3) arrays
            Angular rates [rad/s], specific forces [m/s²].
        """
        self._held.append(np.column_stack((time, rate, force)))
        if time[-1] - self._held[0][0, 0] < LIMITS.held:
            return
        rows = np.concatenate(self._held)
        blocks = np.floor(rows[:, 0] / TURNS.block)
        self._held = [rows[blocks == blocks[-1]]]  # the last block goes on
        rows, blocks = rows[blocks != blocks[-1]], blocks[blocks != blocks[-1]]
        known = np.isfinite(rows).all(axis=1)
        rows, blocks = rows[known], blocks[known]
        if not len(rows):
            return
        begins = np.flatnonzero(np.diff(blocks, prepend=np.nan) != 0)
        count = np.diff(begins, append=len(rows))[:, None]
        mean = np.add.reduceat(rows[:, 4:], begins) / count
        squares = np.add.reduceat(rows[:, 4:] ** 2, begins) / count
        turn = np.add.reduceat(rows[:, 1:4], begins) / count * TURNS.block
        self._weigh(squares)
        said = self._units_of_force()
        if said is None:
            self._add_turns(blocks[begins], mean, turn)
            self._report_units("rate", self._rate, self._units_of_rate())
        else:
            self._report_units("force", self._force, said)

    def _weigh(self, squares: FloatArray) -> None:
        """Count the blocks that speak for and against other units of the force."""
        felt = squares[:, None] * self._factors**2 / STANDARD_GRAVITY**2
        fits = np.abs(felt.sum(axis=2) - 1) < LIMITS.near
        usual = fits[:, :1]
        # A device may begin anew in other units.
        self._run = np.where((fits & ~usual).all(axis=0), self._run + len(felt), 0)
        kept = np.exp(-TURNS.block * len(felt) / LIMITS.memory)
        self._wins = kept * self._wins + (fits & ~usual).sum(axis=0)
        self._losses = kept * self._losses + (~fits & usual).sum(axis=0)
        for which, felt_so in enumerate((felt < LIMITS.low, felt > LIMITS.high)):
            self._shown[which] += (fits[..., None] & felt_so).sum(axis=0)

    def _units_of_force(self) -> tuple[str, ...] | None:
        """Return the units of the force that its length bears out, if they are others; else None."""
        if len(self._others) < 2:
            return None
        changed = self._factors != 1
        # An axis that has felt no gravity yet may be in any unit: as many blocks speak for each.
        most = np.sort(self._wins)[-2:]
        ahead = self._wins - np.where(self._wins == most[1], most[0], most[1])
        shown = ((self._shown >= LIMITS.blocks).all(axis=0) | ~changed).all(axis=1) & changed.any(axis=1)
        shown &= (ahead >= LIMITS.blocks) & (self._losses <= LIMITS.against * self._wins)
        shown = np.where(changed.all(axis=1), self._run >= LIMITS.in_a_row, shown)
        best = int(np.argmax(np.where(shown, self._wins, -1))) if shown.any() else 0
        return self._others[best] if shown.any() else None

    def _add_turns(self, numbers: FloatArray, mean: FloatArray, turn: FloatArray) -> None:
        """Add what the turns of gravity say of the rates of each axis."""
        length = np.linalg.norm(mean, axis=1, keepdims=True)
        rows = np.column_stack((numbers, mean / np.where(length > 0, length, 1.0), turn))
        rows = rows if self._last is None else np.vstack((self._last, rows))
        self._last = rows[-1]
        follows = np.diff(rows[:, 0]) == 1
        before, after = rows[:-1][follows], rows[1:][follows]
        up, angle = (before[:, 1:4] + after[:, 1:4]) / 2, (before[:, 4:] + after[:, 4:]) / 2
        made = after[:, 1:4] - before[:, 1:4]
        # A direction that is fixed in space moves in the device by up × turn.
        said = np.cross(up[:, None, :], np.eye(3)) * angle[..., None]  # by each axis
        kept = np.exp(-TURNS.block * len(made) / TURNS.memory)
        self._normal = kept * self._normal + np.einsum("kij,klj->il", said, said)
        self._right = kept * self._right + np.einsum("kij,kj->i", said, made)
        self._made = kept * self._made + float(np.sum(made**2))
        self._terms = kept * self._terms + made.size

    def _units_of_rate(self) -> tuple[str, ...] | None:
        """Return the units of the rates that the turns of gravity show, if they are different ones."""
        if self._made < TURNS.enough or not all(unit in _ALIKE["rate"] for unit in self._rate):
            return None
        turned = np.diag(self._normal) > 0
        inverse = np.linalg.pinv(self._normal, hermitian=True)
        factors = inverse @ self._right
        left = self._made - float(self._right @ factors)
        if left > (1 - LIMITS.explained) * self._made:
            return None
        sigma = np.sqrt(np.maximum(np.diag(inverse), 0) * max(left, 0) / self._terms)
        units = []
        for axis, unit in enumerate(self._rate):
            ratios = [_factors("rate", (one,), (unit,))[0] for one in _ALIKE["rate"]]
            far = [abs(np.log(max(factors[axis], 1e-9) / ratio)) for ratio in ratios]
            best = int(np.argmin(far))
            is_known = turned[axis] and sigma[axis] < LIMITS.sigma * factors[axis]
            units.append(_ALIKE["rate"][best] if is_known and far[best] < np.log(TURNS.apart) else "")
        if len(set(filter(None, units))) < 2:
            return None
        return tuple(one or now for one, now in zip(units, self._rate, strict=True))

    def _report_units(self, kind: str, now: list[str], units: tuple[str, ...] | None) -> None:
        """Say that the axes of a quantity have units of their own, if they do."""
        if units is None or list(units) == now:
            return
        given = {f"{kind}_{axis}": unit for axis, unit in zip("xyz", units, strict=True)}
        self.said = {
            str(place): f"{one.quantity}[{unit}]"
            if (unit := given.get(one.quantity, one.unit))
            else one.quantity
            for place, one in enumerate(self.columns.columns, 1)
            if one.quantity != IGNORED
        }
        named = {unit: [axis for axis in "xyz" if given[f"{kind}_{axis}"] == unit] for unit in units}
        words = " and ".join(f"{' and '.join(axes)} in {unit}" for unit, axes in named.items())
        what, why = {
            "force": ("specific force", "only so it is 1 g long in every attitude"),
            "rate": ("angular rates", "only so they turn the direction of gravity as it turned"),
        }[kind]
        options = " ".join(f"--column '{number}={text}'" for number, text in self.said.items())
        begin = f"The axes of the {what} are in different units, {words}"
        if len(named) == 1:
            begin = f"The {what} is in {units[0]} now"
        self.sentence = (
            f"{begin}: {why}. The columns are read in {' and '.join(dict.fromkeys(now))}, so what is "
            f"navigated is wrong. {options} reads them right."
        )


def _factors(kind: str, units: tuple[str, ...], now: list[str] | tuple[str, ...]) -> list[float]:
    """Return the factors from numbers read in units to those in others."""
    return [UNITS_OF[kind][a] / UNITS_OF[kind][b] for a, b in zip(units, now, strict=True)]
