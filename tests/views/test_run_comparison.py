"""The table of runs side by side: figures as the tables of each run have them, the best in bold."""

from __future__ import annotations

import re

import numpy as np
import pytest

from lab.experiment.result import Result
from lab.views.run_comparison import comparison_html, figures_of


@pytest.fixture(scope="module")
def other(result: Result) -> Result:
    """Return a run whose filter trusts the fixes too much."""
    changed = result.experiment.copy()
    changed.set("navigator.r_scale", 0.01)
    return changed.run()


def test_the_figures_are_those_of_the_summary(result: Result) -> None:
    found = {figure.name: figure.value for figure in figures_of(result)}
    rms = result.summary.set_index("quantity")["rms"]
    east, north, up = (rms[f"position {axis}"] for axis in ("east", "north", "up"))
    assert found["Horizontal position, rms"] == pytest.approx(np.hypot(east, north))
    assert found["Height, rms"] == pytest.approx(up)
    assert found["Heading, rms"] == pytest.approx(rms["attitude heading"])
    assert found["NIS over its number of measurements"] == pytest.approx(
        float(result.innovations["nis"].mean()) / 6
    )
    assert 90 < found["Errors inside ±3σ"] <= 100


def test_a_table_names_the_runs_marks_the_best_and_says_the_difference(result: Result, other: Result) -> None:
    html = comparison_html([("now", result), ("R <scale> 0.01", other)])
    assert "R &lt;scale&gt; 0.01" in html
    rows = [part.split("</tr>")[0] for part in html.split("<tr>")]
    row = next(part for part in rows if part.startswith("<td>NIS over"))
    values = [float(re.sub("<[^>]*>", "", cell)) for cell in re.findall(r"<td>(?!NIS)(.*?)</td>", row)]
    assert values[1] > 5 * values[0]
    assert f"<b>{values[0]:.3g}</b>" in row
    rms = next(part for part in rows if part.startswith("<td>Horizontal position, rms"))
    here, there = (figures_of(one)[0].value for one in (result, other))
    assert f"{100 * (there / here - 1):+.0f}" in rms.replace("\u2212", "-")
    assert result.verdict.headline in html
    assert other.verdict.headline in html


def test_of_a_reference_with_gaps_the_known_errors_count(
    result: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As that of a log, which may begin later, and have no attitude."""
    errors = result.errors.copy(deep=True)
    errors["position"].values[:100] = np.nan
    errors["attitude"].values[:] = np.nan
    known = errors["position"].values[100:]
    monkeypatch.setitem(result.__dict__, "errors", errors)
    found = {figure.name: figure.value for figure in figures_of(result)}
    assert found["Height, rms"] == pytest.approx(np.sqrt(np.mean(known[:, 2] ** 2)))
    horizontal = np.hypot(known[:, 0], known[:, 1])
    assert found["Horizontal position, 95 %"] == pytest.approx(np.quantile(horizontal, 0.95))
    assert np.isnan(found["Heading, rms"])
    assert "<td>–</td>" in comparison_html([("now", result)])
