"""Saved result: a file that the lab wrote, with what made it, which runs again.

>>> saved = open_result("run.nc")
>>> saved.errors.position  # as of the result
>>> again = saved.run()
>>> saved.is_repeated_by(again)
True
"""

from __future__ import annotations

import gzip
import json
import os
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from html import unescape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lab.base.files.file_content import check_file
from lab.base.parameters.setting_error import SettingError
from lab.base.parameters.toml_file import parse_toml
from lab.base.progress import Progress
from lab.base.registry import find
from lab.experiment.experiment import Experiment
from lab.missions import mission as find_mission
from lab.navigation.algorithm import Algorithm
from lab.run.provenance import (
    ENSEMBLE,
    LARGEST,
    OUTAGES,
    RESULT,
    SWEEP,
    VERSIONS,
    dataset_digest,
    find_facts,
    versions,
)
from lab.run.run import ResultError

if TYPE_CHECKING:
    import xarray as xr

LARGEST_TEXT = 2**26
"""Largest JSON, report or picture that is read [bytes]; a report has 1.5 MB, mostly scripts."""
LARGEST_DATA = 2**34
"""Most memory of the datasets of a file [bytes]; four hours at 200 Hz take 2 GB."""
HEADED = (".tum", ".pos", ".csv", ".csv.gz", ".kml", ".gpx")
"""Endings of files of text that begin with the facts."""
WHOLE = (".html", ".svg", ".pdf", ".png")
"""Endings of files in which they stand anywhere."""
ACCEPTED = f"netCDF (.nc), JSON, {', '.join((*HEADED, '.parquet', *WHOLE))}, and a folder of csv files"
"""What can be opened, as text."""
_SETTINGS = '<pre id="settings">'
"""Where a report has its settings."""


