"""Cards of a notebook: drawn by whoever registered, and not loaded before; every object that has one."""

from __future__ import annotations

import json
import subprocess
import sys
from html.parser import HTMLParser

import numpy as np
import pytest

from lab import card
from lab.base import registry
from lab.base.notebook_card import NotebookCard
from lab.base.registry import find, names, register
from lab.experiment.ensembles.comparison import Compared, Comparison
from lab.experiment.ensembles.seeds import run_ensemble
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.sensors.gps import GpsErrors


class Shown(NotebookCard):
    """Has a card that nobody of the lab draws."""

    CARD = "a card of this test"


def draw(shown: Shown) -> str:
    return f"<p>{type(shown).__name__}</p>"


def test_a_card_is_drawn_by_whoever_registered_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    kinds = {kind: dict(functions) for kind, functions in registry._FUNCTIONS.items()}
    monkeypatch.setattr(registry, "_FUNCTIONS", kinds)
    assert Shown()._repr_html_() is None  # Jupyter shows the text then
    register("card", "a card of this test", f"{__name__}:draw")
    assert Shown()._repr_html_() == "<p>Shown</p>"


def test_every_registered_function_exists() -> None:
    for kind in ("card", "plot", "result", "experiment", "sweep"):
        assert names(kind)
        for name in names(kind):
            assert callable(find(kind, name)), (kind, name)


def test_a_subclass_has_the_card_of_its_parent() -> None:
    assert "sensors" not in GpsErrors()._repr_html_()
    assert "<table>" in GpsErrors(period=2.0)._repr_html_()


def test_importing_the_lab_registers_the_cards_and_loads_nothing_that_draws() -> None:
    script = (
        "import json, sys, lab\nfrom lab.base import registry\n"
        "print(json.dumps([sorted(registry._FUNCTIONS['card']), sorted(sys.modules)]))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    cards, modules = json.loads(done.stdout)
    assert {"settings", "result"} <= set(cards)
    assert not {
        "numpy",
        "param",
        "holoviews",
        "bokeh",
        "IPython",
        "lab.experiment.result",
        "lab.base.parameters.settings",
    } & set(modules)


class Reader(HTMLParser):
    """Collects the texts, the colours of texts, and tags that were opened and not closed."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.texts: list[str] = []
        self.open: list[str] = []
        self.styles = ""
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note a tag and its style."""
        self.styles += f"{dict(attrs).get('style') or ''};"
        if tag != "wbr":  # the one tag of the cards that has no end
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        """Close the tag that was opened last."""
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        """Keep a text."""
        self.texts.append(data)


def test_an_experiment_shows_its_changed_settings_and_folds_the_groups() -> None:
    experiment = Experiment(mission="los_angeles")
    experiment.sensors.gps.period = 0.5
    html = str(experiment._repr_html_())
    read = Reader(html)
    assert not read.open
    first, *folded = html.split("<details>")
    assert [text for text in Reader(first).texts if text in {"los_angeles", "0.5 s"}] == [
        "los_angeles",
        "0.5 s",
    ]
    assert "noise_<wbr>density" not in first
    summaries = [Reader(part.partition("</summary>")[0]).texts for part in folded]
    assert ["general", ": 2 settings, 1 changed"] in summaries
    assert len({name for name, _ in summaries}) == len(summaries)
    rows = sum(part.count("<tr>") - 1 for part in folded)
    assert rows == len(list(experiment.leaves()))


def test_objects_are_short_and_readable_in_a_terminal(mistuned: Result) -> None:
    gyro = Experiment().sensors.gyro
    gyro.noise_density = (0.02,) * 3
    assert "* noise_density       0.02 °/s/√Hz, from 0 to 10" in repr(gyro).splitlines()
    assert len(repr(gyro).splitlines()) == 1 + len(gyro.to_dict())
    assert repr(card("ADIS16470")).startswith("<Card ADIS16470: industrial grade, Analog Devices; 6 numbers")
    verdict = mistuned.verdict
    assert repr(verdict).splitlines()[0] == f"Verdict by {verdict.basis}: {verdict.headline}"
    assert all(finding.counsel in repr(verdict) for finding in verdict.findings)


@pytest.fixture(scope="module")
def mistuned() -> Result:
    """Return a run of a filter that assumes a hundredth of R."""
    experiment = Experiment(mission="los_angeles", seed=3)
    experiment.trajectory.imu_rate = 20
    experiment.navigator.r_scale = 0.01
    return experiment.run()


def test_a_verdict_shows_each_finding_with_its_advice_once(mistuned: Result) -> None:
    read = Reader(str(mistuned.verdict._repr_html_()))
    text = " ".join(read.texts)
    assert not read.open
    assert mistuned.verdict.findings
    for finding in mistuned.verdict.findings:
        assert text.count(finding.sentence) == 1
        assert finding.evidence in text
    assert "✗" in text


def test_a_comparison_is_a_tuple_and_shows_its_rows_and_refusals() -> None:
    rows = Comparison(
        (
            Compared("phi", position=1.25, nees=16.2, degrees=15, nis=np.nan, verdict="Consistent."),
            Compared("<b>mine", refusal="steps > 3 s"),
        )
    )
    first, last = rows
    assert (first.model, last.refusal) == ("phi", "steps > 3 s")
    read = Reader(str(rows._repr_html_()))
    assert not read.open
    for text in (
        "phi",
        "1.250",
        "16.2 / 15",
        "unknown",
        "Consistent.",
        "<b>mine",
        "Does not run: steps > 3 s",
    ):
        assert text in read.texts


def test_an_ensemble_shows_its_verdict_and_its_errors(mistuned: Result) -> None:
    ensemble = run_ensemble(mistuned.experiment, 2)
    read = Reader(str(ensemble._repr_html_()))
    text = " ".join(read.texts)
    assert not read.open
    assert ensemble.verdict.findings[0].sentence in text
    assert f"{ensemble.coverage['rms'][8]:.3g}" in text
    assert "Los Angeles, 2 runs, seeds 3 to 4" in text
    assert "position east [m]" in text
    assert "unit" in ensemble.coverage  # the table itself is as before
    ensemble.experiment.mission = "gone"  # a flight that was removed meanwhile
    assert "gone, 2 runs" in str(ensemble._repr_html_())


def test_a_sweep_names_its_mission_by_its_title_and_scrolls_where_it_is_wide(mistuned: Result) -> None:
    swept = mistuned.experiment.sweep({"navigator.r_scale": [0.1, 1.0]}, 1)
    page = str(swept._repr_html_())
    assert "<h4>Los Angeles, 2 combinations" in page
    assert '<div style="overflow-x:auto;max-width:100%" tabindex="0"' in page


def test_a_sensor_card_shows_numbers_with_units_and_sources() -> None:
    shown = card("ADIS16470")
    read = Reader(str(shown._repr_html_()))
    text = " ".join(read.texts)
    assert not read.open
    assert "0.008 °/s/√Hz (one-sided)" in text
    for terms in (*shown.terms.values(), *shown.assumed.values()):
        for datum in terms.values():
            assert datum.source in text
    assert "background" not in read.styles  # the notebook's own, light or dark
