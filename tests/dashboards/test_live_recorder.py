"""Recordings from the page Live: quick clicks, two pages, an unplugged device, a source that ends."""

from __future__ import annotations

import errno
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import pytest

import dashboards.pages.live.live as live_module
import dashboards.pages.live.recorder as recorder_module
from dashboards import devices, visitors
from dashboards.devices import allow_devices
from dashboards.pages.live.recorder import Recorder
from lab.base.files.locks import LOCK_FILE
from lab.data.log import sensor_log
from lab.data.streams import unfinished
from lab.data.streams.raw_recording import SUFFIX
from lab.data.streams.recorded_log import recorded_samples
from lab.data.streams.source_status import LOST
from lab.live.station import Station
from lab.missions import mission, missions
from lab.missions.catalogue import OWN_FOLDER_VARIABLE
from lab.missions.log_mission import LogMission
from tests.dashboards.test_live_page import PATIENCE, Opened, wait_until_nothing_is_left

ADDRESS = "simulated:rest?device=vectornav&hz=50&rest=240"


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

    open_one.pages = pages  # type: ignore[attr-defined]
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
    """Click on the button that shows, and let the page work."""
    shown = [button for button in (recorder(one)._record, recorder(one)._stop) if button.visible]
    assert len(shown) == 1
    shown[0].clicks += 1
    one.run()


def records(one: Opened) -> bool:
    """Return whether a page shows that a recording runs."""
    return bool(recorder(one)._stop.visible)


def test_quick_clicks_lose_no_recording(
    opened: Callable[[], Opened], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sensor_log, "MIN_OVERLAP", 600.0)  # none becomes a mission, however slow the clicks
    one = opened()
    told: list[str] = []
    job = recorder(one)._job
    say = job.say
    # Of two messages in one turn of the page, the field holds the second.
    monkeypatch.setattr(job, "say", lambda text, *how: (told.append(text), say(text, *how)))
    for _ in range(30):
        clicked(one)
    one.until(lambda: not job.busy)
    one.run()
    assert one.page._station is not None
    assert one.page._station.source.recording is None
    files = sorted(folder.glob(f"*{SUFFIX}"))
    assert len(files) == 15
    # None has what a log needs; each is accounted for.
    assert all(any(path.name in text and "No mission" in text for text in told) for path in files)


@pytest.mark.proof
def test_two_pages_share_one_recording(opened: Callable[[], Opened], folder: Path) -> None:
    first, second = opened(), opened()
    station = first.page._station
    assert station is not None
    assert station is second.page._station
    clicked(first)
    begun = station.source.end
    clicked(second)  # both at once: it has not shown the other's recording yet
    assert "Another page records" in said(second)
    assert records(first)
    assert records(second)
    assert len(list(folder.glob(f"*{SUFFIX}"))) == 1
    first.until(lambda: station.source.end.fix > begun.fix + 3)
    clicked(second)  # who did not begin it may stop it
    assert station.source.recording is None
    first.until(lambda: "to the library" in said(first))
    second.until(lambda: "to the library" in said(second))
    assert not records(first)
    assert not records(second)
    assert said(first) == said(second)
    assert len([name for name in missions() if name.startswith("recording")]) == 1


@pytest.mark.proof
def test_record_pressed_on_two_pages_at_once_records(opened: Callable[[], Opened], folder: Path) -> None:
    """The second click was made on a Record that shows no more when the server learns of it."""
    first, second = opened(), opened()
    station = first.page._station
    assert station is not None
    clicked(first)
    running = station.source.recording
    second.until(lambda: records(second))
    recorder(second)._record.clicks += 1
    recorder(first)._record.clicks += 1  # as of a double click
    for one in (first, second):
        one.run()
        assert records(one)
    assert station.source.recording == running
    assert len(list(folder.glob(f"*{SUFFIX}"))) == 1


@pytest.mark.proof
def test_a_page_that_leaves_does_not_end_what_others_watch(opened: Callable[[], Opened]) -> None:
    first, second = opened(), opened()
    clicked(first)
    assert first.page._station is not None
    running = first.page._station.source.recording
    first.close()  # as its reload does
    second.until(lambda: recorder(second)._path == running)
    assert second.page._station is not None
    assert second.page._station.source.recording == running


def recording(one: Opened) -> Station:
    """Press Record, wait for a few fixes, and return what is recorded."""
    station = one.page._station
    assert station is not None
    clicked(one)
    begun = station.source.end
    one.until(lambda: station.source.end.fix > begun.fix + 3)
    return station


def begun_and_left(opened: Callable[[], Opened], monkeypatch: pytest.MonkeyPatch) -> Recorder:
    """Return the recorder of a page that was opened after the only one had gone amid a recording."""
    monkeypatch.setattr(unfinished, "RUNS", 0.0)
    one = opened()
    recording(one)
    one.close()
    wait_until_nothing_is_left()
    again = opened()
    again.page.appear()
    return recorder(again)


