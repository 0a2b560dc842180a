"""Library: the part of the page that shows all missions, chooses one, and manages the user's own."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from typing import Any

import panel as pn
import panel_material_ui as pmui

from dashboards.computing import LONG, LatestWins, Outcome, attempt
from dashboards.notice import Notice
from dashboards.pages.missions.cards import MissionCards, Question, all_cards, drawings
from dashboards.pages.missions.dialog import Act, Dialog, fill
from dashboards.sending import soon, together
from dashboards.session import Session
from dashboards.style import plain_column, wide_html
from dashboards.visitors import may_edit
from lab.base.progress import Progress
from lab.experiment.experiment import Experiment
from lab.missions import MissionError, describe_mission, missions, rename_mission
from lab.missions.library import user_place

FIELD: dict[str, Any] = {
    "size": "small",
    "variant": "outlined",
    "sizing_mode": "stretch_width",
    "margin": (8, 4),
}


class Library:
    """All missions, with a filter, and the dialogs to change and to delete one.

    Parameters
    ----------
    session
        Whose mission is chosen.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._document = pn.state.curdoc
        self._work: LatestWins[str] = LatestWins(self._list, self._listed, LONG)
        self._drawing: LatestWins[Question] = LatestWins(self._draw, self._drawn, LONG)
        self._cards = MissionCards(
            self._act, self._drawing.submit, sizing_mode="stretch_width", margin=(4, 2)
        )
        self._filter = pmui.TextInput(
            label="Filter", placeholder="words of title, origin, tags …", **FIELD | {"max_width": 420}
        )
        self._filter.param.watch(lambda event: self._cards.param.update(filter=event.new), "value_input")
        self._may_edit = may_edit()
        self._changing = Dialog("Edit mission", "Save", self._change)
        self._name = pmui.TextInput(label="Name", **FIELD)
        self._title = pmui.TextInput(label="Title", **FIELD)
        self._words = pmui.TextAreaInput(label="Description", rows=3, auto_grow=True, max_rows=8, **FIELD)
        self._tags = pmui.TextInput(label="Tags, with commas between", **FIELD)
        self._changing.body[:] = [self._name, self._title, self._words, self._tags]
        self._deleting = Dialog("Delete mission?", "Delete", self._delete, color="error")
        self._what = wide_html(margin=(4, 8))
        self._deleting.body[:] = [self._what]
        self._about = ""
        self._message = Notice(closeable=True)
        self._gone = ""
        self._back = pmui.Button(
            label="Undo: bring it back", icon="undo", size="small", variant="outlined", visible=False
        )
        self._back.on_click(lambda _event: self._bring_back())
        # Without dialogs in the page, a hand-made message has no button to press.
        dialogs = [self._changing.view, self._deleting.view] if self._may_edit else []
        self.view = plain_column(self._message.view, self._back, self._filter, self._cards, *dialogs)
        session.on_library(self._changed)

    def refresh(self) -> None:
        """Mark the chosen mission."""
        self._cards.chosen = self._session.experiment.mission

    def _changed(self) -> None:
        """List the current missions."""
        self.refresh()
        self._work.submit(self._cards.chosen)

    def _say(self, text: str) -> None:
        self._message.say(text, "success")

    def close(self) -> None:
        """End the work, and show no more."""
        self._work.close()
        self._drawing.close()
        self._changing.close()
        self._deleting.close()

    def _list(self, _chosen: str, _progress: Progress) -> Outcome:
        return attempt(lambda: all_cards(self._may_edit))

    def _listed(self, _chosen: str, outcome: Outcome) -> None:
        self._later(lambda: self._show(outcome))

    def _show(self, outcome: Outcome) -> None:
        if outcome.problem:
            self._message.say(outcome.problem, "error")
        else:
            self._cards.missions = outcome.result

    def _draw(self, question: Question, _progress: Progress) -> Outcome:
        return attempt(lambda: drawings(question.names))

    def _drawn(self, question: Question, outcome: Outcome) -> None:
        self._later(lambda: self._cards.answer(question, outcome.result or {}))

    def _later(self, show: Callable[[], None]) -> None:
        """Show something in the turn of this page, and send it as a whole."""
        document = self._document
        assert document is not None

        def turn() -> None:
            with together(document):
                show()

        soon(document, turn)

    def _act(self, what: str, name: str) -> None:
        if what == "ready":
            self._work.submit(self._cards.chosen)
        elif what == "choose":
            self._session.library_changed(name)
            self._session.go(None, None)
        elif what == "filter":
            fill(self._filter, name)
        elif what == "edit" and self._may_edit:
            self._open_changing(name)
        elif what == "delete" and self._may_edit:
            self._open_deleting(name)

    def _open_changing(self, name: str) -> None:
        mission = missions().get(name)
        if mission is None:
            self._changed()
            return
        self._about = name
        fill(self._name, name.removeprefix("user:"))
        fill(self._title, mission.title)
        fill(self._words, mission.description)
        fill(self._tags, ", ".join(mission.tags))
        self._changing.open()

    def _change(self) -> Act:
        name, new = self._about, self._name.value_input.strip()
        title, words = self._title.value_input, self._words.value_input
        tags = self._tags.value_input.split(",")

        def work(_progress: Progress) -> str:
            describe_mission(name, title=title, description=words, tags=tags)
            return name if new == name.removeprefix("user:") else rename_mission(name, new).name

        def done(named: str) -> None:
            if named != name:
                self._say(f"{name} is now called {named}.")
            was_chosen = self._session.experiment.mission == name
            self._session.library_changed(named if was_chosen else None)

        return Act(work, done)

    def _bring_back(self) -> None:
        """Bring the mission back that was deleted last."""
        self._back.visible = False
        try:
            if self._session.bring_back(self._gone):
                self._say(f"{self._gone} is there again.")
        except MissionError as error:
            self._message.say(str(error))

    def _open_deleting(self, name: str) -> None:
        try:
            place = user_place(name)
        except MissionError as error:
            self._say(str(error))
            return
        self._about = name
        self._what.object = (
            f"<p><b>{escape(name)}</b> and its recording will be deleted: {escape(str(place))}</p>"
        )
        self._deleting.open()

    def _delete(self) -> Act:
        name = self._about

        def done(_nothing: None) -> None:
            self._say(f"{name} was deleted.")
            self._back.visible, self._gone = True, name
            was_chosen = self._session.experiment.mission == name
            self._session.library_changed(Experiment().mission if was_chosen else None)

        return Act(lambda _progress: self._session.delete_mission(name), done)
