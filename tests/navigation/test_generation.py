"""Generation: a variant changes what it names and nothing else; its module can be stepped through."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from lab.navigation.kernels import generation
from lab.navigation.kernels.compilation import embedded_kernel, inline_kernel, kernel
from lab.navigation.kernels.generation import (
    Redecorated,
    Slot,
    Variant,
    Written,
    generate_module,
    interpret_kernel,
)

SIZE = 3
change = Slot("change")


@inline_kernel
def inner(x: float) -> float:
    return x * SIZE


@kernel
def untouched(x: float) -> float:
    return x + 1


@kernel
def outer(x: float) -> float:
    total = untouched(0.0)
    for _ in range(SIZE):
        total += inner(x)
    return total


@kernel
def changing(x: float) -> float:
    return change(x) + outer(x)  # ω × r: the parser counts bytes


def made(root: Any, kernels: dict[Any, Any] | None = None, **constants: tuple[Any, Any]) -> Any:
    return generate_module("test", "A test.", [root], Variant(kernels or {}, constants))[root]


def test_constants_are_replaced_throughout_and_nowhere_else() -> None:
    five = made(outer, SIZE=(3, 5))
    assert five(1.0) == 1 + 5 * 5
    assert outer(1.0) == 1 + 3 * 3
    assert five.targetoptions == outer.targetoptions  # type: ignore[attr-defined]
    assert vars(sys.modules[five.__module__])["untouched"] is untouched
    assert made(untouched, SIZE=(3, 5)) is untouched


def test_a_constant_with_another_value_is_another() -> None:
    """As X, the column of the estimate to the filter, and the first axis of the wander frame."""
    assert made(outer, SIZE=(4, 5)) is outer


def test_names_that_two_modules_share_are_kept_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    other = ModuleType("other_module")
    other.__file__ = "<other_module>"
    text = "SIZE = 4\ndef inner(x):\n    return x * SIZE\n"
    monkeypatch.setitem(sys.modules, "other_module", other)
    generation.inspect.linecache.cache["<other_module>"] = (
        len(text),
        None,
        text.splitlines(True),
        "<other_module>",
    )
    exec(compile(text, "<other_module>", "exec"), other.__dict__)
    other.inner = inline_kernel(other.inner)
    changed = made(changing, {change: other.inner}, SIZE=(3, 5))
    assert changed(1.0) == 1 * 4 + 1 + 5 * 5


def test_a_slot_takes_a_kernel_or_a_text() -> None:
    assert made(changing, {change: untouched})(1.0) == 2 + 10
    text = "@inline_kernel\ndef twice(x):\n    return 2 * inner(x)"
    # What a text names is not replaced: a kernel may so call the one whose place it takes.
    twice = Written("twice", text, {"inner": inner})
    assert made(changing, {change: twice, inner: untouched})(1.0) == 6 + 1 + 3 * 2
    with pytest.raises(TypeError, match="this variant has no kernel for it"):
        made(changing)
    with pytest.raises(TypeError, match="generated for each filter"):
        change(1.0)


def test_a_kernel_takes_another_decorator() -> None:
    embedded = made(outer, {outer: Redecorated(outer, embedded_kernel)})
    assert embedded.targetoptions["inline"] == "always"
    assert embedded(1.0) == 1 + 3 * 3


def test_parts_are_imported() -> None:
    variant = Variant({}, {"SIZE": (3, 5)})
    part = generate_module("part", "A part.", [inner], variant)
    whole = generate_module("whole", "The rest.", [outer], variant, [part])
    assert vars(whole.module)["inner"] is part[inner]
    assert whole[outer](1.0) == 1 + 5 * 5


def test_plain_python_calls_nothing_that_is_compiled() -> None:
    plain = interpret_kernel(changing, Variant({change: untouched}, {"SIZE": (3, 5)}))
    assert plain(1.0) == 2 + 1 + 5 * 5
    assert not hasattr(vars(sys.modules[plain.__module__])["untouched"], "py_func")


LAID_OUT = """
from lab.navigation.kernels.compilation import kernel
SIZE = 3

