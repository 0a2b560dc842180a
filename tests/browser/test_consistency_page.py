"""The page on consistency: the verdict in words, beside NEES and the tables it rests on."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect

from dashboards.computing import SupersededError
from dashboards.ensembles import ensemble
from lab.experiment.experiment import Experiment
from tests.browser.conftest import show, wait_for

pytestmark = pytest.mark.browser


TABLES_FOLLOW_THE_PLOTS = """
(() => {
  const edges = (found) => [...Bokeh.index.query(found)].map((view) => view.el.getBoundingClientRect());
  const plots = edges((view) => /^(NEES|NIS|Position|Velocity)/.test(view.model.title?.text));
  const tables = edges((view) => view.model.text?.includes("Innovations [σ]"));
  const gap = tables[0].top - Math.max(...plots.map((edge) => edge.bottom));
  return plots.length >= 2 && gap >= 0 && gap < 40;
})()
"""
"""No plot stands over the tables, and no empty space before them."""


@pytest.mark.proof
def test_the_verdict_is_in_words_and_names_what_is_wrong(open_page: Callable[..., Page]) -> None:
    page = open_page("?mission=los_angeles&sensors.gps.latency=0.2&navigator.latency=0")
    show(page, "Verdict")
    expect(page.get_by_role("heading", name="The fixes are 0.20 s late")).to_be_visible()
    advice = page.get_by_text("Set “Navigator and filter: Latency the filter assumes” to 0.20")
    expect(advice).to_be_visible()
    expect(advice).to_contain_text("Tried: NIS per degree of freedom")
    expect(page.get_by_role("cell", name="position north")).to_have_count(2)
    nees = "Bokeh.documents[0].get_model_by_name('time_gps:nees').data"
    wait_for(page, f"{nees}.nees.length > 100 && {nees}.nees_band_high[5] > 27")


@pytest.mark.proof
def test_many_seeds_are_judged_together_in_the_background(open_page: Callable[..., Page]) -> None:
    page = open_page("?mission=los_angeles")
    show(page, "Verdict")
    choose(page, "10 seeds")
    expect(page.get_by_text("10 flights, seeds 1 to 10")).to_be_visible()
    expect(page.get_by_text("Judged by 10 runs")).to_be_visible()
    averages = "Bokeh.documents[0].get_model_by_name('time:anees')?.data"
    wait_for(page, f"{averages}.anees.length > 90 && {averages}.anees_band_high[5] < 19")
    wait_for(page, TABLES_FOLLOW_THE_PLOTS)
    seed = page.get_by_role("textbox").first
    seed.fill("5")
    seed.press("Enter")
    expect(page.get_by_text("10 flights, seeds 5 to 14")).to_be_visible()
    choose(page, "1 seed")
    expect(page.get_by_text("Judged by 1 run,")).to_be_visible()
    wait_for(page, TABLES_FOLLOW_THE_PLOTS)
    wait_for(page, "Bokeh.documents[0].get_model_by_name('time_gps:nees')?.data.nees.length > 90")


def choose(page: Page, runs: str) -> None:
    page.get_by_role("combobox", name="Runs").click()
    page.get_by_role("menuitem", name=runs, exact=True).click()


def test_an_ensemble_nobody_waits_for_ends_and_is_not_kept() -> None:
    result = Experiment(mission="los_angeles").run()
    told: list[str] = []

    def stop(stage: str, _fraction: float) -> None:
        told.append(stage)
        raise SupersededError

    with pytest.raises(SupersededError):
        ensemble(result, 50, stop)
    assert len(told) < 50
    kept = ensemble(result, 3, lambda *_: None)
    assert ensemble(result, 3, stop) is kept
    assert kept.seeds == (1, 2, 3)
