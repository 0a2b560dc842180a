"""Compiled cache: a damaged file of it costs one compilation, never a command."""

import importlib.util
import sys
from pathlib import Path
from typing import Any

import numba
import pytest

SOURCE = """
from lab.navigation.compilation import entry_kernel

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