@dataclass(frozen=True, eq=False, repr=False)
class SavedResult:
    """What a file says of the run, the runs or the mission that it was made of.

    Datasets are attributes, too: ``saved.errors`` is ``saved.datasets["errors"]``.

    Attributes
    ----------
    path : Path
        The file, or the folder of csv files.
    facts : dict
        What made it, by name: ``made`` (date), ``mission``, ``recording`` (its SHA-256), ``seed``,
        ``versions``, ``settings``; see `lab.run.provenance`. A file of version 0.1 has settings alone.
    datasets : dict of str to xarray.Dataset
        The datasets of a netCDF file and of a folder of csv files.
    content : dict
        All fields of a JSON file.
    """

    path: Path
    facts: Mapping[str, Any]
    datasets: Mapping[str, xr.Dataset] = field(default_factory=dict)
    content: Mapping[str, Any] = field(default_factory=dict)

    @property
    def kind(self) -> str:
        """What it was made of: ``"result"``, ``"ensemble"``, ``"sweep"``, ``"outages"`` or ``"mission"``."""
        return str(self.facts.get("schema", RESULT)).rpartition(" ")[2]

    @property
    def sealed(self) -> str:
        """What seals hidden settings and their seed; empty if the file has all settings."""
        return str(self.facts.get("sealed") or "")

    @property
    def experiment(self) -> Experiment:
        """The settings; of a run that hides something, those that were shown.

        Raises
        ------
        ResultError
            If the file has none, as that of a mission, or they are not accepted.
        """
        settings = self.facts.get("settings")
        if not isinstance(settings, Mapping):
            raise ResultError(f"{self.path}: has no settings, as it was made of a mission without a run")
        try:
            return Experiment().update(settings)
        except SettingError as error:
            raise ResultError(f"{self.path}: its settings are not accepted: {error}") from error

    def run(self, progress: Progress | None = None, *, algorithm: Algorithm | None = None) -> Any:
        """Run again what the file was made of.

        On processors of one family and with the same versions, the figures are the same to the last bit.

        Parameters
        ----------
        progress
            As of `Experiment.run`.
        algorithm
            The user's navigator, if one made the run: no file contains it.

        Returns
        -------
        Result, Ensemble, Sweep or OutageTable

        Raises
        ------
        ResultError
            If something is hidden, the recording is not the one of the file, the navigator is missing, or the
            file is of a mission without a run.
        MissionError, SettingError, ValueError
            As of the method of `Experiment` that made it.
        """
        if self.sealed:
            raise ResultError(
                f"{self.path}: is sealed ({self.sealed.partition(' ')[0]}), and its settings do not repeat "
                "it; ins-lab grade FOLDER --key FILE.key repeats the runs of a homework"
            )
        own = self.facts.get("algorithm")
        if own and algorithm is None:
            raise ResultError(
                f"{self.path}: was navigated by {own}, which no file contains: algorithm=... takes it"
            )
        experiment = self.experiment
        there, expected = find_mission(experiment.mission).content_hash, self.facts.get("recording")
        if expected and there != expected:
            raise ResultError(
                f"{self.path}: was made of another recording of {experiment.mission}: its SHA-256 is "
                f"{expected}, and here {there}"
            )
        return self._run_again(experiment, progress, algorithm)

    def _run_again(
        self, experiment: Experiment, progress: Progress | None, algorithm: Algorithm | None
    ) -> Any:
        kind = self.facts.get("schema", RESULT)
        try:
            if kind == RESULT:
                return experiment.run(progress, algorithm=algorithm)
            if kind == ENSEMBLE:
                ranges = self._seeds() or [[experiment.seed, experiment.seed]]
                seeds = [seed for first, last in ranges for seed in range(first, last + 1)]
                return find("experiment", "ensemble")(experiment, seeds, progress, algorithm=algorithm)
            if kind == SWEEP:
                given = self._given_values(("swept", "fast", "fixed"))
                swept = given.pop("swept")
                return find("experiment", "sweep")(experiment, swept, self._seeds(), progress, None, **given)
            return experiment.outage(
                **self._given_values(("seconds", "cards", "seeds", "wish", "fast")), progress=progress
            )
        except (KeyError, TypeError, json.JSONDecodeError) as error:
            raise ResultError(
                f"{self.path}: does not say what was run ({error}); files of version 0.1 do so for single "
                "runs only"
            ) from error

    def _seeds(self) -> Any:
        """Return the seeds of a sweep, or their ranges of an ensemble."""
        has_none = self.kind == "ensemble" and "result_sha256" in self.facts  # that of a log
        seeds = self.facts.get("seeds") if has_none else self.facts["seeds"]
        return json.loads(seeds) if isinstance(seeds, str) else seeds

    def _given_values(self, accepted: tuple[str, ...]) -> dict[str, Any]:
        """Return what was given, by the names that are accepted."""
        given = self.facts["given"]
        found = json.loads(given) if isinstance(given, str) else dict(given)
        return {name: found[name] for name in accepted}

    def is_repeated_by(self, found: Any) -> bool:
        """Return whether figures are those of the file to the last bit.

        Parameters
        ----------
        found
            What `run` returned.

        Raises
        ------
        ResultError
            If the file has no digest of its figures, as those of version 0.1.
        """
        expected = self.facts.get("result_sha256")
        if not expected:
            raise ResultError(f"{self.path}: has no digest of its figures; files since version 0.2 have one")
        own = dataset_digest(found.dataset) if self.kind == "outages" else found.facts["result_sha256"]
        return bool(own == expected)

    @property
    def other_versions(self) -> dict[str, tuple[str, str]]:
        """The packages that had another version, each with that of the file and that of today."""
        then, now = self.facts.get("versions") or {}, versions()
        return {name: (then[name], now[name]) for name in now if name in then and then[name] != now[name]}

    def __getattr__(self, name: str) -> xr.Dataset:
        """Return a dataset."""
        if name == "datasets" or name.startswith("__"):  # asked for before there is any, as by a copy
            raise AttributeError(name)
        if name in self.datasets:
            return self.datasets[name]
        raise AttributeError(
            f"{self.path} has no {name!r}; it has {', '.join(self.datasets) or 'no datasets'}"
        )

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.datasets]

    def __repr__(self) -> str:
        settings = {} if "made" in self.facts else self.facts.get("settings")  # all that version 0.1 wrote
        facts = {**(settings if isinstance(settings, Mapping) else {}), **self.facts}
        by = (
            f", ins-lab {facts['versions'].get('ins-lab')}"
            if isinstance(facts.get("versions"), Mapping)
            else ""
        )
        seed = f", seed {facts['seed']}" if facts.get("seed") is not None else ""
        hides = ", sealed" if self.sealed else ""
        held = f"; {', '.join(self.datasets)}" if self.datasets else ""
        return (
            f"<{self.path.name}: {self.kind} of {facts.get('mission', 'a mission')}{seed}{hides}, "
            f"made {facts.get('made', 'by version 0.1')}{by}{held}>"
        )


