"""Experiment: settings in, a result out, computed in stages that are cached by the settings they depend on.

In: all settings of a run and a mission. Out: a `Result` with datasets, tables, verdict and plots; many runs
as an `Ensemble` or a `Sweep`.

>>> from lab import Experiment
>>> Experiment(mission="montreal", seed=1).run().summary

Read first: `experiment` (what a user holds), `stages` (what is computed when), `result` (what a run offers).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lab.experiment.experiment import Experiment

__all__ = ["Experiment"]


def __getattr__(name: str) -> Any:
    """Import `Experiment` at its first use, because the compiler loads slowly."""
    if name != "Experiment":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from lab.experiment.experiment import Experiment  # noqa: PLC0415

    return Experiment
