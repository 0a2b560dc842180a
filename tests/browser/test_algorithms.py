"""Algorithms of whoever serves the page: compared beside the models, without a browser."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dashboards.algorithms import VARIABLE, served_algorithm, served_names, use_algorithms
from dashboards.pages.consistency import coverage_html, verdict_html, whiteness_html
from lab import Experiment, compare
from lab.views.ensemble_cards import models_html
from lab.views.figures import TimeAxis
from lab.views.quantities import CONSISTENCY, INNOVATIONS, SENSOR_ERRORS
from lab.views.time_figures import TimeFigures

TEXT = """\
import numpy as np
from lab import Estimate

class Still:
    def navigate(self, imu, fixes, start):
        parts = (start.position, start.velocity_n, start.q_nb, np.ones(9))
        return Estimate(*(np.tile(part, (imu.time.size, 1)) for part in parts))

class Broken:
    def navigate(self, imu, fixes, start):
        raise RuntimeError("<b>lost</b>")
"""


@pytest.fixture
def places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    path = tmp_path / "mine.py"
    path.write_text(TEXT)
    places = f"{path}:Still, {path}:Broken, {path}:Nobody"
    monkeypatch.setenv(VARIABLE, places)
    return places


def test_without_the_variable_there_are_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    assert served_names() == ()


@pytest.mark.usefixtures("places")
def test_sessions_share_no_algorithm() -> None:
    assert served_names() == ("Still", "Broken", "Nobody")
    assert all(served_algorithm(name) is not served_algorithm(name) for name in served_names())


@pytest.mark.usefixtures("places")
def test_those_of_the_server_stand_in_place_of_those_of_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dashboards.algorithms._given", [])
    use_algorithms([f"{tmp_path / 'mine.py'}:Broken"])
    assert served_names() == ("Broken",)
    use_algorithms([])
    assert served_names() == ("Still", "Broken", "Nobody")


@pytest.mark.usefixtures("places")
def test_what_fails_is_a_row_with_the_reason() -> None:
    rows = compare(
        Experiment(mission="los_angeles"),
        ["phi"],
        algorithms={name: served_algorithm(name) for name in served_names()},
    )
    assert [row.model for row in rows] == ["phi", "Still", "Broken", "Nobody"]
    html = models_html(rows)
    assert html.count("unknown") == 2
    assert "mine.py, line 11, in navigate: RuntimeError: &lt;b&gt;lost&lt;/b&gt;" in html
    assert "has no &#x27;Nobody&#x27;" in html


@pytest.mark.usefixtures("places")
def test_the_consistency_page_shows_what_is_known_of_an_algorithm() -> None:
    result = Experiment(mission="los_angeles").run(algorithm=served_algorithm("Still"))
    html = verdict_html(result.verdict, result.innovation_verdict)
    assert "Unknown" in html
    assert 'class="verdict fine"' not in html
    tables = whiteness_html(result.whiteness) + coverage_html(result)
    assert "nan" not in tables
    assert "unknown" in tables
    for plots in (CONSISTENCY, INNOVATIONS, SENSOR_ERRORS):
        figures = TimeFigures(plots, TimeAxis())
        figures.show(result)
        for figure in figures.figures:
            assert np.isfinite([figure.y_range.start, figure.y_range.end]).all(), figure.title.text
