"""Cards: all missions, each with its picture, as one component that reports clicks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import param
from panel.custom import JSComponent

from lab.cache import StageCache
from lab.missions import Mission, MissionError, broken_missions, missions
from lab.missions.library import own_names
from lab.views.thumbnail import picture

_HERE = Path(__file__).parent

KEPT = StageCache(limit=8 * 2**20)
"""Pictures by the content of the recordings, for all sessions of this process."""


class MissionCards(JSComponent):
    """All missions as cards; those that contain all words of a filter are shown.

    Parameters
    ----------
    act
        Called with an action ("choose", "edit", "delete" or "filter") and with the name of the mission, or
        the tag to filter by. Also called with "ready" once the browser shows the cards.
    """

    missions: list[dict[str, Any]] = param.List(doc="The values of `card_of` for all missions.")
    chosen: str = param.String(doc="Name of the chosen mission.")
    filter: str = param.String(doc="Words that a shown mission must all contain.")
    wish: dict[str, Any] = param.Dict({}, doc="The last click: action, name, and a count.")

    _esm = _HERE / "cards.js"
    _stylesheets = [(_HERE / "cards.css").read_text(encoding="utf-8")]  # noqa: RUF012 - Panel's own

    def __init__(self, act: Callable[[str, str], None], **params: Any) -> None:
        super().__init__(**params)  # type: ignore[no-untyped-call]
        self._act = act
        self.param.watch(self._wished, "wish")

    def _wished(self, event: param.parameterized.Event) -> None:
        self._act(str(event.new.get("what")), str(event.new.get("name")))


@dataclass(frozen=True)
class Picture:
    """Picture of a mission, and its duration [s]."""

    svg: str
    duration: float

    @property
    def nbytes(self) -> int:
        """Memory of the picture [bytes]."""
        return len(self.svg)


def all_cards(tell: Callable[[str, float], None], editable: bool) -> Iterator[list[dict[str, Any]]]:
    """Yield the cards of all missions, first without the pictures, then with them.

    Parameters
    ----------
    tell
        Called before each picture, with a phrase and the fraction done.
    editable
        Whether the user's own missions can be changed.
    """
    found, broken, own = missions(), broken_missions(), own_names() if editable else frozenset()
    cards = [card_of(name, mission, name in own) for name, mission in found.items()]
    wrecks = [_card(name, name in own, problem=reason) for name, reason in broken.items()]
    yield [*cards, *wrecks]
    drawn = []
    for number, card in enumerate(cards):
        tell("Drawing the missions", number / len(cards))
        # Dropping a mission frees its recording: thousands of recordings need some gigabytes.
        drawn.append(_drawn(card, found.pop(card["name"])))
    yield sorted([*drawn, *wrecks], key=lambda card: bool(card["problem"]))


def card_of(name: str, mission: Mission, own: bool) -> dict[str, Any]:
    """Return the content of a mission's card that does not need its recording."""
    return _card(
        name,
        own,
        title=mission.title or name,
        origin=mission.origin,
        tags=list(mission.tags),
        more=f"{mission.description} {mission.aircraft} {mission.airport}",
    )


def _card(
    name: str,
    own: bool,
    *,
    title: str = "",
    origin: str = "",
    tags: list[str] | None = None,
    more: str = "",
    problem: str = "",
) -> dict[str, Any]:
    words = " ".join((name, title, origin, *(tags or []), more, problem))
    return {
        "name": name,
        "title": title or name,
        "origin": origin,
        "tags": tags or [],
        "own": own,
        "words": words.lower(),
        "problem": problem,
        "duration": "",
        "picture": "",
    }


def _drawn(card: dict[str, Any], mission: Mission) -> dict[str, Any]:
    try:
        drawn = KEPT.get("picture", mission.content_hash, lambda: Picture(picture(mission), mission.duration))
    except MissionError as error:
        return card | {"problem": str(error)}
    return card | {"picture": drawn.svg, "duration": spoken(drawn.duration)}


def spoken(seconds: float) -> str:
    """Return a duration as text, such as ``"3 min 25 s"``."""
    whole = round(seconds)
    if whole < 600:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
