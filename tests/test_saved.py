"""Saved: what version 0.1.0 wrote still opens: settings, links, missions, recordings, results, homework.

The files in `tests/saved` were written by that version, before its rooms were arranged anew.
"""

from __future__ import annotations

import gzip
import shutil
from pathlib import Path
from urllib.parse import urlencode

import numpy as np
import pytest
import xarray as xr
from flights import circle

from dashboards.drawn_pages import PAGES
from dashboards.query import experiment_of_query, view_of_query
from lab import Experiment, mission
from lab.classroom.homework.grading import GRADED, grade, list_files
from lab.classroom.homework.homework_file import read_homework, read_key
from lab.classroom.lessons.lesson_file import read_lesson
from lab.live import open as open_source

SAVED = Path(__file__).with_name("saved")


def expected() -> Experiment:
    """Return the settings that were saved, as a person would set them."""
    experiment = Experiment(mission="los_angeles", seed=42)
    experiment.sensors.gyro.noise_density = 0.02
    experiment.sensors.gyro.bias_sigma = (0.1, 0.2, 0.3)
    experiment.sensors.gps.outages = [(30.0, 50.0)]
    experiment.sensors.gps.lever_arm = (1.0, 0.0, -0.5)
    experiment.sensors.gps.latency = 0.1
    experiment.navigator.states = 21
    experiment.navigator.model = "psi"
    experiment.navigator.gate = 0.999
    experiment.navigator.smoother = True
    experiment.trajectory.imu_rate = 50
    return experiment


def test_a_settings_file_opens() -> None:
    assert Experiment.from_toml(SAVED / "settings.toml").to_dict() == expected().to_dict()


def test_a_link_opens() -> None:
    opened, problems = experiment_of_query((SAVED / "link.txt").read_text("utf-8").strip())
    assert problems == []
    assert opened.to_dict() == expected().to_dict()


def test_a_mission_opens_with_its_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("INS_LAB_MISSIONS", str(tmp_path))
    for name in ("short_circle.toml", "short_circle.csv.gz"):
        shutil.copy(SAVED / name, tmp_path)
    opened = mission("short_circle")
    assert opened.description == 'Two lines:\n"one" and two'
    assert opened.tags == ("turn",)
    flown = circle(samples=300)
    np.testing.assert_allclose(opened.recording.latitude, flown.latitude, atol=1e-13)
    np.testing.assert_allclose(opened.recording.velocity_n, flown.velocity_n, atol=1e-6)


FILTERED = (
    *("solution", "errors", "sigma", "state_sigma", "track", "sensor_errors"),
    *("innovations", "autocorrelation", "consistency"),
)
"""Datasets that depend on the filter."""


def test_a_result_opens_and_its_settings_give_the_same_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All that the file of version 0.1.0 holds is in one of today, under the same names and units.

    The flight and what the sensors measure are the same. The filter has learnt since then: since a correction
    turns its covariance, its errors differ by 0.04 σ at most.
    """
    monkeypatch.setenv("INS_LAB_MISSIONS", str(tmp_path))
    for name in ("short_circle.toml", "short_circle.csv.gz"):
        shutil.copy(SAVED / name, tmp_path)
    was, now = tmp_path / "was.nc", tmp_path / "now.nc"
    was.write_bytes(gzip.decompress((SAVED / "short_result.nc.gz").read_bytes()))
    with xr.open_datatree(was, engine="netcdf4") as old:
        Experiment.from_toml(old.attrs["settings"]).run().to_netcdf(now)
        with xr.open_datatree(now, engine="netcdf4") as new:
            assert old.children.keys() <= new.children.keys()
            for name, group in old.children.items():
                for quantity, values in group.data_vars.items():
                    today = new[name][quantity]
                    assert values.attrs.get("units") == today.attrs.get("units")
                    if name in FILTERED:
                        assert np.sqrt(np.mean((today - values) ** 2)) <= 0.05 * values.std(), (
                            name,
                            quantity,
                        )
                    else:
                        np.testing.assert_allclose(
                            today, values, rtol=1e-6, atol=1e-9, err_msg=f"{name} {quantity}"
                        )


def test_a_lesson_of_before_and_a_link_to_each_of_its_pages_open_what_took_their_place() -> None:
    titles = [page.title for page in PAGES]
    steps = read_lesson(SAVED / "lesson.toml").steps
    assert [step.page for step in steps if step.page not in titles] == []
    for step in steps:
        view, problems = view_of_query(urlencode({"tab": step.title}), titles)
        assert (view.tab, problems) == (step.page, [])
    now = {step.title: step.page for step in steps if step.page != step.title}
    assert now == {
        "Consistency": "Verdict",
        "Sensor errors": "States",
        "Models": "Compare",
        "Height": "Flight",
        "Summary": "Compare",
    }


def test_a_recording_of_a_stream_is_played_again() -> None:
    with open_source(f"replay:{SAVED / 'drive.inslab'}?speed=max") as source:
        while not source.ended:
            source.wait(source.end, 1.0)
        found = source.since(None)
    assert len(found.imu) > 100
    steps = np.diff(found.imu["time"])
    np.testing.assert_allclose(steps, np.median(steps), rtol=0.01)
    force = np.linalg.norm(found.imu["force"], axis=1).mean()
    assert force == pytest.approx(9.8, rel=0.02)  # an aeroplane before its take-off


@pytest.mark.proof
def test_a_homework_is_worked_with_and_its_hand_ins_are_graded(tmp_path: Path) -> None:
    key = shutil.copy(SAVED / "receiver.key", tmp_path)
    handed = tmp_path / "handed_in"
    handed.mkdir()
    shutil.copy(SAVED / "ada.handin", handed)
    homework = read_homework(SAVED / "receiver.homework")
    assert read_key(Path(key)).homework == homework
    (row,) = grade(list_files(handed), read_key(Path(key)))
    assert (row["file"], row["name"], row["status"]) == ("ada.handin", "Ada Lovelace", GRADED)
    assert float(row["points"]) >= 2  # for the fault, which is the right one
