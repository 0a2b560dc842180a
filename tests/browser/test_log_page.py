"""A sensor log on the page: what is known is shown, the rest is said in a sentence."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from shutil import rmtree

import pytest
from playwright.sync_api import Page, expect
from sensor_logs import tables, write

from tests.browser.conftest import show, shown, wait_for

pytestmark = pytest.mark.browser

Open = Callable[..., Page]


@pytest.fixture
def own_folder(own_missions: Path) -> Iterator[Path]:
    """Return the folder of the user's own missions, which is emptied in the end."""
    yield own_missions
    for path in own_missions.iterdir():
        rmtree(path)


def test_a_log_without_reference(open_page: Open, own_folder: Path) -> None:
    folder = write(own_folder / "blind", tables(60, 90), 'title = "Blind drive"')
    (folder / "ref.csv").unlink()
    page = open_page("?mission=blind", drawn=False)
    page.get_by_text("has no reference, so its errors are unknown").wait_for()
    dimmed = page.get_by_role("tab", name="Errors", exact=True)
    expect(dimmed).to_have_attribute("title", re.compile("has no reference"))
    expect(page.get_by_role("button", name="Errors", exact=True)).to_have_attribute(
        "aria-description", re.compile("has no reference")
    )
    expect(page.get_by_role("button", name="Covariance", exact=True)).not_to_have_attribute(
        "data-nothing", re.compile(".")
    )
    page.get_by_text("Recorded data:").wait_for()
    expect(page.get_by_text("Temperature", exact=True).first).to_be_hidden()
    page.get_by_role("link", name="Innovations").click()
    shown(page, "Innovations")
    source = "Bokeh.documents[0].get_model_by_name('time_gps:innovation_position_east')"
    wait_for(page, f"{source}?.data.time?.length > 20")
    show(page, "Budget")
    page.get_by_text("and the error budget needs them").wait_for()
    show(page, "Compare")
    page.get_by_text("There is no reference").wait_for()
    page.get_by_text("Levelled in motion").wait_for()
    show(page, "Overview")
    page.get_by_text("Filter and smoother differ by").wait_for()


def test_an_outage_set_on_a_plot_is_of_the_clock_of_the_file(open_page: Open, own_folder: Path) -> None:
    """The log begins at 1060 s of its file; the plots begin at 0."""
    write(own_folder / "drive", tables(60, 90))
    page = open_page("?mission=drive")
    page.get_by_role("button", name="GPS outage").click()
    shaded = "Bokeh.documents[0].get_model_by_name('time without GPS').data"
    wait_for(page, f"{shaded}.start?.length === 1")
    assert page.evaluate(f"[{shaded}.start[0], {shaded}.end[0]]") == pytest.approx([0, 20], abs=0.1)
    outages = page.get_by_role("textbox", name="Outages")
    expect(outages).not_to_have_value("")
    written = outages.input_value()
    assert [float(part) for part in written.split("–")] == pytest.approx([1060, 1080], abs=0.1)
