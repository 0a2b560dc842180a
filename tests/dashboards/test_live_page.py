"""The page Live: sources that are allowed, shared, paused, unplugged and left."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from bokeh.document import Document
from xplane_simulator import XPlaneSimulator, montreal

import dashboards.pages.live.live as live_module
from dashboards import devices, phones
from dashboards.devices import STATIONS, allow_devices, allowed_devices
from dashboards.openings import may_not_end
from dashboards.pages.live import Live
from dashboards.pages.live.source_fields import PHONE, SIMULATED, WATCHED
from dashboards.serve_command import free_port
from dashboards.session import Session
from lab.data.streams.source_status import LOST, STREAMING
from lab.data.streams.transport import TransportError
from lab.live.live_state import WAITING
from lab.live.owner import Visitor
from lab.live.station import Station
from lab.live.stations import Stations
from lab.views.figures import TimeAxis

PATIENCE = 120.0
"""Longest time to wait for what must happen [s]: build machines are slow, and a first start compiles."""


class Opened:
    """A page in a document of its own, whose callbacks a test runs."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.document = Document()
        monkeypatch.setattr(type(live_module.pn.state), "curdoc", self.document)
        self.session = Session(self.document)
        self.page = Live(TimeAxis(), self.session)
        self.document.add_root(self.page.view.get_root())
        self.page.appear()

    def run(self) -> None:
        """Run what waits for its turn, and one tick."""
        for callback in list(self.document.session_callbacks):
            if "NextTick" in type(callback).__name__:
                work = callback.callback  # a callback that was removed may be empty
                self.document.remove_next_tick_callback(callback)
                work()
        if self.page._periodic is not None:
            self.page._refresh_page()

    def until(self, happened: Callable[[], bool]) -> None:
        """Run the page until something has happened."""
        end = time.monotonic() + PATIENCE
        while not happened():
            assert time.monotonic() < end, self.page._job._after.text
            self.run()
            time.sleep(0.02)

    def connect(self) -> Station:
        """Connect, and wait until samples come."""
        self.page._toggle()
        self.until(lambda: self.page._station is not None and self.page._station.source.end.imu > 20)
        assert self.page._station is not None
        return self.page._station

    def close(self) -> None:
        """End the page and its session."""
        self.page.close()
        self.session.close()


def threads() -> list[str]:
    """Return the threads of sources and stations."""
    return [
        one.name
        for one in threading.enumerate()
        if one.name.startswith(("live ", "station ", "verdict ", "simulated device"))
    ]


def wait_until_nothing_is_left() -> None:
    """Wait until no source is open and its threads have ended; pages leave them to another thread."""
    end = time.monotonic() + PATIENCE
    while STATIONS.keys() or threads():
        assert time.monotonic() < end, threads()
        time.sleep(0.01)


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], Opened]]:
    """Return what opens pages; they are closed in the end, and nothing is left."""
    pages: list[Opened] = []

    def open_one() -> Opened:
        pages.append(Opened(monkeypatch))
        return pages[-1]

    yield open_one
    for one in pages:
        one.close()
    wait_until_nothing_is_left()


def shown(page: Live) -> np.ndarray:
    """Return time and values of the specific force in the plot, as they were sent to the browser."""
    return np.concatenate([np.empty((0, 4)), *page._figures._force._kept])


def columns(page: Live) -> int:
    return len(shown(page))


def test_the_simulated_device_is_shown_and_navigated_with(opened: Callable[[], Opened]) -> None:
    one = opened()
    station = one.connect()
    one.until(lambda: station.status.state == STREAMING)
    one.until(lambda: columns(one.page) > 30)
    one.until(lambda: "streaming" in one.page._status.strip.object.lower())
    assert abs(float(np.nanmedian(shown(one.page)[:, 3])) + 9.8) < 1
    one.page._toggle()
    assert one.page._station is None
    one.until(lambda: not STATIONS.keys())


def test_two_pages_share_one_source(opened: Callable[[], Opened]) -> None:
    first, second = opened(), opened()
    station = first.connect()
    assert not may_not_end(second.page._document)
    assert second.connect() is station
    assert may_not_end(second.page._document)
    first.page._toggle()
    assert STATIONS.keys()
    assert not station.source.ended
    third = opened()
    watch = next(value for value in third.page._fields._offers().values() if value.startswith(WATCHED))
    third.page._fields._source.value = watch
    assert third.connect() is station
    for one in (second, third):
        one.page._toggle()
    first.until(lambda: station.source.ended)


@pytest.mark.proof
def test_devices_of_one_name_are_told_apart(opened: Callable[[], Opened]) -> None:
    first, second = opened(), opened()
    second.session.experiment.seed = 2
    assert first.connect() is not second.connect()
    watched = [name for name in opened().page._fields._offers() if name.startswith("Watch: ")]
    assert len(watched) == 2
    assert watched[1] == f"{watched[0]} (2)"


