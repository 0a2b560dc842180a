"""Profile: what the columns of a maker's csv are, in a TOML file: headings as the maker writes them.

A profile names the columns in the language of ``--column``: ``"gFx" = "force_x[g]"``. The lab ships profiles
in `lab/data/profiles`; the owner of an installation adds his own in a folder. A file has a profile if it has
all headings that the profile needs.

    name = "My logger"
    needs = ["t_ms", "a1", "a2", "a3"]
    [columns]
    "t_ms" = "time[ms]"
    "a1" = "-force_x[g]"

A profile of a simulator also has rates, accelerations and air data, and is read by
`lab.data.sheets.simulator_csv`.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field
from functools import cache, cached_property, lru_cache
from pathlib import Path
from typing import Any

from lab.base.files.description_toml import check_keys, read_toml
from lab.base.files.mission_error import MissionError
from lab.data.checks.imu_axes import axes_matrix
from lab.data.log.vehicle import VEHICLES

FOLDER_VARIABLE = "INS_LAB_PROFILES"
"""Environment variable that names the folder of the owner's profiles."""
SHIPPED = Path(__file__).parents[1] / "profiles"
"""Folder of the profiles that ship with the lab."""
MAX_PROFILES = 200
"""Most profiles of a folder."""
_MAX_COLUMNS = 1000
"""Most columns of a profile: as many as a csv may have."""
_MAX_TEXT = 300
"""Longest name, heading or quantity [characters]."""
_TEXTS = ("name", "source", "about", "advice", "prefix", "suffix", "without_own_time", "vehicle")
_LISTS = ("needs", "lacks", "remarks", "shared", "axes")
_SWITCHES = ("simulator", "phone", "sea_level", "magnetic")


@dataclass(frozen=True)
class Profile:
    """What the columns of a maker's csv are.

    Attributes
    ----------
    path : Path
        The TOML file.
    name : str
        Name of the format.
    columns : mapping of str
        What each heading is, as ``--column`` takes it; ``-`` for one that is not read. Headings are compared
        as `plain` gives them; of several columns of one quantity the first is the best.
    needs : tuple of tuple of str
        Headings that a file has to have: one of each; all columns if the profile says nothing.
    defaults : mapping of str
        Units of quantities whose headings name none, by quantity: ``rate = "rad/s"``.
    source : str
        How the units are known, for the report.
    remarks : tuple of str
        What the report says of each file.
    phone : bool
        Whether the sensors are those of a phone, whose y axis points to its top.
    axes : tuple of str
        The axes of the IMU that point forward, right and down; empty: gravity and motion show them.
    vehicle : str
        Kind of vehicle that carries the logger, as `lab.data.log.vehicle` has them; empty for any.
    simulator : bool
        Whether `lab.data.sheets.simulator_csv` reads it; the rest is for it alone.
    prefix, suffix : str
        What may stand before and after each heading that is a path.
    shared : tuple of str
        Headings that other programs write too: a file with no others does not have this profile.
    advice : str
        What to record where a file has no motion.
    without_own_time : str
        What the report says where the simulator's own clock is missing.
    sea_level : bool
        Whether heights are above sea level.
    magnetic : bool
        Whether directions may be from magnetic north, as `lab.data.sheets.garmin_csv` reads them.
    lacks : tuple of str
        Headings that a file must not have, because another program writes them beside the same columns.
    """

    path: Path
    name: str
    columns: Mapping[str, str]
    needs: tuple[tuple[str, ...], ...]
    defaults: Mapping[str, str] = field(default_factory=dict)
    source: str = ""
    remarks: tuple[str, ...] = ()
    phone: bool = False
    axes: tuple[str, ...] = ()
    vehicle: str = ""
    simulator: bool = False
    prefix: str = ""
    suffix: str = ""
    shared: tuple[str, ...] = ()
    advice: str = ""
    without_own_time: str = ""
    sea_level: bool = False
    magnetic: bool = False
    lacks: tuple[str, ...] = ()

    @cached_property
    def meanings(self) -> Mapping[str, tuple[int, str]]:
        """Place and meaning of each heading, as `plain` gives it."""
        found: dict[str, tuple[int, str]] = {}
        for place, (heading, text) in enumerate(self.columns.items()):
            for name in self._spellings(heading):
                found.setdefault(name, (place, text))
        return found

    @cached_property
    def needed(self) -> tuple[AbstractSet[str], ...]:
        """What `needs` says as `plain` gives it, and a heading that no other program writes."""
        needs = [frozenset(name for one in need for name in self._spellings(one)) for need in self.needs]
        if self.shared:
            common = {plain(one) for one in self.shared}
            own = (name for name, (_, text) in self.meanings.items() if not text.startswith("time"))
            needs.append(frozenset(own) - common)
        return tuple(needs)

    def fits(self, names: AbstractSet[str]) -> bool:
        """Return whether a file with some headings, as `plain` gives them, has this profile."""
        return not any(map(names.isdisjoint, self.needed)) and names.isdisjoint(map(plain, self.lacks))

    def missing(self, headings: Sequence[str]) -> list[str]:
        """Return the needs that no heading of a file meets, in words."""
        names = set(map(plain, headings))
        needs = zip(self.needs, self.needed, strict=False)
        return [" or ".join(need) for need, spelled in needs if spelled.isdisjoint(names)]

    def may_head(self, text: str) -> bool:
        """Return whether a text has the letters of all needs: quicker than its cells."""
        holds = plain(text).__contains__
        return all(any(map(holds, need)) for need in self.needed)

    def _spellings(self, heading: str) -> Iterator[str]:
        """Yield what a heading may be; a path has something before and after it, or not."""
        is_path = "/" in heading
        for before in dict.fromkeys((self.prefix, "") if is_path else ("",)):
            for after in dict.fromkeys((self.suffix, "") if is_path else ("",)):
                yield plain(f"{before}{heading}{after}")


