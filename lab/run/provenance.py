"""Provenance: what made a file: versions, date, mission, seed and all settings, so that it can be made again.

Every export has the same facts under the same names. A file of text has them as TOML in a block of comments
between two marks; netCDF, parquet and pictures have that block in their own metadata. Of a run that hides
something, neither that nor its seed is in them, but what seals it.
"""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.base.parameters.toml_file import TomlError, parse_toml, toml_text
from lab.missions import LogMission, Mission
from lab.navigation.solution import HISTORIES

if TYPE_CHECKING:
    import xarray as xr

    from lab.navigation.solution import Solution
    from lab.run.experiment_settings import ExperimentSettings
    from lab.run.run import Run

RESULT, ENSEMBLE, SWEEP, OUTAGES, MISSION = (
    f"ins-lab {kind}" for kind in ("result", "ensemble", "sweep", "outages", "mission")
)
VERSIONS = {RESULT: 1, ENSEMBLE: 1, SWEEP: 1, OUTAGES: 1, MISSION: 1}
"""Number of each form that this lab writes; it reads this one and all before it."""
PACKAGES = ("ins-lab", "numpy", "scipy", "numba")
"""Packages whose versions decide the figures of a run."""
BEGIN, END = "INS Lab: what made this file, as TOML", "INS Lab: end"
"""Marks around the facts in a text."""
LARGEST = 2**21
"""Largest block that is read [characters]; the settings have 3000, and one with all outages 100,000."""
LONGEST_SIGN = 20
"""Longest sign of a comment, and words of XML, before a line of the block [characters]."""


def time_stamp_now() -> str:
    """Return the date and time, such as ``"2026-05-04T12:30:00Z"``."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def versions() -> dict[str, str]:
    """Return the versions of the lab and of the packages that decide its figures, and of Python."""
    return {name: version(name) for name in PACKAGES} | {"python": platform.python_version()}


def describe_origin(experiment: ExperimentSettings | None = None) -> dict[str, Any]:
    """Return what stands in each printed analysis: its date, versions, and the settings if there are any."""
    found = {"made": time_stamp_now(), "versions": versions()}
    if experiment is None:
        return found
    known = {} if experiment.hidden else {"seed": experiment.seed}
    sealed = {"sealed": experiment.sealed} if experiment.hidden else {}
    return {**found, "mission": experiment.mission, **known, **sealed, "settings": experiment.shared()}


def collect_facts(
    experiment: ExperimentSettings, flight: Mission, schema: str, **further: Any
) -> dict[str, Any]:
    """Return what made the figures of an experiment; `further` facts stand before the settings.

    Parameters
    ----------
    experiment
        The settings; those that are hidden, and their seed, are left out.
    flight
        Its mission.
    schema
        One of `VERSIONS`.
    **further
        Facts of this kind of file; those that are None are left out.
    """
    is_log = isinstance(flight, LogMission)
    known = {name: value for name, value in further.items() if value is not None}
    shown = {} if is_log or experiment.hidden or schema != RESULT else {"seed": experiment.seed}
    sealed = {"sealed": experiment.sealed} if experiment.hidden else {}
    return {
        "schema": schema,
        "schema_version": VERSIONS[schema],
        "made": time_stamp_now(),
        "mission": experiment.mission,
        "recording": flight.content_hash,
        "kind": "log" if is_log else "simulation",
        **shown,
        **sealed,
        **known,
        "versions": versions(),
        "settings": experiment.shared(),
    }


def facts_of_run(run: Run) -> dict[str, Any]:
    """Return what made a run, with a digest of its solution."""
    digest = solution_digest(run.solution_arrays)
    return collect_facts(
        run.experiment, run.mission, RESULT, algorithm=run.algorithm or None, result_sha256=digest
    )


def facts_of_mission(mission: Mission) -> dict[str, Any]:
    """Return what made a file of a mission, without a run."""
    return {
        "schema": MISSION,
        "schema_version": VERSIONS[MISSION],
        "made": time_stamp_now(),
        "mission": mission.name,
        "recording": mission.content_hash,
        "versions": versions(),
    }


def seed_ranges(seeds: Sequence[int]) -> list[list[int]]:
    """Return the first and the last of each unbroken range of seeds."""
    found: list[list[int]] = []
    for seed in seeds:
        if found and seed == found[-1][1] + 1:
            found[-1][1] = seed
        else:
            found.append([seed, seed])
    return found


def solution_digest(solution: Solution) -> str:
    """Return the SHA-256 of the histories of a solution; runs that are the same to the last bit share it."""
    return digest_arrays(getattr(solution, name) for name in HISTORIES)


def dataset_digest(data: xr.Dataset) -> str:
    """Return the SHA-256 of the values of a dataset's variables, whatever the shape."""
    return digest_arrays(data[name].values for name in sorted(map(str, data.data_vars)))


def digest_arrays(arrays: Iterable[Any]) -> str:
    """Return the SHA-256 of the bytes of arrays; all NaN count as one."""
    whole = hashlib.sha256()
    for one in arrays:
        values = np.ascontiguousarray(one)
        if np.isnan(values).any():
            values = np.where(np.isnan(values), np.asarray(np.nan, values.dtype), values)
        whole.update(values.data.cast("B") if values.size else b"")
    return whole.hexdigest()


def facts_block(facts: Mapping[str, Any], sign: str = "", *, short: bool = False) -> str:
    """Return facts as lines of TOML between two marks, each line after a sign of comments.

    A `short` block has a line for each fact, and all settings in one: it stands before a table, where a
    spreadsheet shows it.

    >>> print(block_of({"schema": "ins-lab mission"}, "# "), end="")
    # INS Lab: what made this file, as TOML
    # schema = "ins-lab mission"
    # INS Lab: end
    """
    lines = (BEGIN, *toml_text(_make_writable(facts), inline=short).splitlines(), END)
    return "".join((f"{sign}{line}" if line else sign.rstrip()) + "\n" for line in lines)


def netcdf_attributes(facts: Mapping[str, Any], title: str) -> dict[str, str | int]:
    """Return facts as attributes of a netCDF file: tables as TOML, lists, which may be nested, as JSON."""
    written = _make_writable(facts)
    others = {name: value for name, value in written.items() if isinstance(value, Mapping)}
    plain = {
        name: json.dumps(value) if isinstance(value, list) else value
        for name, value in written.items()
        if name not in others
    }
    return {"title": title, **plain, **{name: toml_text(value) for name, value in others.items()}}


def _make_writable(facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return facts with what was given as JSON: it has unset values, for which TOML has no word."""
    return {name: json.dumps(value) if name == "given" else value for name, value in facts.items()}


def find_facts(text: str) -> dict[str, Any] | None:
    """Return the facts in a text, wherever they stand in it; None if there are none.

    Raises
    ------
    TomlError
        If the block is not TOML, or too large.
    """
    start = text.find(BEGIN)
    sign = text[text.rfind("\n", 0, max(start, 0)) + 1 : start]
    end = text.find(f"\n{sign}{END}", start)
    if start < 0 or end < 0 or len(sign) > LONGEST_SIGN:
        return None
    inside = text[start:end].partition("\n")[2]
    if len(inside) > LARGEST:
        raise TomlError(f"too large; accepted are blocks of up to {LARGEST} characters")
    bare = sign.rstrip()
    lines = (line.removeprefix(sign).removeprefix(bare) for line in inside.splitlines())
    return parse_toml("\n".join(lines))
