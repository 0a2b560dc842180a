"""Fingerprint: it changes with what a kernel depends on, and with nothing else."""

from __future__ import annotations

import dis
import sys
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numba
import pytest

from lab.base.compiling.fingerprint import _names, fingerprint
from lab.navigation import strapdown
from lab.navigation.filters import observation, user_states
from lab.navigation.kernels import driver, generation

TEXT = '''
from __future__ import annotations
from typing import NamedTuple
import math

FACTOR, OTHER = 2.0, 3.0

class Pair(NamedTuple):
    a: float
    b: float

class Both(NamedTuple):
    pair: Pair

@jit(error_model="numpy")
def called(x):
    return FACTOR * math.sin(x)

@jit
def alone(x):
    return OTHER * x

@jit
def entry(given: Both, x):
    """Say something."""
    return called(x) + given.pair.a  # for a reason
'''


def of(text: str) -> str:
    module: Any = ModuleType("lab.of_a_test")
    module.jit = numba.njit
    sys.modules[module.__name__] = module
    try:
        exec(text, module.__dict__)
        return fingerprint(module.entry)
    finally:
        del sys.modules[module.__name__]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("FACTOR, OTHER = 2.0", "FACTOR, OTHER = 2.5"),
        ("math.sin", "math.cos"),
        ("called(x) + given", "called(x) - given"),
        ("a: float\n    b: float", "b: float\n    a: float"),
        ('error_model="numpy"', 'error_model="python"'),
        ("FACTOR * math", "x * math"),
    ],
)
def test_it_changes_with_what_the_kernel_depends_on(old: str, new: str) -> None:
    assert of(TEXT.replace(old, new)) != of(TEXT)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("OTHER = 2.0, 3.0", "OTHER = 2.0, 4.0"),
        ("OTHER * x", "OTHER + x"),
        ("for a reason", "for another"),
        ("Say something", "Say another thing"),
        ("import math", "import math\n\n\n"),
    ],
)
def test_it_does_not_change_with_anything_else(old: str, new: str) -> None:
    assert of(TEXT.replace(old, new)) == of(TEXT)


def read_by(code: CodeType) -> tuple[set[str], set[str]]:
    """Return the names that a function looks up outside itself, and the attributes, as `dis` tells them."""
    found: tuple[set[str], set[str]] = set(), set()
    for step in dis.get_instructions(code):
        if step.opname in {"LOAD_GLOBAL", "LOAD_ATTR", "LOAD_METHOD"}:
            found[step.opname != "LOAD_GLOBAL"].add(step.argval)
    for part in code.co_consts:
        if isinstance(part, CodeType):
            for names, inner in zip(found, read_by(part), strict=True):
                names.update(inner)
    return found


def test_names_and_attributes_are_those_that_dis_tells() -> None:
    """Also those of long functions, whose instructions have more than 256 names."""
    long = "def long(x):\n" + "".join(f"    x = name_{k}(x.part_{k}, other_{k}.of())\n" for k in range(300))
    scope: dict[str, Any] = {}
    exec(long, scope)
    functions = [scope["long"]]
    for home in (driver, generation, observation, strapdown, user_states):
        plain = (getattr(value, "py_func", value) for value in vars(home).values())
        functions += [one for one in plain if isinstance(one, FunctionType)]
    assert len(functions) > 100
    for function in functions:
        names, attributes = _names(function.__code__)
        assert (set(names), set(attributes)) == read_by(function.__code__)
