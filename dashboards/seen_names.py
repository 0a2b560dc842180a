"""Seen names: settings in a message, named as their fields on the page, not as in files and commands."""

from __future__ import annotations

import re
from functools import cache

from dashboards.settings_panel import SECTIONS
from lab.experiment import Experiment
from lab.settings import SettingError

_PATH = re.compile(r"\b(?:sensors|navigator|trajectory)(?:\.[a-z][a-z0-9_]*)+")


def as_seen(text: str) -> str:
    """Return a text with the dotted paths of settings replaced by group and label of their fields.

    >>> as_seen("The heading is unknown; navigator.initial_heading sets it.")
    'The heading is unknown; “Navigator and filter: Initial heading of a log or stream” sets it.'
    """
    return _PATH.sub(lambda found: _field(found[0]), text)


@cache
def _field(path: str) -> str:
    """Return group and label of the field of a path; the path itself if it has none."""
    group, _, _ = path.rpartition(".")
    try:
        label = Experiment().declaration(path).label
    except SettingError:
        return path
    return f"“{SECTIONS[group][0]}: {label}”" if group in SECTIONS else path
