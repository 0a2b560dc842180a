"""Compiled cache: a damaged file costs one compilation, never a command; processes share a compilation."""

import importlib.util
import subprocess
import sys
from pathlib import Path
from typing import Any

import numba
import pytest
from numba.core.compiler_lock import global_compiler_lock

from lab.base.compiling import compiled_cache
from lab.base.files.locks import locked
from lab.navigation.kernels.compilation import is_ready

SOURCE = """
from lab.navigation.kernels.compilation import entry_kernel

@entry_kernel
def doubled(value: float) -> float:
    return 2 * value
"""


def loaded(folder: Path) -> Any:
    """Return the kernel as a new process would have it."""
    spec = importlib.util.spec_from_file_location("kernel_on_disk", folder / "kernel_on_disk.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module.doubled


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")  # beside the source, whatever the environment says
    (tmp_path / "kernel_on_disk.py").write_text(SOURCE)
    assert loaded(tmp_path)(1.5) == 3.0
    return tmp_path


def test_what_was_compiled_is_loaded(folder: Path) -> None:
    kernel = loaded(folder)
    assert kernel(2.5) == 5.0
    assert sum(kernel.stats.cache_hits.values()) == 1


def test_a_kernel_on_the_disk_is_ready(folder: Path) -> None:
    assert is_ready(loaded(folder))
    source = folder / "kernel_on_disk.py"
    source.write_text(SOURCE.replace("2 * value", "value + value"))
    changed = loaded(folder)
    assert not is_ready(changed)
    assert changed(1.5) == 3.0
    assert is_ready(changed)
    assert is_ready(loaded(folder))
    (index,) = folder.glob("__pycache__/*.nbi")
    index.write_bytes(index.read_bytes()[:-20])
    assert not is_ready(loaded(folder))


@pytest.mark.parametrize("ending", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", ["empty", "cut", "other bytes"])
def test_a_damaged_file_is_compiled_anew(folder: Path, ending: str, damage: str) -> None:
    (file,) = folder.glob(f"__pycache__/*.{ending}")
    content = file.read_bytes()
    middle = len(content) // 2
    file.write_bytes(
        {
            "empty": b"",
            "cut": content[:middle],
            "other bytes": content[:middle] + bytes(255 - byte for byte in content[middle:]),
        }[damage]
    )
    kernel = loaded(folder)
    assert kernel(2.5) == 5.0
    assert sum(kernel.stats.cache_misses.values()) == 1
    again = loaded(folder)
    assert again(3.5) == 7.0
    assert sum(again.stats.cache_hits.values()) == 1


PROCESS = """
import sys
import time
from numba.core import event

class Told(event.Listener):
    def on_start(self, event):
        print("compiles", flush=True)
        input()
    def on_end(self, event):
        pass

def waits(seconds, pause=time.sleep):
    print("waits", flush=True)
    input()
    pause(seconds)

event.register("numba:compile", Told())
time.sleep = waits
sys.path.insert(0, {folder!r})
from kernel_on_disk import doubled
print("asks", flush=True)
input()
print(doubled(4), flush=True)
"""
"""Says what it does, line by line, and goes on when it is told to."""


def test_processes_that_need_a_kernel_at_once_compile_it_once(folder: Path) -> None:
    """The kernel is compiled for real numbers so far, not for integers."""
    command = [sys.executable, "-c", PROCESS.format(folder=str(folder))]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes) as first, subprocess.Popen(command, **pipes) as second:

        def goes_on(process: subprocess.Popen[str]) -> None:
            print(file=process.stdin, flush=True)

        assert [one.stdout.readline() for one in (first, second)] == ["asks\n", "asks\n"]
        goes_on(first)
        assert first.stdout.readline() == "compiles\n"
        goes_on(second)
        assert second.stdout.readline() == "waits\n"
        goes_on(first)
        assert first.stdout.readline() == "8\n"
        goes_on(second)
        assert second.stdout.readline() == "8\n"


def test_a_thread_that_holds_a_kernel_has_the_compiler(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Otherwise it would wait for a thread that compiles another kernel, which may need this one.
    has = []

    def taken(file: Any) -> bool:
        has.append(global_compiler_lock.is_locked())
        return locked(file)

    monkeypatch.setattr(compiled_cache, "locked", taken)
    assert loaded(folder)(3.5) == 7.0
    assert has == [True]


def test_a_process_of_the_lowest_priority_waits_for_nobody(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (path,) = folder.glob("__pycache__/*.lock")
    monkeypatch.setattr(compiled_cache.time, "sleep", lambda _: pytest.fail("it waits"))
    monkeypatch.setattr("os.nice", lambda _: compiled_cache.LOWEST_PRIORITY)
    with path.open("ab") as held:
        assert locked(held)
        assert loaded(folder)(4) == 8
