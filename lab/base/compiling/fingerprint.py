"""Fingerprint: a digest of what a compiled function depends on: its own code, and all that it calls.

It covers the instructions and constants of each function, the options it is compiled with, the values of the
names it uses, and the fields of the tuples given to it. It ignores comments, docstrings and line numbers.
"""

from __future__ import annotations

import dis
import functools
import hashlib
import sys
from collections.abc import Iterator
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

_GLOBAL = dis.opmap["LOAD_GLOBAL"]
_BITS = {"LOAD_GLOBAL": 1, "LOAD_ATTR": int(sys.version_info >= (3, 12)), "LOAD_METHOD": 0}
"""Bits of an instruction's argument before the number of the name that it reads, as `dis` documents them."""
_NAMING = {dis.opmap[name]: bits for name, bits in _BITS.items() if name in dis.opmap}
"""The same by the number of the instruction; newer versions of Python have fewer of them."""


def plain_function(value: object) -> FunctionType | None:
    """Return the Python function of a kernel, or a function of the lab itself; None for other objects."""
    inner = getattr(value, "py_func", None) or getattr(value, "_defn", None)
    if isinstance(inner, FunctionType):
        return inner
    return value if isinstance(value, FunctionType) and value.__module__.startswith("lab.") else None


@functools.cache
def _names(code: CodeType) -> tuple[list[str], list[str]]:
    """Return the names that a function looks up outside itself, and the attributes that it reads.

    `dis.get_instructions` finds the same in five times the time.
    """
    names, attributes, argument = dict[str, None](), dict[str, None](), 0
    for operation, low in zip(code.co_code[::2], code.co_code[1::2], strict=True):
        argument = argument << 8 | low
        if operation in _NAMING:
            name = code.co_names[argument >> _NAMING[operation]]
            (names if operation == _GLOBAL else attributes)[name] = None
        if operation != dis.EXTENDED_ARG:
            argument = 0
    for part in code.co_consts:
        if isinstance(part, CodeType):
            for found, inner in zip((names, attributes), _names(part), strict=True):
                found.update(dict.fromkeys(inner))
    return list(names), list(attributes)


def uses(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """Iterate over what a function may use of its module, and of modules that it names, by name."""
    names, attributes = _names(function.__code__)
    for name in names:
        value = function.__globals__.get(name)
        if isinstance(value, ModuleType):
            yield from ((part, getattr(value, part)) for part in attributes if hasattr(value, part))
        elif name in function.__globals__:
            yield name, value


def fingerprint(function: object) -> str:
    """Return the digest of a kernel and of all kernels that it calls."""
    seen: dict[FunctionType, int] = {}
    digest = hashlib.sha256()

    def add(value: object) -> None:
        plain = plain_function(value)
        if plain is None:
            digest.update(_value_text(value).encode())
        elif plain in seen:
            digest.update(f"function {seen[plain]}".encode())
        else:
            seen[plain] = len(seen)
            options = sorted(getattr(value, "targetoptions", {}).items())
            digest.update(f"{options} {_code(plain.__code__, plain.__doc__)}".encode())
            digest.update(f"{plain.__defaults__} {[_fields(kind) for kind in _kinds(plain)]}".encode())
            for name, used in uses(plain):
                digest.update(name.encode())
                add(used)

    add(function)
    return digest.hexdigest()


def _code(code: CodeType, docstring: str | None) -> str:
    """Return the instructions of a function with its constants, without the docstring."""
    constants = [
        _code(part, None) if isinstance(part, CodeType) else _value_text(part)
        for part in code.co_consts
        if docstring is None or part != docstring
    ]
    return f"{code.co_code.hex()} {constants} {code.co_names} {code.co_varnames} {code.co_argcount}"


def _value_text(value: object) -> str:
    """Return a value as text; only the name of what a kernel does not compile."""
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {value.tobytes().hex()}"
    if isinstance(value, frozenset):
        return str(sorted(map(_value_text, value)))
    if isinstance(value, int | float | complex | str | bytes | tuple | None):
        return repr(value)
    return _fields(value) or getattr(value, "__name__", type(value).__name__)


def _kinds(function: FunctionType) -> Iterator[object]:
    """Iterate over the types of the arguments that are classes of the function's module."""
    for kind in function.__annotations__.values():
        yield function.__globals__.get(kind) if isinstance(kind, str) else kind


def _fields(kind: object) -> str:
    """Return the fields of a named tuple with those of tuples in it; nothing for other types."""
    if not (isinstance(kind, type) and issubclass(kind, tuple) and hasattr(kind, "_fields")):
        return ""
    scope = vars(sys.modules[kind.__module__])
    parts = {
        name: _fields(scope.get(getattr(of, "__forward_arg__", ""), of))
        for name, of in kind.__annotations__.items()
    }
    return f"{kind.__name__} {parts}"
