"""Report: a result as files and as a page of a notebook."""

from __future__ import annotations

import contextlib
import errno
import html as markup
import os
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

from lab.recordings.temporary_files import temporary_folder
from lab.settings_card import settings_html

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from lab.result import Result


def write_netcdf(result: Result, path: Path, *, overwrite: bool) -> None:
    """Write a result as one netCDF file; see `Result.to_netcdf`."""
    import xarray as xr  # noqa: PLC0415 - takes a while to import, and a run does without

    _refuse_existing([path], overwrite)
    if not path.parent.is_dir():
        raise FileNotFoundError(f"{path}: there is no folder {path.parent}")
    tree = xr.DataTree.from_dict({f"/{name}": dataset for name, dataset in result.datasets().items()})
    tree.attrs = {"title": f"INS Lab: {result.mission.title}", "settings": result.experiment.to_toml()}
    with temporary_folder(path.parent) as folder:
        whole = folder / path.name
        try:
            tree.to_netcdf(whole, engine="netcdf4")
        except RuntimeError as error:  # whatever the system refuses the library, that is what it says
            raise _refused(path, sum(leaf.nbytes for leaf in tree.leaves), error) from error
        whole.replace(path)


def _refused(path: Path, size: int, error: RuntimeError) -> OSError:
    """Return why a file of about a size [bytes] could not be written."""
    if shutil.disk_usage(path.parent).free < size:
        return OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
    return OSError(errno.EIO, f"the netCDF library could not write it ({error})", str(path))


def write_csv(result: Result, folder: Path, *, overwrite: bool) -> None:
    """Write a result as csv files in a folder; see `Result.to_csv`."""
    tables = {folder / f"{name}.csv": table(dataset) for name, dataset in result.datasets().items()}
    # Of a log without reference there are no errors to sum up.
    result_table, name = (
        (result.whiteness, "whiteness") if result.lacks("summary") else (result.summary, "summary")
    )
    summary, settings = folder / f"{name}.csv", folder / "settings.toml"
    _refuse_existing([*tables, summary, settings], overwrite)
    is_new = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with temporary_folder(folder) as whole:
            for path, frame in tables.items():
                frame.to_csv(whole / path.name, float_format="%.12g")
            result_table.to_csv(whole / summary.name, index=False, float_format="%.6g")
            (whole / settings.name).write_text(result.experiment.to_toml(), encoding="utf-8")
            for path in (*tables, summary, settings):
                (whole / path.name).replace(path)
    except OSError as error:
        if is_new:
            with contextlib.suppress(OSError):
                folder.rmdir()
        # Where the disk is full, the system does not say which file it was.
        error.filename = error.filename or str(folder)
        raise


def table(dataset: xr.Dataset) -> pd.DataFrame:
    """Return a dataset as a table: a row for each time (or lag), a column for each component, with units."""
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


def _refuse_existing(paths: list[Path], overwrite: bool) -> None:
    existing = [str(path) for path in paths if path.exists()]
    if existing and not overwrite:
        raise FileExistsError(
            f"{existing[0]} exists already; nothing was written. overwrite=True replaces it"
        )


def html(result: Result) -> str:
    """Return a result for a notebook: what was run, the settings that are not default, and the errors."""
    remarks = "".join(f"<li>{markup.escape(remark)}</li>" for remark in result.remarks)
    seed = "" if result.recorded else f", seed {result.experiment.seed}"
    title = f"{result.mission.title or result.mission.name}, {result.time[-1]:.0f} s{seed}"
    lacking = result.lacks("summary")
    shown = result.whiteness if lacking else result.summary
    summary = shown.to_html(index=False, border=0, float_format=lambda value: f"{value:.4g}")
    words = lacking or f"Errors are estimate minus {result.truth_word}, over the whole flight."
    return (
        f"<h4>{markup.escape(title)}</h4>"
        f"{settings_html(result.experiment, changed_only=True)}{summary}"
        f"<p>{markup.escape(words)}</p>"
        f"{f'<ul>{remarks}</ul>' if remarks else ''}"
    )
