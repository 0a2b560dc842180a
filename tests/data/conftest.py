"""Files that tests write, with a name that says nothing of their format."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from lab.data.formats import reader_of
from lab.data.rebuild.raw_flight import RawFlight


@pytest.fixture
def path_of(tmp_path: Path) -> Callable[[bytes], Path]:
    """Return a function that writes bytes into a file, and returns its path."""

    def write(data: bytes) -> Path:
        path = tmp_path / "log.dat"
        path.write_bytes(data)
        return path

    return write


@pytest.fixture
def file(request: pytest.FixtureRequest, path_of: Callable[[bytes], Path]) -> Callable[..., RawFlight]:
    """Return a function that writes text or bytes, and reads them with the `READER` of the test's module."""
    reader = request.module.READER

    def read(text: str | bytes, units: dict[str, str] | None = None) -> RawFlight:
        path = path_of(text if isinstance(text, bytes) else text.encode())
        assert reader_of(path).name == reader.NAME
        return reader.read([path], units or {})

    return read
