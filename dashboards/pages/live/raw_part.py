"""Raw part: the last frames or lines of a stream as they came, in hexadecimal and as text."""

from __future__ import annotations

from html import escape

from dashboards.pages.base import NARROW
from dashboards.pages.live.watched import LookingPart, Watched
from dashboards.style import wide_html
from lab.data.protocols.catalogue import last_frames
from lab.live.station import Station

FRAMES = 20
"""Frames or lines that are shown."""
LOOKED_AT = 2**14
"""Last bytes in which they are looked for: 20 frames of 800 bytes."""
LONGEST = 256
"""Bytes of a frame that are shown."""
_TEXT = bytes(byte if 32 <= byte < 127 else 0xB7 for byte in range(256))
"""Each byte as a letter of Latin-1; a raised dot stands for those that are none in ASCII."""
_STYLE = f"""
table {{ border-collapse: collapse; width: 100%; font: 12.5px/1.45 ui-monospace, monospace; }}
th {{ text-align: left; font-weight: 500; opacity: 0.7; padding: 2px 14px 2px 0; }}
td {{ vertical-align: top; padding: 3px 14px 3px 0; border-top: 1px solid rgba(128, 136, 149, 0.3);
     overflow-wrap: anywhere; white-space: pre-wrap; }}
td:nth-child(3) {{ word-break: break-all; }} .lines th:nth-child(3) {{ width: 55%; }}
td:first-child {{ text-align: right; opacity: 0.7; }}
p {{ margin: 2px 0 6px; }}
@container stage (max-width: {NARROW}px) {{
  th:nth-child(3), td:nth-child(3) {{ display: none; }}
  .lines th:nth-child(3), .lines td:nth-child(3) {{ display: table-cell; }}
  .lines th:nth-child(2), .lines td:nth-child(2) {{ display: none; }}
}}
"""


class RawPart(LookingPart):
    """The last frames of a source, newest first.

    Attributes
    ----------
    view : panel.pane.HTML
        The table.
    """

    def __init__(self) -> None:
        super().__init__()
        self.view = wide_html(margin=(4, 10), stylesheets=[_STYLE])
        self.watch(None)

    def watch(self, watched: Watched | None) -> None:
        """Show another source, or none; no byte of the one before stays."""
        self._watched = watched
        self.view.object = "<p>Connect a source to see its bytes.</p>" if watched is None else ""

    def look(self, station: Station) -> str:
        """Return the last frames as HTML."""
        source = station.source
        return raw_html(last_frames(source.status.protocol, source.latest_bytes(LOOKED_AT), FRAMES))

    def show(self, found: str) -> None:
        """Show them."""
        self.view.object = found


def raw_html(frames: list[bytes]) -> str:
    """Return frames as a table, newest first; what came from outside is text and never mark-up."""
    if not frames:
        return "<p>No byte has come yet.</p>"
    readable = all(frame.isascii() and frame.strip().decode("ascii").isprintable() for frame in frames)
    rows = "".join(
        f"<tr><td>{len(frame)}</td><td>{_cut_frame(frame[:LONGEST].hex(' '), frame)}</td>"
        f"<td>{_cut_frame(escape(frame[:LONGEST].translate(_TEXT).decode('latin-1')), frame)}</td></tr>"
        for frame in reversed(frames)
    )
    head = "<tr><th>Bytes</th><th>Hexadecimal</th><th>Text</th></tr>"
    kind = " class=lines" if readable else ""
    return f"<p>The last of what came, newest first.</p><table{kind}>{head}{rows}</table>"


def _cut_frame(shown: str, frame: bytes) -> str:
    return f"{shown} …" if len(frame) > LONGEST else shown
