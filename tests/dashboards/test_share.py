"""The menu Share: texts that repeat a run, files one at a time with progress, nothing of what is hidden."""

from __future__ import annotations

import io
import json
import shlex
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from html import unescape

import numpy as np
import pandas as pd
import pytest
from panel.io.state import set_curdoc

from dashboards import share
from dashboards.session import Held
from dashboards.share import Kind, ShareMenu, command_of, python_of
from lab.classroom.gallery.faults import FAULTS
from lab.classroom.gallery.faulty_experiment import FaultyExperiment
from lab.experiment.experiment import Experiment
from lab.views.run_comparison import assess
from tests.dashboards.walking import Walk, walking
from tests.views.export.test_full_disk import files_up_to

Given = list[tuple[str, bytes]]
PATIENCE = 240
"""Longest time that a process may take [s], with kernels to be compiled."""


@pytest.fixture(scope="module")
def walk() -> Iterator[Walk]:
    """Return a page with the result of a short flight."""
    with pytest.MonkeyPatch.context() as patch, walking(patch) as made:
        experiment = Experiment(mission="los_angeles")
        experiment.trajectory.imu_rate = 50.0
        made.page.session.experiment = experiment.copy()
        assert made.run(experiment).problem == ""
        yield made


def ask(walk: Walk, what: str) -> None:
    menu = walk.page._share.view
    with set_curdoc(walk._document):
        menu.asked = {"what": what, "count": menu.asked.get("count", 0) + 1}


def told(walk: Walk) -> dict[str, dict[str, str]]:
    ask(walk, "open")
    return walk.page._share.view.told


@pytest.fixture(autouse=True)
def files(monkeypatch: pytest.MonkeyPatch) -> Given:
    """Return the files that browsers get, with their names."""
    found: Given = []
    monkeypatch.setattr(ShareMenu, "give", lambda _self, name, content: found.append((name, content)))
    return found


def given(walk: Walk, what: str, files: Given) -> bytes:
    """Return what a browser gets for a click."""
    files.clear()
    ask(walk, what)
    wait(walk)
    ((_, content),) = files
    return content


def wait(walk: Walk) -> None:
    job, ended = walk.page._share._job, threading.Event()
    while job is not None and job.busy:
        ended.wait(0.01)
    walk.settle()


def test_nothing_is_sent_until_the_menu_is_opened(walk: Walk) -> None:
    assert walk.page._share.view.told["texts"] == {}
    assert walk.page._share._job is None


@pytest.mark.skipif(shutil.which("sh") is None, reason="this system has no shell that reads such a line")
@pytest.mark.proof
def test_the_command_and_the_python_repeat_the_run_to_the_last_digit(walk: Walk) -> None:
    changed = Experiment(mission="los_angeles", seed=7)
    changed.update({"trajectory.imu_rate": 50.0, "navigator.q_scale": 1 / 3})
    changed.update({"sensors.gps.outages": [(40.0, 60.0)], "sensors.gyro.bias": [0.1, -0.2, 1e-5]})
    walk.page.session.experiment = changed.copy()
    assert walk.run(changed).problem == ""
    expected = walk.page.session.result
    assert expected is not None
    texts = told(walk)["texts"]
    line = texts["command"].replace("ins-lab", f"{shlex.quote(sys.executable)} -m dashboards", 1)
    lines = f"{texts['python']}print(result.to_json())\n"
    for command in (["sh", "-c", f"{line} --json"], [sys.executable, "-c", lines]):
        done = subprocess.run(command, capture_output=True, check=False, timeout=PATIENCE)
        assert done.returncode == 0, done.stderr.decode()
        assert [row["rms"] for row in json.loads(done.stdout)["summary"]] == list(expected.summary["rms"])


@pytest.mark.parametrize("mission", ["it's mine", "a b; rm -rf ~", "$HOME", "-x"])
def test_a_command_is_quoted_for_a_shell(mission: str) -> None:
    made = Experiment(mission=mission).update({"sensors.gps.outages": [(1.0, 2.0)]})
    words = shlex.split(command_of(made))
    assert words[:2] == ["ins-lab", "run"]
    assert mission in words
    again = Experiment()
    again.set_texts([word for word in words if word.startswith("sensors.")])
    assert again.get("sensors.gps.outages") == [(1.0, 2.0)]
    names: dict[str, Experiment] = {}
    exec(python_of(made).rpartition("result =")[0], names)
    assert names["experiment"].to_dict() == made.to_dict()


def test_impatient_clicks_write_one_file_whose_progress_shows_at_once(
    walk: Walk, monkeypatch: pytest.MonkeyPatch, files: Given
) -> None:
    may_end, begun = threading.Event(), []

    def slow(_result: object, progress: share.Progress) -> bytes:
        begun.append(1)
        progress("Writing errors.csv", 0.5)
        may_end.wait(60)
        return b"PK"

    monkeypatch.setitem(share.FILES, "data", Kind("slow", "zip", slow))
    shared = walk.page._share
    for _ in range(4):
        ask(walk, "data")
        assert shared._job is not None
        assert shared._job._row.visible
    may_end.set()
    wait(walk)
    assert len(begun) == 1
    ((name, content),) = files
    assert (name.partition("_")[0], content) == ("los", b"PK")
    assert not shared._job._row.visible


