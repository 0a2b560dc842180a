"""Dialog: a question over the page with one action, done in a thread; the dialog itself shows a refusal."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import panel as pn
import panel_material_ui as pmui

from dashboards.computing import WRITING
from dashboards.pages.missions.job import Job
from dashboards.style import plain_column
from lab.base.progress import Progress


class Act(NamedTuple):
    """The action of a dialog.

    Attributes
    ----------
    work
        Called in a thread. A `MissionError` is shown, and the dialog stays open.
    done
        Called with the result of `work`, in the page's own thread, once the dialog is closed.
    """

    work: Callable[[Progress], Any]
    done: Callable[[Any], None]


class Dialog:
    """A dialog with Cancel and one action.

    Parameters
    ----------
    title
        The question.
    word
        Label of the button of the action.
    act
        Called when the button is clicked; returns the action.
    color
        Colour of the button.

    Attributes
    ----------
    body : panel.Column
        The content above the buttons.
    """

    def __init__(self, title: str, word: str, act: Callable[[], Act], color: str = "primary") -> None:
        self._act = act
        self.body = plain_column()
        self._job = Job(pool=WRITING)
        cancel = pmui.Button(label="Cancel", variant="text", color="default", margin=(6, 4))
        cancel.on_click(lambda _event: self._close())
        button = pmui.Button(label=word, color=color, margin=(6, 4))
        button.on_click(lambda _event: self._try_action())
        self.view = pmui.Dialog(
            self.body,
            self._job.view,
            pn.Row(cancel, button, align="end", margin=0),
            title=title,
            title_variant="h6",
            width_option="sm",
        )

    def open(self) -> None:
        """Ask."""
        self._job.say("")
        self.view.open = True

    def close(self) -> None:
        """Close the dialog, and start no further action."""
        self._job.close()

    def _close(self) -> None:
        self.view.open = False

    def _try_action(self) -> None:
        if self._job.busy:
            return
        act = self._act()

        def done(result: Any) -> None:
            self._close()
            act.done(result)

        self._job.start("Working", act.work, done)


def fill(field: Any, text: str) -> None:
    """Show a text in a text field; later typing changes its `value_input`."""
    field.param.update(value=text, value_input=text)
