"""Hatch build: the readme of the wheel for the page of an index, where relative links lead nowhere."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

UNKNOWN = "https://example.org/"
"""How an address begins that leads nowhere: RFC 2606 reserves this domain."""
PICTURE = re.compile(r"<picture>\n<source [^>]*>\n<img alt=\"([^\"]+)\" src=\"([^\"]+)\">\n</picture>")
LINK = re.compile(r"\[([^\]\n]+)\]\((?!https?://|#)([^)\n]+)\)")


def readme_of(text: str, repository: str, version: str) -> str:
    """Return a readme whose pictures and links lead to the files of a version in a repository.

    Parameters
    ----------
    text
        The readme, with relative pictures and links.
    repository
        Its address at a host that serves files below ``raw`` and pages of files below ``blob``, as GitHub and
        GitLab do. While it is unknown, a picture becomes its description, and a link its text.
    version
        The version, whose tag is ``v`` and that.
    """
    if repository.startswith(UNKNOWN):
        return LINK.sub(r"\1", PICTURE.sub(r"*Picture: \1.*", text))
    text = PICTURE.sub(rf'<img alt="\1" src="{repository}/raw/v{version}/\2">', text)
    return LINK.sub(rf"[\1]({repository}/blob/v{version}/\2)", text)


class CustomMetadataHook(MetadataHookInterface):
    """Gives the metadata its readme."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Add the readme."""
        text = (Path(self.root) / "README.md").read_text("utf-8")
        made = readme_of(text, metadata["urls"]["Repository"], metadata["version"])
        metadata["readme"] = {"content-type": "text/markdown", "text": made}
