"""The page of missions in a real browser: browse, choose, change and delete."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import pytest
from playwright.sync_api import Locator, Page, expect
from xplane_sender import XPlaneSender

from lab.data.protocols.catalogue import ENCODERS
from lab.flying.airports import runway
from lab.live.simulated.simulated_flight import SimulatedFlight
from lab.missions import FlightPlan, Recording, add_mission, mission, missions, write_flight_csv
from lab.missions.library import delete_mission
from tests.browser.conftest import PASSED, RANGE_END, show, wait_for

ADD = re.compile("^Simulate sensors on its path")
LAST_FIGURE = """[...Bokeh.index.query((view) => view.model.type === 'Figure')]
  .filter((view) => view.el.getClientRects().length && !view.model.title.text.includes("error"))
  .map((view) => view.el.getBoundingClientRect()).sort((a, b) => a.bottom - b.bottom).at(-1)"""
"""Place of the lowest figure of the preview; those of the tab are below the sheet."""

pytestmark = pytest.mark.browser


@pytest.fixture
def mine(own_missions: Path, shared_page: Page, request: pytest.FixtureRequest) -> Iterator[Path]:
    """Return the folder of the user's own missions, with one called mine in it; the library is open again."""
    recording = mission("los_angeles").recording
    add_mission(recording, "mine", title="My flight", tags=["rare"], origin="tests", overwrite=True)
    yield own_missions
    if request.node.stash.get(PASSED, False):
        missions_tab(shared_page)
    for path in own_missions.iterdir():
        if path.is_file():  # a folder has what a page may bring back until it closes
            path.unlink()


def part_of_montreal() -> Recording:
    """Return a piece of a turning climb."""
    whole = mission("montreal").recording
    return Recording(*(getattr(whole, field.name)[2000:2300] for field in fields(Recording)))


def missions_tab(page: Page, chosen: str = "") -> None:
    """Open the page of missions, and choose the mission with this title there."""
    show(page, "Missions")
    part(page, "Library")
    page.get_by_role("textbox", name="Filter").fill("")
    if chosen:
        page.get_by_role("button", name=f"Choose {chosen}").click()
        expect(chooser(page)).to_have_text(chosen)
        expect(page.get_by_role("button", name="Close Missions")).to_be_hidden()
        show(page, "Missions")


def card(page: Page, name: str) -> Locator:
    return page.locator(f"article[data-name='{name}']")


def chooser(page: Page) -> Locator:
    return page.get_by_role("combobox", name="Mission")


def test_missions_are_browsed_filtered_and_chosen(mine: Path, shared_page: Page) -> None:
    page = shared_page
    (mine / "broken.toml").write_text('title = "Broken"\nrecording = "none.csv"\n')
    missions_tab(page)
    expect(card(page, "montreal").locator("svg")).to_be_visible()
    expect(card(page, "montreal")).to_have_class("card chosen")
    expect(card(page, "montreal").get_by_role("button", name="Delete")).to_have_count(0)
    expect(card(page, "broken")).to_contain_text("its recording none.csv does not exist")
    expect(card(page, "mine")).to_contain_text("105 s")
    card(page, "mine").get_by_role("button", name="rare").click()
    expect(card(page, "montreal")).to_be_hidden()
    page.get_by_role("textbox", name="Filter").fill("no such words")
    expect(page.get_by_text("No mission contains all these words.")).to_be_visible()
    page.get_by_role("textbox", name="Filter").fill("my flight")
    card(page, "mine").get_by_role("button", name="Choose My flight").click()
    expect(chooser(page)).to_have_text("My flight")
    expect(page.get_by_text("/ 105 s")).to_be_visible()
    wait_for(page, "location.search.includes('mission=mine')")
    expect(page.get_by_role("button", name="Close Missions")).to_be_hidden()
    show(page, "Missions")
    expect(card(page, "mine")).to_have_class("card chosen")