def plain(heading: str) -> str:
    """Return a heading without what loggers decorate it with: case, blanks, underscores and quotes."""
    return "".join(heading.replace("_", "").replace('"', "").replace("\ufeff", "").split()).lower()


def read_profile(path: Path) -> Profile:
    """Return the profile in a TOML file.

    Raises
    ------
    MissionError
        If it cannot be read, or has a key or value that is not accepted.
    """
    values = read_toml(path)
    check_keys(path, values, (*_TEXTS, *_LISTS, *_SWITCHES, "columns", "defaults"), _TEXTS)
    for key in _SWITCHES:
        if not isinstance(values.get(key, False), bool):
            raise MissionError(f"{path}: {key} = {values[key]!r}; accepted are true and false")
    for key in ("lacks", "remarks", "shared", "axes"):
        if not _are_texts(values.get(key, [])):
            raise MissionError(f"{path}: {key} = {values[key]!r}; accepted is a list of texts")
    columns, defaults = (_table(path, values, key) for key in ("columns", "defaults"))
    needs = _read_needs(path, values.get("needs", list(columns)))
    name = values.get("name", "").strip()
    if not name or not needs:
        raise MissionError(
            f'{path}: the profile has no {"headings" if name else "name"}; accepted is name = "My logger" '
            'and a table [columns] with lines such as "a1" = "force_x[g]"'
        )
    rest: dict[str, Any] = {key: values[key] for key in (*_TEXTS[1:], *_SWITCHES) if key in values}
    rest.pop("about", None)
    rest |= {key: tuple(values.get(key, ())) for key in ("lacks", "remarks", "shared", "axes")}
    if rest["axes"]:
        axes_matrix(rest["axes"], f"{path}: axes = ")
    if rest.get("vehicle", "") not in ("", *VEHICLES):
        raise MissionError(f"{path}: vehicle = {rest['vehicle']!r}; accepted are {', '.join(VEHICLES)}")
    return Profile(path, name, columns, needs, defaults, **rest)


