"""Text: the text of a step as HTML, made of a few elements only; whatever else is in it is shown as it is.

Paragraphs have an empty line between them. Lines that begin with ``- `` are a list. Inside, ``$…$`` is a
formula, ``$$…$$`` one on its own line, `` `…` `` the name of a setting, and ``*…*`` is emphasised.
"""

from __future__ import annotations

import re
from html import escape

from lab.classroom.lessons.formula import FormulaError, mathml

_PART = re.compile(
    r"\$\$(?P<block>[^$]+)\$\$|\$(?P<inline>[^$]+)\$|`(?P<code>[^`\n]+)`|\*(?P<strong>[^*\n]+)\*"
)

_GROUPS = frozenset({"trajectory", "sensors", "navigator"})
"""Groups of settings with which paths begin."""


class TextError(ValueError):
    """A text with a formula that cannot be read; the message says what is accepted."""


def text_html(text: str) -> str:
    """Return a text as HTML.

    Raises
    ------
    TextError
        If a formula cannot be read.
    """
    blocks = re.split(r"\n\s*\n", text.strip())
    return "".join(_block(block) for block in blocks if block.strip())


def settings_named(text: str) -> list[str]:
    """Return the paths of settings that a text marks, such as ``navigator.r_scale``."""
    marked = (found["code"] for found in _PART.finditer(text) if found["code"])
    return [name for name in marked if name.partition(".")[0] in _GROUPS and "." in name]


def _block(block: str) -> str:
    lines = [line.strip() for line in block.strip().splitlines()]
    words, points = list[str](), list[str]()
    for line in lines:
        if line.startswith("- "):
            points.append(line[2:])
        elif points:
            points[-1] += f" {line}"
        else:
            words.append(line)
    listed = "".join(f"<li>{_inline(point)}</li>" for point in points)
    paragraph = f"<p>{_inline(' '.join(words))}</p>" if words else ""
    return paragraph + (f"<ul>{listed}</ul>" if listed else "")


def _inline(words: str) -> str:
    parts, end = [], 0
    for found in _PART.finditer(words):
        parts += [_escape_plain(words[end : found.start()]), _mark_up(found)]
        end = found.end()
    return "".join((*parts, _escape_plain(words[end:])))


def _escape_plain(words: str) -> str:
    if "$" in words:
        raise TextError("a $ without the one that ends its formula; accepted is $…$ in one paragraph")
    return escape(words)


def _mark_up(found: re.Match[str]) -> str:
    if found["code"]:
        return f"<code>{escape(found['code'])}</code>"
    if found["strong"]:
        return f"<em>{_inline(found['strong'])}</em>"
    formula = found["block"] or found["inline"]
    try:
        return mathml(formula, display=bool(found["block"]))
    except FormulaError as error:
        raise TextError(f"the formula ${formula[:40]}$ {error}") from error
