"""Card maker: a card of sensors from their record at rest: its name, a button, and the file to download."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from typing import Any

import panel_material_ui as pmui

from dashboards.exchange import Download
from dashboards.pages.missions.entry_fields import fields_row, layout_width
from dashboards.pages.missions.job import Job
from lab.analysis import rest
from lab.base.progress import Progress
from lab.missions.mission_name import accepted_name
from lab.sensors.cards import Card


class CardMaker:
    """Makes a card of the record that is there when the button is pressed.

    Parameters
    ----------
    source
        Returns what the record is of, or None. A card that is ready when it returns another is dropped.
    records
        Returns the records of the triads of a source, and its name; called in a thread. A ValueError is told
        on the page.

    Attributes
    ----------
    view : panel.Row
        Name, button and download, after what its owner puts before them.
    job : Job
        Progress and outcome.
    card : Card or None
        The card that was made last of this source.
    """

    def __init__(
        self, source: Callable[[], Any], records: Callable[[Any], tuple[Mapping[str, rest.Record], str]]
    ) -> None:
        self._source, self._records = source, records
        self.card: Card | None = None
        self._name = pmui.TextInput(
            label="Name of the card", value="my sensor", size="small", variant="outlined", margin=(8, 4),
            **layout_width(190),
        )  # fmt: skip
        self.button = pmui.Button(label="Make a card of this", icon="badge", disabled=True, margin=(10, 4))
        self.button.on_click(lambda _event: self.start())
        self.download = Download(
            callback=self._file, filename="card.toml", label="Card", visible=False, size="small",
            variant="outlined", margin=(10, 4),
        )  # fmt: skip
        self.job = Job()
        self.view = fields_row(self._name, self.button, self.download)

    def forget(self) -> None:
        """Know nothing of the source before."""
        self.card = None
        self.download.visible, self.button.disabled = False, True
        self.job.say("")

    def start(self) -> None:
        """Fit the noise terms, and make the card."""
        source = self._source()
        if source is None or self.job.busy:
            return
        try:
            name = accepted_name(str(self._name.value_input or self._name.value).strip())
        except ValueError as error:
            self.job.say(str(error))
            return

        def work(_progress: Progress) -> Card:
            records, where = self._records(source)
            return rest.card_of(name, records, where)

        self.job.start("Fitting the noise terms", work, lambda card: self._made(source, card))

    def _made(self, source: object, card: Card) -> None:
        if source is not self._source():  # it has gone, or is another person's, meanwhile
            return
        self.card = card
        self.download.param.update(
            filename=f"{card.name}.toml", label=f"Download {card.name}.toml", visible=True
        )
        self.job.say(f"The card {card.name} is ready. {card.note}".rstrip(), "success")

    def _file(self) -> io.BytesIO:
        return io.BytesIO(b"" if self.card is None else self.card.to_toml().encode())

    def close(self) -> None:
        """Deliver no further card."""
        self.job.close()
