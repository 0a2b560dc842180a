"""Completion: in Jupyter, the Tab key lists settings with their value, unit and bounds.

``experiment.sensors.gyro.`` completes the names of the group. Inside the quotes of ``experiment.set("`` and
of ``experiment.sweep({"``, dotted paths are completed.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lab.settings import Settings

_ATTRIBUTE = re.compile(r"(\w+(?:\.\w+)*)\.(\w*)")
_PATH = re.compile(r"(\w+(?:\.\w+)*)\.(?:get|set|sweep)\([^)]*[\"']([\w.]*)$")
WIDE = 40
"""Most characters of a kind, beside which the names have room."""
_BACK = 2000
"""Characters before the cursor among which the call is searched: more than such a call has."""


def register_completion() -> None:
    """Add the completion to a running IPython; without one, do nothing."""
    # IPython that is not loaded does not run; loading it would take half a second.
    if "IPython" not in sys.modules:
        return
    shell = sys.modules["IPython"].get_ipython()
    if shell is None:
        return

    def complete_settings(context: Any) -> dict[str, Any]:
        before = context.full_text.split("\n")[: context.cursor_line]
        text = "\n".join((*before, context.text_until_cursor))[-_BACK:]
        return completions(context.token, text, shell.user_ns)

    complete_settings.matcher_api_version = 2  # type: ignore[attr-defined]
    shell.Completer.custom_matchers.append(complete_settings)


def completions(token: str, text: str, names: Mapping[str, Any]) -> dict[str, Any]:
    """Return the completions of a token, in the form of IPython's matchers.

    Parameters
    ----------
    token
        The word before the cursor, with its dots.
    text
        All text before the cursor.
    names
        The variables of the notebook.
    """
    from IPython.core.completer import SimpleCompletion  # noqa: PLC0415 - only IPython calls this

    if (quoted := _PATH.search(text)) and (settings := _settings(quoted[1], names)):
        found = [(path, brief) for path, brief in _paths(settings) if path.startswith(quoted[2])]
    elif (whole := _ATTRIBUTE.fullmatch(token)) and (settings := _settings(whole[1], names)):
        found = [(f"{whole[1]}.{name}", kind) for name, kind in _members(settings, whole[2])]
    else:
        found = []
    return {
        "completions": [SimpleCompletion(word, type=in_one_line(kind)) for word, kind in found],
        "suppress": bool(found),
    }


def in_one_line(kind: str) -> str:
    """Return a kind for JupyterLab, which breaks lines at spaces, no longer than `WIDE`."""
    short = kind if len(kind) <= WIDE else f"{kind[: WIDE - 1]}…"
    return short.replace(" ", "\N{NO-BREAK SPACE}")


def _settings(expression: str, names: Mapping[str, Any]) -> Settings | None:
    """Return the settings that a dotted expression names; nothing is evaluated but groups of settings."""
    from lab.settings import Settings  # noqa: PLC0415 - importing the lab loads no settings

    first, *rest = expression.split(".")
    found = names.get(first)
    for name in rest:
        found = found.groups().get(name) if isinstance(found, Settings) else None
    return found if isinstance(found, Settings) else None


def _members(settings: Settings, start: str) -> list[tuple[str, str]]:
    from lab.setting_help import brief  # noqa: PLC0415 - importing the lab loads no settings

    groups, found = settings.groups(), []
    for name in dir(settings):
        if not name.startswith(start):
            continue
        if name in groups:
            kind = "settings"
        elif name in settings.param:
            kind = brief(settings.param[name], getattr(settings, name))
        else:
            kind = "function"
        found.append((name, kind))
    return found


def _paths(settings: Settings) -> list[tuple[str, str]]:
    from lab.setting_help import brief  # noqa: PLC0415 - importing the lab loads no settings

    return [(path, brief(owner.param[name], getattr(owner, name))) for path, owner, name in settings.leaves()]
