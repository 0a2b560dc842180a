"""Holding: a button that holds the shown result, and a bar of the held ones, to compare them with others."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import permutations
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qsl

import panel as pn
import panel_material_ui as pmui

from dashboards.history import seen_value
from dashboards.query import query
from dashboards.seen_names import seen_label
from dashboards.session import MOST_HELD, Held, Session
from dashboards.style import TOOLTIP, header_icon
from lab.base.parameters.setting_error import SettingError
from lab.experiment.experiment import Experiment
from lab.views.quantities import HELD as COLOURS
from lab.views.quantities import LETTERS

if TYPE_CHECKING:
    from dashboards.address import HistoryBar

AS_DELIVERED = "default settings"
LONGEST = 14
"""Longest value in the name of a result [characters]."""
LONGEST_NAME = 40
"""Longest name that a person gives to a held result [characters]."""
NAMED = 2
"""Most settings in the name of a result."""
ARRIVED = 200
"""Time after which what was typed has arrived [ms]: Panel handles it later than the key Enter."""
_MORE = re.compile(r", \d+ more$")


class Holding:
    """A button to hold the shown result, and the held results beside each other.

    Each held result is named by its settings, until a person renames it. A press on its name brings these
    settings back.

    Parameters
    ----------
    session
        The session whose results are held.
    keys
        What hears the keys of the page.

    Attributes
    ----------
    button : viewable
        The button, for the header.
    bar : viewable
        The held results; it is visible while there are any.
    """

    def __init__(self, session: Session, keys: HistoryBar) -> None:
        self._session = session
        self._document = pn.state.curdoc
        keys.hear(lambda what, _number: self.hold() if what == "hold" else None)
        self.button = header_icon("push_pin", "Hold this result, to compare it with the next ones (H)")
        self.button.on_click(lambda _event: self.hold())
        self.bar = pn.FlexBox(visible=False, margin=(2, 8), sizing_mode="stretch_width", align_items="center")
        session.param.watch(lambda _event: self._list(), "held")
        session.param.watch(lambda _event: self._name_again(), "shows_sigmas")

    def hold(self) -> None:
        """Hold the shown result."""
        result, held = self._session.result, self._session.held
        if result is None or any(one.result is result for one in held):
            return
        if result.is_long:
            self._session.problem = (
                "A result of so long a flight cannot be held, because two of them take too much memory. "
                "A lower IMU rate makes it smaller."
            )
        elif len(held) == MOST_HELD:
            self._session.problem = f"{MOST_HELD} results are held. Remove one of them first."
        else:
            one = Held(describe_differences(result.experiment), result)
            self._session.held = name_held((*held, one), self._session.shows_sigmas)

    def _name_again(self) -> None:
        """Name the held results that no person has named, once the fields show σ, or variances."""
        self._session.held = name_held(self._session.held, self._session.shows_sigmas)

    def _list(self) -> None:
        """Show the held results by their names; a field to change a name is hidden beside each."""
        held = self._session.held
        self.bar[:] = [part for slot, one in enumerate(held) for part in self._entry(slot, one)]
        self.bar.visible = bool(held)

    def _entry(self, slot: int, held: Held) -> list[pn.viewable.Viewable]:
        common: dict[str, Any] = {"size": "small", "margin": (2, 2), "stylesheets": [TOOLTIP]}
        letter = LETTERS[slot]
        away = pmui.IconButton(icon="close", description=f"Remove {letter}", **common)
        away.on_click(lambda _event: self._remove(held))
        name = pmui.TextInput(
            label=f"Name of {letter}",
            value=held.name,
            max_length=LONGEST_NAME,
            size="small",
            width=240,
            visible=False,
        )
        name.param.watch(lambda _event: self._rename(slot, name.value), "value")
        assert self._document is not None
        later = self._document.add_timeout_callback
        # Enter is told before the name, which may be the same as before.
        name.param.watch(lambda _event: later(self._list, ARRIVED), "enter_pressed")
        back = pmui.Button(
            label=f"{letter} · {held.name}",
            description=f"{letter} · {held.name}: bring these settings back",  # and what a reader hears
            variant="outlined",
            sx={"borderColor": COLOURS[slot], "borderWidth": "2px"},
            **common,
        )
        back.on_click(lambda _event: self._bring_back(held))
        rename = pmui.IconButton(icon="edit", description=f"Rename {letter}", **common)

        def edit(_event: object) -> None:
            """Show the field for the name, which is there already: the next key is for it."""
            back.visible = rename.visible = False
            name.visible = True
            name.focus()

        rename.on_click(edit)
        return [back, rename, name, away]

    def _rename(self, slot: int, name: str) -> None:
        """Give a held result a name; an empty one is that of its settings."""
        held = list(self._session.held)
        if slot < len(held):
            called = name.strip()[:LONGEST_NAME] or describe_differences(held[slot].result.experiment)
            held[slot] = held[slot]._replace(name=called)
        self._session.held = name_held(held, self._session.shows_sigmas)
        self._list()

    def _bring_back(self, held: Held) -> None:
        experiment = held.result.experiment
        if experiment.hidden != self._session.experiment.hidden:
            self._session.problem = "This result belongs to another lesson, whose settings are hidden."
            return
        try:
            self._session.accept(experiment.copy(), held.result)
        except SettingError as error:
            self._session.problem = str(error)

    def _remove(self, held: Held) -> None:
        left = [one for one in self._session.held if one is not held]
        self._session.held = name_held(left, self._session.shows_sigmas)


def name_held(held: Sequence[Held], sigmas: bool) -> tuple[Held, ...]:
    """Return held results with their names, which tell them apart, unless a person has named them."""
    together = [one.result.experiment for one in held]
    return tuple(
        one
        if is_renamed(one.result.experiment, one.name)
        else one._replace(name=describe_differences(one.result.experiment, sigmas, together))
        for one in held
    )


def describe_differences(
    experiment: Experiment, sigmas: bool = False, together: Sequence[Experiment] = ()
) -> str:
    """Return what differs from the defaults in some settings, in a few words, as their fields show it.

    What all of the experiments in ``together`` share comes last, since it does not tell them apart.

    >>> name_of(Experiment().update({"navigator": {"q_scale": 0.1}}))
    'Q scale 0.1'
    >>> name_of(Experiment().update({"sensors.gps.position_variance": 0.49}), sigmas=True)
    'Position σ 0.7'
    """
    shared = set.intersection(*(set(parse_qsl(query(one))) for one in together or (experiment,)))
    changed = sorted(parse_qsl(query(experiment)), key=shared.__contains__)
    words = [_describe_setting(path, value, sigmas) for path, value in changed[:NAMED]]
    more = [f"{len(changed) - NAMED} more"] if len(changed) > NAMED else []
    return ", ".join(words + more) or AS_DELIVERED


def _describe_setting(path: str, text: str, sigmas: bool) -> str:
    value = seen_value(path, text, sigmas)
    if path == "mission":
        return value
    label = seen_label(path, sigmas)
    return f"{label} {value}" if len(value) <= LONGEST else f"{label} changed"


def is_renamed(experiment: Experiment, name: str) -> bool:
    """Return whether a person gave a held result its name."""
    changed = parse_qsl(query(experiment))
    words = {_describe_setting(path, value, sigmas) for path, value in changed for sigmas in (False, True)}
    first, count = _MORE.sub("", name), min(NAMED, len(changed))
    return first not in map(", ".join, permutations(words, count)) and name != AS_DELIVERED