def _are_texts(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(one, str) and len(one) <= _MAX_TEXT for one in value)


def _table(path: Path, values: Mapping[str, Any], key: str) -> dict[str, str]:
    table = values.get(key, {})
    if not isinstance(table, dict) or len(table) > _MAX_COLUMNS or not _are_texts([*table, *table.values()]):
        raise MissionError(
            f'{path}: accepted as [{key}] are at most {_MAX_COLUMNS} lines such as "a1" = "force_x[g]"'
        )
    return {heading.strip(): text.strip() for heading, text in table.items()}


def _read_needs(path: Path, value: object) -> tuple[tuple[str, ...], ...]:
    found = [one if isinstance(one, list) else [one] for one in value] if isinstance(value, list) else [[]]
    if not all(one and _are_texts(one) for one in found) or len(found) > _MAX_COLUMNS:
        raise MissionError(
            f'{path}: needs = {value!r}; accepted is a list of headings, such as ["t", ["lat", "latitude"]], '
            "in which a list stands for any one of its headings"
        )
    return tuple(tuple(text.strip() for text in one) for one in found)


def own_folder() -> Path:
    """Return the folder of the owner's profiles, which need not exist.

    It is what the environment variable ``INS_LAB_PROFILES`` names, or else ``profiles`` in the user's data
    folder of ``ins-lab`` (on Linux ``~/.local/share/ins-lab/profiles``).
    """
    if named := os.environ.get(FOLDER_VARIABLE):
        return Path(named).expanduser()
    from platformdirs import user_data_path  # noqa: PLC0415 - only needed without the variable

    return user_data_path("ins-lab", appauthor=False) / "profiles"


@cache
def shipped_profiles() -> tuple[Profile, ...]:
    """Return the profiles that ship with the lab."""
    return _of_folder(SHIPPED, _listing(SHIPPED))


def own_profiles() -> tuple[Profile, ...]:
    """Return the owner's profiles; one that is broken is left out with a warning."""
    folder = own_folder()
    return _of_folder(folder, _listing(folder))


def _listing(folder: Path) -> tuple[tuple[str, int, int], ...]:
    """Return the TOML files of a folder, with what changes when one is written."""
    try:
        with os.scandir(folder) as entries:
            found = [
                (entry.name, entry.stat().st_mtime_ns, entry.stat().st_size)
                for entry in entries
                if entry.name.endswith(".toml") and entry.is_file()
            ]
    except OSError:
        return ()
    return tuple(sorted(found)[:MAX_PROFILES])


@lru_cache(maxsize=8)
def _of_folder(folder: Path, listing: tuple[tuple[str, int, int], ...]) -> tuple[Profile, ...]:
    found = []
    for name, _, _ in listing:
        try:
            found.append(read_profile(folder / name))
        except MissionError as error:
            warnings.warn(f"profile left out: {error}", stacklevel=2)
    return tuple(found)


def profile_of(file: str, headings: Sequence[str]) -> Profile | None:
    """Return the profile of a csv that is no simulator's; None if there is none.

    Parameters
    ----------
    file
        Name of the file, for the message.
    headings
        Its headings.

    Raises
    ------
    MissionError
        If several profiles have these headings.
    """
    there = frozenset(map(plain, headings))
    fitting = [one for one in (*shipped_profiles(), *own_profiles()) if not one.simulator and one.fits(there)]
    # A profile whose needs include all of another's is the more particular one.
    needs = [set(one.needed) for one in fitting]
    best = [one for one, need in zip(fitting, needs, strict=True) if not any(other > need for other in needs)]
    if len(best) > 1:
        names = " and ".join(f"{one.name} ({one.path})" for one in best)
        raise MissionError(
            f"{file}: its headings are those of several profiles: {names}; accepted is one. Remove one, "
            "or let it need a heading that the other file does not have"
        )
    return best[0] if best else None
