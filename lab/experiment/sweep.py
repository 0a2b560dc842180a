"""Sweep: the errors of many runs over values of settings, as one dataset, made by `ensembles.sweeping`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from lab.base.files.atomic_file import atomic_file
from lab.base.notebook_card import NotebookCard
from lab.base.registry import find
from lab.base.result_files import csv_blocks, refuse_existing, write_netcdf
from lab.run.provenance import dataset_digest, facts_block, netcdf_attributes, time_stamp_now

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


@dataclass(frozen=True, eq=False, repr=False)
class Sweep(NotebookCard):
    """Runs of an experiment over all combinations of values of settings, and over seeds.

    Attributes
    ----------
    mission : str
        Name of the mission of the experiment; of several, separated by commas.
    settings : tuple of str
        Dotted paths of the swept settings, in the order of the first dimensions of the dataset.
    dataset : xarray.Dataset
        Dimensions: one for each swept setting, named by the end of its path, such as ``noise_density``;
        ``seed``; ``quantity``, whose coordinate ``unit`` has the units. Variables: ``rms`` and ``max`` of the
        errors along each flight, ten times a second as in an ensemble, ``sigma``, the root mean square of σ
        of the filter there, ``nees`` and ``nis``, averaged over the fixes, with their expected values
        ``nees_degrees`` and ``nis_degrees``, and ``horizontal_95``, which 95 % of the horizontal position
        errors do not exceed. Each has its ``units``; those of `rms`, `max` and `sigma` are of several, and
        `of` gives one quantity in its own. What is unknown is NaN.
    refused : tuple of str
        The reasons why runs have no values, each with the number of such runs; their values are NaN.
    missing : int
        Number of runs that were not done, because the sweep was stopped; `refused` says so too.
    made_of : mapping
        What made the sweep: the facts of `lab.run.provenance`, and ``swept``, the given values of each
        setting with those of the dataset.
    options : mapping
        Whether it was ``fast``, and the settings that were ``fixed``, whatever a swept card says.
    """

    CARD: ClassVar[str] = "sweep"

    mission: str
    settings: tuple[str, ...]
    dataset: xr.Dataset
    refused: tuple[str, ...] = ()
    missing: int = 0
    made_of: Mapping[str, Any] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def facts(self) -> dict[str, Any]:
        """What makes this sweep again, or the selected part of it, as every export has it."""
        given, data = dict(self.made_of), self.dataset
        swept = {}
        for path, values in given.pop("swept", {}).items():
            (name,) = (one for one in data.coords if data[one].attrs.get("setting") == path)
            shown = data[name].values.reshape(-1).tolist()
            swept[path] = [value for value, as_shown in values if as_shown in shown]
        last: dict[str, Any] = {name: given.pop(name) for name in ("versions", "settings") if name in given}
        return {
            **given,
            "made": time_stamp_now(),
            "given": {"swept": swept, **self.options},
            **({} if "sealed" in given else {"seeds": data["seed"].values.reshape(-1).tolist()}),
            "result_sha256": dataset_digest(data),
            **last,
        }

    @property
    def dims(self) -> tuple[str, ...]:
        """Dimensions of the swept settings, in their order."""
        swept = (name for name in self.dataset.dims if "setting" in self.dataset[name].attrs)
        return tuple(str(name) for name in swept)

    def sel(self, **values: Any) -> Sweep:
        """Return the part of the sweep with some values of its settings, as `xarray.Dataset.sel` selects it.

        Parameters
        ----------
        **values
            A value, a list of values or a slice for each named dimension.
        """
        return replace(self, dataset=self.dataset.sel(values))

    def of(self, quantity: str) -> xr.Dataset:
        """Return ``rms``, ``max`` and ``sigma`` of one quantity, such as ``"position east"``, in its unit.

        Raises
        ------
        ValueError
            If there is no such quantity.
        """
        known = self.dataset["quantity"].values.tolist()
        if quantity not in known:
            raise ValueError(f"of: there is no quantity {quantity!r}; accepted are {', '.join(known)}")
        chosen = self.dataset[["rms", "max", "sigma"]].sel(quantity=quantity)
        for values in chosen.data_vars.values():
            values.attrs["units"] = str(chosen["unit"].values)
        return chosen.drop_vars("unit")

    def to_dict(self) -> dict[str, Any]:
        """Return the sweep as plain data, as ``ins-lab sweep --json`` prints it: means over the seeds.

        The form is described in ``docs/json.md``.
        """
        form: dict[str, Any] = find("sweep", "json")(self)
        return form

    def to_netcdf(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write the dataset as netCDF; `xarray.open_dataset` reads it.

        Parameters
        ----------
        path
            The file, in a folder that exists.
        overwrite
            True replaces an existing file.

        Raises
        ------
        OSError
            If the file exists and may not be replaced, or cannot be written.
        """
        write_netcdf(
            Path(path),
            lambda: {"": self.dataset},
            netcdf_attributes(self.facts, f"Sweep of {self.mission}"),
            overwrite=overwrite,
        )

    def to_csv(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write a csv file with a row for each run and units in the column names; what is unknown is empty.

        Lines that begin with ``#`` say what made it; pandas skips them with ``comment="#"``.

        Parameters
        ----------
        path
            The file, in a folder that exists.
        overwrite
            True replaces an existing file.

        Raises
        ------
        OSError
            If the file exists and may not be replaced, or cannot be written.
        """
        refuse_existing([Path(path)], overwrite)
        with atomic_file(Path(path)) as file:
            file.write(facts_block(self.facts, "# ", short=True).encode())
            file.writelines(block.encode() for block in csv_blocks(self._table()))

    def _table(self) -> pd.DataFrame:
        """Return a table with a row for each run."""
        import pandas as pd  # noqa: PLC0415 - takes a while to import, and a run does without

        data, axes = self.dataset, (*self.dims, "seed")
        shape = [data.sizes[dim] for dim in axes]
        columns = {}
        for name, values in data.data_vars.items():
            if "quantity" not in values.dims:
                columns[_column_title(str(name), values.attrs["units"])] = values.values.reshape(-1)
                continue
            for quantity in values["quantity"].values:
                one = values.sel(quantity=quantity)
                columns[_column_title(f"{name} {quantity}", str(one["unit"].values))] = one.values.reshape(-1)
        places = np.indices(shape).reshape(len(shape), -1)
        keys = {
            _column_title(dim, data[dim].attrs.get("units", "")): data[dim].values[at]
            for dim, at in zip(axes, places, strict=True)
        }
        return pd.DataFrame(keys | columns).set_index(next(iter(keys)))

    def plot(self, quantities: Sequence[str] | None = None) -> Any:
        """Return plots over the first setting; a second setting makes a curve for each of its values.

        The line is the root mean square over the seeds, and the band holds 90 % of the runs. The dashed line
        is σ of the filter. Over cards, missions and other texts, marks stand in place of the lines.

        Parameters
        ----------
        quantities
            Any of the dataset's quantities, and ``"position"``, ``"velocity"`` and ``"attitude"`` for whole
            vectors. By default position, velocity and heading. NEES and NIS follow.

        Raises
        ------
        ValueError
            If there is no such quantity, or more than two settings vary; `sel` chooses values.
        """
        return find("sweep", "plot")(self, quantities)

    def __repr__(self) -> str:
        sizes = " × ".join(f"{self.dataset.sizes[name]} {name}" for name in (*self.dims, "seed"))
        missing = f", {len(self.refused)} reasons for missing runs" if self.refused else ""
        return f"<Sweep of {self.mission}: {sizes}{missing}; .dataset has the errors, .plot() draws them>"


def _column_title(name: str, unit: str) -> str:
    """Return the title of a column."""
    return f"{name} [{unit}]" if unit not in {"", "1"} else name
