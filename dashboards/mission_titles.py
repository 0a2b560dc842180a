"""Mission titles: what missions are called where one is chosen."""

from __future__ import annotations

from collections.abc import Mapping

from lab.missions import Mission


def mission_titles(found: Mapping[str, Mission]) -> dict[str, str]:
    """Return names of missions by title, with the name beside titles that occur twice."""
    titles: dict[str, str] = {}
    for name, mission in found.items():
        title = mission.title or name
        titles[title if title not in titles else f"{title} ({name})"] = name
    return titles
