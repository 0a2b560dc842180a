"""Lane draws: standard normal draws of eight runs abreast, those of the generators of `lab.sensors.draws`.

NumPy's generator calls a function for each number. Here one vector instruction makes the next number of all
runs, and the draws are the same to the bit: PCG64, and the ziggurat of NumPy with Numba's tables of it. One
draw in ninety needs more than a step and a product: it is made alone.

References
----------
M. E. O'Neill, *PCG: A Family of Simple Fast Space-Efficient Statistically Good Algorithms for Random Number
Generation*, HMC-CS-2014-0905 (2014); G. Marsaglia, W. W. Tsang, *The Ziggurat Method for Generating Random
Variables*, J. Stat. Software 5 (2000).
"""

from __future__ import annotations

import functools
import math
import zlib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic
from numba.np.random import distributions
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.compiling.compiled_cache import DISABLE_JIT
from lab.navigation.kernels import compilation
from lab.navigation.kernels.compilation import entry_kernel, inline_kernel, kernel
from lab.navigation.kernels.lane_views import LANES
from lab.sensors.draws import DrawStream, generator

Streams = NDArray[np.uint64]
Kernel = Callable[..., Any]
_function: Kernel = cgutils.get_or_insert_function

MULTIPLIER = 0x2360ED051FC65DA44385DF649FCCF645
"""What PCG64 multiplies its state of 128 bits by."""
HALF, WORD = 2**32 - 1, 2**64 - 1
"""The lower half of a word, and a whole one."""
MANTISSA = 2**52 - 1
"""The bits of a word, from the tenth on, that say where in a layer of the ziggurat a draw is."""
LAYER, SIGN = 2**8 - 1, 2**8
"""The bits of a word that choose one of the layers, and the sign."""

_TABLES: Any = distributions
_WIDTHS, _LIMITS, _HEIGHTS = _TABLES.wi_double, _TABLES.ki_double, _TABLES.fi_double
_LAST, _PER_LAST = _TABLES.ziggurat_nor_r, _TABLES.ziggurat_nor_inv_r  # where the tail begins; its inverse
_U = np.uint64
_UPPER, _LOWER = _U(MULTIPLIER >> 64), _U(MULTIPLIER & WORD)  # words of the multiplier
_LOWER_1, _LOWER_0 = _U((MULTIPLIER & WORD) >> 32), _U(MULTIPLIER & HALF)  # halves of its lower word
_HALF, _MANTISSA, _LAYER, _SIGN = _U(HALF), _U(MANTISSA), _U(LAYER), _U(SIGN)
_1, _8, _9, _11, _16, _32, _58, _63, _64 = (_U(bits) for bits in (1, 8, 9, 11, 16, 32, 58, 63, 64))
_FIRST_IN, _BY_IN = _U(0x43B0D7E5), _U(0x931E8875)  # factors of `SeedSequence` for words into its pool,
_FIRST_OUT, _BY_OUT = _U(0x8B51F9DD), _U(0x58F38DED)  # for those out of it,
_MIX_LEFT, _MIX_RIGHT = _U(0xCA01F9DD), _U(0x4973F715)  # and where two are mixed
_UNIT = 2.0**-53  # of the upper bits of a word, as a number from 0 to 1
_V = ir.VectorType(ir.IntType(64), LANES)  # types of the compiler: words and numbers of all runs, a word
_D = ir.VectorType(ir.DoubleType(), LANES)  # numbers of all runs
_I = ir.IntType(64)  # a word


def seed_streams(seeds: Sequence[int], name: str) -> Streams:
    """Return the generators of an error source of eight runs, for `draw`; see `lab.sensors.draws.generator`.

    The lower halves of the states of all runs, the upper halves, those of their increments, and room for the
    words of a draw, one after the other.
    """
    if DISABLE_JIT or max(seeds) > WORD:
        states = [generator(seed, name).bit_generator.state["state"] for seed in seeds]
        parts = [one[part] >> by for part in ("state", "inc") for by in (0, 64) for one in states]
        return np.array([*(part & WORD for part in parts), *[0] * LANES], dtype=np.uint64)
    streams = np.zeros(5 * LANES, dtype=np.uint64)
    _seed(np.array(seeds, dtype=np.uint64), zlib.crc32(name.encode()), streams)
    return streams


@kernel
def _hash_word(value: Any, factors: NDArray[np.uint64], by: np.uint64) -> Any:
    """Return a word of 32 bits hashed, as NumPy's `SeedSequence` does; the factor changes each time."""
    value ^= factors[0]
    factors[0] = (factors[0] * by) & _HALF
    value = (value * factors[0]) & _HALF
    return value ^ (value >> _16)


@kernel
def _mix_words(left: Any, right: Any) -> Any:
    """Return two words of 32 bits as one, as `SeedSequence` does."""
    value = (_MIX_LEFT * left - _MIX_RIGHT * right) & _HALF
    return value ^ (value >> _16)


