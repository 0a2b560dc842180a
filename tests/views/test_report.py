"""The report: one file that opens without a network, has what its reader needs, and repeats the run."""

from __future__ import annotations

import dataclasses
import json
import re
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from sensor_logs import tables, write

from lab.base.parameters.toml_file import parse_toml
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.views.report import report_html

LARGEST = 5e6
"""Size that a file of plots may have to be sent by mail [bytes]."""


@pytest.fixture(scope="module")
def changed() -> Result:
    made = Experiment(mission="los_angeles", seed=4)
    made.update({"trajectory": {"imu_rate": 50.0}, "navigator": {"q_scale": 0.1}})
    made.set("sensors.gps.outages", [(40.0, 60.0)])
    return made.run()


@pytest.fixture(scope="module")
def html(changed: Result) -> str:
    return report_html(changed)


def settings_of(html: str) -> Experiment:
    found = re.search(r'<pre id="settings">(.*?)</pre>', html, re.DOTALL)
    assert found is not None
    return Experiment().update(parse_toml(unescape(found[1])))


def test_notes_on_the_flight_stand_in_the_report_as_text(changed: Result) -> None:
    html = report_html(changed, [(40.0, 60.0, "<script>alert(1)</script> & so on"), (70.5, 70.5, "look")])
    found = re.search(r'<ul id="notes">(.*?)</ul>', html)
    assert found is not None
    assert found[1] == (
        "<li>40.0 to 60.0 s: &lt;script&gt;alert(1)&lt;/script&gt; &amp; so on</li><li>70.5 s: look</li>"
    )
    assert "<script>alert" not in html
    assert "Notes on the flight" not in report_html(changed)


def test_the_settings_in_a_report_repeat_its_run_bit_for_bit(changed: Result, html: str) -> None:
    again = settings_of(html).run()
    for name in ("q_nb", "velocity_n", "innovation", "fix_covariance"):
        before, after = (getattr(one.solution_arrays, name) for one in (changed, again))
        assert np.array_equal(before, after, equal_nan=True), name
    assert again.experiment.to_dict() == changed.experiment.to_dict()
    assert changed.mission.content_hash in html


def test_a_report_has_its_verdict_the_changes_and_the_tables(changed: Result, html: str) -> None:
    text = unescape(re.sub(r"<(script|style).*?</\1>", "", html, flags=re.DOTALL))
    assert changed.tried_verdict.headline in text
    assert re.search(r"navigator\.(<wbr>)?q_(<wbr>)?scale", text)
    assert "Los Angeles" in text
    assert "seed 4" in text
    for value in changed.summary["rms"]:
        assert f"<td>{value:.3g}</td>" in text
    assert text.count('<div class="plots">') == 5
    assert len(html) < LARGEST


def test_a_report_of_a_log_promises_no_truth_of_the_biases(tmp_path: Path, html: str) -> None:
    headings = re.compile(r"<h2>(Biases.*?)</h2>")
    log = Experiment(mission=str(write(tmp_path / "drive", tables(20, 80)))).run()
    assert headings.findall(report_html(log)) == ["Biases: the estimate with ±3σ"]
    assert headings.findall(html) == ["Biases: the estimate with ±3σ, and the truth"]


def test_nothing_is_fetched_from_elsewhere(html: str) -> None:
    tags = re.findall(r"<(?:script|link|img|iframe)\b[^>]*>", html)
    assert tags
    assert not [tag for tag in tags if re.search(r"\b(?:src|href)\s*=", tag)]


def test_a_title_ends_no_script(changed: Result) -> None:
    evil = "</script><script>alert(1)</script>"
    mission = dataclasses.replace(changed.mission, title=evil)
    html = report_html(dataclasses.replace(changed, mission=mission))
    assert "<script>alert" not in html
    assert "&lt;script&gt;alert" in html


def test_a_file_is_replaced_only_when_told(changed: Result, tmp_path: Path) -> None:
    path = tmp_path / "run.html"
    changed.report(path)
    written = path.read_text()
    with pytest.raises(FileExistsError, match="nothing was written"):
        changed.report(path)
    assert path.read_text() == written
    changed.report(path, overwrite=True)
    with pytest.raises(FileNotFoundError, match="no folder"):
        changed.report(tmp_path / "no" / "run.html")
    assert [one.name for one in tmp_path.iterdir()] == ["run.html"]


def test_the_flight_is_drawn_in_three_dimensions_and_to_scale_but_for_its_heights(
    changed: Result, html: str
) -> None:
    found = re.search(r'<svg id="scene".*?</svg>', html, re.DOTALL)
    assert found is not None
    data = re.search(r'data-paths="(.*?)"', found[0])
    factor = re.search(r"Heights are drawn ([0-9.]+) times larger", html)
    assert data is not None
    paths = [np.array(path) for path in json.loads(unescape(data[1]))]
    shadow, estimate, truth = paths[0], paths[-2], paths[-1]
    assert len(paths) == found[0].count("<polyline") == 3 + len(changed.fixes.time)
    latitude, longitude, height = changed.truth_arrays.taken(np.arange(0, len(changed.time), 50)).position.T
    earth = 6.371e6  # [m], to half a percent
    extent = np.ptp([earth * np.cos(latitude[0]) * longitude, earth * latitude, height], axis=1)
    drawn = np.ptp(truth, axis=0) / extent / [1, 1, float(factor[1]) if factor else 1]
    assert drawn == pytest.approx(drawn[:1].repeat(3), rel=0.02)
    assert np.ptp(shadow[:, 2]) == 0 and (shadow[:, :2] == estimate[:, :2]).all()
    assert (estimate[:, 2] >= shadow[0, 2]).all()
    points = re.findall(r'points="(.*?)"', found[0])[-1].split()
    seen = np.array([[float(one) for one in point.split(",")] for point in points])
    right, down = np.linalg.lstsq(truth, seen, rcond=None)[0].T
    # From the south-west, what is north-east is behind, and higher; north-west is left, south-east right.
    assert right == pytest.approx([np.sqrt(0.5), -np.sqrt(0.5), 0], abs=2e-3)
    assert down[0] == pytest.approx(down[1], abs=2e-3)
    assert down[0] < 0 > down[2]
