"""Own states: errors of the inertial sensors that a user declares, which a filter can then estimate.

A state acts on the sensors by its column of F, and develops by its row. The column follows from the effect:
what gyros and accelerometers read too much for each unit of the state, which may depend on rate and force.
The row is that of a constant, or of a first-order Gauss-Markov process.

>>> def asymmetry(rate, force, effect):  # scale factors that differ between left and right turns
...     effect[2, 0] = abs(rate[2])
>>> declare_states("asymmetry", ["asymmetry z"], asymmetry, sigma=0.003)

`sensors.own_errors` simulates the errors by their names, and `navigator.own_states` estimates them.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any, cast

import numba
import numpy as np

from lab.base.arrays import FloatArray
from lab.base.parameters.setting_error import SettingError
from lab.navigation.filters import blocks
from lab.navigation.filters.blocks import Block
from lab.navigation.filters.error_models import STATES
from lab.navigation.kernels import own_room
from lab.navigation.kernels.compilation import ALLOCATING, inline_kernel
from lab.navigation.kernels.generation import Slot, Written
from lab.navigation.kernels.propagation import NAV, OWN, OWN_SIZE, PLACES
from lab.navigation.strapdown import Vector, get, plus, without_own_errors

Effect = Callable[[Vector, Vector, FloatArray], None]


@dataclass(frozen=True, eq=False)
class UserStates:
    """States that a user declared.

    Attributes
    ----------
    name : str
        Name, as in the settings.
    block : str
        Name of their block, unique for each declaration.
    effect : callable
        ``effect(rate, force, E)`` writes E (6, k): what gyros x, y, z [rad/s] and accelerometers x, y, z
        [m/s²] read too much for each unit of each state, given rate [rad/s] and specific force [m/s²] in b. E
        is zero before.
    sigma, drift_sigma : (k,) arrays
        Standard deviations of the constant part and of the slow part of each state.
    correlation_time : float
        Of the slow part [s].
    """

    name: str
    block: str
    effect: Effect
    sigma: FloatArray
    drift_sigma: FloatArray
    correlation_time: float

    @property
    def size(self) -> int:
        """Number k of states."""
        return self.sigma.size

    def effects(self, rates: FloatArray, forces: FloatArray) -> FloatArray:
        """Return E (n, 6, k) for rates [rad/s] and specific forces [m/s²] in b, (n, 3) each."""
        E = np.zeros((rates.shape[0], own_room.WIDTH, self.size))
        for rate, force, effect in zip(rates.tolist(), forces.tolist(), E, strict=True):
            self.effect(tuple(rate), tuple(force), effect)
        return E


_DECLARED: dict[str, UserStates] = {}
"""The declarations of this process by name; the last one of each name counts."""
_NUMBERS = itertools.count(1)
"""Numbers of the declarations, for the names of their blocks."""
_MOTIONS: tuple[tuple[Vector, Vector], ...] = (
    ((0.1, -0.2, 0.3), (1.0, -2.0, -9.8)),
    ((-0.1, 0.2, -0.3), (-1.0, 2.0, 9.8)),
    ((3.0, -5.0, 8.0), (40.0, -60.0, -90.0)),
    ((-3.0, 5.0, -8.0), (-40.0, 60.0, 90.0)),
)
"""Rates [rad/s] and specific forces [m/s²] at which an effect is tried: a gentle turn, a hard manoeuvre, and
both reversed, since an effect may begin at some rate or force."""
_OF_EVERY_FILTER = (
    *STATES,
    *(f"{what} {axis}" for what in ("position", "velocity") for axis in ("east", "north", "up")),
    *("roll", "pitch", "heading"),
)
"""The states that every filter has, and how pages and tables show them."""


def declare_states(
    name: str,
    states: Sequence[str],
    effect: Effect,
    *,
    sigma: float | Sequence[float],
    drift_sigma: float | Sequence[float] = 0.0,
    correlation_time: float = 1000.0,
    unit: str = "",
    shown_unit: str | None = None,
    shown_scale: float = 1.0,
) -> None:
    """Declare states of errors of the inertial sensors, for this process; a name may be declared again.

    Parameters
    ----------
    name
        Name for `navigator.own_states` and `sensors.own_errors`, without commas.
    states
        Name of each state, as it is shown.
    effect
        ``effect(rate, force, E)``, as of `UserStates`. Numba compiles it: it may use `math` and numbers.
    sigma, drift_sigma
        Standard deviations of the constant and of the slow part, for all states or each, in `unit`.
    correlation_time
        Of the slow part, a first-order Gauss-Markov process [s].
    unit, shown_unit, shown_scale
        SI unit of the states; unit on pages and in tables, and its value of one SI unit.

    Raises
    ------
    SettingError
        If a number is not accepted, the name of a state is taken, or the effect cannot be computed.
    """
    k = len(states)
    if not name.strip() or "," in name or name != name.strip():
        raise SettingError(f"own states {name!r}: accepted is a name without commas and outer spaces")
    if not 0 < k <= own_room.MOST or isinstance(states, str):
        raise SettingError(
            f"own states {name!r}: {k} states; accepted are 1 to {own_room.MOST} names of states, as a list"
        )
    if not all(isinstance(one, str) and one.strip() for one in states):
        raise SettingError(f"own states {name!r}: states = {states!r}; accepted are names")
    taken = {*_OF_EVERY_FILTER, *(one for block in blocks.BLOCKS.values() for one in block.names)}
    taken |= {
        one for other in _DECLARED.values() if other.name != name for one in blocks.OWN[other.block].names
    }
    twice = [one for one in states if one in taken or list(states).count(one) > 1]
    if twice:
        raise SettingError(
            f"own states {name!r}: there is already a state {twice[0]!r}; accepted are new names"
        )
    sigmas, drifts = (
        _broadcast_sigma(name, what, value, k)
        for what, value in (("sigma", sigma), ("drift_sigma", drift_sigma))
    )
    if not isinstance(correlation_time, Real) or not (0 < correlation_time < math.inf):
        raise SettingError(
            f"own states {name!r}: correlation_time = {correlation_time!r}; accepted is a positive time "
            "in seconds"
        )
    block = f"{name} #{next(_NUMBERS)}"
    declared = UserStates(name, block, effect, sigmas, drifts, float(correlation_time))
    _check_effect(declared)
    place = _find_room(name, k)
    process = blocks.gauss_markov(sigmas**2, drifts**2, float(correlation_time))
    blocks.OWN[block] = Block(
        tuple(states),
        place,
        unit,
        unit if shown_unit is None else shown_unit,
        shown_scale,
        process=lambda _sensors, _navigator: process,
    )
    _DECLARED[name] = declared


def _find_room(name: str, size: int) -> int:
    """Return where in the state of a navigator there is room beside the states declared with other names."""
    taken: set[int] = set()
    for other in _DECLARED.values():
        if other.name != name:
            taken.update(range(blocks.OWN[other.block].place, blocks.OWN[other.block].place + other.size))
    for place in range(own_room.VALUES, own_room.EFFECTS - size + 1):
        if not taken & set(range(place, place + size)):
            return place
    raise SettingError(
        f"own states {name!r}: {size} states, and {len(taken)} are declared with other names; accepted are "
        f"up to {own_room.MOST} together in one process"
    )


def _broadcast_sigma(name: str, what: str, value: float | Sequence[float], k: int) -> FloatArray:
    """Return a standard deviation for each state."""
    try:
        values = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        values = np.full(k, np.nan)
    if values.shape not in ((), (k,)) or not np.isfinite(values).all() or (values < 0).any():
        raise SettingError(
            f"own states {name!r}: {what} = {value!r}; accepted are one number from 0, or one for each of "
            f"the {k} states"
        )
    return np.array(np.broadcast_to(values, (k,)))


def _compiled(effect: Effect) -> Effect:
    """Return an effect compiled, for kernels."""
    return cast(Effect, numba.njit(**ALLOCATING)(effect))


def _check_effect(own: UserStates) -> None:
    """Raise `SettingError` if an effect cannot be computed."""
    rate, force = _MOTIONS[0]
    # Column by column in memory, as kernels see it in the state of the navigator.
    E = np.zeros((own.size, own_room.WIDTH)).T
    try:
        own.effect(rate, force, E)
        compiled = np.zeros((own.size, own_room.WIDTH)).T
        _compiled(own.effect)(rate, force, compiled)
    except Exception as error:
        reason = str(error).strip().splitlines() or [type(error).__name__]
        raise SettingError(
            f"own states {own.name!r}: the effect cannot be computed ({reason[0]}); accepted is a function "
            f"effect(rate, force, E) that writes numbers into E (6, {own.size}), with arithmetic and math"
        ) from error
    accepted = f"finite numbers in E (6, {own.size}), gyros in rows 0 to 2, accelerometers in rows 3 to 5"
    if not np.isfinite(E).all():
        raise SettingError(
            f"own states {own.name!r}: the effect of a rate of {rate} rad/s and a force of {force} m/s² is "
            f"not finite; accepted are {accepted}"
        )
    if not any(_shows_effect(own, *motion) for motion in _MOTIONS):
        raise SettingError(
            f"own states {own.name!r}: the effect is zero for gentle and for hard motions; accepted are "
            f"{accepted}"
        )


def _shows_effect(own: UserStates, rate: Vector, force: Vector) -> bool:
    """Return whether an effect shows in a motion."""
    E = np.zeros((own.size, own_room.WIDTH)).T
    with contextlib.suppress(ArithmeticError, ValueError):  # outside the range of a function of `math`
        own.effect(rate, force, E)
    return bool(E.any())


def declared_states(text: str, setting: str) -> list[UserStates]:
    """Return the declared states that a setting names.

    Parameters
    ----------
    text
        Names, separated by commas.
    setting
        Path of the setting, for the message.

    Raises
    ------
    SettingError
        If a name was not declared, or there are too many states.
    """
    names = [part.strip() for part in text.split(",") if part.strip()]
    for name in names:
        if name not in _DECLARED:
            known = ", ".join(_DECLARED) or "none; lab.declare_states declares them"
            raise SettingError(
                f"{setting}: no states {name!r} are declared in this process; declared are {known}"
            )
    found = [_DECLARED[name] for name in dict.fromkeys(names)]
    size = sum(one.size for one in found)
    if size > own_room.MOST:
        raise SettingError(f"{setting}: {size} states; accepted are up to {own_room.MOST} together")
    return found


def of_blocks(names: Sequence[str]) -> list[UserStates]:
    """Return the declared states among the blocks of a filter, in their order."""
    by_block = {one.block: one for one in _DECLARED.values()}
    return [by_block[name] for name in names if name in blocks.OWN]


write_effects = Slot("write_effects")
"""``write_effects(state, rate, force)``: it keeps the effects of all declared states in the state."""


@inline_kernel
def without_errors(state: FloatArray, dtheta: Vector, dvelocity: Vector, dt: float) -> tuple[Vector, Vector]:
    """Return increments without the declared errors, and keep their effects for the error model."""
    per_dt, nothing = 1 / dt, (0.0, 0.0, 0.0)
    write_effects(state, plus(nothing, per_dt, dtheta), plus(nothing, per_dt, dvelocity))
    for k in range(OWN_SIZE):
        amount, effect = dt * state[PLACES[OWN - NAV + k]], own_room.EFFECTS + own_room.WIDTH * k
        dtheta = plus(dtheta, -amount, get(state, effect))
        dvelocity = plus(dvelocity, -amount, get(state, effect + 3))
    return dtheta, dvelocity


def compiled_effect(block: str) -> Effect:
    """Return the effect of a declared block, compiled for kernels."""
    return _compiled(of_blocks([block])[0].effect)


def user_kernels(names: Sequence[str]) -> dict[Any, Any]:
    """Return the kernels of a filter with declared blocks in place of others; none without such blocks."""
    found = of_blocks(names)
    if not found:
        return {}
    lines = ["@inline_kernel", "def write_effects(state, rate, force):"]
    effects, first = {}, own_room.EFFECTS
    for k, own in enumerate(found):
        effect = Written(
            f"effect_{k}",
            f"effect_{k} = compiled_effect({own.block!r})",
            {"compiled_effect": compiled_effect},
        )
        effects[effect.name], last = effect, first + own_room.WIDTH * own.size
        lines += [
            f"    E_{k} = state[{first}:{last}].reshape(({own.size}, {own_room.WIDTH})).T",
            f"    E_{k}[:, :] = 0.0",
            f"    effect_{k}(rate, force, E_{k})",
        ]
        first = last
    written = Written("write_effects", "\n".join(lines), effects)
    return {without_own_errors: without_errors, write_effects: written}
