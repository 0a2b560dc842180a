"""Numbers: the part of the page *Sensors* that finds which noise of an IMU goes into a filter."""

from __future__ import annotations

import io
from dataclasses import replace
from functools import partial
from html import escape
from pathlib import Path

import panel as pn
import panel_material_ui as pmui

from dashboards.exchange import Download
from dashboards.mission_titles import mission_titles
from dashboards.pages.base import OwnPage
from dashboards.pages.missions.job import Job
from dashboards.pages.summary import TABLE_STYLE
from dashboards.style import plain_column, wide_html
from dashboards.upload import MAX_BYTES, Upload, without_folder
from lab.base.files.mission_error import MissionError
from lab.base.progress import Progress
from lab.experiment.filter_programs import PROGRAMS, lines
from lab.experiment.imu_numbers import numbers
from lab.experiment.number_table import HEADS, UNKNOWN, ImuNumbers
from lab.missions import LogMission, missions
from lab.views.ensemble_cards import scroll_box
from lab.views.figures import TimeAxis

OWN_REST = "The longest rest of the drive"
NO_DRIVE = "No drive"
WORDS = (
    "<p>This page finds the noise that a filter should assume. A log at rest shows the noise of the IMU; a "
    "log of a drive with a GPS receiver shows what the filter needs in the vehicle. Each number has its 95 % "
    "interval; the factor between the two has its cause. Choose logs among the missions, or files of up to "
    f"{MAX_BYTES // 2**20} MB.</p>"
)
_STYLE = """
table { margin-bottom: 12px; }
@media (max-width: 600px) { th, td:not(.words) { white-space: normal; } }
pre { font: 12.5px/1.5 "Roboto Mono", ui-monospace, monospace; padding: 10px 12px; margin: 6px 0;
      border: 1px solid rgba(128,128,128,.3); border-radius: 6px; white-space: pre-wrap;
      overflow-wrap: anywhere; }
"""


