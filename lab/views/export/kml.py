"""KML 2.2: the true path, the estimated path and the GPS fixes for Google Earth.

Lines are drawn at their height (absolute). Long ones are thinned, as Google Earth shows ten thousand points
well; the file names the omitted parts.

References
----------
OGC 07-147r2, *KML* 2.2, https://www.ogc.org/standard/kml/
"""

from __future__ import annotations

from lab.views.export.tracks import Track, Tracks, xml

MAX_POINTS = 10_000
"""Most points of a line."""
MAX_FIXES = 2000
"""Most fixes that are shown."""

_STYLES = {"true": ("ff3fb43f", 3), "estimated": ("ff1f6fff", 2)}
"""Colour (opacity, blue, green, red) and width of a line [px]."""
_DOT = "http://maps.google.com/mapfiles/kml/shapes/shaded_dot.png"


def text(tracks: Tracks) -> str:
    """Return a KML document."""
    marks = []
    for track, style in ((tracks.true, "true"), (tracks.estimated, "estimated")):
        if track is not None:
            marks.append(_line(track, style))
    if tracks.fixes is not None:
        marks.append(_points(tracks.fixes))
    styles = "".join(
        f'  <Style id="{name}"><LineStyle><color>{colour}</color><width>{width}</width></LineStyle></Style>\n'
        for name, (colour, width) in _STYLES.items()
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2">\n <Document>\n'
        f"  <name>{xml(_strip_tags(tracks.title))}</name>\n  <open>1</open>\n"
        f"  <description>{xml(_strip_tags(tracks.description))}</description>\n{styles}"
        '  <Style id="fixes"><IconStyle><color>ff00d7ff</color><scale>0.4</scale>'
        f"<Icon><href>{_DOT}</href></Icon></IconStyle><LabelStyle><scale>0</scale></LabelStyle></Style>\n"
        f"{_origin(tracks)}{''.join(marks)} </Document>\n</kml>\n"
    )


def _origin(tracks: Tracks) -> str:
    """Return what made the file; Google Earth shows nothing of what is in a namespace of its own."""
    if not tracks.origin:
        return ""
    return (
        f'  <ExtendedData xmlns:lab="urn:ins-lab"><lab:origin>{tracks.origin}</lab:origin></ExtendedData>\n'
    )


def _strip_tags(text: str) -> str:
    """Return text without the signs of tags: Google Earth takes names and descriptions for HTML."""
    return text.translate({ord("<"): "‹", ord(">"): "›"})


def _line(track: Track, style: str) -> str:
    shown = track.thinned(MAX_POINTS)
    return (
        f"  <Placemark>\n   <name>{xml(track.name)}</name>\n"
        f"   <description>{xml(_describe_track(track, shown))}</description>\n   "
        f"<styleUrl>#{style}</styleUrl>\n"
        "   <LineString>\n    <altitudeMode>absolute</altitudeMode>\n"
        f"    <coordinates>\n{_coordinates(shown)}    </coordinates>\n   </LineString>\n  </Placemark>\n"
    )


def _points(track: Track) -> str:
    step = -(-len(track.time) // MAX_FIXES)
    shown = Track(track.name, track.time[::step], track.position[::step])
    points = "".join(
        f"    <Point><altitudeMode>absolute</altitudeMode><coordinates>{place}</coordinates></Point>\n"
        for place in _coordinates(shown).split()
    )
    return (
        f"  <Placemark>\n   <name>{xml(track.name)}</name>\n"
        f"   <description>{xml(_describe_track(track, shown))}</description>\n   "
        "<styleUrl>#fixes</styleUrl>\n"
        f"   <MultiGeometry>\n{points}   </MultiGeometry>\n  </Placemark>\n"
    )


def _describe_track(track: Track, shown: Track) -> str:
    low, high = track.position[:, 2].min(), track.position[:, 2].max()
    words = f"{track.time[0]:.1f} to {track.time[-1]:.1f} s, {low:.1f} to {high:.1f} m above the ellipsoid"
    if len(shown.time) < len(track.time):
        words += f"; {len(shown.time)} of {len(track.time)} points are shown"
    return f"{words}."


def _coordinates(track: Track) -> str:
    """Return longitude, latitude [°] and height [m], to 0.1 mm, a point a line."""
    rows = track.position[:, (1, 0, 2)].tolist()
    return "".join(f"{longitude:.9f},{latitude:.9f},{height:.4f}\n" for longitude, latitude, height in rows)
