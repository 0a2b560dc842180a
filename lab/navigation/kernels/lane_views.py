"""Lane views: the numbers of eight runs that lie side by side in a buffer, as arrays for kernels.

Number k of run o is element 8 k + o. `numbers` and `rows` show those of one run, for a loop over the runs of
which the compiler makes vectors. `wide` shows those of all runs: each number is a vector, which adds,
subtracts and multiplies as that of one run does. So a kernel of a single run that does no more than that is
one of eight runs, and nothing is left to the compiler's judgement.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typeconv.castgraph import Conversion
from numba.extending import intrinsic, lower_builtin, lower_cast, models, register_model, type_callable

from lab.base.arrays import FloatArray
from lab.base.compiling.compiled_cache import DISABLE_JIT

Kernel = Callable[..., Any]
_pack: Kernel = cgutils.pack_array
_lower_cast: Callable[..., Callable[[Kernel], Kernel]] = lower_cast
_lower: Kernel = lower_builtin

LANES = 8
"""Runs in a block: the float64 numbers in a cache line, and in the widest vector of today's processors."""


class Wide(types.Type):
    """The compiler's type of a number of eight runs."""

    def can_convert_from(self, _context: Any, other: Any) -> Any:
        """Return how a number becomes that of all runs; None if `other` is none."""
        return Conversion.promote if isinstance(other, types.Number) else None


WIDE = Wide("wide")
_VECTOR = ir.VectorType(ir.DoubleType(), LANES)


@register_model(Wide)
class _WideModel(models.PrimitiveModel):
    """A vector of the processor."""

    def __init__(self, manager: Any, kind: Any) -> None:
        model: Any = super()
        model.__init__(manager, kind, _VECTOR)


def _vector(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Return a value as a vector; a number is that of all runs."""
    if isinstance(kind, Wide):
        return value
    value = context.cast(builder, value, kind, types.float64)
    first = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    same = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(first, ir.Constant(_VECTOR, ir.Undefined), same)


@_lower_cast(types.Number, Wide)
def _cast_to_wide(context: Any, builder: Any, kind: Any, _to: Any, value: Any) -> Any:
    """Return a number as that of all runs."""
    return _vector(context, builder, kind, value)


def _declare(*operators: Callable[..., Any], instruction: str) -> None:
    """Declare what an operator does with wide numbers: one instruction."""

    def lower(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        both = (_vector(context, builder, *one) for one in zip(signature.args, arguments, strict=True))
        return getattr(builder, instruction)(*both)

    for one in operators:

        @type_callable(one)
        def kind(context: Any) -> Any:
            def result(left: Any, right: Any) -> Any:
                known = all(isinstance(side, Wide | types.Number) for side in (left, right))
                return WIDE if known and WIDE in (left, right) else None

            return result

        for sides in ((Wide, Wide), (Wide, types.Number), (types.Number, Wide)):
            _lower(one, *sides)(lower)


_declare(operator.add, operator.iadd, instruction="fadd")
_declare(operator.sub, operator.isub, instruction="fsub")
_declare(operator.mul, operator.imul, instruction="fmul")
_declare(operator.truediv, operator.itruediv, instruction="fdiv")


def _wide_vectors(context: Any) -> Any:
    """Let the compiler use the widest vectors for the calling function.

    On some processors it prefers half of their width, for code that is not made of vectors alone.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        # llvmlite checks the names of attributes against a list without this one.
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')
        builder.function.attributes.alignstack = 64
        return context.get_dummy_value()

    return types.void(), generate


def _numbers(context: Any, buffer: Any, first: Any, lane: Any) -> Any:
    """Return the numbers of one run from `first` on as an array; its stride is a constant."""
    view = types.Array(buffer.dtype, 1, "A")

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _view(context, builder, signature, arguments, [1])

    return view(buffer, types.intp, types.intp), generate


def _rows(context: Any, buffer: Any, first: Any, width: Any, lane: Any) -> Any:
    """Return the numbers of one run from `first` on as a matrix with rows of a `width`, a constant."""
    view = types.Array(buffer.dtype, 2, "A")

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        buffer, first, width, lane = arguments
        return _view(context, builder, signature, (buffer, first, lane), [width, 1])

    return view(buffer, types.intp, types.intp, types.intp), generate


def _view(context: Any, builder: Any, signature: Any, arguments: Any, steps: list[Any]) -> Any:
    """Return a view into the buffer, with strides given in numbers of a run."""
    kind, word = signature.args[0], context.get_value_type(types.intp)
    size = kind.dtype.bitwidth // 8
    base = context.make_array(kind)(context, builder, arguments[0])
    at = builder.add(builder.mul(arguments[1], word(LANES)), arguments[2])
    strides = [
        builder.mul(word(step) if isinstance(step, int) else step, word(LANES * size)) for step in steps
    ]
    data = builder.gep(base.data, [at], inbounds=True)
    return _array(context, builder, signature.return_type, data, strides)


def _view_wide(context: Any, buffer: Any, first: Any) -> Any:
    """Return the numbers from `first` on of all runs as an array of wide numbers."""
    view = types.Array(WIDE, 1, "C")

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word, kind = context.get_value_type(types.intp), signature.args[0]
        base = context.make_array(kind)(context, builder, arguments[0]).data
        at = builder.gep(base, [builder.mul(arguments[1], word(LANES))], inbounds=True)
        return _array(context, builder, view, builder.bitcast(at, _VECTOR.as_pointer()), [word(8 * LANES)])

    return view(buffer, types.intp), generate


def _array(context: Any, builder: Any, kind: Any, data: Any, strides: list[Any]) -> Any:
    """Return an array of a kind at a place in memory; constants as indices are within its shape."""
    word, array = context.get_value_type(types.intp), context.make_array(kind)(context, builder)
    context.populate_array(
        array,
        data=data,
        shape=_pack(builder, [word(2**30)] * len(strides)),
        strides=_pack(builder, strides),
        itemsize=word(context.get_abi_sizeof(context.get_data_type(kind.dtype))),
        meminfo=None,
        parent=None,
    )
    return array._getvalue()


def plain_wide_vectors() -> None:
    """Do nothing: without a compiler, there are no vectors."""


def plain_numbers(buffer: FloatArray, first: int, lane: int) -> FloatArray:
    """Return the numbers of one run from `first` on, to the end of the buffer."""
    view: FloatArray = buffer[first * LANES + lane :: LANES]
    return view


def plain_rows(buffer: FloatArray, first: int, width: int, lane: int) -> FloatArray:
    """Return the numbers of one run from `first` on, to the end of the buffer, as a matrix."""
    found = plain_numbers(buffer, first, lane)
    matrix: FloatArray = found[: found.size // width * width].reshape(-1, width)
    return matrix


def view_plain(buffer: FloatArray, first: int) -> FloatArray:
    """Return the numbers from `first` on of all runs, (k, LANES)."""
    view: FloatArray = np.asarray(buffer[first * LANES :]).reshape(-1, LANES)
    return view


# What these return is for kernels; the compiler passes the context, and not its callers. A debugger has the
# functions above.
wide_vectors: Kernel = plain_wide_vectors if DISABLE_JIT else intrinsic(_wide_vectors)
numbers: Kernel = plain_numbers if DISABLE_JIT else intrinsic(_numbers)
rows: Kernel = plain_rows if DISABLE_JIT else intrinsic(_rows)
wide: Kernel = view_plain if DISABLE_JIT else intrinsic(_view_wide)
