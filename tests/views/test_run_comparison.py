"""The table of runs: figures as the tables of each run have them, the best in bold, reasons for gaps."""

from __future__ import annotations

import re
from html import unescape

import numpy as np
import pytest

from lab.experiment.ensembles.seeds import run_ensemble
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.views.run_comparison import (
    COLUMNS,
    MOST_POSITION,
    NEES,
    NIS,
    NO_OUTAGE,
    OUTAGE_END,
    RMS_HEADING,
    RMS_HEIGHT,
    RMS_LEVEL,
    RMS_POSITION,
    RMS_VELOCITY,
    Assessment,
    Row,
    assess,
    assess_seeds,
    comparison_html,
)


@pytest.fixture(scope="module")
def other(result: Result) -> Result:
    """Return a run whose filter trusts the fixes too much."""
    changed = result.experiment.copy()
    changed.set("navigator.r_scale", 0.01)
    return changed.run()


def cells(html: str, name: str) -> list[str]:
    """Return the texts of the cells of a row, its name first."""
    (row,) = [part for part in html.split("<tr>") if part.startswith(f"<td>{name}")]
    return [unescape(re.sub("<[^>]*>", "", cell)) for cell in re.findall(r"<td.*?>(.*?)</td>", row)]


def test_the_figures_are_those_of_the_tables(result: Result) -> None:
    found = {f"{column.name} {column.unit}": value for column, value in assess(result).values.items()}
    rms = result.summary.set_index("quantity")["rms"]
    east, north, up = (rms[f"position {axis}"] for axis in ("east", "north", "up"))
    assert found["Horizontal, rms m"] == pytest.approx(np.hypot(east, north))
    assert found["Height, rms m"] == pytest.approx(up)
    speeds = [rms[f"velocity {axis}"] for axis in ("east", "north", "up")]
    assert found["Velocity, rms m/s"] == pytest.approx(np.linalg.norm(speeds))
    assert found["Roll and pitch, rms °"] == pytest.approx(
        np.hypot(rms["attitude roll"], rms["attitude pitch"])
    )
    assert found["Heading, rms °"] == pytest.approx(rms["attitude heading"])
    assert found["NIS per measured value "] == pytest.approx(float(result.innovations["nis"].mean()) / 6)
    assert found["NEES per state "] == pytest.approx(float(result.consistency["nees"].mean()) / 15)
    position = result.errors["position"].values
    assert found["Horizontal, 95 % m"] == pytest.approx(
        np.quantile(np.hypot(position[:, 0], position[:, 1]), 0.95)
    )
    assert 90 < found["Inside ±3σ %"] <= 100
    assert not any("outages" in name for name in found)


def test_a_table_names_the_runs_marks_the_best_and_says_the_difference(result: Result, other: Result) -> None:
    rows = [Row("now", "", assess(result)), Row("R <scale> 0.01", "", assess(other)), Row("later")]
    html = comparison_html(rows)
    assert "R &lt;scale&gt; 0.01" in html
    here, there = (row.found.values for row in rows[:2])
    shown = [column for column in COLUMNS if column in here]
    now, wrong = cells(html, "now"), cells(html, "R &lt;")
    at = 1 + shown.index(NIS)
    assert float(wrong[at]) > 5 * float(now[at])
    assert f"<b>{here[NIS]:.3g}</b>" in html
    change = f"{100 * (there[RMS_POSITION] / here[RMS_POSITION] - 1):+.0f}".replace("-", "\u2212")
    assert wrong[1 + shown.index(RMS_POSITION)] == f"{there[RMS_POSITION]:.3g}{change}\u2009%"
    assert "%" not in "".join(now)
    assert "%" in "".join(cells(comparison_html(rows, "R <scale> 0.01"), "now"))
    assert result.verdict.consistent
    assert now[-1] == "✓ Consistent"
    assert other.verdict.headline in wrong[-1]
    assert cells(html, "later") == ["later", "computing …"]


