"""Themed pictures: of a ``<picture>`` for light and dark, the site shows the one of its own theme.

Where the code is hosted, the browser chooses by the theme of the computer. The site has a switch of its own.
"""

from __future__ import annotations

import re

from sphinx.application import Sphinx

PICTURE = re.compile(
    r"^<picture>\n<source media=\"\(prefers-color-scheme: dark\)\" srcset=\"(?P<dark>[^\"]+)\">\n"
    r"<img alt=\"(?P<alt>[^\"]+)\" src=\"(?P<light>[^\"]+)\">\n</picture>$",
    re.MULTILINE,
)
"""A picture as the documents write it."""


def images(picture: re.Match[str]) -> str:
    """Return a picture as two images, of which the theme shows one."""
    return "\n".join(
        f"```{{image}} {picture[theme]}\n:alt: {picture['alt']}\n:class: only-{theme}\n```\n"
        for theme in ("light", "dark")
    )


def replace(app: Sphinx, name: str, source: list[str]) -> None:
    """Replace the pictures of a document before it is parsed."""
    source[0] = PICTURE.sub(images, source[0])
    if "<picture" in source[0]:
        raise ValueError(f"{name}: a <picture> is not in the form that docs/site/themed_pictures.py reads")


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the replacement."""
    app.connect("source-read", replace)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
