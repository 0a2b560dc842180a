"""Result files: functions that write a result's datasets and tables to files."""

from __future__ import annotations

import contextlib
import errno
import math
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lab.base.files.temporary_files import temporary_folder
from lab.base.progress import Progress

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

BLOCK = 4096
"""Rows that are written to a csv file at a time."""
GROUPS = (
    'This file has its data in groups: xarray.open_dataset(path, group="NAME") opens one, '
    "xarray.open_datatree(path) all, and lab.open_result(path) all with the settings."
)
"""What a reader of a netCDF file learns who sees no variables in it."""


def write_netcdf(
    path: Path,
    datasets: Callable[[], Mapping[str, xr.Dataset]],
    about: Mapping[str, str | int],
    *,
    overwrite: bool,
) -> None:
    """Write datasets as groups of one netCDF file, which says which; one without a name is the file's own.

    Parameters
    ----------
    path
        The file, in a folder that exists.
    datasets
        Returns the datasets by name; called only if the file can be written.
    about
        Attributes of the file.
    overwrite
        True replaces an existing file.

    Raises
    ------
    FileExistsError
        If the file exists and `overwrite` is not given.
    FileNotFoundError
        If the folder does not exist.
    """
    import xarray as xr  # noqa: PLC0415 - takes a while to import, and a run does without

    refuse_existing([path], overwrite)
    if not path.parent.is_dir():
        raise FileNotFoundError(f"{path}: there is no folder {path.parent}")
    named = datasets()
    tree = xr.DataTree.from_dict({f"/{name}": dataset for name, dataset in named.items()})
    tree.attrs.update(about)
    if any(named):
        tree.attrs |= {"groups": ", ".join(filter(None, named)), "how_to_open": GROUPS}
    with temporary_folder(path.parent) as folder:
        whole = folder / path.name
        try:
            tree.to_netcdf(whole, engine="netcdf4")
        # The library reports any refusal by the system as its own error, or as a lack of permission.
        except (RuntimeError, PermissionError) as error:
            raise _write_error(path, sum(leaf.nbytes for leaf in tree.leaves), error) from error
        whole.replace(path)


def _write_error(path: Path, size: int, error: Exception) -> OSError:
    """Return why a file of about a size [bytes] could not be written."""
    if shutil.disk_usage(path.parent).free < size:
        return OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
    return OSError(errno.EIO, f"the netCDF library could not write it ({error})", str(path))


def write_csv(
    folder: Path,
    datasets: Mapping[str, xr.Dataset],
    overview: tuple[str, pd.DataFrame],
    settings: str,
    *,
    overwrite: bool,
    progress: Progress | None = None,
) -> None:
    """Write each dataset as a csv file in a folder, units in the column names.

    Parameters
    ----------
    folder
        Target folder; it is created if it does not exist.
    datasets
        The datasets by name.
    overview
        Name and content of one more table.
    settings
        All settings as TOML, with what made them in comments, written to the same folder.
    overwrite
        True replaces existing files.
    progress
        Called before each file with its name.

    Raises
    ------
    FileExistsError
        If one of the files exists and `overwrite` is not given.
    """
    tables = {folder / f"{name}.csv": table(dataset) for name, dataset in datasets.items()}
    name, overview_table = overview
    summary, toml = folder / f"{name}.csv", folder / "settings.toml"
    refuse_existing([*tables, summary, toml], overwrite)
    is_new = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with temporary_folder(folder) as whole:
            sizes, done = {path: frame.size for path, frame in tables.items()}, 0
            for path, frame in tables.items():
                if progress is not None:
                    progress(f"Writing {path.name}", done / sum(sizes.values()))
                with (whole / path.name).open("w", encoding="utf-8") as file:
                    file.writelines(csv_blocks(frame))
                done += sizes[path]
            overview_table.to_csv(whole / summary.name, index=False, float_format="%.6g")
            (whole / toml.name).write_text(settings, encoding="utf-8")
            for path in (*tables, summary, toml):
                (whole / path.name).replace(path)
    except OSError as error:
        if is_new:
            with contextlib.suppress(OSError):
                folder.rmdir()
        # If the disk is full, the system does not name the file.
        error.filename = error.filename or str(folder)
        raise


def csv_blocks(frame: pd.DataFrame) -> Iterator[str]:
    """Yield a table as csv text, a block of rows at a time: twelve digits a number, an empty cell for NaN.

    The text is that of `pandas.DataFrame.to_csv`, in a quarter of its time.
    """
    columns = [frame.index.to_numpy(), *(frame[name].to_numpy() for name in frame)]
    yield ",".join(_cell(str(name)) for name in (frame.index.name, *frame)) + "\n"
    for start in range(0, len(frame), BLOCK):
        cells, kinds = [], []
        for column in columns:
            block = column[start : start + BLOCK]
            is_plain = block.dtype.kind == "f" and not np.isnan(block).any()
            kinds.append("%.12g" if is_plain else "%s")
            cells.append(block.tolist() if is_plain else map(_cell, block.tolist()))
        row = ",".join(kinds) + "\n"
        yield "".join([row % one for one in zip(*cells, strict=True)])


def _cell(value: object) -> str:
    """Return a value as a cell of a csv file."""
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.12g}"
    text = str(value)
    return '"' + text.replace('"', '""') + '"' if any(sign in text for sign in ',"\n') else text


def table(dataset: xr.Dataset) -> pd.DataFrame:
    """Return a dataset as a table: a row per time (or lag), a column per component, with units."""
    import pandas as pd  # noqa: PLC0415 - as above

    rows = next(str(dim) for dim in dataset.dims if str(dim).startswith("time") or dim == "lag")
    columns = {}
    for name, array in dataset.data_vars.items():
        others = [dim for dim in array.dims if dim != rows]
        if not others:
            columns[_heading(str(name), array.attrs["units"])] = array.values
            continue
        for component in array[others[0]].values:
            part = array.sel({others[0]: component})
            unit = str(part.unit.values) if "unit" in part.coords else array.attrs["units"]
            columns[_heading(f"{name} {component}", unit)] = part.values
    index = pd.Index(dataset[rows].values, name=_heading(rows, dataset[rows].attrs.get("units", "")))
    return pd.DataFrame(columns, index=index)


def _heading(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def refuse_existing(paths: list[Path], overwrite: bool) -> None:
    """Raise `FileExistsError` if one of some files exists that may not be replaced."""
    existing = [str(path) for path in paths if path.exists()]
    if existing and not overwrite:
        raise FileExistsError(
            f"{existing[0]} exists already; nothing was written. overwrite=True replaces it"
        )