@pytest.mark.proof
def test_a_paused_page_loses_nothing(opened: Callable[[], Opened]) -> None:
    one = opened()
    one.page._window.value = "4 min"  # a busy computer may take longer than the 20 s that are shown else
    station = one.connect()
    one.until(lambda: columns(one.page) > 10)
    one.page._stop_or_go()
    before = columns(one.page)
    reached = station.source.end.imu
    one.until(lambda: station.source.end.imu > reached + 100)
    assert columns(one.page) == before
    one.page._stop_or_go()
    one.until(lambda: columns(one.page) > before + 30)
    times = shown(one.page)[:, 0]
    assert np.diff(times).max() < 0.5
    assert times[0] < 1.0


def test_a_page_that_is_closed_while_it_connects_leaves_nothing(
    opened: Callable[[], Opened], monkeypatch: pytest.MonkeyPatch
) -> None:
    one = opened()
    begun, closed, left = threading.Event(), threading.Event(), threading.Event()
    chosen = one.page._fields.chosen()

    def slow() -> Station:
        begun.set()
        assert closed.wait(PATIENCE)
        return chosen.make()

    leave = STATIONS.leave

    def leaving(key: str, watcher: object) -> None:
        leave(key, watcher)
        left.set()

    monkeypatch.setattr(STATIONS, "leave", leaving)
    one.page._start(chosen._replace(make=slow))
    assert begun.wait(PATIENCE)
    one.page.close()
    closed.set()
    assert left.wait(PATIENCE)
    one.until(lambda: not STATIONS.keys())


def test_a_hidden_page_does_nothing(opened: Callable[[], Opened]) -> None:
    one = opened()
    one.connect()
    one.page.hide()
    assert one.page._periodic is None
    one.page.appear()
    assert one.page._periodic is not None


def test_unplugging_is_shown(opened: Callable[[], Opened], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_module, "AWAY", 0.0)
    one = opened()
    station = one.connect()
    assert one.page._unplug.visible
    one.until(lambda: station.state.phase != WAITING)  # the navigator starts later than the source
    device = station.source.device
    assert device is not None
    device.unplug()
    one.until(lambda: station.status.state == LOST)
    one.page._report()
    assert "lost" in one.page._status.strip.object
    # No sample comes: what the navigator said of the last one does not hold now.
    one.page._status._turn()
    assert "Before: " in one.page._status.details.object
    assert "with the last samples" in one.page._status.details.object
    assert "stands" in one.page._readout.view.object  # as do the large digits
    device.plug()
    reached = station.source.end.imu
    one.until(lambda: station.source.end.imu > reached)


