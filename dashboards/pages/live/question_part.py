"""Question part: what a source does not say, asked of a person: the unit of rates, and what columns are."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from html import escape
from typing import Any

import panel_material_ui as pmui

from dashboards.notice import Notice
from dashboards.pages.live.watched import PartOfWatched, Watched
from dashboards.pages.missions.entry_fields import fields_row, layout_width
from dashboards.style import plain_column, wide_html
from lab.data.protocols.column_guess import cells_to_name
from lab.data.protocols.column_map import IGNORED, QUANTITIES, ColumnMapError
from lab.data.streams.source_status import Status

UNITS = {
    "time": ("s", "ms", "µs", "ns", "clock"),
    "rate": ("°/s", "rad/s", "°/s/131", "°/s/65.5", "°/s/32.8", "°/s/16.4"),
    "force": ("m/s²", "g", "mg", "g/16384", "g/8192", "g/4096", "g/2048"),
    "magnetic": ("µT", "G", "mG"),
}
"""Units that are offered for a quantity with several; any other is written as `columns` of the source."""
OTHERS_QUESTION = "In a class, only the person who opened a source and the teacher may answer."
"""Said to others who watch."""
NO_READING: Mapping[str, str] = {}
"""Nothing contradicts the columns."""
_SMALL: dict[str, Any] = {"size": "small", "variant": "outlined", "margin": (3, 4)}
_OFFERED = (
    IGNORED,
    *(
        f"{quantity}[{unit}]"
        for quantity in QUANTITIES
        for unit in UNITS.get(quantity.rpartition("_")[0] or quantity, ())
    ),
)
"""What a column may be chosen to be."""


class QuestionPart(PartOfWatched):
    """The question about a unit with its buttons, and the chooser of columns.

    Attributes
    ----------
    view : panel.Column
        Both; hidden while nothing is asked.
    notice : Notice
        The question, in amber.
    buttons : panel.Row
        A button for each unit, or one for columns that the samples bear out.
    chooser : panel.Column
        The last lines, a choice for each column, and the command that says the same.

    Parameters
    ----------
    answered
        Is called with the option of the source that says the same as a person, such as ``unit=rate=°/s``.
    """

    def __init__(self, answered: Callable[[str, str], None]) -> None:
        self._answered = answered
        self._units: tuple[str, ...] = ()
        self._reading: dict[str, str] = {}
        self._count = 0
        self.notice = Notice()
        self.buttons = fields_row(visible=False)
        self._lines = wide_html(margin=(4, 10))
        self._choices = fields_row()
        self._use = pmui.Button(label="Use these columns", icon="check", color="primary", margin=(6, 8))
        self._use.on_click(lambda _event: self._name(self.said))
        self._command = wide_html(margin=(2, 10))
        self.chooser = plain_column(self._lines, self._choices, self._use, self._command, visible=False)
        self.view = plain_column(self.notice.view, self.buttons, self.chooser)

    def watch(self, watched: Watched | None) -> None:
        """Ask about another source, or none."""
        self._watched = watched
        self._ask((), 0, "")

    def tell(self, status: Status) -> None:
        """Ask what the source does not say now, and nothing else."""
        lines = status.last_lines if not status.samples else ()
        # Lines of other lengths between them must not take away what is chosen.
        count = (self._count or len(cells_to_name(lines))) if lines else 0
        question = ""
        if status.doubt:
            used, *others = status.doubt
            question = (
                f"The unit of the angular rates is unknown. {used} is used, and {' or '.join(others)} is "
                "possible. Choose one, or tilt the device by 20°, which shows it."
            )
        elif count:
            question = "The columns of these lines are not recognised. Say what they are."
        reading = dict(status.reading)
        if reading:
            question = status.question
        if (status.doubt, count, reading) != (self._units, self._count, self._reading):
            self._ask(status.doubt, count, question, reading)
        if count:
            shown = "\n".join(escape(line) for line in lines)
            self._lines.object = f"<pre style='margin:2px 0;overflow-x:auto'>{shown}</pre>"

    def _ask(
        self, units: tuple[str, ...], count: int, question: str, reading: Mapping[str, str] = NO_READING
    ) -> None:
        self._units, self._count, self._reading = units, count, dict(reading)
        self.notice.say(question, "warning")
        self.buttons[:] = [self._button(f"They are in {unit}", partial(self._answer, unit)) for unit in units]
        if reading:
            self.buttons[:] = [self._button("Read them so", partial(self._name, self._reading))]
        self.buttons.visible = bool(len(self.buttons))
        self.chooser.visible = bool(count) and not units
        self._choices[:] = [self._choice(number) for number in range(1, count + 1)]
        self._show_command()

    @staticmethod
    def _button(label: str, act: Callable[[], None]) -> Any:
        button = pmui.Button(label=label, **_SMALL)
        button.on_click(lambda _event: act())
        return button

    def _choice(self, number: int) -> Any:
        choice = pmui.Select(
            label=f"Column {number}", options=list(_OFFERED), value=IGNORED, **_SMALL, **layout_width(150)
        )
        choice.param.watch(lambda _event: self._show_command(), "value")
        return choice

    @property
    def said(self) -> dict[str, str]:
        """What is chosen for the columns, by their numbers."""
        # A hand-made message may contain any value.
        return {
            str(number): str(choice.value)
            for number, choice in enumerate(self._choices, 1)
            if choice.value in _OFFERED and choice.value != IGNORED
        }

    def _show_command(self) -> None:
        options = " ".join(f"--column '{number}={text}'" for number, text in self.said.items())
        self._command.object = (
            f"<p>On the command line: <code>{escape(options, quote=False)}</code></p>" if options else ""
        )

    def _may_answer(self) -> bool:
        if self._watched is not None and self._watched.may_change:
            return True
        self.notice.say(OTHERS_QUESTION, "warning")
        return False

    def _answer(self, unit: str) -> None:
        """Set the unit of the source, for all who watch it."""
        station = self._station
        if station is None or not self._may_answer():
            return
        try:
            station.source.answer(unit)
        except ColumnMapError as error:  # the device was lost meanwhile
            self.notice.say(str(error))
            return
        self._answered("unit", f"rate={unit}")
        self._ask((), 0, "")

    def _name(self, said: Mapping[str, str]) -> None:
        """Set the columns of the source, for all who watch it."""
        station = self._station
        if station is None or not self._may_answer():
            return
        try:
            station.source.name_columns(said)
        except ColumnMapError as error:
            self.notice.say(f"{error}.", "warning")
            return
        self._answered("column", ";".join(f"{number}={text}" for number, text in said.items()))
