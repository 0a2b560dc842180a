"""Result files: tables as csv, and a disk that is full: the message says so, and nothing is left behind."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from lab.base import result_files
from lab.base.result_files import BLOCK, csv_blocks, write_netcdf

resource = pytest.importorskip("resource", reason="this system has no limit of a file's size")


@pytest.fixture
def full(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Let no file get larger than the parameter [bytes], and have the disk say that it has no room."""
    before, usage = resource.getrlimit(resource.RLIMIT_FSIZE), shutil.disk_usage("/")
    monkeypatch.setattr(result_files.shutil, "disk_usage", lambda _folder: usage._replace(free=0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (request.param, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("full", [0, 4000, 40_000], indirect=True)
@pytest.mark.usefixtures("full")
def test_a_full_disk_is_named_whenever_it_is_full(tmp_path: Path) -> None:
    """The netCDF library calls it a lack of permission if it cannot write the first bytes."""
    dataset = xr.Dataset({"error": ("time", np.arange(20_000.0))})
    path = tmp_path / "run.nc"
    with pytest.raises(OSError, match=r"No space left on device: .*run\.nc'"):
        write_netcdf(path, lambda: {"errors": dataset}, {"title": "run"}, overwrite=False)
    assert list(tmp_path.iterdir()) == []


def test_a_table_is_written_as_pandas_writes_it() -> None:
    rows = BLOCK + 5
    draws = np.random.default_rng(1)
    numbers = draws.normal(size=rows) * 10.0 ** draws.integers(-300, 300, rows)
    few = numbers.copy()
    few[[0, 3, -1]] = np.nan, -np.inf, 0.1
    columns = {
        "position east [m]": numbers,
        "nees, of all": few,
        "used": draws.random(rows) < 0.5,
        "fix": draws.integers(0, 9, rows),
        "kind": ["speed", 'says "no", twice'] * (rows // 2) + ["speed"] * (rows % 2),
    }
    frame = pd.DataFrame(columns, index=pd.Index(np.arange(rows) * 0.005, name="time [s]"))
    expected = frame.to_csv(float_format="%.12g", lineterminator="\n")
    assert "".join(csv_blocks(frame)) == expected
    assert "".join(csv_blocks(frame[:0])) == frame[:0].to_csv(lineterminator="\n")