def test_a_mission_of_ones_own_is_changed_and_deleted(mine: Path, shared_page: Page) -> None:
    page = shared_page
    missions_tab(page, "My flight")
    card(page, "mine").get_by_role("button", name="Edit mine").click()
    page.get_by_role("textbox", name="Name").fill("a/b")
    page.get_by_role("textbox", name="Title").fill("A <b>better</b> title")
    page.get_by_role("textbox", name="Tags").fill("one, two")
    page.get_by_role("button", name="Save").click()
    expect(page.get_by_role("alert").filter(has_text="is not possible in the name of a file")).to_be_visible()
    page.get_by_role("textbox", name="Name").fill("better")
    page.get_by_role("button", name="Save").click()
    expect(page.get_by_text("mine is now called better.")).to_be_visible()
    expect(card(page, "better")).to_contain_text("A <b>better</b> title")
    expect(chooser(page)).to_have_text("A <b>better</b> title")
    assert missions()["better"].tags == ("one", "two")
    card(page, "better").get_by_role("button", name="Delete better").click()
    dialog = page.get_by_role("dialog")
    expect(dialog).to_contain_text("better and its recording will be deleted")
    dialog.get_by_role("button", name="Cancel").click()
    expect(dialog).to_be_hidden()
    assert "better" in missions()
    card(page, "better").get_by_role("button", name="Delete better").click()
    dialog.get_by_role("button", name="Delete").click()
    expect(page.get_by_text("better was deleted.")).to_be_visible()
    expect(card(page, "better")).to_have_count(0)
    expect(chooser(page)).to_have_text("Montréal")
    assert "better" not in missions()


def part(page: Page, title: str) -> None:
    """Turn to a part of the page; of the buttons of this name, its own is the first."""
    page.get_by_role("button", name=title, exact=True).first.click()


def box(page: Page, name: str) -> Locator:
    return page.get_by_role("textbox", name=name)


@pytest.mark.proof
def test_a_plan_is_changed_saved_flown_and_cancelled(mine: Path, shared_page: Page) -> None:
    page = shared_page
    pytest.importorskip("jsbsim")
    shipped = mission("los_angeles")
    add_mission(shipped.recording, "again", title=shipped.title, flight=shipped.flight)
    missions_tab(page, "My flight")
    part(page, "Fly")
    page.get_by_role("combobox", name="Start from").click()
    expect(page.get_by_role("menuitem", name="Los Angeles", exact=True)).to_be_visible()
    page.get_by_role("menuitem", name="Los Angeles (again)").click()
    fly = page.get_by_role("button", name="Fly this plan")
    box(page, "Duration").fill("1e9")
    box(page, "Duration").press("Tab")
    expect(
        page.get_by_role("alert").filter(has_text="duration_s = 1000000000.0; accepted is")
    ).to_be_visible()
    expect(fly).to_be_disabled()
    box(page, "Duration").fill("12")
    box(page, "Duration").press("Tab")
    page.get_by_role("combobox", name="Runway of").click()
    page.get_by_role("menuitem", name="EGYP 10").click()
    expect(box(page, "Latitude")).to_have_value("-51.8176994")
    for left in (5, 4, 3, 2, 1):
        page.get_by_role("button", name="Remove: 2").click()
        expect(page.get_by_role("button", name="Remove: ")).to_have_count(left)
    page.get_by_role("combobox", name="Manoeuvre").click()
    page.get_by_role("menuitem", name="Turn by").click()
    page.get_by_role("button", name="Add manoeuvre").click()
    expect(page.get_by_role("alert").filter(has_text="angle_deg is missing")).to_be_visible()
    box(page, "Angle").fill("90")
    box(page, "Angle").press("Tab")
    expect(fly).to_be_enabled()
    with page.expect_download() as download:
        page.get_by_role("button", name="Save plan").click()
    plan = tomllib.loads(download.value.path().read_text(encoding="utf-8"))["flight"]
    assert [one["do"] for one in plan["manoeuvres"]] == ["take_off", "turn_by"]
    assert plan["runway"] == runway("EGYP 10")
    box(page, "Name").fill("mine")
    fly.click()
    expect(
        page.get_by_role("alert").filter(has_text="'mine': a mission already has this name")
    ).to_be_visible()
    box(page, "Name").fill("flown here")
    fly.click()
    expect(page.get_by_text("flown here was flown for 12 s and opened.")).to_be_visible()
    expect(page.get_by_text("ended during manoeuvre 1")).to_be_visible()
    expect(chooser(page)).to_have_text("A flight")
    found = mission("flown here")
    assert found.duration == pytest.approx(12, abs=0.06)
    assert found.plan == FlightPlan.from_dict(plan)
    box(page, "Duration").fill("3600")
    box(page, "Duration").press("Tab")
    fly.click()
    page.get_by_role("button", name="Cancel").click()
    expect(page.get_by_text("s into the flight")).to_be_visible()


