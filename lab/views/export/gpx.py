"""GPX 1.1: the true path, the estimated path and the GPS fixes as tracks, for GIS programs and maps.

Flights have no date: their time counts from the start of the year 2000.

References
----------
Topografix, *GPX 1.1 Schema*, https://www.topografix.com/GPX/1/1
"""

from __future__ import annotations

import numpy as np

from lab.views.export.tracks import Track, Tracks, xml

STEP = 0.1
"""Shortest time between two points [s]."""
START = np.datetime64("2000-01-01T00:00:00", "ms")
"""What time 0 is called."""

_POINT = '   <trkpt lat="%.9f" lon="%.9f"><ele>%.4f</ele><time>%sZ</time></trkpt>\n'


def text(tracks: Tracks) -> str:
    """Return a GPX document."""
    origin = f'<origin xmlns="urn:ins-lab">{tracks.origin}</origin>' if tracks.origin else ""
    words = f"{tracks.description}\nTime 0 of the flight is {START} here, as it has no date."
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<gpx version="1.1" creator="INS Lab" xmlns="http://www.topografix.com/GPX/1/1">\n'
        f" <metadata><name>{xml(tracks.title)}</name><desc>{xml(words)}</desc>"
        f"{f'<extensions>{origin}</extensions>' if origin else ''}</metadata>\n"
        f"{''.join(_track(one) for one in tracks.known)}</gpx>\n"
    )


def _track(track: Track) -> str:
    shown = track.every(STEP)
    stamps = np.datetime_as_string(START + np.rint(1000 * shown.time).astype("timedelta64[ms]"))
    rows = zip(shown.position.tolist(), stamps.tolist(), strict=True)
    points = "".join(_POINT % (*place, stamp) for place, stamp in rows)
    return f" <trk>\n  <name>{xml(track.name)}</name>\n  <trkseg>\n{points}  </trkseg>\n </trk>\n"
