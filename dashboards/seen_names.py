"""Seen names: settings in a message, named as their fields on the page, not as in files and commands."""

from __future__ import annotations

import re
from functools import cache
from html import escape

from dashboards.settings_panel import SECTIONS
from dashboards.sigmas import sigma_at
from lab.experiment.experiment import Experiment

_PATH = re.compile(r"\b(?:sensors|navigator|trajectory)(?:\.[a-z][a-z0-9_]*)+")
_SWITCH = re.compile(r"\b(sensors\.[a-z]+)\.fitted = true uses (them|it)\b")
_CODE = re.compile(rf"<code>({_PATH.pattern})</code>")


def as_seen(text: str) -> str:
    """Return a text with the dotted paths of settings replaced by group and label of their fields.

    >>> as_seen("The heading is unknown; navigator.initial_heading sets it.")
    'The heading is unknown; “Navigator and filter: Initial heading of a log or stream” sets it.'
    >>> as_seen("Pressures are not used; sensors.barometer.fitted = true uses them.")
    'Pressures are not used; switch on Barometer to use them.'
    """
    fields = _fields()
    text = _SWITCH.sub(lambda found: f"switch on {SECTIONS[found[1]][0]} to use {found[2]}", text)
    return _PATH.sub(lambda found: fields.get(found[0], found[0]), text)


def html_as_seen(html: str) -> str:
    """Return HTML with the settings in `code` elements replaced by group and label of their fields.

    The path is the tooltip of the new element.

    >>> html_as_seen("<p>Set <code>navigator.r_scale</code>.</p>")
    '<p>Set <b class="field" title="navigator.r_scale">Navigator and filter: R scale</b>.</p>'
    """
    return _CODE.sub(lambda found: _field(found[1]) or found[0], html)


def seen_name(path: str, sigmas: bool = False) -> str:
    """Return group and label of the field of a setting; the label alone where it is in no group.

    Parameters
    ----------
    path
        Dotted path of the setting.
    sigmas
        Whether the field of a variance shows σ.

    >>> seen_name("navigator.r_scale"), seen_name("seed")
    ('Navigator and filter: R scale', 'Seed')
    >>> seen_name("sensors.gps.position_variance", sigmas=True)
    'GPS receiver: Position σ'
    """
    group, colon, _label = _fields().get(path, "").strip("“”").rpartition(": ")
    return f"{group}{colon}{seen_label(path, sigmas)}"


def seen_label(path: str, sigmas: bool) -> str:
    """Return the label of the field of a setting, with σ for a variance that is shown as σ."""
    sigma = sigma_at(path) if sigmas else None
    return str((sigma or Experiment().declaration(path)).label)


def _field(path: str) -> str:
    """Return the element that names the field of a setting; empty where the page has none."""
    named = _fields().get(path)
    return f'<b class="field" title="{path}">{escape(named.strip("“”"))}</b>' if named else ""


@cache
def _fields() -> dict[str, str]:
    """Return group and label of each field, by the path of its setting."""
    experiment, found = Experiment(), {}
    for path, *_ in experiment.leaves():
        group = path.rpartition(".")[0]
        if group in SECTIONS:
            found[path] = f"“{SECTIONS[group][0]}: {experiment.declaration(path).label}”"
    return found