def test_only_allowed_sources_are_opened(
    opened: Callable[[], Opened], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(devices, "_decided", {})
    monkeypatch.delenv(devices.VARIABLE, raising=False)
    assert allowed_devices() == {}
    one = opened()
    assert one.page._fields._source.options == {"Simulated device": SIMULATED, "A phone": PHONE}
    for wanted in (
        "tcp:127.0.0.1:1",
        "serial:/dev/ttyS0",
        "replay:/etc/passwd",
        "xplane:127.0.0.1:49000",
        "watch nothing",
    ):
        one.page._fields._source.param.update(options={wanted: wanted}, value=wanted)  # a hand-made message
        one.page._toggle()
        one.until(lambda: bool(one.page._job._after.text) and not one.page._job.busy)
        assert "--allow-device" in one.page._job._after.text or "has ended" in one.page._job._after.text
        one.page._job.say("")
    assert one.page._station is None
    allow_devices(["tcp:127.0.0.1:1"])
    one.page._fields.refresh()
    assert "tcp:127.0.0.1:1" in one.page._fields._source.options.values()
    one.page._fields._source.value = "tcp:127.0.0.1:1"
    one.page._toggle()
    one.until(lambda: one.page._station is not None and one.page._station.status.state == LOST)


def test_a_device_that_is_open_in_another_way_is_not_watched_unasked(
    opened: Callable[[], Opened], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(devices, "_decided", {})
    plain = f"udp:127.0.0.1:{free_port()}"  # one program alone can open it, however it is written
    other = f"{plain}?protocol=mip"
    allow_devices([plain, other])
    first, second = opened(), opened()

    def choose(one: Opened, source: str) -> None:
        one.page._fields.refresh()
        one.page._fields._source.value = source
        one.page._toggle()
        one.until(lambda: one.page._station is not None or bool(one.page._job._after.text))

    choose(first, plain)
    station = first.page._station
    assert station is not None
    second.session.experiment.sensors.gyro.set("noise_density", 0.2)
    choose(second, other)
    assert second.page._station is None
    told = second.page._job._after.text
    for words in (
        f"{plain} is open already on one other page",
        "protocol is to be found out, not mip",
        "the navigator assumes other sensors than your settings",
        "Press Connect to watch it as it is",
    ):
        assert words in told
    assert "axes" not in told
    assert str(second.page._fields._source.value).startswith(WATCHED)
    second.page._toggle()
    second.until(lambda: second.page._station is station)

    second.page._toggle()
    first.page._toggle()
    second.until(lambda: not STATIONS.keys())
    choose(second, other)  # nobody else has it open now
    assert second.page._station is not None
    assert second.page._station.status.protocol == "mip"
    second.page._fields._source.value = other
    second.page._fields._protocol.value = "xsens"  # a hand-made message: only mip is offered
    found = second.page._fields.chosen().wanted
    assert found is not None
    assert found.address.options["protocol"] == "mip"


@pytest.mark.proof
def test_a_source_is_as_it_was_chosen_by_the_page_that_opens_it(
    opened: Callable[[], Opened], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(devices, "_decided", {})
    lines = tmp_path / "lines.txt"
    lines.write_text("ax,ay,az,gx,gy,gz\n" + "0.01,0.02,-9.81,0.001,0.002,0.003\n" * 3000)
    sources = [f"replay:{lines}?rate=50", f"replay:{lines}?axes=y, x, -z&rate=100"]
    allow_devices(sources)
    pages = opened(), opened()
    for source in sources:
        for one in pages:  # the second one watches what the first one has opened
            one.page._fields.refresh()
            one.page._fields._source.value = source
            one.page._toggle()
            one.until(lambda one=one: one.page._station is not None or bool(one.page._job._after.text))
            assert one.page._station is not None, one.page._job._after.text
        assert pages[0].page._station is pages[1].page._station
        for one in pages:
            one.page._toggle()
        pages[0].until(lambda: not STATIONS.keys())


def test_x_plane_is_watched_with_the_sensors_of_the_settings(
    opened: Callable[[], Opened], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(devices, "_decided", {})
    one = opened()
    one.session.experiment.sensors.gyro.set("noise_density", 0.0)
    one.session.experiment.sensors.gyro.set("bias_sigma", 0.0)
    with XPlaneSimulator(montreal(60.0)) as xplane:
        address = f"xplane:127.0.0.1:{xplane.port}"
        allow_devices([address])
        one.page._fields.refresh()
        one.page._fields._source.value = address
        assert not one.page._fields._protocol.visible
        assert not one.page._fields._axes.visible
        assert "X-Plane sends its motion" in one.page._fields._note.object
        one.page._toggle()
        one.until(lambda: one.page._station is not None)
        station = one.page._station
        assert station is not None
        one.until(lambda: station.source.end.imu > 100)
        assert one.page._errors._truth is not None
        rate = station.source.last(0.5).imu["rate"]
        assert np.abs(np.diff(rate, axis=0)).max() < np.radians(0.1)  # the default noise is 0.5°/s
        one.page._toggle()
        one.until(lambda: not xplane.subscribers)


def test_a_phone_is_refused_where_it_is_not_wanted(
    opened: Callable[[], Opened], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(phones.VARIABLE, raising=False)
    one = opened()
    one.page._fields._source.value = PHONE
    one.page._toggle()
    assert "ins-lab serve --phone" in one.page._job._after.text
    assert not one.page._inviting.waiting


def test_a_phone_comes_by_its_invitation(
    opened: Callable[[], Opened], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.setenv(phones.VARIABLE, "127.0.0.1:0")
    one, other = opened(), opened()
    try:
        for page in (one.page, other.page):
            page._fields._source.value = PHONE
            page._status.say("Disconnected.")  # as after another source, which was recorded
            page._recorder._job.say("recording is in the library now.", "info")
            page._toggle()
            assert "Waiting for the phone" in page._status.hint.object
            assert page._recorder._job._after.text == ""
        hub = phones.phone_server().hub
        assert "<svg" in one.page._inviting.view.object
        assert [state.state for state in hub.phones()] == ["invited", "invited"]
        other.page._toggle()  # cancels
        assert [state.state for state in hub.phones()] == ["invited"]
        assert "Choose a source" in other.page._status.hint.object
        other.page._toggle()
        hub.forget(list(hub._phones)[-1])  # as of an invitation that nobody took in time
        other.page._inviting._look()
        assert other.page._connect.label == "Connect"
        assert "expired" in other.page._status.hint.object
        (key,) = hub._phones
        assert hub.claim(hub._phones[key], "device", "Ann")
        one.until(lambda: one.page._inviting._look() is None and one.page._station is not None)
        assert one.page._station is not None
        assert one.page._station.name == "Ann"
        assert not one.page._inviting.waiting
        one.page._toggle()
        one.until(lambda: hub.phones() == [])

        # A phone that cannot be watched with these settings is not left to send to nobody.
        one.page._session.experiment.navigator.model = "nonlinear"
        for heading in ("", "north"):
            one.page._fields._heading.value = ""
            one.page._toggle()
            (key,) = hub._phones
            assert hub.claim(hub._phones[key], "device", "Bob")
            one.page._fields._heading.value = heading
            one.until(lambda: one.page._inviting._look() is None and hub.phones() == [])
            one.until(lambda: "accepted" in one.page._job._after.text)
            assert one.page._connect.label == "Connect"
            assert one.page._station is None
    finally:
        phones.close_phone_server()


def test_the_environment_allows_devices_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(devices, "_decided", {})
    monkeypatch.setenv(devices.VARIABLE, "udp:5555 tcp:192.168.1.20:5555?protocol=mip")
    assert list(allowed_devices().values()) == ["udp:5555", "tcp:192.168.1.20:5555?protocol=mip"]
    with pytest.raises(TransportError, match="names no source"):
        allow_devices(["COM3"])


@pytest.mark.proof
@pytest.mark.parametrize(
    ("field", "text", "words"),
    [
        ("_axes", "x,y,-z", "mirror image"),
        ("_axes", "<img src=x>", "accepted are the directions"),
        ("_heading", "north", "accepted is a number from -360 to 360 °"),
        ("_heading", "1e99", "Initial heading"),
    ],
)
def test_wrong_fields_are_told(opened: Callable[[], Opened], field: str, text: str, words: str) -> None:
    one = opened()
    getattr(one.page._fields, field).value = text
    one.page._toggle()
    assert words in one.page._job._after.text
    assert one.page._station is None


def test_the_columns_of_text_lines_are_shown_and_corrected(
    opened: Callable[[], Opened], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(devices, "_decided", {})
    address = "simulated:rest?device=text&hz=100&rest=60"
    allow_devices([address])
    one = opened()
    fields = one.page._fields
    fields.refresh()
    fields._source.value = address
    assert fields._columns.visible
    station = one.connect()
    one.page._status._turn()
    one.page._report()
    shown = str(station.source._reception.detector.columns)
    assert shown in one.page._status.details.object
    before = station.source.last(0.2).imu["force"][-1]
    one.page._toggle()
    swapped = shown.replace("force_x", "a").replace("force_z", "force_x").replace("a[", "force_z[")
    fields._columns.value = swapped
    one.page._toggle()
    one.until(lambda: bool(one.page._job._after.text) or one.page._station is not None)
    after = one.connect() if one.page._station is None else one.page._station
    one.until(lambda: after.source.end.imu > 20)
    found = after.source.last(0.2).imu["force"][-1]
    assert found == pytest.approx(before[[2, 1, 0]], abs=0.5)  # noise of two samples
    assert before[2] < -9
    one.page._toggle()
    fields._columns.value = "moon[m/s]"
    one.page._toggle()
    assert "is no quantity" in one.page._job._after.text
    fields._protocol.value = "vectornav"
    assert not fields._columns.visible


def test_what_the_address_gives_is_not_offered_as_found_out(
    opened: Callable[[], Opened], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(devices, "_decided", {})
    place = "tcp:127.0.0.1:1"
    allow_devices([place, f"{place}?protocol=ublox", f"{place}?protocol=text&columns=t[s]&axes=y,x,-z"])
    one = opened()
    fields = one.page._fields
    fields.refresh()

    def shown(source: str) -> tuple[list[str], bool, str, bool, bool]:
        fields._source.value = source
        told = "columns of text lines" in fields._note.object
        found = list(fields._protocol.options), fields._columns.visible, fields._columns.placeholder
        return *found, told, fields._axes.visible

    everything, *rest = shown(place)
    assert everything[0] == "found out"
    assert len(everything) > 5
    assert rest == [True, "found out", True, True]
    assert shown(f"{place}?protocol=ublox") == (["ublox"], False, "found out", False, True)
    assert shown(f"{place}?protocol=text&columns=t[s]&axes=y,x,-z") == (["text"], True, "t[s]", True, False)
    fields._columns.value = "t[s],rate_x[rad/s],force_x[m/s^2]"
    with pytest.raises(ValueError):
        fields.chosen()
    fields._columns.value = ""
    fields.chosen()
    assert [*shown(place)] == [everything, *rest]
    fields._protocol.value = "mip"
    assert not fields._columns.visible
    assert "text lines" not in fields._note.object


def test_a_server_has_a_bound_on_sources() -> None:
    stations = Stations(most=0)
    with pytest.raises(TransportError, match="accepted are up to 0"):
        stations.open("one", 1, lambda: pytest.fail("must not be made"), Visitor())
