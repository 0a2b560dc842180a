"""Cards: all missions, as one component that reports clicks, and asks for the pictures of the cards in view.

A folder may have thousands of missions. Their texts are sent at once; a recording is read, and its picture
sent, only when its card comes into view.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import param
from panel.custom import JSComponent

from lab.base.cache import StageCache
from lab.missions import Mission, MissionError, broken_missions, missions
from lab.missions.library import user_names
from lab.views.thumbnail import picture

_HERE = Path(__file__).parent

KEPT = StageCache(limit=8 * 2**20)
"""Pictures by the content of the recordings, for all sessions of this process."""

MOST = 64
"""Most pictures for which a browser may ask at once: more than there are cards on a large screen."""


class Question(NamedTuple):
    """Names of cards in view whose pictures a browser lacks, and the number of its question."""

    names: tuple[str, ...]
    number: int


class MissionCards(JSComponent):
    """All missions as cards; those that contain all words of a filter are shown.

    Parameters
    ----------
    act
        Called with an action ("choose", "edit", "delete" or "filter") and with the name of the mission, or
        the tag to filter by. Also called with "ready" once the browser shows the cards.
    draw
        Called with a `Question`; `answer` takes what was drawn.
    """

    missions: list[dict[str, Any]] = param.List(doc="The values of `all_cards`.")
    asked: dict[str, Any] = param.Dict({}, doc="The last question of the browser: names, and a count.")
    drawn: dict[str, Any] = param.Dict({}, doc="The last answer: the values of `drawings`, and that count.")
    chosen: str = param.String(doc="Name of the chosen mission.")
    filter: str = param.String(doc="Words that a shown mission must all contain.")
    wish: dict[str, Any] = param.Dict({}, doc="The last click: action, name, and a count.")

    _esm = _HERE / "cards.js"
    _stylesheets = [(_HERE / "cards.css").read_text(encoding="utf-8")]  # noqa: RUF012 - Panel's own

    def __init__(
        self, act: Callable[[str, str], None], draw: Callable[[Question], None], **params: Any
    ) -> None:
        super().__init__(**params)  # type: ignore[no-untyped-call]
        self._act = act
        self._draw = draw
        self.param.watch(self._follow_wish, "wish")
        self.param.watch(self._questioned, "asked")

    def answer(self, question: Question, drawings: dict[str, dict[str, str]]) -> None:
        """Send what the browser asked for; it then asks for the next."""
        self.drawn = {"cards": drawings, "count": question.number}

    def _follow_wish(self, event: param.parameterized.Event) -> None:
        self._act(str(event.new.get("what")), str(event.new.get("name")))

    def _questioned(self, event: param.parameterized.Event) -> None:
        names, count = event.new.get("names"), event.new.get("count")
        if isinstance(names, list) and isinstance(count, int):
            self._draw(Question(tuple(name for name in names[:MOST] if isinstance(name, str)), count))


@dataclass(frozen=True)
class Picture:
    """Picture of a mission, and its duration [s]."""

    svg: str
    duration: float

    @property
    def nbytes(self) -> int:
        """Memory of the picture [bytes]."""
        return len(self.svg)


def all_cards(editable: bool) -> list[dict[str, Any]]:
    """Return the content of the cards of all missions, which needs none of their recordings.

    Parameters
    ----------
    editable
        Whether the user's own missions can be changed.
    """
    found, broken, own = missions(), broken_missions(), user_names() if editable else frozenset()
    cards = [
        _card(
            name,
            name in own,
            title=mission.title or name,
            origin=mission.origin,
            about=mission.description.strip() or mission.origin,
            tags=list(mission.tags),
            more=f"{mission.description} {mission.aircraft} {mission.airport}",
            recorded=_stamp(mission.recording_path),
        )
        for name, mission in found.items()
    ]
    return cards + [_card(name, name in own, problem=reason) for name, reason in broken.items()]


def _card(
    name: str,
    own: bool,
    *,
    title: str = "",
    origin: str = "",
    about: str = "",
    tags: list[str] | None = None,
    more: str = "",
    recorded: str = "",
    problem: str = "",
) -> dict[str, Any]:
    words = " ".join((name, title, origin, *(tags or []), more, problem))
    return {
        "name": name,
        "title": title or name,
        "about": about,
        "origin": origin,
        "tags": tags or [],
        "own": own,
        "words": words.lower(),
        "recorded": recorded,  # a card with another recording is another card, so its picture is drawn anew
        "problem": problem,
    }


def _stamp(path: Path) -> str:
    try:
        return str(path.stat().st_mtime_ns)
    except OSError:
        return ""


def drawings(names: Sequence[str]) -> dict[str, dict[str, str]]:
    """Return, by name, picture and duration of missions, or the problem with their recordings.

    Parameters
    ----------
    names
        Which missions; those that are gone are left out.
    """
    found = missions()
    # Each mission is dropped once it is drawn, which frees its recording.
    return {name: _drawing(found.pop(name)) for name in dict.fromkeys(names) if name in found}


def _drawing(mission: Mission) -> dict[str, str]:
    try:
        made = KEPT.get("picture", mission.content_hash, lambda: Picture(picture(mission), mission.duration))
    except MissionError as error:
        return {"picture": "", "duration": "", "problem": str(error)}
    return {"picture": made.svg, "duration": format_duration(made.duration), "problem": ""}


def format_duration(seconds: float) -> str:
    """Return a duration as text, such as ``"3 min 25 s"``."""
    whole = round(seconds)
    if whole < 600:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
