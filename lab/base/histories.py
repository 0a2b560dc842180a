"""Histories: the precision of a flight's histories that are displayed, not used in computations.

Up to `LONG` samples, everything is float64. Beyond, what is simulated and not integrated any more is float32:
true velocity, attitude, biases and increments, and the measured increments once the navigator has used them.
Beyond `SINGLE` samples, so is the solution, except for its position. A float32 has 24 bits, so a σ has an
error of 3 parts in 10⁸, and a bias, an increment, a velocity or an element of a quaternion of 6.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, Self, TypeVar, cast, overload

import numpy as np

from lab.base.arrays import FloatArray

T = TypeVar("T")

LONG = 2**18
"""Number of samples up to which everything is float64, and values derived of the arrays are kept: 22 minutes
at 200 Hz. An open page takes 1.6 kB per sample of such a flight, so 420 MB at most."""
SINGLE = 2**20
"""Number of samples up to which a solution is float64: 87 minutes at 200 Hz, some 310 MB. It is larger than
`LONG`, as the solution of a log is compared with that of a live run."""


def shrink_history(values: FloatArray) -> FloatArray:
    """Return a history for storage: for a long flight in float32, unless it is constant."""
    if values.shape[0] <= LONG or values.strides[0] == 0:
        return values
    # Computations with it give float64.
    return cast(FloatArray, values.astype(np.float32))


class cached_unless_long(Generic[T]):  # noqa: N801 - a decorator, like `cached_property`
    """A property that is computed at its first use and then kept; not kept for a long flight.

    Its owner has an attribute `is_long`.
    """

    def __init__(self, function: Callable[[Any], T]) -> None:
        self._function = function
        self._name = function.__name__
        self.__doc__ = function.__doc__

    @overload
    def __get__(self, owner: None, kind: type[Any]) -> Self: ...

    @overload
    def __get__(self, owner: object, kind: type[Any]) -> T: ...

    def __get__(self, owner: Any, kind: type[Any]) -> Self | T:
        """Compute the value; a kept value hides this descriptor, as it has the same name."""
        if owner is None:
            return self
        value = self._function(owner)
        if not owner.is_long:
            owner.__dict__[self._name] = value
        return value
