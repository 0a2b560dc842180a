"""Comparison: the error models of the navigator, and a user's algorithms, on the same realisations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from lab.base.notebook_card import NotebookCard
from lab.base.parameters.setting_error import SettingError
from lab.base.progress import Progress
from lab.experiment.ensembles.ensemble import QUANTITIES, Ensemble
from lab.experiment.ensembles.seeds import run_ensemble
from lab.experiment.experiment import Experiment
from lab.navigation.algorithm import Algorithm, AlgorithmError
from lab.navigation.checks import DivergedError
from lab.navigation.filters.kalman import MEASUREMENTS

if TYPE_CHECKING:
    import pandas as pd
    from distributed import Client


COLUMNS = {
    "position": "position [m]",
    "velocity": "velocity [m/s]",
    "heading": "heading [°]",
    "nees": "NEES",
    "degrees": "NEES expected",
    "nis": "NIS",
    "nis_degrees": "NIS expected",
    "seconds": "time [s]",
}
"""Titles of the columns of the table, with their units."""


@dataclass(frozen=True)
class Compared:
    """The results of one error model, or of a user's algorithm, on the flights.

    Attributes
    ----------
    model
        Name of the model or algorithm.
    position, velocity, heading
        Root mean square errors over all runs, of the vectors [m], [m/s] and of the heading [°].
    nees, degrees
        NEES averaged over epochs and runs, and its expected value; NaN and 0 if unknown.
    nis, nis_degrees
        NIS averaged likewise, and its expected value; NaN if unknown.
    seconds
        Computing time of the navigator for one flight, median of the runs, without compilation [s].
    verdict
        Verdict in one sentence.
    refusal
        Reason why it did not run, in which case all figures are NaN; empty if it ran.
    """

    model: str
    position: float = field(default=np.nan)
    velocity: float = field(default=np.nan)
    heading: float = field(default=np.nan)
    nees: float = field(default=np.nan)
    degrees: int = 0
    nis: float = field(default=np.nan)
    nis_degrees: int = MEASUREMENTS
    seconds: float = field(default=np.nan)
    verdict: str = ""
    refusal: str = ""


class Comparison(NotebookCard, tuple[Compared, ...]):
    """What was compared, in order: a tuple that shows itself as a table, in a notebook and printed."""

    CARD: ClassVar[str] = "comparison"

    def to_frame(self) -> pd.DataFrame:
        """Return a row for each model: errors, NEES and NIS with their expected values, time, verdict.

        What is unknown is NaN; a model that did not run has the reason in ``refusal``.
        """
        import pandas as pd  # noqa: PLC0415 - takes a while to import, and a run does without

        return pd.DataFrame([asdict(row) for row in self]).rename(columns=COLUMNS).set_index("model")

    def __repr__(self) -> str:
        frame = self.to_frame()
        words = frame.pop("verdict"), frame.pop("refusal")
        frame["verdict"] = [said or f"Does not run: {why}" for said, why in zip(*words, strict=True)]
        return str(frame.to_string(float_format=lambda value: f"{value:.3f}", na_rep="–", max_colwidth=60))


def models() -> tuple[str, ...]:
    """Return the names of the error models."""
    return tuple(Experiment().navigator.param["model"].objects)


def compare(
    experiment: Experiment,
    names: Sequence[str] | None = None,
    seeds: int | Sequence[int] = 1,
    progress: Progress | None = None,
    *,
    algorithms: Mapping[str, Algorithm] | None = None,
    client: Client | None = None,
) -> Comparison:
    """Run an experiment with several error models: same flight, same sensors, same draws.

    Parameters
    ----------
    experiment
        Experiment to run; its other settings are the same for all.
    names
        Error models; by default all.
    seeds
        Number of runs with each, or the seed of each run.
    progress
        Called with a sentence about the current work and the fraction done, from 0 to 1.
    algorithms
        The user's navigators by name, compared after the models; one that fails is a refusal. Their first run
        is timed too, including compilation and loading.
    client
        A client of a Dask cluster, whose workers do the runs; see `run_ensemble`.

    Raises
    ------
    SettingError
        If a model does not exist, or none of the models can run with these settings.
    ValueError
        As in `run_ensemble`.
    """
    rivals: list[tuple[str, Experiment, Algorithm | None]] = []
    for name in dict.fromkeys(models() if names is None else names):
        variant = experiment.copy()
        variant.set("navigator.model", name)
        rivals.append((name, variant, None))
    rivals += [(name, experiment, algorithm) for name, algorithm in (algorithms or {}).items()]
    if not rivals:
        raise SettingError(f"models: none named; accepted are {', '.join(models())}")
    found = []
    for index, (name, variant, algorithm) in enumerate(rivals):

        def tell(step: str, fraction: float, index: int = index, name: str = name) -> None:
            if progress is not None:
                progress(f"{name}, {step}", (index + fraction) / len(rivals))

        try:
            elsewhere = algorithm is not None or client is not None
            seconds = np.inf if elsewhere else _warm_up(variant)
            many = run_ensemble(variant, seeds, tell, algorithm=algorithm, client=client)
            row = _compared(name, many)
            # The compared run may be cached, with a time that includes compilation.
            found.append(replace(row, seconds=min(row.seconds, seconds)))
        except (SettingError, AlgorithmError, DivergedError) as error:
            found.append(Compared(name, refusal=str(error)))
    if all(row.refusal for row in found):
        raise SettingError("; ".join(dict.fromkeys(row.refusal for row in found)))
    return Comparison(found)


def _warm_up(experiment: Experiment) -> float:
    """Run once more for the time, and return it [s]; the first run of a model also compiles its code."""
    stranger = experiment.copy()
    scale = experiment.navigator.q_scale
    # Changed by nothing that matters, so that the cache does not answer.
    stranger.set("navigator.q_scale", scale * (1 - 1e-9 if scale > 1 else 1 + 1e-9))
    try:
        return stranger.run().seconds
    except DivergedError:  # other seeds need not diverge
        return np.inf


def _compared(model: str, ensemble: Ensemble) -> Compared:
    square = np.mean(ensemble.rms**2, axis=0)
    return Compared(
        model,
        position=float(np.sqrt(square[0:3].sum())),
        velocity=float(np.sqrt(square[3:6].sum())),
        heading=float(np.sqrt(square[QUANTITIES.index("attitude heading")])),
        nees=float(ensemble.at_fixes.mean_of_all("nees")),
        degrees=ensemble.degrees,
        nis=float(ensemble.at_fixes.mean_of_all("nis")),
        nis_degrees=ensemble.nis_degrees,
        seconds=float(np.median(ensemble.seconds)),
        verdict=" ".join(filter(None, (ensemble.remark, ensemble.verdict.headline))),
    )
