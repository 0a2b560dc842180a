"""Completion: in Jupyter, Tab lists settings with value, unit and bounds, and plots with what they show.

``experiment.sensors.gyro.`` completes the settings of the group, then its methods. ``result.plot.`` completes
the plots that the result has, and ``result.`` its datasets and methods. Inside the quotes of
``experiment.set("`` and of ``experiment.sweep({"``, dotted paths are completed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from lab.base.notebook_card import NotebookCard
from lab.experiment.result_plots import ResultPlots

if TYPE_CHECKING:
    from lab.base.parameters.settings import Settings

_ATTRIBUTE = re.compile(r"(\w+(?:\.\w+)*)\.(\w*)")
_PATH = re.compile(r"(\w+(?:\.\w+)*)\.(?:get|set|sweep)\([^)]*[\"']([\w.]*)$")
WIDE = 44
"""Most characters of a kind, beside which the names have room: the names of settings have up to 28."""
_BACK = 2000
"""Characters before the cursor among which the call is searched: more than such a call has."""


def register_completion() -> None:
    """Add the completion to a running IPython; without one, do nothing."""
    import IPython  # noqa: PLC0415 - it takes half a second, and is there where a notebook runs

    shell: Any = IPython.get_ipython()
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

    found: list[tuple[str, str]] = []
    start = token
    if (quoted := _PATH.search(text)) and _is_settings(settings := _find_named(quoted[1], names)):
        start, found = quoted[2], _paths(settings)
    elif whole := _ATTRIBUTE.fullmatch(token):
        start, found = whole[2], _members(_find_named(whole[1], names), private=whole[2].startswith("_"))
    kept = [(word, kind) for word, kind in found if word.startswith(start)]
    return {
        "completions": [SimpleCompletion(word, type=in_one_line(kind)) for word, kind in kept],
        # The list shows the names without the words before them, in this order.
        "matched_fragment": start,
        "ordered": True,
        "suppress": bool(kept),
    }


def in_one_line(kind: str) -> str:
    """Return a kind for JupyterLab, which breaks lines at spaces and strokes, no longer than `WIDE`."""
    short = kind if len(kind) <= WIDE else f"{kind[: WIDE - 1]}…"
    return short.replace(" ", "\N{NO-BREAK SPACE}").replace("/", "/\N{WORD JOINER}")


def _is_settings(found: object) -> bool:
    from lab.base.parameters.settings import Settings  # noqa: PLC0415 - importing the lab loads no settings

    return isinstance(found, Settings)


def _find_named(expression: str, names: Mapping[str, Any]) -> Any:
    """Return the object that a dotted expression names, or None; nothing is computed for it."""
    first, *rest = expression.split(".")
    found = names.get(first)
    for name in rest:
        found = _part(found, name)
    return found


def _part(owner: object, name: str) -> Any:
    """Return a part of an object of the lab that is there already: a group, an attribute, the plots."""
    import inspect  # noqa: PLC0415 - takes a quarter of the import of the lab, and only a prompt needs it

    if not isinstance(owner, NotebookCard):
        return None
    if _is_settings(owner):
        return owner.groups().get(name)  # type: ignore[attr-defined]
    if name == "plot" and isinstance(inspect.getattr_static(owner, name, None), property):
        return owner.plot  # type: ignore[attr-defined]
    return vars(owner).get(name) if hasattr(owner, "__dict__") else None


def _members(owner: object, *, private: bool) -> list[tuple[str, str]]:
    """Return the names of an object of the lab with their kinds; nothing for another object."""
    if private or not isinstance(owner, (NotebookCard, ResultPlots)):
        return []
    listed = [name for name in dir(owner) if not name.startswith("_")]
    if not _is_settings(owner):
        return [(name, _describe_member(owner, name)) for name in listed]
    return _settings(owner, listed)


def _settings(settings: Any, listed: list[str]) -> list[tuple[str, str]]:
    """Return settings and groups first, then the methods."""
    from lab.base.parameters.setting_kinds import brief_value  # noqa: PLC0415 - importing the lab loads no settings

    groups, values, methods = settings.groups(), [], []
    for name in listed:
        if name in groups:
            values.append((name, "settings"))
        elif name in settings.param:
            values.append((name, brief_value(settings.param[name], getattr(settings, name))))
        else:
            methods.append((name, _describe_member(settings, name)))
    return values + methods


def _describe_member(owner: object, name: str) -> str:
    """Return the first sentence about a method, a plot or a property, in a few words; nothing is computed."""
    import inspect  # noqa: PLC0415 - takes a quarter of the import of the lab, and only a prompt needs it

    member = (
        getattr(owner, name)
        if isinstance(owner, ResultPlots)
        else inspect.getattr_static(type(owner), name, None)
    )
    text = (inspect.getdoc(member) or "") if callable(member) or hasattr(member, "__get__") else ""
    words = text.partition("\n")[0].removeprefix("Return ").rstrip(".")
    return words or "value"


def _paths(settings: Settings) -> list[tuple[str, str]]:
    from lab.base.parameters.setting_kinds import brief_value  # noqa: PLC0415 - importing the lab loads no settings

    return [
        (path, brief_value(owner.param[name], getattr(owner, name)))
        for path, owner, name in settings.leaves()
    ]