def test_what_is_seen_is_the_visible_stretch_of_the_page(walk: Walk, files: Given) -> None:
    walk.open("Errors")
    walk.page.axis.range.update(start=20.0, end=30.0)
    result = walk.page.session.result
    assert result is not None
    content = given(walk, "seen", files)
    assert len(content) < 200_000
    read = pd.read_csv(io.BytesIO(content), index_col=0, comment="#")
    assert (read.index[0], read.index[-1], len(read)) == (20.0, 30.0, 501)
    errors = result.errors.sel(time=slice(20, 30))
    np.testing.assert_allclose(read["errors position east [m]"], errors.position.values[:, 0], rtol=1e-11)
    assert len([name for name in read if name.startswith("sigma ")]) == 9
    walk.open("Innovations")
    read = pd.read_csv(io.BytesIO(given(walk, "seen", files)), index_col=0, comment="#")
    assert read.index.name == "time_gps [s]"
    assert 10 <= len(read) <= 11
    walk.page.axis.whole()


def test_what_is_seen_of_a_comparison_is_its_table(walk: Walk, files: Given) -> None:
    walk.open("Compare")
    result = walk.page.session.result
    assert result is not None
    read = pd.read_csv(io.BytesIO(given(walk, "seen", files)), index_col=0, comment="#")
    assert list(read.index) == list(result.summary["quantity"])
    np.testing.assert_allclose(read["rms"], result.summary["rms"], rtol=1e-11)
    other = result.experiment.copy()
    other.set("navigator.q_scale", 0.1)
    walk.page.session.held = (Held("a, b", other.run()),)
    walk.settle()
    read = pd.read_csv(io.BytesIO(given(walk, "seen", files)), index_col=0, comment="#")
    assert list(read.index) == ["A · a, b", "Now"]
    for name, run in (("A · a, b", walk.page.session.held[0].result), ("Now", result)):
        found = assess(run)
        assert read.loc[name, "Verdict"] == found.verdict
        for column, value in found.values.items():
            assert read.loc[name, column.heading] == pytest.approx(value, rel=1e-11)
    walk.page.session.held = ()
    walk.settle()


@pytest.mark.proof
@pytest.mark.parametrize(
    ("what", "reason"), [("netcdf", "netCDF library could not write"), ("data", "File too large")]
)
def test_a_full_disk_is_told_and_hands_nothing_over(walk: Walk, what: str, reason: str, files: Given) -> None:
    assert given(walk, what, files)
    shared = walk.page._share
    assert shared._job is not None
    with files_up_to(10_000):
        ask(walk, what)
        wait(walk)
    assert "The server could not write the file" in shared._job._after.text
    assert reason in shared._job._after.text
    assert len(files) == 1
    assert given(walk, what, files)


def test_a_report_has_the_verdict_and_no_address_of_another_file(walk: Walk, files: Given) -> None:
    """Panel's extensions are loaded here; a report must not refer to their files."""
    html = given(walk, "report", files).decode()
    result = walk.page.session.result
    assert result is not None
    assert result.verdict.headline.split(".")[0] in unescape(html)
    assert "static/extensions" not in html


def test_the_json_is_that_of_python(walk: Walk, files: Given) -> None:
    result = walk.page.session.result
    assert result is not None
    assert given(walk, "json", files).decode() == result.to_json()


def test_without_a_result_only_what_needs_none_is_offered() -> None:
    with pytest.MonkeyPatch.context() as patch, walking(patch) as opened:
        found = told(opened)
        assert {"report", "seen", "json"} <= set(found["withheld"])
        assert "settings" not in found["withheld"]
        assert found["texts"]["command"] == "ins-lab run montreal"
        ask(opened, "report")
        assert opened.page._share._job is None


def test_of_a_run_that_hides_something_nothing_repeats_it_and_no_seed_is_told(
    files: Given,
) -> None:
    with pytest.MonkeyPatch.context() as patch, walking(patch) as opened:
        made = FaultyExperiment(FAULTS["latency"])
        made.update({"mission": "los_angeles", "seed": 4711, "navigator.q_scale": 0.5})
        with set_curdoc(opened._document):
            opened.page.session.accept(made)
        opened.show(made.run())
        found = told(opened)
        assert {"command", "python"} <= set(found["withheld"])
        assert found["texts"] == {"link": "?mission=los_angeles&navigator.q_scale=0.5"}
        assert "4711" in opened.sent()["search"]  # it is the address of one's own page
        settings = given(opened, "settings", files).decode()
        assert "seed" not in settings.partition("\n")[2]
        assert files[0][0] == "los_angeles.toml"
