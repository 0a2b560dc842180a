"""The upload of a recording at rest: its Allan deviation, its card, and what is wrong with it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from panel.io.state import set_curdoc
from walking import PATIENCE, PAUSE, Walk, walking

from dashboards.pages import rest_upload
from dashboards.pages.allan import Allan
from dashboards.pages.rest_upload import RestRecording
from lab.base.progress import Progress
from lab.experiment.experiment import Experiment
from lab.sensors.cards import read_cards

RATE = 100.0
NOISE = 0.02
"""White noise of the gyros [°/s/√Hz]."""


@pytest.fixture
def walk() -> Iterator[Walk]:
    with pytest.MonkeyPatch.context() as patch, walking(patch) as opened:
        experiment = Experiment(mission="los_angeles")
        experiment.set("trajectory.imu_rate", 20)
        opened.page.session.experiment = experiment
        assert opened.run(experiment).problem == ""
        opened.open("Allan")
        yield opened


def part(walk: Walk) -> Allan:
    found = walk.shown
    assert isinstance(found, Allan)
    return found


def upload(walk: Walk, *files: Path) -> None:
    with set_curdoc(walk._document):
        part(walk)._upload._read(list(files))
    walk.wait(lambda: not part(walk)._upload._job.busy)


def recording(path: Path, gyros_alone: bool = False, moves: bool = False) -> Path:
    rng, n = np.random.default_rng(1), int(300 * RATE)
    rate = NOISE * np.sqrt(RATE) * rng.standard_normal((n, 3))
    force = 0.002 * np.sqrt(RATE) * rng.standard_normal((n, 3)) - (0, 0, 9.81)
    if moves:
        rate += 40 * np.sin(np.arange(n) / RATE)[:, None]
    columns = [np.arange(n) / RATE, *rate.T, *([] if gyros_alone else force.T)]
    names = "t_s,gx_deg_s,gy_deg_s,gz_deg_s" + ("" if gyros_alone else ",fx_m_s2,fy_m_s2,fz_m_s2")
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=names, comments="", fmt="%.9g")
    return path


def test_a_recording_takes_the_place_of_the_simulation_and_becomes_a_card(walk: Walk, tmp_path: Path) -> None:
    assert "simulated at rest" in walk.text()
    upload(walk, recording(tmp_path / "still.csv"))
    assert "still.csv: 300 s at rest" in walk.text()
    fitted = part(walk)._content[1].terms["gyro"]  # type: ignore[index]
    white = np.degrees(fitted.N)
    assert white == pytest.approx(NOISE, rel=0.1)
    maker = part(walk)._upload._maker
    with set_curdoc(walk._document):
        maker.start()
    walk.wait(lambda: maker.download.visible)
    path = tmp_path / "cards.toml"
    path.write_bytes(maker._file().getvalue())
    (made,) = read_cards(path).values()
    assert made.value("gyro", "noise_density") == pytest.approx([NOISE] * 3, rel=0.1)
    with set_curdoc(walk._document):
        part(walk)._upload._take(None)
    walk.settle()
    assert "simulated at rest" in walk.text()
    assert not maker.download.visible
    assert not walk.complaints()


def test_gyros_alone_are_enough(walk: Walk, tmp_path: Path) -> None:
    upload(walk, recording(tmp_path / "gyros.csv", gyros_alone=True))
    assert "gyros.csv: 300 s at rest" in walk.text()
    assert "Accelerometers: White noise" not in walk.text()
    assert not walk.complaints()


def test_what_is_no_recording_at_rest_is_refused_and_the_page_stays(walk: Walk, tmp_path: Path) -> None:
    text = tmp_path / "notes.csv"
    text.write_text("a,b\n1,x\n")
    for wrong, said in ((recording(tmp_path / "drive.csv", moves=True), "rest"), (text, "notes.csv")):
        upload(walk, wrong)
        assert said in part(walk)._upload._job._after.text
        assert "simulated at rest" in walk.text()


def test_what_is_read_after_the_page_has_closed_is_not_shown(walk: Walk, tmp_path: Path) -> None:
    page, path = part(walk), recording(tmp_path / "late.csv")
    read: list[Path] = []
    whole = rest_upload._recording

    def slow(files: list[Path], progress: Progress) -> RestRecording:
        page._upload.close()
        found = whole(files, progress)
        read.extend(files)
        return found

    with pytest.MonkeyPatch.context() as patch, set_curdoc(walk._document):
        patch.setattr(rest_upload, "_recording", slow)
        page._upload._read([path])
        until = time.monotonic() + PATIENCE
        while not read:
            assert time.monotonic() < until
            time.sleep(PAUSE)
    walk.settle()
    assert page._upload.recording is None
