"""The page Numbers: files of a visitor, logs of the library, lines for programs, and what is refused."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from panel.io.state import set_curdoc
from sensor_logs import IMU, tables, write, write_csv
from walking import Walk, send, walking

from dashboards.pages import numbers as page_of_numbers
from dashboards.pages.numbers import NO_DRIVE, OWN_REST, Numbers
from dashboards.upload import PREFIX
from lab.experiment.experiment import Experiment
from lab.experiment.imu_numbers import numbers

NOISE = 1e-3
"""White noise of a sample of the gyros at 100 Hz [rad/s]."""


@pytest.fixture
def library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "missions"
    folder.mkdir()
    monkeypatch.setenv("INS_LAB_MISSIONS", str(folder))
    write(folder / "round_trip", tables(20, 100))
    return folder


@pytest.fixture
def walk(library: Path) -> Iterator[Walk]:
    with pytest.MonkeyPatch.context() as patch, walking(patch) as opened:
        experiment = Experiment(mission="los_angeles")
        experiment.set("trajectory.imu_rate", 20)
        opened.page.session.experiment = experiment
        assert opened.run(experiment).problem == ""
        opened.open("Numbers")
        yield opened


def part(walk: Walk) -> Numbers:
    found = walk.shown
    assert isinstance(found, Numbers)
    return found


def find(walk: Walk) -> None:
    with set_curdoc(walk._document):
        part(walk).start()
    walk.wait(lambda: not part(walk).job.busy)


def still(path: Path) -> Path:
    rng = np.random.default_rng(1)
    rows = rng.normal(scale=[NOISE] * 3 + [0.02] * 3, size=(20_000, 6)) - [0, 0, 0, 0, 0, 9.8]
    write_csv(path, IMU, np.column_stack((np.arange(20_000) / 100, rows)))
    return path


def upload(walk: Walk, name: str, path: Path) -> None:
    with set_curdoc(walk._document):
        send(part(walk)._uploads[name], path)
    walk.settle()


def test_a_file_at_rest_gives_its_noise_and_lines_to_paste(walk: Walk, tmp_path: Path) -> None:
    upload(walk, "still", still(tmp_path / "still.csv"))
    find(walk)
    row = part(walk)._found.row("gyro", "white noise")  # type: ignore[union-attr]
    assert np.radians(row.used) == pytest.approx(NOISE / np.sqrt(100), rel=0.02)  # N = σ √Δt
    text = walk.text()
    for words in ("At rest: still.csv. In motion: unknown", "gyroscope_noise_density", "there is no drive"):
        assert words in text
    with set_curdoc(walk._document):
        part(walk)._program.value = "px4"
    walk.settle()
    assert "EKF2_GYR_NOISE" in walk.text()
    assert part(walk)._lines.encode() == part(walk)._download.callback().getvalue()
    assert PREFIX not in walk.text() + part(walk)._lines  # nobody is told where the file was put
    assert not walk.complaints()


@pytest.mark.proof
def test_logs_of_the_library_give_the_numbers_of_the_command(
    walk: Walk, library: Path, tmp_path: Path
) -> None:
    upload(walk, "still", still(tmp_path / "still.csv"))
    with set_curdoc(walk._document):
        part(walk)._drive.value = "round_trip"
    find(walk)
    assert "In motion: round_trip" in walk.text()
    wanted = numbers(tmp_path / "still.csv", "round_trip")
    assert [row.used for row in part(walk)._found.rows] == [row.used for row in wanted.rows]  # type: ignore[union-attr]


def test_what_cannot_be_used_is_said_and_the_numbers_stay(walk: Walk, library: Path, tmp_path: Path) -> None:
    find(walk)
    assert "Choose a log" in part(walk).job._after.text
    upload(walk, "still", still(tmp_path / "still.csv"))
    find(walk)
    notes = tmp_path / "notes.csv"
    notes.write_text("a,b\n1,x\n")
    upload(walk, "still", notes)
    find(walk)
    assert "notes.csv" in part(walk).job._after.text
    assert PREFIX not in part(walk).job._after.text
    assert "At rest: still.csv" in walk.text()
    for select, sent in (("_still", "../../etc/passwd"), ("_drive", "montreal"), ("_drive", "nowhere")):
        with set_curdoc(walk._document):
            part(walk)._still.value, part(walk)._drive.value = OWN_REST, NO_DRIVE
            getattr(part(walk), select).param.update(options=[sent, OWN_REST, NO_DRIVE], value=sent)
        find(walk)
        assert "is not a log among the missions" in part(walk).job._after.text
    assert not walk.complaints()


def test_a_log_that_is_imported_meanwhile_is_offered(walk: Walk, library: Path) -> None:
    assert "round_trip" in part(walk)._drive.options.values()
    write(library / "another", tables(20, 40))
    with set_curdoc(walk._document):
        part(walk).appear()
    assert "another" in part(walk)._drive.options.values()
    assert part(walk)._drive.value == NO_DRIVE


def test_what_is_found_after_the_page_has_closed_is_not_shown(
    walk: Walk, tmp_path: Path, monkeypatch
) -> None:
    page, began = part(walk), []
    monkeypatch.setattr(page_of_numbers, "numbers", lambda *_: began.append(1))
    upload(walk, "still", still(tmp_path / "still.csv"))
    with set_curdoc(walk._document):
        page.start()
        page.close()
    walk.wait(lambda: not page.job.busy)
    assert page._found is None
