"""Histories: in what precision those of a flight are kept that are looked at, and not computed on.

Up to `LONG` samples everything is float64. Beyond, what nobody integrates is kept in float32: variances,
biases and true increments. A float32 has 24 bits, so a σ is off by 3 parts in 10⁸, and a bias by 6.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, Self, TypeVar, cast, overload

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
T = TypeVar("T")

LONG = 2**20
"""Samples up to which everything is kept in float64: 87 minutes at 200 Hz, some 600 MB."""


def kept(values: FloatArray) -> FloatArray:
    """Return a history as it is kept: of a long flight in float32, unless it is one value throughout."""
    if values.shape[0] <= LONG or values.strides[0] == 0:
        return values
    # Whoever reads it gets float64 as soon as anything is computed of it.
    return cast(FloatArray, values.astype(np.float32))


class made_when_asked(Generic[T]):  # noqa: N801 - a decorator, like `cached_property`
    """A property that is computed at its first use and then kept, but of a long flight computed each time.

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
        """Return what is computed; what is kept hides this, as it has the same name."""
        if owner is None:
            return self
        value = self._function(owner)
        if not owner.is_long:
            owner.__dict__[self._name] = value
        return value