def upload(page: Page, *paths: Path) -> None:
    """Upload files; two seconds after an upload the button empties itself, and what is given to it before."""
    files = page.locator("input[type=file][multiple]")
    expect(files).to_have_js_property("value", "")
    files.set_input_files(list(paths))


@pytest.mark.proof
def test_a_flight_is_uploaded_judged_and_added(mine: Path, shared_page: Page, tmp_path: Path) -> None:
    page = shared_page
    flight, broken, nameless = (
        tmp_path / name for name in ("our flight.csv", "bro<b>ken.csv", "nameless.csv")
    )
    write_flight_csv(flight, part_of_montreal())
    rows = [f"{time},{45.0 + 1e-4 * time:.6f},-73.0,100.0" for time in range(60)]
    nameless.write_text("\n".join(["a,b,c,d", *rows]), encoding="utf-8")
    broken.write_text("time_s,latitude_deg\n0,1\n", encoding="utf-8")
    missions_tab(page, "My flight")
    part(page, "Import")
    expect(page.get_by_text("X-Plane Data.txt")).to_be_visible()
    upload(page, broken)
    problem = page.get_by_role("alert").filter(has_text="bro_b_ken.csv")
    expect(problem).to_be_visible()
    expect(problem).to_have_text(re.compile("^bro_b_ken.csv: its format is unknown"))
    upload(page, nameless)
    refusal = page.get_by_role("alert").filter(has_text="nameless.csv")
    expect(refusal).to_contain_text("Here, the field 'Columns of a csv' takes it")
    columns = box(page, "Columns of a csv")
    columns.fill("a = time[s]\nb = latitude[°]\nc = longitude[°]\nd = height[m]")
    columns.blur()
    expect(page.get_by_role("cell", name="60 rows read, 60 used")).to_be_visible()
    upload(page, flight)
    expect(page.get_by_role("alert").filter(has_text="looks fine")).to_be_visible()
    expect(page.get_by_text("INS Lab flight csv", exact=True)).to_be_visible()
    expect(page.get_by_role("cell", name="300 rows read, 300 used")).to_be_visible()
    expect(box(page, "Name")).to_have_value("our flight")
    wide = page.viewport_size
    assert wide is not None
    page.set_viewport_size({"width": 400, "height": 900})
    wait_for(page, f"{LAST_FIGURE}.bottom > 900")  # below the track, and not beside it
    report = page.get_by_role("cell", name="300 rows read, 300 used").bounding_box()
    assert report is not None
    assert page.evaluate(f"{LAST_FIGURE}.bottom") <= report["y"], "the report covers the plots"
    page.set_viewport_size(wide)
    box(page, "Name").fill("ours")
    page.get_by_role("button", name=ADD).click()
    expect(page.get_by_role("button", name="Close Missions")).to_be_hidden()
    expect(chooser(page)).to_have_text("Flight of our flight.csv")
    assert mission("ours").duration == pytest.approx(part_of_montreal().duration, abs=0.3)
    # A browser keeps the models of the preview for half a minute: they have names of their own.
    wait_for(page, f"{RANGE_END} > 0")