class Numbers(OwnPage):
    """Takes a log at rest and one of a drive, and shows the numbers."""

    title = "Numbers"
    contents = "the form for a log at rest and one of a drive"

    def __init__(self, axis: TimeAxis, _session: object = None) -> None:
        self._files: dict[str, Path] = {}
        self._found: ImuNumbers | None = None
        self._lines = ""
        super().__init__(axis)

    def make(self) -> pn.viewable.Viewable:
        """Return the choices, the button and the places of the numbers and the lines."""
        field = {"size": "small", "variant": "outlined", "margin": (8, 8), "width": 270}
        self._still = pmui.Select(label="At rest", **field)
        self._drive = pmui.Select(label="In motion", **field)
        self.job = Job(closeable=True)
        self._uploads = {
            name: Upload(
                partial(self._arrived, name),
                self.job.say,
                most=1,
                label=label,
                variant="outlined",
                size="small",
                margin=(10, 8),
            )
            for name, label in (("still", "My log at rest"), ("drive", "My log of a drive"))
        }
        self._button = pmui.Button(
            label="Find the numbers", variant="contained", size="small", margin=(10, 8)
        )
        self._button.on_click(lambda _event: self.start())
        self._program = pmui.Select(
            label="Lines for", options=list(PROGRAMS), value=next(iter(PROGRAMS)), visible=False, **field
        )
        self._program.param.watch(lambda _event: self._show_lines(), "value")
        self._download = Download(
            callback=lambda: io.BytesIO(self._lines.encode()), filename="noise.txt",
            label="Download the lines", visible=False, size="small", variant="outlined", margin=(10, 8),
        )  # fmt: skip
        self.words = wide_html(WORDS, margin=(4, 20), stylesheets=[TABLE_STYLE, _STYLE])
        self.pasted = wide_html(margin=(0, 20), stylesheets=[TABLE_STYLE, _STYLE], visible=False)
        self._offer()
        return plain_column(
            pn.FlexBox(self._still, self._uploads["still"], margin=(8, 8, 0, 8), align_items="center"),
            pn.FlexBox(
                self._drive, self._uploads["drive"], self._button, margin=(0, 8), align_items="center"
            ),
            plain_column(self.job.view, margin=(0, 16)),
            self.words,
            pn.FlexBox(self._program, self._download, margin=(0, 12), align_items="center"),
            self.pasted,
        )

    def appear(self) -> None:
        """Offer the logs that there are now."""
        self._offer()

    def close(self) -> None:
        """End the work, and delete the files."""
        self.job.close()
        for upload in self._uploads.values():
            upload.delete()

    def start(self) -> None:
        """Find the numbers of the chosen logs."""
        still, drive = str(self._still.value), str(self._drive.value)
        if drive == NO_DRIVE and still == OWN_REST:
            self.job.say("Choose a log: one at rest, one of a drive, or both.")
            return
        self.job.start("Reading the logs", lambda progress: self._numbers(still, drive, progress), self._show)

    def _offer(self) -> None:
        """Offer the logs among the missions, and the files that have arrived."""
        found = {name: one for name, one in missions().items() if isinstance(one, LogMission)}
        titles = mission_titles(found)
        for select, first, name in ((self._still, OWN_REST, "still"), (self._drive, NO_DRIVE, "drive")):
            options = {first: first, **titles}
            if name in self._files:
                options = {f"My file {self._files[name].name}": name, **options}
            if select.options != options:
                kept = select.value if select.value in options.values() else first
                select.param.update(options=options, value=kept)

    def _arrived(self, name: str, paths: list[Path]) -> None:
        path = self._files[name] = paths[0]
        self._offer()
        (self._still if name == "still" else self._drive).value = name
        self.job.say(f"{path.name} is here. Press Find the numbers when both logs are chosen.", "info")

    def _numbers(self, still: str, drive: str, progress: Progress) -> ImuNumbers:
        """Return the numbers; called in a thread. A browser may send names that it was not offered."""
        try:
            found = numbers(self._static(still), self._moving(drive), progress)
            rows = [
                replace(row, basis=self._seen(row.basis), cause=self._seen(row.cause)) for row in found.rows
            ]
            remarks = tuple(self._seen(remark) for remark in found.remarks)
            return replace(found, static=self._seen(found.static), rows=tuple(rows), remarks=remarks)
        except (MissionError, ValueError) as error:
            raise MissionError(self._seen(str(error))) from error

    def _static(self, still: str) -> Path | None:
        if still == OWN_REST:
            return None
        if still == "still" and "still" in self._files:
            return self._files["still"]
        return self._log(still).recording_path

    def _moving(self, drive: str) -> str | Path | None:
        if drive == NO_DRIVE:
            return None
        if drive == "drive" and "drive" in self._files:
            return self._files["drive"]
        return self._log(drive).name

    @staticmethod
    def _log(name: str) -> LogMission:
        found = missions().get(name)
        if not isinstance(found, LogMission):
            raise MissionError(f"{name}: is not a log among the missions")
        return found

    def _seen(self, text: str) -> str:
        """Return a text with the names of files in place of where they are, which no visitor is told."""
        for name, one in missions().items():
            if isinstance(one, LogMission):
                text = text.replace(str(one.recording_path), name)
        return without_folder(text)

    def _show(self, found: ImuNumbers) -> None:
        self._found = found
        self.words.object = numbers_html(found)
        self._show_lines()

    def _show_lines(self) -> None:
        program = self._program.value
        if self._found is None or program not in PROGRAMS:
            return
        self._lines = lines(self._found, program)
        self._download.param.update(filename=f"{program}_noise.txt", visible=True)
        self._program.visible = self.pasted.visible = True
        self.pasted.object = f"<pre>{escape(self._lines)}</pre>"


def numbers_html(found: ImuNumbers) -> str:
    """Return the table of terms, what each number rests on, and the remarks."""
    heads = "".join(f"<th>{escape(head)}</th>" for head in ("", *HEADS[2:]))
    rows = "".join(
        f"<tr><td>{escape(triad)}, {escape(term)}</td>"
        + "".join(f"<td>{escape(cell)}</td>" for cell in cells)
        + "</tr>"
        for triad, term, *cells in found.cells
    )
    why = "".join(
        f"<li><b>{escape(row.triad)}, {escape(row.term)}</b>: {escape(row.basis)}. Cause of the factor: "
        f"{escape(row.cause)}</li>"
        for row in found.rows
    )
    remarks = "".join(f"<li>{escape(remark)}</li>" for remark in found.remarks)
    return (
        f"<p>At rest: {escape(found.static or UNKNOWN)}. In motion: {escape(found.moving or UNKNOWN)}. "
        f"Intervals are 95 % intervals.</p>{scroll_box(f'<table><tr>{heads}</tr>{rows}</table>', 'Numbers')}"
        f"<p>{escape(found.convention)}</p><ul>{why}{remarks}</ul>"
    )