def open_result(path: str | os.PathLike[str]) -> SavedResult:
    """Open a file that the lab wrote: its datasets, if it has any, and what runs it again.

    Parameters
    ----------
    path
        A netCDF or JSON file, a report, a folder of csv files, a file of ``export_track``, or a figure. SBET
        has no room for what made it.

    Raises
    ------
    ResultError
        If it is none of these, is damaged, or is of a newer version of the lab.
    FileNotFoundError
        If there is no such file.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: there is no such file or folder; accepted are {ACCEPTED}")
    try:
        saved = _read(path)
    except ResultError:
        raise
    # Besides what the readers of text raise, the netCDF library has these for damaged files.
    except (OSError, EOFError, ValueError, RuntimeError, LookupError, TypeError, zlib.error) as error:
        words = getattr(error, "strerror", None) or error
        raise ResultError(f"{path}: cannot be read: {words}") from error
    _check_version(saved)
    return saved


def _read(path: Path) -> SavedResult:
    if path.is_dir():
        return _of_folder(path)
    name = path.name.lower()
    check_file(path, 2**40)
    readers: tuple[tuple[tuple[str, ...], Callable[[Path], SavedResult]], ...] = (
        ((".nc",), _of_netcdf),
        ((".json",), _of_json),
        ((".parquet",), _of_parquet),
        (HEADED, lambda one: SavedResult(one, _facts(one, _text(one, LARGEST)))),
        (WHOLE, lambda one: SavedResult(one, _of_page_or_picture(one))),
    )
    for endings, read in readers:
        if name.endswith(endings):
            return read(path)
    if name.endswith((".sbet", ".out")):
        raise ResultError(f"{path}: SBET has no room for what made it; accepted are {ACCEPTED}")
    raise ResultError(f"{path}: is no file that says what made it; accepted are {ACCEPTED}")


def _check_version(saved: SavedResult) -> None:
    """Raise `ResultError` if a file is of no form of ours, or of a newer one."""
    schema, number = saved.facts.get("schema", RESULT), saved.facts.get("schema_version", 1)
    if not isinstance(schema, str) or schema not in VERSIONS:
        raise ResultError(f"{saved.path}: is {str(schema)[:40]!r}; accepted are {', '.join(VERSIONS)}")
    if not isinstance(number, int) or isinstance(number, bool) or number < 1:
        raise ResultError(f"{saved.path}: schema_version {number!r}; accepted is a whole number from 1 on")
    if number > VERSIONS[schema]:
        made = saved.facts.get("versions")
        by = f", written by ins-lab {made.get('ins-lab', '?')}" if isinstance(made, Mapping) else ""
        raise ResultError(
            f"{saved.path}: is of a newer lab{by}: it has version {number} of the form “{schema}”, and "
            f"ins-lab {versions()['ins-lab']} reads up to {VERSIONS[schema]}. A newer ins-lab opens it"
        )


def _text(path: Path, most: int) -> str:
    """Return the first characters of a file, decompressed."""
    with gzip.open(path, "rb") if path.name.lower().endswith(".gz") else path.open("rb") as file:
        return file.read(most).decode("utf-8", "replace").replace("\r\n", "\n")


def _facts(path: Path, text: str) -> dict[str, Any]:
    found = find_facts(unescape(text) if path.suffix.lower() in {".kml", ".gpx", ".html", ".svg"} else text)
    if found is None:
        raise ResultError(f"{path}: says nothing of what made it; files that ins-lab writes since 0.2 do")
    return found


def _of_folder(path: Path) -> SavedResult:
    """Return a folder of csv files, with the settings beside them."""
    import pandas as pd  # noqa: PLC0415 - takes a while to import, and a run does without

    toml = path / "settings.toml"
    if not toml.is_file():
        raise ResultError(f"{path}: is a folder without settings.toml; accepted are {ACCEPTED}")
    text = _text(toml, LARGEST)
    facts = (find_facts(text) or {}) | {"settings": parse_toml(text)}
    tables = sorted(one for one in path.glob("*.csv") if one.stem not in {"summary", "whiteness"})
    return SavedResult(path, facts, {one.stem: pd.read_csv(one, index_col=0).to_xarray() for one in tables})


def _of_netcdf(path: Path) -> SavedResult:
    """Return a netCDF file, all groups in memory: it can be replaced while it is open."""
    import xarray as xr  # noqa: PLC0415 - takes a while to import, and a run does without

    with xr.open_datatree(path, engine="netcdf4") as tree:
        if (size := sum(leaf.nbytes for leaf in tree.leaves)) > LARGEST_DATA:
            raise ResultError(
                f"{path}: its data take {size / 2**30:.0f} GB in memory; accepted are "
                f"{LARGEST_DATA // 2**30} GB. xarray.open_datatree opens it without reading them"
            )
        tree.load()
        datasets = {name: one.to_dataset() for name, one in tree.children.items()}
        if tree.data_vars:
            datasets["sweep"] = tree.to_dataset()
        attributes: dict[Any, Any] = {
            name: one.tolist() if hasattr(one, "tolist") else one for name, one in tree.attrs.items()
        }
    if "settings" not in attributes:
        raise ResultError(f"{path}: says nothing of what made it; accepted are files that ins-lab wrote")
    tables = {
        name: parse_toml(str(attributes[name])) for name in ("versions", "settings") if name in attributes
    }
    kinds = {"sweep": SWEEP, "runs": ENSEMBLE, "outages": OUTAGES}  # files of version 0.1 do not say so
    schema = next((kind for name, kind in kinds.items() if name in datasets), RESULT)
    return SavedResult(path, {"schema": schema, **attributes, **tables}, datasets)


def _of_json(path: Path) -> SavedResult:
    if path.stat().st_size > LARGEST_TEXT:
        raise ResultError(f"{path}: too large; accepted is JSON up to {LARGEST_TEXT // 2**20} MB")
    content = json.loads(path.read_text("utf-8-sig"))
    if not isinstance(content, dict) or not isinstance(content.get("settings"), dict):
        raise ResultError(f"{path}: is no result of ins-lab; accepted is what --json prints of a run")
    return SavedResult(path, content, content=content)


def _of_parquet(path: Path) -> SavedResult:
    try:
        from pyarrow import ArrowException  # noqa: PLC0415 - an extra
        from pyarrow.parquet import read_schema  # noqa: PLC0415 - an extra
    except ImportError:
        raise ResultError(f"{path}: parquet needs pyarrow: pip install 'ins-lab[parquet]'") from None
    try:
        written = (read_schema(path).metadata or {}).get(b"ins-lab", b"")
    except ArrowException as error:
        raise ResultError(f"{path}: is no parquet file: {error}") from error
    return SavedResult(path, _facts(path, written.decode("utf-8", "replace")))


def _of_page_or_picture(path: Path) -> dict[str, Any]:
    """Return the facts of a report or a figure; those of a report of version 0.1 are its settings alone."""
    if path.stat().st_size > LARGEST_TEXT:
        raise ResultError(f"{path}: too large; accepted are files up to {LARGEST_TEXT // 2**20} MB")
    suffix = path.suffix.lower()
    if suffix in {".pdf", ".png"}:
        facts: dict[str, Any] = _facts(path, find("figure", "note")(path))
        return facts
    text = _text(path, LARGEST_TEXT)
    _, has_settings, after = text.partition(_SETTINGS)
    if suffix != ".html" or not has_settings:
        return _facts(path, text)
    settings = parse_toml(unescape(after.partition("</pre>")[0]))
    return (find_facts(unescape(text)) or {}) | {"settings": settings}
