"""Sheet form: the numbers of a data sheet, typed or pasted, and the card that they make."""

from __future__ import annotations

import io
from html import escape
from typing import Any

import panel as pn
import panel_material_ui as pmui

from dashboards.exchange import Download
from dashboards.field_text import shown
from dashboards.pages.missions.entry_fields import layout_width
from dashboards.session import Session
from dashboards.style import whole_column, wide_html
from lab.base.parameters.setting_error import SettingError
from lab.missions import MissionError
from lab.missions.mission_name import accepted_name
from lab.sensors.cards import GRADES, Card
from lab.sensors.data_sheet import DataSheet, SheetNumber
from lab.sensors.suite import TRIADS, SensorSuite

MOST_LINES = 40
"""Most lines that are read: ten terms of two triads, twice."""
EXAMPLE = """gyro range = 2000 dps
gyro noise density = 3.8 mdps/sqrt(Hz)
gyro zero-rate offset = 0.5 dps
accelerometer noise = 1.2 mg rms in 100 Hz
accelerometer bias stability = 36 ug"""
WORDS = (
    "<h3>A card from a datasheet</h3><p>Write one number per line, in the words and units of the datasheet. "
    "Missing numbers are typical of the grade, or zero for <i>own</i>. A number far outside the range of all "
    "sensors is refused.</p>"
)


class SheetForm:
    """Makes a card of lines of text; the card is downloaded, or loaded into the session.

    Parameters
    ----------
    session
        Whose sensors are set.

    Attributes
    ----------
    view : panel.Column
        The fields, the buttons and the answer.
    card : Card or None
        The card that was made last.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self.card: Card | None = None
        field = {"size": "small", "variant": "outlined", "margin": (6, 8)}
        self._name = pmui.TextInput(
            label="Name of the sensor", value="my sensor", **field, **layout_width(190)
        )
        self._grade = pmui.Select(
            label="Grade", options=list(GRADES), value=GRADES[0], **field, **layout_width(150)
        )
        self._source = pmui.TextInput(label="Source: document and revision", **field, **layout_width(270))
        self._numbers = pmui.TextAreaInput(
            label="Numbers", value=EXAMPLE, rows=7, max_length=8000, sizing_mode="stretch_width", **field
        )
        self._button = pmui.Button(label="Make the card", size="small", variant="outlined", margin=(8, 8))
        self._button.on_click(lambda _event: self.make())
        self._load = pmui.Button(
            label="Load it", size="small", variant="outlined", margin=(8, 8), visible=False
        )
        self._load.on_click(lambda _event: self.load())
        self.download = Download(
            callback=lambda: io.BytesIO(b"" if self.card is None else self.card.to_toml().encode()),
            filename="card.toml", label="Card", visible=False, size="small", variant="outlined",
            margin=(8, 8),
        )  # fmt: skip
        self.answer = wide_html(margin=(0, 8))
        self.view = whole_column(
            wide_html(WORDS, margin=(8, 8, 0, 8)),
            pn.FlexBox(self._name, self._grade, self._source, margin=0, align_items="center"),
            self._numbers,
            pn.FlexBox(self._button, self._load, self.download, margin=0, align_items="center"),
            self.answer,
            margin=(8, 8),
        )

    def make(self) -> None:
        """Make the card of what is written, or say what is wrong with it."""
        self.card = None
        try:
            name = accepted_name(_typed(self._name).strip())
            sheet = DataSheet(name, "", str(self._grade.value), _typed(self._source))
            read = sheet.take_all(_lines(_typed(self._numbers)))
            self.card = sheet.card()
        except (SettingError, MissionError) as error:
            self.answer.object = f"<p>{escape(str(error))}</p>"
        else:
            self.answer.object = answer_html(self.card, read)
            self.download.param.update(filename=f"{name}.toml", label=f"Download {name}.toml")
        self._load.visible = self.download.visible = self.card is not None

    def load(self) -> None:
        """Give the session's experiment the sensors of the card, and the filter that suits them."""
        if self.card is not None:
            trial = self._session.experiment.copy()
            self.card.load(trial)
            self._session.accept(trial, called=f"Sensors: {self.card.name}")


def _typed(field: Any) -> str:
    """Return what a field holds, also while it is typed in."""
    return str(field.value_input or field.value or "")


def _lines(text: str) -> list[tuple[str, str]]:
    """Return triad and number of each line.

    Raises
    ------
    SettingError
        If there are too many lines, or one begins with no triad.
    """
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    if len(lines) > MOST_LINES:
        raise SettingError(f"there are {len(lines)} lines; accepted are up to {MOST_LINES}")
    found = []
    for line in lines:
        triad, _, rest = line.partition(" ")
        triad = triad.casefold().removesuffix("s")
        if triad not in TRIADS:
            raise SettingError(f"{line[:60]}: accepted are lines that begin with gyro or accelerometer")
        found.append((triad, rest))
    return found


def answer_html(card: Card, read: list[SheetNumber]) -> str:
    """Return what was read otherwise than it stands, what is assumed and what is missing."""
    items = [
        f"read as {shown(one.datum.value)} {one.datum.unit}: {one.reading}" for one in read if one.reading
    ]
    groups = SensorSuite().groups()
    for triad, data in card.assumed.items():
        labels = [groups[triad].param[name].label for name in data]
        items.append(f"{triad}, assumed: {'; '.join(labels)}")
    items += [
        f"{triad}, missing and off: {'; '.join(labels)}" for triad, labels in card.missing().items() if labels
    ]
    given = sum(map(len, card.terms.values()))
    rows = "".join(f"<li>{escape(item)}</li>" for item in items)
    return f"<p>{escape(card.name)}: {given} numbers of the sheet.</p><ul>{rows}</ul>"
