"""What is built on Numba's classes: kernels that become instructions for their callers, and nothing more."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest
from numba.core.codegen import JITCodeLibrary
from numba.core.errors import TypingError
from numba.core.runtime import _nrt_python, rtsys

from lab.base.arrays import FloatArray
from lab.navigation.kernels.compilation import (
    allocating_kernel,
    embedded_kernel,
    entry_kernel,
    inline_kernel,
    kernel,
    loop_kernel,
    passing_loop_kernel,
)

ROOT = Path(__file__).parents[2]


@inline_kernel
def square(x: float) -> float:
    return x * x


@kernel
def two_squares(x: float, y: float) -> float:
    return square(x) + square(y)


@embedded_kernel
def first_two(v: FloatArray) -> float:
    return two_squares(float(v[0]), float(v[1]))


@allocating_kernel
def reversed_sum(v: FloatArray, w: FloatArray) -> float:
    turned = np.empty(v.size)
    for i in range(v.size):
        turned[i] = v[v.size - 1 - i]
    return first_two(turned) + float(w[0])


@loop_kernel
def through_all(v: FloatArray, times: int) -> float:
    total = 0.0
    for _ in range(times):
        total += reversed_sum(v, v[1:])
    return total


@kernel
def forgetful(v: FloatArray) -> float:
    return float(np.zeros(v.size)[0])


@entry_kernel
def calls_forgetful(v: FloatArray) -> float:
    return forgetful(v)


def test_only_what_python_calls_is_optimised(monkeypatch: pytest.MonkeyPatch) -> None:
    optimised = []
    optimise = JITCodeLibrary._optimize_final_module

    def noted(library: JITCodeLibrary) -> None:
        optimised.append(library.name)
        optimise(library)

    monkeypatch.setattr(JITCodeLibrary, "_optimize_final_module", noted)
    fresh = passing_loop_kernel(through_all.py_func)  # type: ignore[attr-defined]
    assert fresh(np.array([1.0, 2.0, 3.0]), 2) == 2 * (3.0**2 + 2.0**2 + 2.0)
    assert "through_all" in optimised
    assert not {"square", "two_squares", "reversed_sum"} & set(optimised)


def test_a_kernel_is_also_called_from_python() -> None:
    assert two_squares(3.0, 4.0) == 25.0
    assert reversed_sum(np.array([1.0, 2.0]), np.array([7.0])) == 1.0 + 4.0 + 7.0


def test_what_a_kernel_allocates_is_freed() -> None:
    """Though its caller counts no references."""
    v = np.arange(5.0)
    through_all(v, 1)
    _nrt_python.memsys_enable_stats()
    try:
        before = rtsys.get_allocation_stats()
        through_all(v, 1000)
        after = rtsys.get_allocation_stats()
    finally:
        _nrt_python.memsys_disable_stats()
    assert after.alloc - before.alloc >= 1000
    assert after.free - before.free == after.alloc - before.alloc


def test_a_kernel_that_allocates_must_say_so() -> None:
    with pytest.raises(TypingError, match="Only accept returning of array passed into the function"):
        calls_forgetful(np.zeros(2))


def test_the_page_on_compiling_names_what_is_not_public() -> None:
    page = (ROOT / "docs" / "compiling.md").read_text("utf-8")
    for path in (ROOT / "lab").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("numba.core"):
                for name in node.names:
                    assert f"`{name.name}`" in page, f"{path}: {name.name}"