def test_of_a_reference_with_gaps_the_known_errors_count(
    result: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As that of a log, which may begin later, and have no attitude."""
    errors = result.errors.copy(deep=True)
    errors["position"].values[:100] = np.nan
    errors["attitude"].values[:] = np.nan
    known = errors["position"].values[100:]
    monkeypatch.setitem(result.__dict__, "errors", errors)
    found = assess(result)
    assert found.values[RMS_HEIGHT] == pytest.approx(np.sqrt(np.mean(known[:, 2] ** 2)))
    horizontal = np.hypot(known[:, 0], known[:, 1])
    assert found.values[MOST_POSITION] == pytest.approx(np.quantile(horizontal, 0.95))
    assert RMS_HEADING not in found.values
    whole = Assessment({RMS_HEADING: 1.0, RMS_HEIGHT: 2.0}, verdict="fine")
    assert "–" in cells(comparison_html([Row("gap", "", found), Row("whole", "", whole)]), "gap")


def test_the_error_at_the_end_of_an_outage_is_that_before_the_next_fix() -> None:
    experiment = Experiment(mission="los_angeles")
    experiment.set("trajectory.imu_rate", 20)
    # The second one begins after the first fixes, and lasts to the end; the last is after the flight.
    experiment.set("sensors.gps.outages", [(30.0, 50.0), (80.0, 1e4), (2e4, 3e4)])
    result = experiment.run()
    position = np.linalg.norm(result.errors["position"].values[:, :2], axis=1)
    time = result.time
    ends = [position[np.isclose(time, 49.95)][0], position[-1]]
    assert assess(result).values[OUTAGE_END] == pytest.approx(np.sqrt(np.mean(np.square(ends))))
    assert position[np.isclose(time, 49.95)][0] > 2 * position[np.isclose(time, 51.5)][0]
    html = comparison_html([Row("cut", "", assess(result)), Row("whole", "", Assessment({NIS: 1.0}))])
    assert f'title="{NO_OUTAGE}"' in html


def test_figures_of_seeds_are_those_of_separate_runs() -> None:
    experiment = Experiment(mission="los_angeles", seed=4)
    experiment.update({"trajectory.imu_rate": 20, "sensors.gps.outages": [[30.0, 45.0]]})
    found = assess_seeds(run_ensemble(experiment, 4), 4)
    alone = [assess(experiment.copy().update({"seed": seed}).run()).values for seed in (4, 5, 6, 7)]
    for column in (RMS_POSITION, RMS_HEIGHT, RMS_VELOCITY, RMS_LEVEL, RMS_HEADING, NEES, NIS):
        each = [one[column] for one in alone]
        assert found.values[column] == pytest.approx(np.mean(each)), column
        assert found.spread[column] == pytest.approx(np.std(each, ddof=1)), column
    assert found.remark == ""
    assert assess_seeds(run_ensemble(experiment, 2), 5).remark == "2 of 5 seeds"
    html = comparison_html(
        [Row("alone", "", Assessment(alone[0])), Row("seeds", "Many", found, is_many=True)]
    )
    assert f"±\u2009{found.spread[NEES]:.2g}" in html
    for column in (MOST_POSITION, OUTAGE_END):  # of ten samples a second
        each = [one[column] for one in alone]
        assert found.values[column] == pytest.approx(np.mean(each), rel=0.02), column


def test_a_row_without_figures_says_why_and_one_without_errors_has_the_reason_below() -> None:
    rows = [
        Row("whole", "", Assessment({NIS: 2.0, RMS_HEIGHT: 1.0})),
        Row("log", "", Assessment({NIS: 1.0}, why_unknown="No <reference>.")),
        Row("other", "", Assessment({NIS: 1.0}, why_unknown="No <reference>.")),
        Row("refused", "", Assessment(verdict="Not <possible>.")),
    ]
    html = comparison_html(rows)
    assert cells(html, "refused")[1] == "Not <possible>."
    assert html.endswith("<p>log: No &lt;reference&gt;.</p>")
    assert "–" in cells(html, "log")
    assert (
        cells(comparison_html(rows, "refused"), "whole")[1] == "1"
    )  # what is relative to nothing has no percent