@entry_kernel
def _seed(seeds: NDArray[np.uint64], key: int, streams: Streams) -> None:
    """Write the streams of seeds of 64 bits, as `SeedSequence` with a key and `PCG64` begin them."""
    pool, words, factors = np.zeros(4, np.uint64), np.zeros(8, np.uint64), np.zeros(1, np.uint64)
    for lane in range(LANES):
        factors[0] = _FIRST_IN
        for place in range(4):
            entropy = (seeds[lane] >> _32 * _U(place)) & _HALF if place < 2 else _U(0)
            pool[place] = _hash_word(entropy, factors, _BY_IN)
        for source in range(5):
            for place in range(4):
                if source != place:
                    entropy = pool[source] if source < 4 else _U(key)
                    pool[place] = _mix_words(pool[place], _hash_word(entropy, factors, _BY_IN))
        factors[0] = _FIRST_OUT
        for place in range(8):
            words[place] = _hash_word(pool[place % 4], factors, _BY_OUT)
        upper, low, upper_step, low_step = (
            words[0] | words[1] << _32,
            words[2] | words[3] << _32,
            words[4] | words[5] << _32,
            words[6] | words[7] << _32,
        )
        # The increment of the generator is odd: 2 n + 1, over both words.
        streams[2 * LANES + lane] = low_step << _1 | _1
        streams[3 * LANES + lane] = upper_step << _1 | low_step >> _63
        # The first step is from zero, and leads to the increment.
        streams[lane] = streams[2 * LANES + lane] + low
        carried = _U(streams[lane] < low)
        streams[LANES + lane] = streams[3 * LANES + lane] + upper + carried
        _next_word(streams, lane)


class LaneSeed(DrawStream):
    """A seed of a block of runs, whose draws are made with those of the others; see `seeds_abreast`."""

    def __init__(self, seed: int, lane: int, draws: Callable[[str, int], FloatArray]) -> None:
        super().__init__(seed)
        self._lane, self._draws = lane, draws

    def following(self, name: str, shape: tuple[int, ...]) -> FloatArray:
        """Return the draws of an error source; see `lab.sensors.draws.unit_draws`."""
        found: FloatArray = self._draws(name, math.prod(shape))[self._lane].reshape(shape)
        found.flags.writeable = False
        return found


def seeds_abreast(seeds: Sequence[int]) -> list[LaneSeed]:
    """Return what stands in the place of up to eight seeds: each asks once for each error source."""
    whole = [*seeds, *[seeds[-1]] * (LANES - len(seeds))]

    @functools.cache
    def draw_source(name: str, size: int) -> FloatArray:
        out = np.empty((LANES, size))
        if size:
            _fill(seed_streams(whole, name), np.empty(LANES), out)
        return out

    return [LaneSeed(seed, lane, draw_source) for lane, seed in enumerate(seeds)]


def is_ready() -> bool:
    """Return whether draws wait for no compiler: compiled here, or on the disk."""
    return all(compilation.is_ready(one) for one in (_seed, _fill))


@entry_kernel
def _fill(streams: Streams, drawn: FloatArray, out: FloatArray) -> None:
    """Write draws of all runs (LANES, n)."""
    for k in range(out.shape[1]):
        draw(streams, drawn, 0)
        for lane in range(LANES):
            out[lane, k] = drawn[lane]


@inline_kernel
def _next_word(streams: Streams, lane: int) -> np.uint64:
    """Return the next word of a run."""
    low, upper = streams[lane], streams[LANES + lane]
    # The upper word of 64 by 64 bits, from products of halves: the compiler has no longer words.
    a, b = low & _HALF, low >> _32
    p, q, r = a * _LOWER_0, a * _LOWER_1, b * _LOWER_0
    carried = b * _LOWER_1 + (q >> _32) + (r >> _32) + (((p >> _32) + (q & _HALF) + (r & _HALF)) >> _32)
    added = low * _LOWER + streams[2 * LANES + lane]
    upper = carried + low * _UPPER + upper * _LOWER + streams[3 * LANES + lane]
    upper += _U(added < streams[2 * LANES + lane])
    streams[lane], streams[LANES + lane] = added, upper
    # XSL-RR of PCG: both words as one, turned to the right by the six uppermost bits.
    both, turn = upper ^ added, upper >> _58
    return _U((both >> turn) | (both << ((_64 - turn) & _63)))


@inline_kernel
def _unit(streams: Streams, lane: int) -> float:
    """Return the next number of a run that is equally distributed from 0 to 1."""
    return float(np.int64(_next_word(streams, lane) >> _11) * _UNIT)


