"""Test the field of an import that says what the columns of a table are."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bokeh.document import Document
from writers.nmea import sentence

from dashboards.pages.missions.draft import Draft, describe_fine_samples
from dashboards.pages.missions.import_fields import ColumnField
from dashboards.session import Session
from lab.data.files.profile import read_profile
from lab.data.formats import read_raw
from lab.data.sheets.profile_check import check_profile
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


def test_a_track_that_a_setting_refuses_comes_with_that_setting(draft: Draft, tmp_path: Path) -> None:
    path = tmp_path / "reckoned.nmea"
    place = "{:09.4f},N,01131.000,E,6,00,0.9,545.4,M,46.9,M,,"
    lines = (f"GPGGA,1200{i:02d}.00," + place.format(4800 + 0.0054 * i) for i in range(40))
    path.write_text("".join(map(sentence, lines)), encoding="ascii")
    draft.read([path])
    assert "0 of 40 positions are measured" in draft._verdict._words.object
    assert (draft._fields.view.visible, draft._add.visible) == (True, False)
    draft._settings.param.update(vehicle="car", positions="all")
    draft._rebuild()
    assert (draft._fields.view.visible, draft._add.visible) == (True, True)


def test_a_setting_that_a_report_advises_is_named_as_its_field(draft: Draft, tmp_path: Path) -> None:
    path = tmp_path / "walk.gpx"
    times = [f"2024-01-01T12:{t // 60:02d}:{t % 60:02d}Z" for t in (i + 30 * (i // 12) for i in range(48))]
    points = (
        f'<trkpt lat="{48 + 1e-5 * i}" lon="11"><ele>500</ele><time>{time}</time></trkpt>'
        for i, time in enumerate(times)
    )
    path.write_text(f"<gpx><trk><trkseg>{''.join(points)}</trkseg></trk></gpx>", encoding="utf-8")
    draft.read([path])
    for said in (draft._verdict._words.object, draft._report.object):
        assert "“Longest gap” = 31 keeps 100 % of the samples" in said
        assert "--set" not in said


def rest(path: Path, size: float) -> Path:
    """Write an IMU at rest and fixes in a table whose headings name no unit."""
    lines = ["t,gx,gy,gz,ax,ay,az,lat,lon,alt"]
    for i in range(3000):
        fix = f"45.5,-73.{i // 100:03d},30" if i % 100 == 0 else ",,"
        lines.append(f"{10 * i},0.01,{0.01 * (i % 2)},0,{0.001 * (i % 3)},0,{-size},{fix}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.fixture
def draft() -> Draft:
    made = Draft(Session(Document()))

    def start(_words: str, work: Callable[..., Any], done: Callable[..., None]) -> None:
        try:
            done(work(lambda *_: None))
        except MissionError as error:
            made._job.say(str(error))

    made._job.start = start  # type: ignore[method-assign]
    return made


def rows_of(draft: Draft) -> dict[str, dict[str, Any]]:
    return {one["heading"]: one for one in draft._table._table.columns}


def choose(draft: Draft, heading: str, **chosen: str) -> None:
    place = list(rows_of(draft)).index(heading)
    row = {name: rows_of(draft)[heading][name] for name in ("quantity", "axis", "unit")}
    draft._table._table.edits = {**draft._table._table.edits, str(place): {**row, **chosen}}


def test_guessed_columns_are_shown_corrected_and_undone(draft: Draft, tmp_path: Path) -> None:
    draft.read([rest(tmp_path / "imu.csv", 1.0)])
    assert draft._table.view.visible
    row = rows_of(draft)["az"]
    assert (row["quantity"], row["axis"], row["unit"], row["unsure"]) == ("force", "z", "g", True)
    choose(draft, "az", axis="-z")
    choose(draft, "gx", quantity="-")
    draft._table._applied()
    assert draft._columns.columns == {"az": "-force_z[g]", "gx": "-"}
    assert (rows_of(draft)["az"]["axis"], rows_of(draft)["az"]["evidence"]) == ("-z", "You said so.")
    assert not draft._table._back.disabled
    draft._columns.undo()
    assert draft._columns.columns == {}
    assert (rows_of(draft)["az"]["axis"], draft._table._back.disabled) == ("z", True)


def test_a_profile_is_kept_for_the_next_file_and_downloaded(draft: Draft, tmp_path: Path) -> None:
    draft.read([rest(tmp_path / "imu.csv", 1.0)])
    choose(draft, "alt", unit="ft")
    draft._table._name.value = "Mine"
    draft._table._keep()
    toml = tmp_path / "mine.toml"
    toml.write_bytes(draft._table._toml().getvalue())
    profile = read_profile(toml)
    check_profile(profile)
    assert (profile.name, profile.columns["alt"]) == ("Mine", "height[ft]")
    assert profile.columns["az"] == "force_z[g]"
    (tmp_path / "next").mkdir()
    draft.read([rest(tmp_path / "next" / "other.csv", 1.0)])
    assert draft._columns.columns["alt"] == "height[ft]"
    assert rows_of(draft)["alt"]["unit"] == "ft"
    assert "ft" in next(one for one in draft._raw.remarks if one.startswith("Heights"))
    draft.read([rest(tmp_path / "other.csv", 1.0)])
    draft._columns.undo()
    assert (draft._columns.columns, rows_of(draft)["alt"]["unit"]) == ({}, "m")


def test_a_table_of_which_nothing_is_known_is_shown_with_the_refusal(draft: Draft, tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text(
        "a,b,c,d\n" + "".join(f"{i},{45 + 1e-4 * i},-73.2,100\n" for i in range(60)), encoding="utf-8"
    )
    draft.read([path])
    assert draft._table.view.visible and not draft._body.visible
    for heading, quantity, unit in (
        ("a", "time", "s"),
        ("b", "latitude", "°"),
        ("c", "longitude", "°"),
        ("d", "height", "m"),
    ):
        choose(draft, heading, quantity=quantity, axis="+", unit=unit)
    draft._table._applied()
    assert draft._body.visible
    assert len(draft._raw.time) == 60


def test_a_flight_whose_columns_could_be_a_log_too_shows_them(draft: Draft, tmp_path: Path) -> None:
    """Of the IMU, the headings name no quantity, so only the path was read."""
    _, *lines = rest(tmp_path / "imu.csv", 9.8).read_text(encoding="utf-8").splitlines()
    path = tmp_path / "turning.csv"
    heading = "t_ms,p,q,r,Acc X,Acc Y,Acc Z,LAT,LON,H"
    path.write_text("\n".join([heading, *lines]), encoding="utf-8")
    draft.read([path])
    assert draft._body.visible and draft._read is not None and draft._read.log is None
    assert "As a sensor log it is refused" in draft._log_report.object
    assert draft._table.view.visible
    for axis, rate in zip("xyz", "pqr", strict=True):
        choose(draft, rate, quantity="rate", axis=axis, unit="rad/s")
        choose(draft, f"Acc {axis.upper()}", quantity="force", axis=axis, unit="m/s²")
    choose(draft, "H", quantity="height", axis="+", unit="m")
    draft._table._applied()
    assert draft._read.log is not None, draft._read.log_refused


def test_two_columns_said_to_be_the_same_are_named(draft: Draft, tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("a,b,c\n" + "".join(f"{i},{45 + 1e-4 * i},-73.2\n" for i in range(60)), encoding="utf-8")
    draft.read([path])
    choose(draft, "a", quantity="time", axis="+", unit="s")
    for heading in "bc":
        choose(draft, heading, quantity="latitude", axis="+", unit="°")
    draft._table._applied()
    assert "said to be latitude: b, c." in draft._table._said.object
    choose(draft, "c", quantity="longitude", axis="+", unit="°")
    draft._table._applied()
    assert draft._table._said.object == ""


@pytest.mark.parametrize(
    "edits",
    [{"x": {}}, {"99": {"quantity": "rate"}}, {"0": "rate"}, {"0": {"quantity": "wing"}},
     {"0": {"quantity": "force", "axis": "w"}}, {"0": {"quantity": "force", "axis": "x", "unit": "ft"}}],
)  # fmt: skip
def test_what_the_table_does_not_offer_is_no_answer(
    draft: Draft, tmp_path: Path, edits: dict[str, Any]
) -> None:
    draft.read([rest(tmp_path / "imu.csv", 1.0)])
    draft._table._table.edits = edits
    assert draft._table.answers() == {}


def test_samples_without_a_fault_are_counted() -> None:
    assert (
        describe_fine_samples(np.arange(1963) / 10) == "The file looks fine: 1,963 samples at 10 Hz, 196 s."
    )