@kernel
def laid_out(
    x: float,
) -> float:
    \'\'\'Return a product.

    A text within.
    \'\'\'
    total = 0.0
# A comment at the margin.
    note = \'\'\'
def other(x):
\'\'\'
    for _ in range(SIZE):
        total += (
            x
        )

    total += len(note)
# Another one, before the end.
    return total
# Of what follows.
@kernel
def following(x: float) -> float:
    return 7.0
"""


def laid_out(path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return the first kernel of a module with the text above, which is in a file."""
    path.write_text(LAID_OUT, "utf-8")
    module = ModuleType("laid_out_module")
    module.__file__ = str(path)
    monkeypatch.setitem(sys.modules, module.__name__, module)
    exec(compile(LAID_OUT, str(path), "exec"), module.__dict__)
    return module.laid_out


def test_a_function_ends_where_the_next_statement_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However it is laid out; comments at the margin, and lines of texts, do not end it."""
    changed = made(laid_out(tmp_path / "laid_out.py", monkeypatch), SIZE=(3, 5))
    assert changed(2.0) == 5 * 2 + len("\ndef other(x):\n")
    written = Path(str(sys.modules[changed.__module__].__file__)).read_text("utf-8")
    assert "# Another one, before the end.\n    return total\n" in written
    assert "following" not in written


def test_a_source_that_changed_meanwhile_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "laid_out.py"
    function = laid_out(path, monkeypatch)
    path.write_text(LAID_OUT.replace("total += len(note)", "total += 1"), "utf-8")
    with pytest.raises(RuntimeError, match=r"laid_out\.py has changed"):
        made(function, SIZE=(3, 6))


STEPPED = """
import numpy as np
from lab.navigation import unscented
from lab.navigation.kernels.driver import driver
from lab.navigation.filters.error_models import PHI
from lab.navigation.navigator import navigate
from lab.navigation.solution import Belief, Fixes, Imu, Start
rng = np.random.default_rng(1)
time = np.arange(21) / 20.0
imu = Imu(time, rng.normal(0, 1e-3, (20, 3)), rng.normal(0, 1e-2, (20, 3)) + [0, 0, -0.49])
fixes = Fixes(np.array([0.5, 1.0]), np.array([[0.8, 0.1, 99.0]] * 2), np.zeros((2, 3)))
start = Start(np.array([0.8, 0.1, 100.0]), np.zeros(3), np.array([1.0, 0, 0, 0]))
belief = Belief(np.eye(15), np.eye(6), np.full(12, 1e-4), np.full(6, 0.01), np.array([1.0, 0, 0]))
out = navigate(imu, fixes, start, belief)
assert (out.fix_sample > 0).all()
go = driver(PHI, summed=False)
print(hasattr(go, "py_func"), getattr(go, "py_func", go).__code__.co_filename)
points = unscented.navigate(imu, fixes, start, belief)
both = [part for one in (out, points) for part in (one.velocity_n, one.variance, one.bias)]
np.save({path!r}, np.hstack(both))
"""


@pytest.mark.proof
def test_a_filter_can_be_stepped_through(tmp_path: Path) -> None:
    """Without the compiler, it is the function in the generated file, and computes the same."""
    found = {}
    for plain in ("0", "1"):
        path = str(tmp_path / f"{plain}.npy")
        run = subprocess.run(
            [sys.executable, "-c", STEPPED.format(path=path)],
            env=os.environ | {"NUMBA_DISABLE_JIT": plain},
            capture_output=True,
            text=True,
            check=True,
        )
        found[plain] = np.load(path)
    compiled, file = run.stdout.split()
    assert compiled == "False"
    assert "def advance(" in Path(file).read_text("utf-8")
    fast, slow = (np.split(found[plain], 2, axis=1) for plain in ("0", "1"))
    np.testing.assert_allclose(slow[0], fast[0], rtol=1e-9, atol=1e-12)
    # The positions of sigma points have a roundoff of 1e-9 m.
    np.testing.assert_allclose(slow[1], fast[1], rtol=1e-9, atol=1e-8)
