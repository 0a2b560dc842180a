"""Recordings from the page Live: quick clicks, two pages, an unplugged device, a source that ends."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import dashboards.pages.live.live as live_module
from dashboards import devices, visitors
from dashboards.devices import allow_devices
from dashboards.pages.live.recorder import Recorder
from lab.live.raw_recording import SUFFIX
from lab.live.recorded_log import recorded_samples
from lab.live.source_status import LOST
from lab.logs import sensor_log
from lab.missions import mission
from lab.missions.catalogue import OWN_FOLDER_VARIABLE
from lab.missions.log_mission import LogMission
from tests.dashboards.test_live_page import Opened, wait_until_nothing_is_left

ADDRESS = "simulated:rest?device=vectornav&hz=50&rest=60"


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], Opened]]:
    """Return what opens pages that are connected to one device on a table."""
    monkeypatch.setattr(devices, "_decided", {})
    allow_devices([ADDRESS])
    pages: list[Opened] = []

    def open_one() -> Opened:
        one = Opened(monkeypatch)
        pages.append(one)
        one.page._fields.refresh()
        one.page._fields._source.value = ADDRESS
        one.connect()
        return one

    yield open_one
    for one in pages:
        one.close()
    wait_until_nothing_is_left()


@pytest.fixture(autouse=True)
def folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Return the empty folder of a user who may record."""
    monkeypatch.setenv(OWN_FOLDER_VARIABLE, str(tmp_path))
    monkeypatch.setattr(visitors, "_decided", {visitors.VARIABLE: "edit"})
    monkeypatch.setattr(sensor_log, "MIN_OVERLAP", 1.0)  # a mission of seconds
    return tmp_path


def recorder(one: Opened) -> Recorder:
    return one.page._recorder


def said(one: Opened) -> str:
    return recorder(one)._job._after.text


def clicked(one: Opened) -> None:
    """Click on the button, and let the page work."""
    recorder(one)._toggle()
    one.run()


def test_quick_clicks_lose_no_recording(opened: Callable[[], Opened], folder: Path) -> None:
    one = opened()
    told: list[str] = []
    for _ in range(30):
        clicked(one)
        told.append(said(one))
    one.until(lambda: not recorder(one)._job.busy)
    one.run()
    told.append(said(one))
    assert one.page._station is not None
    assert one.page._station.source.recording is None
    files = sorted(folder.glob(f"*{SUFFIX}"))
    assert len(files) == 15
    # So short, none has what a log needs; each is accounted for.
    assert all(any(path.name in text and "No mission" in text for text in told) for path in files)


def test_a_page_ends_its_own_recording_only(opened: Callable[[], Opened]) -> None:
    first, second = opened(), opened()
    clicked(first)
    assert first.page._station is not None
    source = first.page._station.source
    clicked(second)
    assert "is being recorded; stop it first" in said(second)
    source.stop_recording()  # as a full disk does
    clicked(second)
    running = source.recording
    assert running is not None
    clicked(first)  # it still shows Stop
    assert source.recording == running
    assert recorder(second)._path == running
    first.page.close()
    assert source.recording == running


def test_a_device_that_is_unplugged_is_recorded_when_it_comes_back(
    opened: Callable[[], Opened], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_module, "AWAY", 0.3)
    other, one = opened(), opened()
    station = one.page._station
    assert station is not None
    other.page._pull_plug()
    other.close()  # the page that pulled the plug is gone, the device comes back all the same
    one.until(lambda: station.status.state == LOST)
    clicked(one)
    begun = station.source.end
    one.until(lambda: station.source.end.fix > begun.fix + 3)
    name = recorder(one)._path
    assert name is not None
    clicked(one)
    one.until(lambda: "in the library" in said(one))
    made = mission(said(one).split()[0])
    assert isinstance(made, LogMission)
    assert made.log.time.size >= len(recorded_samples(name).imu) - 2 > 50


def test_a_recording_whose_source_ends_becomes_a_mission(opened: Callable[[], Opened]) -> None:
    one = opened()
    station = one.page._station
    assert station is not None
    clicked(one)
    begun = station.source.end
    one.until(lambda: station.source.end.fix > begun.fix + 3)
    station.source.close()
    one.until(lambda: "in the library" in said(one))
    assert recorder(one)._button.label == "Record"
