"""The preview shows the recorded samples beside the curve made of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from bokeh.models.renderers import GlyphRenderer
from bokeh.plotting import figure

from lab.data.rebuild.raw_flight import RawFlight
from lab.missions import mission
from lab.missions.flight_import import FlightImport, prepare_flight
from lab.views.import_preview import POINTS, import_preview


def read(**values: object) -> FlightImport:
    recording = mission("montreal").recording
    names = ("time", "latitude", "longitude", "height", "velocity_n", "euler")
    raw = RawFlight(format="a format", **{name: getattr(recording, name) for name in names})
    return prepare_flight(replace(raw, **values))


def figures(found: FlightImport) -> dict[str, figure]:
    return {one.title.text: one for one in import_preview(found).select({"type": figure})}


def glyphs(fig: figure, kind: str) -> list[GlyphRenderer]:
    return [
        one for one in fig.renderers if isinstance(one, GlyphRenderer) and type(one.glyph).__name__ == kind
    ]


def test_every_quantity_has_a_figure_with_samples_and_curve():
    found = figures(read())
    assert set(found) == {
        "Ground track", "Height [m]", "Speed over the Earth [m/s]", "Roll [°]", "Pitch [°]", "Heading [°]",
    }  # fmt: skip
    for fig in found.values():
        assert glyphs(fig, "Line")
        assert glyphs(fig, "Scatter")
        for glyph in glyphs(fig, "Line") + glyphs(fig, "Scatter"):
            assert all(len(column) <= 2 * POINTS for column in glyph.data_source.data.values())


def test_the_curve_is_the_recording_in_its_units():
    imported = read()
    line = glyphs(figures(imported)["Roll [°]"], "Line")[0].data_source.data
    roll = np.degrees(imported.recording.euler[:, 0])
    assert np.max(line["value"]) == np.max(roll)
    assert np.max(line["time"]) <= imported.recording.time[-1]


def test_a_reconstructed_attitude_is_called_so():
    titles = set(figures(read(euler=None)))
    assert {f"{name}, reconstructed [°]" for name in ("Roll", "Pitch", "Heading")} < titles