@kernel
def _draw_alone(streams: Streams, lane: int) -> Any:
    """Return the draw of a run whose first word is known, and may not be enough."""
    word = streams[4 * LANES + lane]
    while True:
        layer, place = word & _LAYER, (word >> _9) & _MANTISSA
        value = np.int64(place) * _WIDTHS[layer]
        if word & _SIGN:
            value = -value
        if place < _LIMITS[layer]:
            return value
        if layer == 0:
            while True:
                # Marsaglia's draw from the tail of the normal distribution.
                beyond = -_PER_LAST * np.log1p(-_unit(streams, lane))
                other = -np.log1p(-_unit(streams, lane))
                if other + other > beyond * beyond:
                    tail = _LAST + beyond
                    return -tail if (place >> _8) & _1 else tail
        step = _HEIGHTS[layer - _1] - _HEIGHTS[layer]
        if step * _unit(streams, lane) + _HEIGHTS[layer] < math.exp(-0.5 * value * value):
            return value
        word = _next_word(streams, lane)


def _abreast(context: Any, streams: Any, out: Any, at: Any, widths: Any, limits: Any) -> Any:
    """Write one draw of each run from a word, and return the bits of the runs that need more; see `draw`."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        def data(place: int) -> Any:
            return context.make_array(signature.args[place])(context, builder, arguments[place]).data

        def all_of(value: int) -> Any:
            return ir.Constant(_V, [value] * LANES)

        def of_layer(table: Any, layer: Any, kind: Any) -> Any:
            found = ir.Constant(kind, ir.Undefined)
            for lane in range(LANES):
                place = ir.Constant(ir.IntType(32), lane)
                value = builder.load(builder.gep(table, [builder.extract_element(layer, place)]))
                found = builder.insert_element(found, value, place)
            return found

        add, mul, right = builder.add, builder.mul, builder.lshr
        words = [
            builder.gep(builder.bitcast(data(0), _V.as_pointer()), [ir.Constant(_I, k)]) for k in range(5)
        ]
        low, upper, low_step, upper_step = (builder.load(word, align=8) for word in words[:4])
        half, by_32 = all_of(HALF), all_of(32)
        a, b = builder.and_(low, half), right(low, by_32)
        p, q = mul(a, all_of(int(_LOWER_0))), mul(a, all_of(int(_LOWER_1)))
        r, s = mul(b, all_of(int(_LOWER_0))), mul(b, all_of(int(_LOWER_1)))
        middle = add(add(right(p, by_32), builder.and_(q, half)), builder.and_(r, half))
        carried = add(add(s, right(q, by_32)), add(right(r, by_32), right(middle, by_32)))
        added = add(add(p, builder.shl(add(q, r), by_32)), low_step)
        over = builder.zext(builder.icmp_unsigned("<", added, low_step), _V)
        upper = add(mul(low, all_of(int(_UPPER))), mul(upper, all_of(int(_LOWER))))
        upper = add(add(carried, upper), add(upper_step, over))
        both, turn = builder.xor(upper, added), right(upper, all_of(58))
        rotate = _function(builder.module, ir.FunctionType(_V, [_V] * 3), f"llvm.fshr.v{LANES}i64")
        word = builder.call(rotate, [both, both, turn])
        for value, place in zip((added, upper, word), (words[0], words[1], words[4]), strict=True):
            builder.store(value, place, align=8)
        layer = builder.and_(word, all_of(LAYER))
        place = builder.and_(right(word, all_of(9)), all_of(MANTISSA))
        value = builder.fmul(builder.sitofp(place, _D), of_layer(data(3), layer, _D))
        sign = builder.shl(builder.and_(word, all_of(SIGN)), all_of(55))
        value = builder.bitcast(builder.xor(builder.bitcast(value, _V), sign), _D)
        drawn = builder.bitcast(builder.gep(data(1), [arguments[2]]), _D.as_pointer())
        builder.store(value, drawn, align=8)
        more = builder.icmp_unsigned(">=", place, of_layer(data(4), layer, _V))
        return builder.zext(builder.bitcast(more, ir.IntType(LANES)), _I)

    return types.intp(streams, out, at, widths, limits), generate


_draw_abreast: Kernel = intrinsic(_abreast)


@inline_kernel
def _draw(streams: Streams, out: FloatArray, at: int) -> None:
    """Write the next draw of each run into ``out[at : at + LANES]``; see `seed_streams`."""
    more = _draw_abreast(streams, out, at, _WIDTHS, _LIMITS)
    if more:
        for lane in range(LANES):
            if (more >> lane) & 1:
                out[at + lane] = _draw_alone(streams, lane)


def plain_draw(streams: Streams, out: FloatArray, at: int) -> None:
    """Write the next draw of each run by NumPy's generator: for a debugger."""
    for lane in range(LANES):
        parts = [int(word) for word in streams[lane : 4 * LANES : LANES]]
        bits = np.random.PCG64()
        state = bits.state
        state["state"] = {"state": parts[0] | parts[1] << 64, "inc": parts[2] | parts[3] << 64}
        bits.state = state
        out[at + lane] = np.random.Generator(bits).standard_normal()
        after = bits.state["state"]["state"]
        streams[lane], streams[LANES + lane] = after & WORD, after >> 64


draw: Kernel = plain_draw if DISABLE_JIT else _draw
