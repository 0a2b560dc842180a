"""Files of a result from the page: one at a time, with progress, and the stretch that is seen alone."""

from __future__ import annotations

import io
import threading
from base64 import b64decode
from collections.abc import Iterator

import numpy as np
import pandas as pd
import pytest
from panel.io.state import set_curdoc

from dashboards import exchange
from dashboards.exchange import Download, Files
from lab.experiment.experiment import Experiment
from tests.dashboards.walking import Walk, walking
from tests.views.export.test_full_disk import files_up_to


@pytest.fixture(scope="module")
def walk() -> Iterator[Walk]:
    """Return a page with the result of a short flight."""
    with pytest.MonkeyPatch.context() as patch, walking(patch) as made:
        experiment = Experiment(mission="los_angeles")
        experiment.trajectory.imu_rate = 50.0
        assert made.run(experiment).problem == ""
        yield made


def files(walk: Walk) -> Files:
    if walk.page._files is None:
        with set_curdoc(walk._document):
            walk.page._add_files()
    assert walk.page._files is not None
    return walk.page._files


def given(walk: Walk, button: Download) -> bytes:
    """Return what a browser gets for a click."""
    before = button._transfers
    button._clicks += 1
    wait(walk)
    assert button._transfers == before + 1
    return b64decode(button.data.partition(",")[2])


def wait(walk: Walk) -> None:
    ended = threading.Event()
    while files(walk)._job.busy:
        ended.wait(0.01)
    walk.settle()


def test_impatient_clicks_write_one_file_whose_progress_shows_at_once(
    walk: Walk, monkeypatch: pytest.MonkeyPatch
) -> None:
    may_end, begun = threading.Event(), []

    def slow(_result: object, progress: exchange.Progress) -> bytes:
        begun.append(1)
        progress("Writing errors.csv", 0.5)
        may_end.wait(60)
        return b"PK"

    shown = files(walk)
    button = shown._download("slow", "slow.zip", slow, {})
    for _ in range(4):
        button._clicks += 1
        assert shown._job._row.visible
    may_end.set()
    wait(walk)
    assert (len(begun), button._transfers) == (1, 1)
    assert not shown._job._row.visible


def test_what_is_seen_is_the_visible_stretch_of_the_page(walk: Walk) -> None:
    shown, result = files(walk), walk.page.session.result
    assert result is not None
    walk.open("Errors")
    walk.page.axis.range.update(start=20.0, end=30.0)
    content = given(walk, shown._seen)
    assert len(content) < 200_000
    read = pd.read_csv(io.BytesIO(content), index_col=0)
    assert (read.index[0], read.index[-1], len(read)) == (20.0, 30.0, 501)
    errors = result.errors.sel(time=slice(20, 30))
    np.testing.assert_allclose(read["errors position east [m]"], errors.position.values[:, 0], rtol=1e-11)
    assert len([name for name in read if name.startswith("sigma ")]) == 9
    walk.open("Innovations")
    read = pd.read_csv(io.BytesIO(given(walk, shown._seen)), index_col=0)
    assert read.index.name == "time_gps [s]"
    assert 10 <= len(read) <= 11
    walk.page.axis.whole()


@pytest.mark.proof
@pytest.mark.parametrize(
    ("name", "reason"), [("_netcdf", "netCDF library could not write"), ("_csv", "File too large")]
)
def test_a_full_disk_is_told_and_hands_nothing_over(walk: Walk, name: str, reason: str) -> None:
    shown = files(walk)
    button: Download = getattr(shown, name)
    before = button._transfers
    with files_up_to(10_000):
        button._clicks += 1
        wait(walk)
    assert "The server could not write the file" in shown._job._after.text
    assert reason in shown._job._after.text
    assert button._transfers == before
    assert given(walk, button)


def test_a_report_has_the_verdict_and_no_address_of_another_file(walk: Walk) -> None:
    """Panel's extensions are loaded here; a report must not refer to their files."""
    html = given(walk, files(walk)._report).decode()
    result = walk.page.session.result
    assert result is not None
    assert result.verdict.headline.split(".")[0] in html
    assert "static/extensions" not in html
