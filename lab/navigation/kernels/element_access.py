"""Element access: single numbers of an array, by their place in memory, for generated code with hundreds.

Numba's own access allows for negative indices and for any strides. It takes thirty instructions for each
number, which disappear from the code, but take most of the time of its compilation.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba.core import types
from numba.extending import intrinsic

from lab.base.arrays import FloatArray
from lab.base.compiling.compiled_cache import DISABLE_JIT


def _number(context: Any, values: Any, at: Any) -> Any:
    """Return number `at` of a contiguous array, counted through all its rows."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load(_pointer(context, builder, signature, arguments))

    return values.dtype(values, types.intp), generate


def _put_number(context: Any, values: Any, at: Any, number: Any) -> Any:
    """Write number `at` of a contiguous array, counted through all its rows."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        builder.store(arguments[2], _pointer(context, builder, signature, arguments))
        return context.get_dummy_value()

    return types.void(values, types.intp, values.dtype), generate


def _pointer(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """Return the place of a number in memory."""
    assert signature.args[0].layout == "C", "the numbers must be contiguous"
    data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
    return builder.gep(data, [arguments[1]], inbounds=True)


# What these return is for kernels; the compiler passes the context, and not its callers.
number: Callable[..., Any] = intrinsic(_number)
put_number: Callable[..., Any] = intrinsic(_put_number)

if DISABLE_JIT:  # the same for a debugger

    def number(values: FloatArray, at: int) -> float:
        """Return number `at` of a contiguous array, counted through all its rows."""
        return float(values.reshape(-1)[at])

    def put_number(values: FloatArray, at: int, number: float) -> None:
        """Write number `at` of a contiguous array, counted through all its rows."""
        values.reshape(-1)[at] = number
