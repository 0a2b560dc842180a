"""Sweep: the errors of many runs over values of settings, as one dataset, made by `ensembles.sweeping`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

from lab.base.notebook_card import NotebookCard
from lab.base.registry import find

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, eq=False, repr=False)
class Sweep(NotebookCard):
    """Runs of an experiment over all combinations of values of settings, and over seeds.

    Attributes
    ----------
    mission : str
        Name of the mission of the experiment.
    settings : tuple of str
        Dotted paths of the swept settings, in the order of the first dimensions of the dataset.
    dataset : xarray.Dataset
        Dimensions: one for each swept setting, named by the end of its path, such as ``noise_density``;
        ``seed``; ``quantity``, whose coordinate ``unit`` has the units. Variables: ``rms`` and ``max`` of the
        errors over each whole flight, ``sigma``, the root mean square of σ of the filter, ``nees`` and
        ``nis``, averaged over the fixes, with their expected values ``nees_degrees`` and ``nis_degrees``, and
        ``horizontal_95``, which 95 % of the horizontal position errors do not exceed.
        What is unknown is NaN.
    refused : tuple of str
        The reasons why runs are missing, each with the number of such runs; their values are NaN.
    """

    CARD: ClassVar[str] = "sweep"

    mission: str
    settings: tuple[str, ...]
    dataset: xr.Dataset
    refused: tuple[str, ...] = ()

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

    def plot(self, quantities: Sequence[str] | None = None) -> Any:
        """Return plots over the first setting; a second setting makes a curve for each of its values.

        The line is the root mean square over the seeds, and the band holds 90 % of the runs. The dashed line
        is σ of the filter.

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
