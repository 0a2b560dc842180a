"""Mission titles: the titles of missions in a selection."""

from __future__ import annotations

from collections.abc import Mapping

from lab.missions import Mission


def mission_titles(found: Mapping[str, Mission]) -> dict[str, str]:
    """Return names of missions by title; titles that occur twice get the name appended."""
    titles: dict[str, str] = {}
    for name, mission in found.items():
        title = mission.title or name
        titles[title if title not in titles else f"{title} ({name})"] = name
    return titles