@pytest.mark.proof
def test_a_recording_of_a_page_that_was_reloaded_becomes_a_mission(
    opened: Callable[[], Opened], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = begun_and_left(opened, monkeypatch)
    assert found.offer._offer.visible
    assert found.offer._name.value == "recording"
    found.offer._name.value = "../evil"
    found.offer._finish()
    assert "../evil" in found._job._after.text
    found.offer._name.value = "after the reload"
    found.offer._finish()
    page = next(one for one in opened.pages if recorder(one) is found)  # type: ignore[attr-defined]
    page.until(lambda: "to the library" in found._job._after.text)
    assert isinstance(mission("after the reload"), LogMission)
    found.offer.refresh()
    assert not found.offer._offer.visible
    assert len(list(folder.glob(f"*{SUFFIX}"))) == 1


@pytest.mark.proof
def test_an_unfinished_recording_that_was_discarded_comes_back_with_its_bytes(
    opened: Callable[[], Opened], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = begun_and_left(opened, monkeypatch)
    (path,) = folder.glob(f"*{SUFFIX}")
    before = path.read_bytes()
    found.offer._discard()
    assert not list(folder.glob(f"*{SUFFIX}*"))
    assert not found.offer._offer.visible
    assert found.offer._back.visible
    found.offer._bring_back()
    assert path.read_bytes() == before
    assert found.offer._offer.visible
    assert not found.offer._back.visible
    found.offer._bring_back()  # once
    found.offer._discard()
    found.close()
    assert [one.name for one in folder.glob("*")] == [LOCK_FILE]


@pytest.mark.proof
def test_a_device_that_is_unplugged_is_recorded_when_it_comes_back(
    opened: Callable[[], Opened], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_module, "AWAY", 3600.0)
    other, one = opened(), opened()
    station = one.page._station
    assert station is not None
    device = station.source.device
    assert device is not None
    other.page._pull_plug()
    other.close()  # the page that pulled the plug is gone, the device comes back all the same
    one.until(lambda: station.status.state == LOST)
    clicked(one)
    device._back -= 3600.0  # the time is over only now, however slow this computer is
    begun = station.source.end
    one.until(lambda: station.source.end.fix > begun.fix + 3)
    name = recorder(one)._path
    assert name is not None
    clicked(one)
    one.until(lambda: "to the library" in said(one))
    made = mission(recorder(one)._saved)
    assert isinstance(made, LogMission)
    assert made.log.time.size >= len(recorded_samples(name).imu) - 2 > 50


@pytest.mark.proof
def test_a_recording_whose_source_ends_becomes_a_mission(opened: Callable[[], Opened]) -> None:
    one = opened()
    station = recording(one)
    station.source.close()
    one.until(lambda: "to the library" in said(one))
    assert not records(one)
    went: list[str | None] = []
    one.session.go = lambda page, _time: went.append(page)
    made = recorder(one)._saved
    assert f"“{made}”" in said(one)
    assert recorder(one)._open.visible
    recorder(one)._open.clicks += 1
    assert one.session.experiment.mission == made
    assert went == ["Overview"]
    assert not recorder(one)._open.visible
    assert not said(one)


def test_a_recording_in_work_is_offered_to_nobody(
    opened: Callable[[], Opened], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The source ends while one page stands still, and another one is open beside it."""
    monkeypatch.setattr(unfinished, "RUNS", 0.0)
    may_go_on = threading.Event()
    add_log = recorder_module.add_log
    monkeypatch.setattr(
        recorder_module, "add_log", lambda *args, **how: may_go_on.wait(PATIENCE) and add_log(*args, **how)
    )
    one, other = opened(), opened()
    station = recording(one)
    one.page._stop_or_go()  # no tick comes any more
    path = recorder(one)._path
    station.source.close()
    one.page._look()
    assert not records(one)
    try:
        for page in (one, other):
            offer = recorder(page).offer
            offer.refresh()
            assert not offer._offer.visible
            for clicks, answer in (
                ((offer._discard,), "a mission is made of it"),
                ((offer._finish,), "Another page"),
            ):
                offer._choice.options, offer._choice.value = {"late": path}, path  # as it was offered before
                for click in clicks:
                    click()
                assert answer in said(page)
            assert list(folder.glob(f"*{SUFFIX}")) == [path]
    finally:
        may_go_on.set()
    one.until(lambda: "to the library" in said(one))


@pytest.mark.proof
@pytest.mark.parametrize("ends_by_itself", [False, True])
def test_what_a_full_disk_lost_is_told_with_the_mission(
    opened: Callable[[], Opened], monkeypatch: pytest.MonkeyPatch, *, ends_by_itself: bool
) -> None:
    """The last bytes cannot be written: with Stop, or while it records."""
    one = opened()
    station = recording(one)
    writer = station.source._recorder.writer
    assert writer is not None
    if ends_by_itself:
        monkeypatch.setattr("lab.data.streams.raw_recording.SPARE", 1 << 62)  # no disk has so much
        one.until(lambda: "to the library" in said(one))
        assert "are free on the disk" in said(one)
    else:
        file = writer._file
        assert file is not None
        monkeypatch.setattr(writer, "_file", FullAtTheEnd(file))
        clicked(one)
        one.until(lambda: "to the library" in said(one))
        assert "cannot be written any more: No space left on device" in said(one)
    assert recorder(one)._job._after.view.severity == "warning"
    assert "what was written stays" in station.recorded


class FullAtTheEnd:
    """A file of a disk that is full once the file is closed."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)

    def close(self) -> None:
        """Close it, and fail."""
        self._file.close()
        raise OSError(errno.ENOSPC, "No space left on device")
