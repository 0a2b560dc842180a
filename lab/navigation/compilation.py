"""Compilation: the one set of options under which every navigation kernel is compiled.

A kernel works on arrays from its caller, allocates nothing per step and holds no state. With the environment
variable NUMBA_DISABLE_JIT=1, kernels are plain Python, for a debugger.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba
from numba.core import types
from numba.core.registry import CPUDispatcher

from lab.compiled_cache import DISABLE_JIT, CachedKernel, cached

P = ParamSpec("P")
R = TypeVar("R")

OPTIONS: dict[str, Any] = {"nopython": True, "error_model": "numpy", "fastmath": {"contract"}}
"""Options of every kernel."""

ENTRY_OPTIONS = OPTIONS | {"nogil": True}
"""Options of a function called from Python."""
WITHOUT_WRAPPERS = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Options of a kernel that no Python and no C calls."""


_unliteral: Callable[[Any], Any] = types.unliteral


class Kernel(CPUDispatcher):
    """A function that kernels call, compiled without the wrappers for callers in Python and in C.

    The wrappers of all kernels of a driver are a seventh of the time its compilation takes. A kernel that
    Python calls, as tests do, is compiled a second time, with them.
    """

    def __call__(self, *arguments: Any) -> Any:
        """Call the function from Python."""
        return self.for_python(*arguments)

    @functools.cached_property
    def for_python(self) -> Callable[..., Any]:
        """The function compiled for callers in Python, at the first call."""
        called = {name: value for name, value in self.targetoptions.items() if name not in WITHOUT_WRAPPERS}
        return cast(Callable[..., Any], numba.jit(**called)(self.py_func))

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return what a call in a kernel needs; a number as an argument is a variable, not a constant.

        Otherwise Numba compiles a function for each constant with which it is called. A function that is
        inlined gets its constants all the same.
        """
        return super().get_call_template([_unliteral(kind) for kind in args], kws)


def _kernel(function: Callable[P, R], **options: Any) -> Callable[P, R]:
    if DISABLE_JIT:
        return function
    return cast(Callable[P, R], Kernel(function, targetoptions=OPTIONS | WITHOUT_WRAPPERS | options))


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function that other kernels call."""
    return _kernel(function)


def inline_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a small function of the hot path, inlined into its callers."""
    return _kernel(function, forceinline=True)


def embedded_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Inline a function that is called in one place into its caller, before the caller is compiled.

    The compiler optimises each kernel with all functions that it calls, and again in each caller. A function
    that is called once compiles in half the time if it is not a separate kernel.
    """
    return _kernel(function, inline="always")


def entry_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function called from Python: cached on disk, and running without the interpreter's lock."""
    return cast(Callable[P, R], cached(function, ENTRY_OPTIONS))


def passing_entry_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function called from Python as `entry_kernel` does, for this process alone."""
    return cast(Callable[P, R], numba.jit(**ENTRY_OPTIONS)(function))


def is_ready(function: Callable[..., Any]) -> bool:
    """Return whether a function called from Python waits for no compiler: compiled here, or on the disk."""
    if isinstance(function, CachedKernel):
        return function.is_ready
    return bool(getattr(function, "signatures", True))
