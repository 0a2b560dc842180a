"""Compilation: the one set of options under which every navigation kernel is compiled.

A kernel works on arrays from its caller, allocates nothing per step and holds no state. The compiler's cache
on disk checks only the file of the function that Python calls, not the functions that this one calls.
Functions called from Python therefore close over `SOURCES`, which makes it part of their identity in the
cache: a change in any file below causes a new compilation.
"""

from __future__ import annotations

import functools
import hashlib
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from types import CellType, FunctionType
from typing import Any, ParamSpec, TypeVar, cast

import numba
from numba.core import types
from numba.core.registry import CPUDispatcher

from lab import earth
from lab.compiled_cache import cached

P = ParamSpec("P")
R = TypeVar("R")

OPTIONS: dict[str, Any] = {"nopython": True, "error_model": "numpy", "fastmath": {"contract"}}
"""Options of every kernel."""

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


def entry_kernel(function: Callable[P, R], *, kept: bool = True) -> Callable[P, R]:
    """Compile a function called from Python: cached on disk, and running without the interpreter's lock.

    Parameters
    ----------
    function
        The function.
    kept
        Whether it is cached on disk.
    """
    options = OPTIONS | {"nogil": True}
    return cast(Callable[P, R], cached(function, options) if kept else numba.jit(**options)(function))


def interpreted(function: Callable[P, R]) -> Callable[P, R]:
    """Return a kernel and all kernels that it calls as plain Python: slow, but ready at once."""
    plain = getattr(function, "py_func", function)
    scope = {name: plain.__globals__[name] for name in plain.__code__.co_names if name in plain.__globals__}
    scope |= {name: interpreted(value) for name, value in scope.items() if hasattr(value, "py_func")}
    return FunctionType(plain.__code__, scope, plain.__name__, plain.__defaults__)


def rebound(function: Callable[P, R], **kernels: Callable[..., Any]) -> Callable[P, R]:
    """Return a function or kernel as a plain function that calls other kernels than its module's.

    A function cached on disk must not close over kernels, because they would be part of its identity there
    and are new in each process. It does not close over names of its module.
    """
    plain = cast(FunctionType, getattr(function, "py_func", function))
    scope = plain.__globals__ | kernels
    bound = FunctionType(plain.__code__, scope, plain.__name__, plain.__defaults__, plain.__closure__)
    bound.__qualname__ = plain.__qualname__
    others = "_".join(getattr(k, "py_func", k).__qualname__ for _, k in sorted(kernels.items()))
    return named(hashlib.sha256(others.encode()).hexdigest()[:8])(bound) if kernels else bound


def named(label: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Return a decorator that gives a unique name to a function that is made many times.

    Compiled code loaded from the disk calls other functions by name, argument types and a number that is
    unique only in the process that compiled it. If two processes compile two functions with the same name, a
    third process that loads both could call the wrong one.
    """

    def rename(function: Callable[P, R]) -> Callable[P, R]:
        function.__qualname__ += "_" + re.sub(r"\W", "_", label)
        return function

    return rename


def rebound_throughout(
    function: Callable[P, R], written_for: Mapping[str, Any], **values: Any
) -> Callable[P, R]:
    """Return a function with other values for names of its module, also in all kernels that it calls.

    So one source serves filters with any number of states, and the number stays a constant for the compiler.
    A kernel stays a kernel with the same options; a function without any of the names is returned unchanged.
    In the modules of the called kernels, a name counts as the same only if it has the same value.

    Parameters
    ----------
    function
        The function or kernel.
    written_for
        The values of the names in the modules.
    values
        The values in their place.
    """
    return _rebound(function, tuple((name, written_for[name], new) for name, new in values.items()))


@functools.cache
def _rebound(function: Callable[P, R], changes: tuple[tuple[str, Any, Any], ...]) -> Callable[P, R]:
    """Return a function with changes of names (name, old value, new value) throughout."""
    plain = cast(FunctionType, getattr(function, "py_func", function))

    def other(value: Any) -> Any:
        return _rebound(value, changes) if hasattr(value, "py_func") else value

    def changed(name: str, value: Any) -> Any:
        return next((new for at, old, new in changes if at == name and old is value), other(value))

    used = {name: plain.__globals__[name] for name in plain.__code__.co_names if name in plain.__globals__}
    scope = {name: changed(name, value) for name, value in used.items()}
    cells = [cell.cell_contents for cell in plain.__closure__ or ()]
    closed = [other(value) for value in cells]
    pairs = [(value, scope[name]) for name, value in used.items()] + list(zip(cells, closed, strict=True))
    if all(before is after for before, after in pairs):
        return function
    closure = tuple(CellType(value) for value in closed)
    bound = FunctionType(
        plain.__code__, plain.__globals__ | scope, plain.__name__, plain.__defaults__, closure
    )
    # Another name, for the reason that `named` gives.
    bound.__qualname__ = plain.__qualname__
    # A digest, because the name is that of a file in the cache: with many states it would be too long.
    others = "_".join(str(new) for _, _, new in changes)
    named(hashlib.sha256(others.encode()).hexdigest()[:16])(bound)
    return _kernel(bound, **function.targetoptions) if isinstance(function, Kernel) else bound


def _fingerprint() -> str:
    texts = [file.read_bytes() for file in sorted(Path(__file__).parent.glob("*.py"))]
    texts = [text for text in texts if b"kernel" in text or b"NamedTuple" in text]
    return hashlib.sha256(b"".join([Path(earth.__file__).read_bytes(), *texts])).hexdigest()[:16]


SOURCES = _fingerprint()
"""Digest of the sources of the kernels: all files with kernels, or with the tuples given to them."""
