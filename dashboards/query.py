"""Query: the settings of an experiment, and what a page shows of it, as the query of an address."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Collection, Mapping
from functools import cache
from types import MappingProxyType
from typing import Any, NamedTuple
from urllib.parse import parse_qsl, urlencode

from dashboards.notes import MOST_FIELDS, NOTE
from dashboards.session import RUNS
from dashboards.teaching.class_link import FIELD
from lab.base.parameters.setting_error import RefusedValueError, SettingError, UnknownSettingError
from lab.base.parameters.setting_kinds import MatrixOrNone, requirement
from lab.classroom.lessons.lesson import RENAMED
from lab.experiment.experiment import Experiment

MOST_PROBLEMS = 10
"""Most wrong settings of an address that are reported; the rest is ignored, because each message takes
time."""

HOMEWORK = "homework"
"""What names a homework of the server in an address."""

HELD = "hold"
"""What names the settings of a held result in an address; there is one for each."""

THEME = "theme"
"""What names the theme in an address, ``dark`` or ``default``; Panel itself takes it."""

BESIDE = ("Missions", "Lessons")
"""Titles of the pages that open beside the tabs."""

VARIANCE = "variance"
"""What an address says of a page whose fields show variances, and not σ."""

_NUMBER = r"\d{1,9}(?:\.\d{1,9})?"
_SPAN = re.compile(rf"({_NUMBER})-({_NUMBER})", re.ASCII)
_TIME = re.compile(_NUMBER, re.ASCII)


class View(NamedTuple):
    """What a page shows of its result.

    Attributes
    ----------
    tab : str
        Title of the open tab; empty for the tab with which a page opens.
    time : float
        The time cursor [s].
    zoom : tuple or None
        First and last visible time [s]; None for the whole flight.
    runs : int
        Number of runs that are judged together.
    beside : str
        Title of the page that is open beside the tabs; empty without one.
    noise : str
        `VARIANCE` if the fields of variances show them; empty if they show σ.
    """

    tab: str = ""
    time: float = 0.0
    zoom: tuple[float, float] | None = None
    runs: int = 1
    beside: str = ""
    noise: str = ""


def homework_of_query(query: str) -> tuple[str, str]:
    """Return the name of a homework in an address query, empty without one, and the rest of the query."""
    parts = query.split("&")
    names = [part.partition("=")[2] for part in parts if part.startswith(f"{HOMEWORK}=")]
    return (names[-1] if names else ""), "&".join(
        part for part in parts if not part.startswith(f"{HOMEWORK}=")
    )


def experiment_of_query(query: str) -> tuple[Experiment, list[str]]:
    """Return the experiment of an address query, and messages about settings that were not accepted.

    The code of a class, the theme, held results, notes and the parts of a view are no settings.
    """
    trial, problems = Experiment(), list[str]()
    try:
        fields = parse_qsl(query, keep_blank_values=True, max_num_fields=MOST_FIELDS)
    except ValueError:
        return trial, [f"The address has too many settings; accepted are up to {MOST_FIELDS}."]
    # Other forms come last, because they depend on the other settings.
    for path, text in sorted(fields, key=lambda item: item[0] in Experiment.OTHER_FORMS):
        if path in (FIELD, THEME, HELD, NOTE, *View._fields):
            continue
        try:
            trial.set_text(path, text)
        except UnknownSettingError:
            problems.append(f"The link has an unknown setting, {path[:60]}; it was ignored.")
        except RefusedValueError:
            limits = requirement(trial.declaration(path), name=path)
            problems.append(f"{limits} The link has {text[:60]}, which was ignored.")
        except SettingError as error:
            problems.append(str(error))
        if len(problems) == MOST_PROBLEMS:
            problems.append("The rest of the address is ignored.")
            break
    return trial, problems


def view_of_query(query: str, tabs: Collection[str]) -> tuple[View, list[str]]:
    """Return what a page shows according to an address query, and messages about what is not accepted.

    Parameters
    ----------
    query
        The query; of a part that is there twice, the last one counts.
    tabs
        Titles of the tabs.
    """
    try:
        fields = dict(parse_qsl(query, max_num_fields=MOST_FIELDS))
    except ValueError:  # `experiment_of_query` reports it
        return View(), []
    readers: dict[str, tuple[Callable[[str], Any], str]] = {
        "tab": (
            lambda text: found if (found := RENAMED.get(text, text)) in tabs else None,
            f"one of {', '.join(tabs)}",
        ),
        "time": (_time_of, "a time in seconds, such as 12.5"),
        "zoom": (_span_of, "two times in seconds, such as 60-75"),
        "runs": ({str(runs): runs for runs in RUNS}.get, f"one of {', '.join(map(str, RUNS))}"),
        "beside": (lambda text: text if text in BESIDE else None, " or ".join(BESIDE)),
        "noise": (lambda text: text if text == VARIANCE else None, VARIANCE),
    }
    found, problems = dict[str, Any](), list[str]()
    for name, (read, accepted) in readers.items():
        if name not in fields:
            continue
        value = read(fields[name])
        if value is None:
            ignored = f"The link has {name}={fields[name][:40]}, which was ignored"
            problems.append(f"{ignored}; accepted is {accepted}.")
        else:
            found[name] = value
    return View(**found), problems


def _time_of(text: str) -> float | None:
    return float(text) if _TIME.fullmatch(text) else None


def _span_of(text: str) -> tuple[float, float] | None:
    found = _SPAN.fullmatch(text)
    span = (float(found[1]), float(found[2])) if found else (0.0, 0.0)
    return span if span[0] < span[1] else None


def query_of_view(view: View) -> str:
    """Return what of a view differs from that with which a page opens, as the query of an address."""
    start, end = view.zoom or (0.0, 0.0)
    parts = {
        "tab": view.tab,
        "time": _seconds(view.time) if view.time else "",
        "zoom": f"{_seconds(start)}-{_seconds(end)}" if view.zoom else "",
        "runs": str(view.runs) if view.runs != 1 else "",
        "beside": view.beside,
        "noise": view.noise,
    }
    return urlencode({name: text for name, text in parts.items() if text})


def _seconds(time: float) -> str:
    return f"{time:.2f}".rstrip("0").rstrip(".")


def with_settings_of(begun: Experiment, other: Experiment) -> Experiment:
    """Give an experiment, which may hide something, all settings of another one, and return it."""
    for path, owner, name in other.leaves():
        if begun.get(path) != getattr(owner, name):
            begun.set(path, getattr(owner, name))
    return begun


@cache
def default_settings() -> Mapping[str, Any]:
    """Return the default of each setting by its path."""
    return MappingProxyType({path: getattr(owner, name) for path, owner, name in Experiment().leaves()})


def query(experiment: Experiment) -> str:
    """Return the settings that differ from the defaults, as the query of an address."""
    default = default_settings()
    changed = []
    for path, owner, name in experiment.leaves():
        value = getattr(owner, name)
        if value != default[path]:
            if isinstance(value, tuple) and len(set(value)) == 1:
                value = value if isinstance(owner.param[name], MatrixOrNone) else value[0]
            changed.append((path, value if isinstance(value, str) else json.dumps(value)))
    return urlencode(changed, safe="[], ")
