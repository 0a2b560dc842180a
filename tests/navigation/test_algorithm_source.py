"""Source of an algorithm: what travels makes the same algorithm, and what cannot travel is named."""

from __future__ import annotations

import pickle
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from lab import Experiment
from lab.navigation.algorithm import AlgorithmError, load_algorithm
from lab.navigation.algorithm_source import AlgorithmSource

FILE = """
import numpy as np
from lab import Estimate

RUNS = []

class LastFix:
    def __init__(self, factor: float = 1.0) -> None:
        self.factor, self.gains = factor, {"position": np.ones(3)}

    def navigate(self, imu, fixes, start):
        at = np.maximum(np.searchsorted(fixes.time, imu.time, side="right") - 1, 0)
        n = imu.time.size
        RUNS.append(n)
        self.gains["position"] += 1
        sigma = np.full((n, 9), 20.0 * self.factor)
        return Estimate(fixes.position[at], fixes.velocity_n[at], np.tile(start.q_nb, (n, 1)), sigma)
"""
CELLS = (
    "import numpy as np\nimport threading\nfrom lab import Estimate as Answer\nfrom math import sqrt\n",
    "SIGMA = np.full(9, 20.0)\nTABLE = {'a': [1, 2.5, float('nan')]}\nLOCK = threading.Lock()\n",
    """def held(fixes, imu):
    return np.maximum(np.searchsorted(fixes.time, imu.time, side="right") - 1, 0)

def doubled(function):
    def twice(self, *given):
        return function(self, *given)
    return twice

class Base:
    scale = sqrt(4.0)

class LastFix(Base):
    factor: "Missing" = 1.0

    @doubled
    def navigate(self, imu: "Missing", fixes, start) -> "Missing":
        at, n = held(fixes, imu), imu.time.size
        sigma = np.tile(self.scale * self.factor * SIGMA, (n, 1)) + TABLE["a"][0]
        return Answer(fixes.position[at], fixes.velocity_n[at], np.tile(start.q_nb, (n, 1)), sigma)

class Locked(LastFix):
    def navigate(self, imu, fixes, start):
        with LOCK:
            return super().navigate(imu, fixes, start)
""",
)


@pytest.fixture
def notebook(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """Yield the module of a notebook: its cells are known to `linecache` only, as those of IPython."""
    import linecache

    module = ModuleType("__main__")
    monkeypatch.setitem(sys.modules, "__main__", module)
    for number, cell in enumerate(CELLS):
        name = f"/tmp/ipykernel_7/{number}.py"
        linecache.cache[name] = len(cell), None, cell.splitlines(True), name
        exec(compile(cell, name, "exec"), vars(module))
    yield module
    for number in range(len(CELLS)):
        del linecache.cache[f"/tmp/ipykernel_7/{number}.py"]


def arrived(algorithm: Any) -> Any:
    """Return an algorithm made from its source, after a way through a pipe."""
    return pickle.loads(pickle.dumps(AlgorithmSource.of(algorithm))).made()


def assert_same(one: Any, other: Any) -> None:
    experiment = Experiment(mission="los_angeles").update({"trajectory.imu_rate": 50.0})
    first, second = (experiment.run(algorithm=algorithm).solution_arrays for algorithm in (one, other))
    assert np.array_equal(first.position, second.position)
    assert np.array_equal(first.variance, second.variance, equal_nan=True)


def test_an_algorithm_in_a_file_travels_as_the_file_with_its_attributes(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(FILE, "utf-8")
    mine: Any = load_algorithm(f"{file}:LastFix")
    mine.factor, mine.gains = 3.0, {"position": np.arange(3.0)}
    source = AlgorithmSource.of(mine)
    file.unlink()
    there = source.made()
    assert type(there) is not type(mine)
    assert (there.factor, there.gains["position"].tolist()) == (3.0, [0.0, 1.0, 2.0])
    assert_same(mine, there)
    assert source.made().gains["position"].tolist() == [0.0, 1.0, 2.0]  # each one is new
    mine.factor = 4.0
    assert AlgorithmSource.of(mine).digest != source.digest


def test_a_class_of_a_notebook_travels_with_all_that_it_uses(notebook: ModuleType) -> None:
    mine = notebook.LastFix()
    source = AlgorithmSource.of(mine)
    assert sorted(source.values) == ["SIGMA", "TABLE"]
    assert "Lock" not in source.text
    assert_same(mine, arrived(mine))


def test_what_cannot_travel_is_named(notebook: ModuleType) -> None:
    with pytest.raises(
        AlgorithmError, match="Locked: LOCK, which it uses, is of type lock and cannot travel"
    ):
        AlgorithmSource.of(notebook.Locked())
    mine = notebook.LastFix()
    mine.thread = threading.current_thread()
    with pytest.raises(AlgorithmError, match="its attribute thread is of type _MainThread"):
        AlgorithmSource.of(mine)

    class Inside:
        def navigate(self) -> None: ...

    with pytest.raises(AlgorithmError, match="Inside: is made inside test_what_cannot_travel_is_named"):
        AlgorithmSource.of(Inside())  # type: ignore[arg-type]


def test_a_file_that_needs_another_is_refused_where_it_arrives(tmp_path: Path) -> None:
    (tmp_path / "beside_it.py").write_text("FACTOR = 2\n", "utf-8")
    file = tmp_path / "mine.py"
    file.write_text(f"import beside_it\n{FILE}", "utf-8")
    source = AlgorithmSource.of(load_algorithm(f"{file}:LastFix"))
    sys.path.remove(str(tmp_path))
    del sys.modules["beside_it"]
    with pytest.raises(AlgorithmError, match=r"LastFix: cannot be made from its source: .*beside_it"):
        source.made()
