"""Seen names: settings in a message, named as their fields on the page, not as in files and commands."""

from __future__ import annotations

import re
from functools import cache

from dashboards.settings_panel import SECTIONS
from lab.experiment import Experiment

_PATH = re.compile(r"\b(?:sensors|navigator|trajectory)(?:\.[a-z][a-z0-9_]*)+")


def as_seen(text: str) -> str:
    """Return a text with the dotted paths of settings replaced by group and label of their fields.

    >>> as_seen("The heading is unknown; navigator.initial_heading sets it.")
    'The heading is unknown; “Navigator and filter: Initial heading of a log or stream” sets it.'
    """
    fields = _fields()
    return _PATH.sub(lambda found: fields.get(found[0], found[0]), text)


@cache
def _fields() -> dict[str, str]:
    """Return group and label of each field, by the path of its setting."""
    experiment, found = Experiment(), {}
    for path, *_ in experiment.leaves():
        group = path.rpartition(".")[0]
        if group in SECTIONS:
            found[path] = f"“{SECTIONS[group][0]}: {experiment.declaration(path).label}”"
    return found
