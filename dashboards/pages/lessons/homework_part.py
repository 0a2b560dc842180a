"""Homework part: the homework of the server and the button that opens a file, and the one that is open."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from html import escape
from pathlib import Path

import panel as pn
import panel_material_ui as pmui
from bokeh.document import Document

from dashboards.classroom import shelf
from dashboards.computing import LatestWins, Outcome, attempt
from dashboards.kept import Typed
from dashboards.notice import Notice
from dashboards.pages.lessons.homework_view import Answers, Doings, HomeworkView
from dashboards.pages.lessons.lesson_list import HEADING, ROW, SUMMARY, TITLE, WIDTH
from dashboards.sending import soon
from dashboards.session import Session
from dashboards.style import plain_row, whole_column
from dashboards.upload import Upload
from lab.base.parameters.setting_error import SettingError
from lab.classroom.homework.hand_in import HandInError, hand_in, hand_in_text
from lab.classroom.homework.homework import Homework
from lab.classroom.homework.homework_file import LARGEST, read_homework
from lab.classroom.homework.shelf import Shelved
from lab.experiment.experiment import Experiment

IS_OFF = (
    "The settings at the left are not those of the homework, because they were reset or loaded. Choose “Run "
    "with the settings at the left”, which takes those that you may change, or “Start again”."
)
SAVED = "The file is saved where your browser saves files. Hand it in as your teacher asked."


class HomeworkPart:
    """The homework of one page.

    Parameters
    ----------
    session
        The session, whose settings a homework sets.
    changed
        Called when a homework is opened or closed.

    Attributes
    ----------
    list_view : panel.Column
        The homework of the server, and the button that opens a file.
    open : Homework or None
        The homework that is open.
    """

    def __init__(self, session: Session, changed: Callable[[], None]) -> None:
        self._session, self._changed = session, changed
        self._document: Document | None = pn.state.curdoc
        self._shelf = shelf()
        self._seen = self._shelf.version
        self.open: Homework | None = session.homework
        self._view = HomeworkView(Doings(self._begin, self._take, self.close, self._hand_in, session.keep))
        self._reading: LatestWins[Path] = LatestWins(
            lambda path, _progress: attempt(lambda: read_homework(path)), self._deliver
        )
        self._upload = Upload(
            self._uploaded,
            self._report_refusal,
            most=1,
            largest=LARGEST,
            accept=".homework",
            label="Open a homework file",
            size="small",
            variant="outlined",
            margin=(4, 4),
            width=WIDTH,
        )
        self._problem = Notice()
        self.list_view = whole_column(margin=(4, 8))
        if self.open is not None:
            self._view.show(self.open)

    @property
    def view(self) -> pn.viewable.Viewable:
        """The view of the homework that is open."""
        return self._view.view

    @property
    def reminder(self) -> str:
        """Sentence for the other pages while a homework is open."""
        return "" if self.open is None else f"Homework “{self.open.title}”: it is among the Lessons."

    @property
    def typed(self) -> Typed | None:
        """What is typed into a homework of the server; None without one."""
        shared = self._session.homework
        if shared is None or shared is not self.open:
            return None
        return Typed(shared.name, *self._view.typed)

    def take_back(self, typed: Typed | None) -> None:
        """Type again what was typed into the homework that is open."""
        if typed is not None and self.open is not None and typed.homework == self.open.name:
            self._view.type_again(Answers(*typed[1:]))

    def show_list(self) -> None:
        """Show the homework of the server."""
        heading = pn.pane.HTML("<h2>Homework</h2>", margin=(0, 4), stylesheets=[HEADING])
        rows = [self._row(entry) for entry in self._shelf.entries]
        self.list_view[:] = [heading, *rows, self._upload, self._problem.view]

    def has_changed(self) -> bool:
        """Return whether the keys of the server have changed; a homework whose key is gone is closed."""
        self._shelf.refresh()
        if self._shelf.version == self._seen:
            return False
        self._seen = self._shelf.version
        shared = self._session.homework
        if shared is not None and self._shelf.find(shared.link) is None:
            self.close()
        return True

    def end(self) -> None:
        """End the part: read no more, and delete the uploaded file."""
        self._reading.close()
        self._upload.delete()

    def close(self) -> None:
        """Go back to the list."""
        self.open = self._session.homework = None
        self._changed()

    def _row(self, entry: Shelved) -> pn.viewable.Viewable:
        found = entry.homework
        button = pmui.Button(
            label=found.title if found else entry.file,
            icon="assignment",
            variant="text",
            margin=0,
            width=WIDTH,
            disabled=found is None,
            sx=TITLE,
        )
        if found is not None:
            button.on_click(lambda _event: self._open_homework(found, shared=True))
        words = f"{found.best:g} points" if found else f'<div class="problem">{escape(entry.problem)}</div>'
        about = pn.pane.HTML(f"<div>{words}</div>", margin=(0, 4), stylesheets=[SUMMARY])
        return plain_row(button, about, stylesheets=[ROW])

    def _open_homework(self, homework: Homework, *, shared: bool) -> None:
        """Open a homework; the name of one of the server is in the address from now on."""
        self.open = homework
        self._session.homework = homework if shared else None
        self._view.show(homework)
        self._changed()
        self._begin()

    def _begin(self) -> None:
        if self.open is not None:
            self._run(self.open.experiment, self.open.title)

    def _take(self) -> None:
        if self.open is not None:
            self._run(partial(self.open.taking, self._session.experiment), self.open.title)

    def _run(self, make: Callable[[], Experiment], title: str) -> None:
        try:
            self._session.accept(make(), called=title)
        except SettingError as error:
            self._view.say(str(error))
        else:
            self._view.say("")

    def _hand_in(self, given: Answers) -> bytes | None:
        homework, experiment = self.open, self._session.experiment
        if homework is None:
            return None
        if experiment.hidden != homework.scenario.key:
            self._view.say(IS_OFF)
            return None
        try:
            handed = hand_in(homework, given.name, experiment, given.faults, given.answers)
        except (HandInError, SettingError) as error:
            self._view.say(f"The hand-in {error}.")
            return None
        self._view.say(SAVED, "right")
        return hand_in_text(homework, handed).encode()

    def _uploaded(self, paths: list[Path]) -> None:
        self._problem.say("")
        self._reading.submit(paths[0])

    def _report_refusal(self, reason: str) -> None:
        self._problem.say(f"The homework is not accepted. {reason}")

    def _deliver(self, _path: Path, outcome: Outcome) -> None:
        if self._document is not None:
            soon(self._document, partial(self._arrive, outcome))

    def _arrive(self, outcome: Outcome) -> None:
        if outcome.problem:
            self._report_refusal(f"{outcome.problem}.")
        else:
            self._open_homework(outcome.result, shared=False)
