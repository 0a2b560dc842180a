"""Importing: the part of the page that makes a mission of files of a simulator or logger."""

from __future__ import annotations

from dashboards.pages.missions.draft import Draft
from dashboards.session import Session
from dashboards.style import whole_column, wide_html
from dashboards.upload import MAX_BYTES, Upload
from lab.data.formats import READERS


class Importing:
    """Takes files, shows a report on the flight in them, and adds it.

    Parameters
    ----------
    session
        Session that then runs the mission.
    """

    def __init__(self, session: Session) -> None:
        self._draft = Draft(session)
        self._upload = Upload(
            self._draft.read,
            self._draft.say,
            label="Choose or drop the files of one flight",
            variant="outlined",
            margin=(8, 4),
            sizing_mode="stretch_width",
            sx={"borderStyle": "dashed", "padding": "22px"},
        )
        formats = ", ".join(reader.name for reader in READERS)
        note = wide_html(
            f"<p>The format is detected from the content, whatever the file name: {formats}. Up to "
            f"{MAX_BYTES // 2**20} MB.</p>",
            margin=(0, 6),
            styles={"opacity": "0.7", "font-size": "13px"},
        )
        self.view = whole_column(self._upload, note, self._draft.view)

    def refresh(self) -> None:
        """Do nothing: this part does not depend on the missions."""

    def close(self) -> None:
        """Delete the uploaded files."""
        self._draft.close()
        self._upload.delete()
