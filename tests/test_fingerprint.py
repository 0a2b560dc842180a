"""Fingerprint: it changes with what a kernel depends on, and with nothing else."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any

import numba
import pytest

from lab.compiling.fingerprint import fingerprint

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