def test_the_columns_of_a_table_are_chosen_kept_and_undone(
    mine: Path, shared_page: Page, tmp_path: Path
) -> None:
    page = shared_page
    nameless = tmp_path / "nameless.csv"
    rows = [f"{time},{45.0 + 1e-4 * time:.6f},-73.0,100.0" for time in range(60)]
    nameless.write_text("\n".join(["a,<b>b</b>,c,d", *rows]), encoding="utf-8")
    missions_tab(page, "My flight")
    part(page, "Import")
    upload(page, nameless)
    expect(page.get_by_role("alert").filter(has_text="nameless.csv")).to_be_visible()
    for heading, quantity, unit in (
        ("a", "time", "s"), ("<b>b</b>", "latitude", "°"), ("c", "longitude", "°"), ("d", "height", "m"),
    ):  # fmt: skip
        expect(page.get_by_role("rowheader", name=heading, exact=True)).to_be_visible()
        page.get_by_label(f"Quantity of {heading}", exact=True).select_option(quantity)
        page.get_by_label(f"Unit of {heading}", exact=True).select_option(unit)
    page.get_by_role("button", name="Apply", exact=True).click()
    expect(page.get_by_role("cell", name="60 rows read, 60 used")).to_be_visible()
    expect(page.get_by_label("Quantity of d", exact=True)).to_have_value("height")
    expect(box(page, "Columns of a csv")).to_have_value(re.compile(r"d = height\[m\]"))
    box(page, "Profile called").fill("Of a test")
    page.get_by_role("button", name="Keep as a profile").click()
    with page.expect_download() as download:
        page.get_by_role("button", name="Download", exact=True).click()
    assert tomllib.loads(Path(download.value.path()).read_text(encoding="utf-8")) == {
        "name": "Of a test", "needs": ["a", "<b>b</b>", "c", "d"],
        "columns": {"a": "time[s]", "<b>b</b>": "latitude[°]", "c": "longitude[°]", "d": "height[m]"},
    }  # fmt: skip
    page.get_by_role("button", name="Undo", exact=True).click()
    expect(page.get_by_role("alert").filter(has_text="nameless.csv")).to_be_visible()
    expect(page.get_by_role("cell", name="60 rows read, 60 used")).to_be_hidden()
    upload(page, nameless)
    expect(page.get_by_role("cell", name="60 rows read, 60 used")).to_be_visible()


def capture_of(protocol: str, path: Path) -> Path:
    """Write what a device with this protocol sends in 40 s, the first 12 of them at rest."""
    sent, encoder, parts = SimulatedFlight.of("montreal", 50.0, seed=3, rest=12.0), ENCODERS[protocol](), []
    for second in range(40):
        of_imu, of_fix = (
            (rows["time"] >= second) & (rows["time"] < second + 1) for rows in (sent.imu, sent.fix)
        )
        parts.append(encoder.encode(sent.imu[of_imu], sent.fix[of_fix]))
    path.write_bytes(b"".join(parts))
    return path


@pytest.mark.proof
def test_the_bytes_of_a_device_are_uploaded_and_added_as_a_log(
    mine: Path, shared_page: Page, tmp_path: Path
) -> None:
    """With those that are a flight too, and with those that no reader of flights knows."""
    page = shared_page
    missions_tab(page, "My flight")
    part(page, "Import")
    add, add_log = (
        page.get_by_role("button").filter(has_text=text)
        for text in ("Simulate sensors", "Navigate its sensors")
    )
    upload(page, capture_of("vectornav", tmp_path / "drive.bin"))
    expect(page.get_by_role("alert").filter(has_text="A sensor log")).to_be_visible()
    expect(page.get_by_text("The axes of the device are taken to point forward")).to_be_visible()
    expect(add_log).to_be_visible()
    expect(add).to_be_hidden()
    expect(box(page, "Title")).to_have_value("Log of drive.bin")
    upload(page, capture_of("ublox", tmp_path / "drive.ubx"))
    expect(page.get_by_text("u-blox UBX", exact=True)).to_be_visible()
    expect(page.get_by_text("The axes of the device are taken to point forward")).to_be_visible()
    expect(page.get_by_role("button").filter(has_text=ADD)).to_be_visible()
    box(page, "Title").fill("My drive")
    add_log.click()
    expect(page.get_by_role("button", name="Close Missions")).to_be_hidden()
    expect(chooser(page)).to_have_text("My drive")
    assert missions()["drive.ubx"].log.duration == pytest.approx(40.0, abs=1.0)
    missions_tab(page, "My flight")
    delete_mission("drive.ubx")


def test_x_plane_is_recorded(mine: Path, shared_page: Page) -> None:
    page = shared_page
    missions_tab(page, "My flight")
    part(page, "X-Plane")
    box(page, "Port").fill("none")
    page.get_by_role("button", name="Start").click()
    expect(page.get_by_text("Port and rate must be numbers")).to_be_visible()
    with XPlaneSender(part_of_montreal()) as sender:
        sent = iter(range(1, 10_000))
        sender.received = lambda: next(sent)
        box(page, "Port").fill(str(sender.port))
        page.get_by_role("button", name="Start").click()
        expect(page.get_by_text(re.compile(r"[1-9]\d* samples"))).to_be_visible()
        assert sender.done.wait(60)
        page.get_by_role("button", name="Stop").click()
        expect(page.get_by_role("button", name=ADD)).to_be_visible()
        expect(page.get_by_role("cell", name=re.compile("X-Plane"))).to_be_visible()
