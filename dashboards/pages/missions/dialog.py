"""Dialog: a question over the page with one act, which says in the dialog itself why it was refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import panel as pn
import panel_material_ui as pmui

from dashboards.notice import Notice
from lab.missions import MissionError


class Dialog:
    """A dialog with Cancel and one act.

    Parameters
    ----------
    title
        What is asked.
    word
        What the button of the act says.
    act
        Called when it is clicked. A `MissionError` is shown, and the dialog stays.
    color
        Colour of the button.

    Attributes
    ----------
    body : panel.Column
        What is above the buttons.
    """

    def __init__(self, title: str, word: str, act: Callable[[], None], color: str = "primary") -> None:
        self._act = act
        self.body = pn.Column(margin=0, sizing_mode="stretch_width")
        self._problem = Notice()
        cancel = pmui.Button(label="Cancel", variant="text", color="default", margin=(6, 4))
        cancel.on_click(lambda _event: self._close())
        button = pmui.Button(label=word, color=color, margin=(6, 4))
        button.on_click(lambda _event: self._try())
        self.view = pmui.Dialog(
            self.body,
            self._problem.view,
            pn.Row(cancel, button, align="end", margin=0),
            title=title,
            title_variant="h6",
            width_option="sm",
        )

    def open(self) -> None:
        """Ask."""
        self._problem.say("")
        self.view.open = True

    def _close(self) -> None:
        self.view.open = False

    def _try(self) -> None:
        try:
            self._act()
        except MissionError as error:
            self._problem.say(str(error))
        else:
            self._close()


def fill(field: Any, text: str) -> None:
    """Show a text in a text field; what is typed from then on is in its `value_input`."""
    field.param.update(value=text, value_input=text)
