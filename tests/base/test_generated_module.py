"""Generated module: what runs is the text, whatever is in the folder of the modules."""

from __future__ import annotations

import inspect
import os
import subprocess
import sys
from collections.abc import Iterator
from itertools import count
from pathlib import Path

import numba
import pytest

from lab.base.compiling import generated_module
from lab.base.compiling.generated_module import VERSIONS, generated_folder, load_module

NUMBERS = count()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    generated_folder.cache_clear()
    yield tmp_path / "generated"
    generated_folder.cache_clear()


def text() -> str:
    """Return the text of a module that no other test has."""
    return f'"""Number {next(NUMBERS)}."""\n\n\ndef answer() -> int:\n    return 42\n'


def test_a_module_is_in_a_file_and_made_once(folder: Path) -> None:
    words = text()
    module = load_module("written", words)
    assert module.answer() == 42
    (file,) = folder.glob("*.py")
    assert Path(str(module.__file__)) == file
    assert file.read_text("utf-8") == words
    assert load_module("written", words) is module
    alone = subprocess.run(
        [sys.executable, "-c", f"import {module.__name__} as it; print(it.answer())"],
        env={"PYTHONPATH": str(folder)},
        capture_output=True,
        check=True,
    )
    assert alone.stdout == b"42\n"


@pytest.mark.parametrize("found", ["empty", "foreign", "link", "folder"])
def test_what_else_is_there_is_never_executed(folder: Path, found: str, tmp_path: Path) -> None:
    words, trap = text(), "raise SystemExit('executed')"
    name = load_module("written", words).__name__
    del sys.modules[name]
    (file,) = folder.glob("*.py")
    target = tmp_path / "target"
    target.write_text(trap)
    file.unlink()
    if found == "folder":
        file.mkdir()
    elif found == "link":
        file.symlink_to(target)
    else:
        file.write_text("" if found == "empty" else trap)
    cached = folder / "__pycache__" / f"{file.stem}.{sys.implementation.cache_tag}.pyc"
    cached.parent.mkdir(exist_ok=True)
    cached.write_bytes(b"not read either")
    assert load_module("written", words).answer() == 42
    if found != "folder":
        assert not file.is_symlink()
        assert file.read_text("utf-8") == words
    assert target.read_text("utf-8") == trap
    assert not list(folder.glob("*.tmp"))


def test_without_a_folder_a_module_is_in_memory(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder.parent.joinpath("file").touch()
    monkeypatch.setattr(generated_module, "_folders", lambda: iter([folder.parent / "file" / "within"]))
    module = load_module("unwritten", text())
    assert module.answer() == 42
    assert "return 42" in inspect.getsource(module.answer)
    assert not folder.exists()


def test_a_folder_that_cannot_be_written_is_passed_over(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tmp_path.joinpath("file").touch()
    other = tmp_path / "other"
    monkeypatch.setattr(generated_module, "_folders", lambda: iter([tmp_path / "file" / "within", other]))
    assert Path(str(load_module("written", text()).__file__)).parent == other


def test_a_disk_that_becomes_full_does_no_harm(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, data: bytes) -> int:
        raise OSError("no space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    assert load_module("unwritten", text()).answer() == 42


def test_only_the_last_versions_are_kept(folder: Path) -> None:
    stems = [load_module("versions", text()).__name__ for _ in range(VERSIONS + 2)]
    load_module("versions_of_another", text())
    kept = {path.stem for path in folder.glob("versions_*.py")}
    assert stems[-1] in kept
    assert len(kept) == VERSIONS + 1


AT_ONCE = """
import sys
from lab.base.compiling.generated_module import load_module
sys.stdin.readline()
for k in range(30):
    assert load_module("shared", f"number = {k}\\n" + "# " + "x" * 20_000 + "\\n").number == k
"""


def test_processes_may_write_at_once(folder: Path) -> None:
    command = [sys.executable, "-c", AT_ONCE]
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder.parent)}
    processes = [
        subprocess.Popen(command, stdin=subprocess.PIPE, text=True, env=environment) for _ in range(3)
    ]
    for process in processes:
        process.communicate("go\n")
    assert [process.returncode for process in processes] == [0, 0, 0]
    for path in folder.glob("*.py"):
        assert len(path.read_text("utf-8").splitlines()) == 2
    assert not list(folder.glob("*.tmp"))
