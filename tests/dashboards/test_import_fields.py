"""Test the field of an import that says what the columns of a table are."""

from __future__ import annotations

from pathlib import Path

import pytest
from bokeh.document import Document
from writers.nmea import sentence

from dashboards.pages.missions.draft import Draft
from dashboards.pages.missions.import_fields import ColumnField
from dashboards.session import Session
from lab.data.formats import read_raw
from lab.missions import MissionError


def field_of(*names: str) -> tuple[ColumnField, list[str]]:
    """Return the field that is offered for files, and what it refused or "changed"."""
    told: list[str] = []
    made = ColumnField(lambda: told.append("changed"), told.append)
    made.offer(names)
    return made, told


def test_lines_are_quantities_units_and_axes() -> None:
    columns, told = field_of("flight.csv")
    columns._text.value = "A1 = force_x[g]\nspeed=km/h\n\naxes = y, x,-z"
    assert columns.columns == {"A1": "force_x[g]", "speed": "km/h"}
    assert columns.axes == ("y", "x", "-z")
    columns._text.value = "A1 force_x[g]"
    assert told == ["changed", "A1 force_x[g]: accepted is HEADING = QUANTITY[UNIT], such as A1 = force_x[g]"]


def test_a_refusal_that_names_an_option_names_the_field(tmp_path: Path) -> None:
    table = tmp_path / "table.csv"
    table.write_text("a,b,c,d\n" + "1,45.1,-73.2,100\n" * 9, encoding="utf-8")
    with pytest.raises(MissionError, match="--column") as refused:
        read_raw([table])
    message = str(refused.value)
    columns, _ = field_of(table.name)
    assert columns.located(message) == (
        f"{message}. Here, the field 'Columns of a csv' takes it: HEADING = QUANTITY[UNIT], "
        "HEADING = UNIT or axes = X,Y,Z, one in a line."
    )
    assert ".." not in columns.located(f"{message}.")
    assert columns.located("table.csv: it is empty") == "table.csv: it is empty"
    hidden, _ = field_of("track.gpx")
    assert hidden.located(message) == message


def test_a_track_that_a_setting_refuses_comes_with_that_setting(tmp_path: Path) -> None:
    path = tmp_path / "reckoned.nmea"
    place = "{:09.4f},N,01131.000,E,6,00,0.9,545.4,M,46.9,M,,"
    lines = (f"GPGGA,1200{i:02d}.00," + place.format(4800 + 0.0054 * i) for i in range(40))
    path.write_text("".join(map(sentence, lines)), encoding="ascii")
    draft = Draft(Session(Document()))
    draft._job.start = lambda _words, work, done: done(work(lambda *_: None))  # type: ignore[method-assign]
    draft.read([path])
    assert "0 of 40 positions are measured" in draft._verdict._words.object
    assert (draft._fields.view.visible, draft._add.visible) == (True, False)
    draft._settings.param.update(vehicle="car", positions="all")
    draft._rebuild()
    assert (draft._fields.view.visible, draft._add.visible) == (True, True)
