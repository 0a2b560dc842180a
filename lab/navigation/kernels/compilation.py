"""Compilation: the one set of options under which every navigation kernel is compiled.

A kernel works on arrays from its caller, allocates nothing per step and holds no state. With the environment
variable NUMBA_DISABLE_JIT=1, kernels are plain Python, for a debugger.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba

from lab.base.compiling.compiled_cache import DISABLE_JIT, CachedKernel, compile_cached
from lab.base.compiling.kernel_compiler import Kernel

P = ParamSpec("P")
R = TypeVar("R")

OPTIONS: dict[str, Any] = {
    "nopython": True,
    "error_model": "numpy",
    "fastmath": {"contract"},
    "_nrt": False,
}
"""Options of every kernel. Without Numba's runtime (NRT), a kernel cannot make arrays, and no references are
counted: with the hundred arrays of a filter, counting is half of what the compiler gets."""

ALLOCATING: dict[str, Any] = {"_nrt": True}
"""Option of a kernel that makes arrays."""
ENTRY: dict[str, Any] = {"nogil": True, "no_cfunc_wrapper": True}
"""Options of a function called from Python, and not from C."""


def _kernel(function: Callable[P, R], *, apart: bool = False, **options: Any) -> Callable[P, R]:
    if DISABLE_JIT:
        return function
    return cast(Callable[P, R], Kernel(function, OPTIONS | options, apart=apart))


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function that other kernels call, and that makes no arrays."""
    return _kernel(function)


def allocating_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function that other kernels call, and that makes small arrays for itself; it returns none."""
    return _kernel(function, **ALLOCATING)


def separate_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function as `kernel` does, and optimise it before it is a part of its callers."""
    return _kernel(function, apart=True)


def inline_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a small function of the hot path, inlined into its callers."""
    return _kernel(function, forceinline=True)


def embedded_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Inline a function that is called in one place into its caller, before the caller is compiled.

    A call passes each number of each array: a function with many arrays that is called once compiles in half
    the time if it is not a separate kernel.
    """
    return _kernel(function, inline="always")


def entry_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function called from Python: cached on disk, and running without the interpreter's lock."""
    return cast(Callable[P, R], compile_cached(function, OPTIONS | ALLOCATING | ENTRY))


def loop_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a loop over samples as `entry_kernel` does; it makes no arrays."""
    return cast(Callable[P, R], compile_cached(function, OPTIONS | ENTRY))


def passing_loop_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a loop over samples as `loop_kernel` does, for this process alone."""
    return cast(Callable[P, R], numba.jit(**(OPTIONS | ENTRY))(function))


def is_ready(function: Callable[..., Any]) -> bool:
    """Return whether a function called from Python waits for no compiler: compiled here, or on the disk."""
    if isinstance(function, CachedKernel):
        return function.is_ready
    return bool(getattr(function, "signatures", True))
