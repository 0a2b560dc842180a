"""The parts Errors, Axes, Allan and Twin of the page Live, on simulated devices."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from bokeh.document.events import DocumentChangedEvent
from walking import send

import dashboards.pages.live.allan_part as allan_module
import dashboards.pages.live.twin_part as twin_part_module
import lab.live.bench.growing_allan as growing_module
import lab.live.twin as twin_module
from dashboards import devices
from dashboards.devices import allow_devices
from dashboards.pages.live.live import ALLAN, AXES, ERRORS, PLOTS, SLOWEST, TWIN
from lab.base.parameters.toml_file import parse_toml
from lab.data.streams.axis_map import AxisMap
from lab.data.streams.source_status import LOST
from lab.live.live_errors import join_errors
from lab.sensors.cards import read_cards
from tests.dashboards.test_live_page import Opened, wait_until_nothing_is_left


def connected(monkeypatch: pytest.MonkeyPatch, address: str) -> Iterator[Opened]:
    """Lend a page that is connected to a simulated device."""
    monkeypatch.setattr(devices, "_decided", {})
    allow_devices([address])
    opened = Opened(monkeypatch)
    opened.page._fields.refresh()
    opened.page._fields._source.value = address
    opened.connect()
    yield opened
    opened.close()
    wait_until_nothing_is_left()


@pytest.fixture
def one(monkeypatch: pytest.MonkeyPatch) -> Iterator[Opened]:
    """Return a page that is connected to a device on a table."""
    yield from connected(monkeypatch, "simulated:rest?device=vectornav&hz=200&rest=60")


@pytest.fixture
def without_fixes(monkeypatch: pytest.MonkeyPatch) -> Iterator[Opened]:
    """Return a page that is connected to a device on a table without a receiver."""
    yield from connected(monkeypatch, "simulated:rest?device=memsense&hz=150&rest=60")


def rate_times(one: Opened) -> list[float]:
    """Return the times of the plot of rates as a browser has them, by the messages from now on."""
    times = list(one.page._figures._rate.source.data["time"])
    carrier = one.page._figures._parcel.carrier

    def receive(event: DocumentChangedEvent) -> None:
        if getattr(event, "model", None) is not carrier or not carrier.data["what"]:
            return
        for model, columns, rollover in json.loads(carrier.data["what"][0])["streams"]:
            if model == 0:
                times[:] = [*(times if rollover else ()), *dict(columns)["time"]]

    one.document.on_change(receive)
    return times


@pytest.mark.proof
def test_a_position_is_taken_and_the_axes_are_used(one: Opened) -> None:
    page, station = one.page, one.page._station
    assert station is not None
    page._choice.value = AXES
    part = page._axes
    assert list(page._stage) == [part.view]
    one.until(lambda: station.source.end.imu > 700)
    part._accept("level")
    assert list(part.check.positions) == ["level"]
    assert "Gyro biases" in part._words.object
    assert "Earth" in part._words.object
    assert part._use.disabled
    part._accept("nose up")
    assert "alike" in part._notice.text
    part._apply()  # nothing is found yet
    assert station.source.axes == AxisMap()
    rows = station.source.last(3.0).imu
    rows["force"] = rows["force"][:, [2, 1, 0]] * (-1, 1, 1)  # as if the nose were up
    part.check.take("nose up", rows)
    part._report()
    assert not part._use.disabled
    assert "forward" in part._picture.object
    part._apply()
    assert station.source.axes == AxisMap()  # the device has the axes of the vehicle
    assert "for all who watch it" in part._notice.text
    part._forget()
    assert part._use.disabled


def test_a_calibration_file_is_applied_to_the_source(one: Opened, tmp_path: Path) -> None:
    page, station = one.page, one.page._station
    assert station is not None
    page._choice.value = AXES
    part, source = page._axes, station.source
    wrong, file = tmp_path / "wrong.toml", tmp_path / "sensor.toml"
    wrong.write_text("[gyro]\nbias = [0, 0, 90]\nmatrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n")
    send(part._calibration, wrong)
    assert part._notice.text.startswith("wrong.toml: gyro.bias is beyond 50")
    assert source.calibration is None
    one.until(lambda: source.end.imu > 100)
    before = source.last(0.3).imu["rate"].mean(axis=0)
    file.write_text("[gyro]\nbias = [5, 0, -5]\nmatrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n")
    send(part._calibration, file)
    assert "gyro bias and matrix" in part._notice.text
    assert source.calibration is not None
    end = source.end.imu
    one.until(lambda: source.end.imu > end + 200)
    after = source.last(0.3).imu["rate"].mean(axis=0)
    np.testing.assert_allclose(after, before - np.radians([5.0, 0.0, -5.0]), atol=0.01)


@pytest.mark.proof
def test_samples_from_before_the_source_was_lost_are_no_position(one: Opened) -> None:
    page, station = one.page, one.page._station
    assert station is not None
    page._choice.value = AXES
    one.until(lambda: station.source.end.imu > 700)
    assert station.source.device is not None
    station.source.device.unplug(60.0)
    one.until(lambda: station.source.status.state == LOST)
    page._axes._accept("nose up")
    assert not page._axes.check.positions
    assert "no samples" in page._axes._notice.text


@pytest.mark.proof
def test_the_deviation_grows_and_becomes_a_card(
    one: Opened, monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> None:
    for module in (allan_module, growing_module):
        monkeypatch.setattr(module, "LEAST_FOR_CARD", 4.0)
    page = one.page
    page._choice.value = ALLAN
    part = page._allan
    assert part._maker.button.disabled

    def told(happened: Callable[[], bool]) -> Callable[[], bool]:
        def look() -> bool:
            part.tell()
            return happened()

        return look

    source = part._figures.figures[0].renderers[0].data_source
    one.until(told(lambda: len(source.data["at"]) > 3))
    assert "A record of" in part._words.object
    assert "τ = 100 s is reached in" in part._words.object
    assert source.data["x"][0] > 0
    one.until(told(lambda: not part._maker.button.disabled))
    part._maker.start()
    one.until(lambda: part._maker.download.visible)
    path = tmp_path_factory.mktemp("card") / "cards.toml"
    path.write_bytes(part._maker._file().getvalue())
    assert parse_toml(path.read_text())
    (made,) = read_cards(path).values()
    assert made.datum("gyro", "noise_density") is not None
    assert part._grid.visible
    times = rate_times(one)
    reached = page._station.source.end.imu if page._station else 0
    page._choice.value = PLOTS
    assert list(page._stage) == [page._plots]
    one.until(lambda: page._station is not None and page._station.source.end.imu > reached + 20)
    one.until(lambda: len(times) > 100)
    assert (np.diff(times) > 0).all()  # a browser would draw rows from before as a line back
    page._toggle()
    assert not part._grid.visible
    assert "Connect a source" in part._words.object
    assert len(source.data["at"]) == 0


@pytest.mark.proof
def test_the_errors_against_the_truth_are_drawn_and_told(one: Opened) -> None:
    page = one.page
    page._choice.value = ERRORS
    part = page._errors
    waits = not part._recent  # on a busy computer, the navigator may have an attitude already
    assert ("has no attitude. " in part._words.object) is waits
    assert part._of_attitude.visible is (not waits)  # no plots without curves
    carrier = part._figures._parcel.carrier
    drawn: list[float] = []

    def rows_came() -> bool:
        for model, columns, _ in (
            json.loads(carrier.data["what"][0])["streams"] if carrier.data["what"] else []
        ):
            if model == 18:  # the source of the roll: each plot before it has three models
                drawn.extend(dict(columns)["error"])
        return len(drawn) > 20

    one.until(rows_came)
    found = join_errors(list(part._recent))
    roll, sigma = found.attitude[:, 0], found.attitude_sigma[:, 0]
    nearest = np.abs(np.subtract.outer(drawn, np.degrees(roll))).min(axis=1)
    assert nearest.max() < 1e-5  # the page gets six digits of an error of some tenths of a degree
    # Levelled by the default sensors: the error is below 5 σ, and the σ below 3°.
    assert (np.abs(roll) < 5 * sigma).all()
    assert (sigma < np.radians(3)).all()
    part.tell()
    assert "attitude" in part._words.object
    assert "σ" in part._words.object
    assert part._of_attitude.visible
    assert part._of_position.visible is bool(np.isfinite(found.position).any())
    part._of_position.visible = True
    part.begin_anew()
    assert (part._of_position.visible, part._of_attitude.visible) == (False, False)  # nothing is drawn
    page._toggle()
    assert not part._of_attitude.visible
    assert "Only a simulated device and X-Plane" in part._words.object


def test_plots_are_filled_before_a_browser_gets_them(one: Opened) -> None:
    """Rows that overtake the plots they are for are lost in the browser."""
    page = one.page
    page._choice.value = AXES
    one.until(lambda: len(page._station.thinned.since(0)[1]) > 60)  # type: ignore[union-attr]
    page._choice.value = PLOTS
    parcel = page._figures._parcel
    assert len(page._figures._rate.source.data["time"]) > 50
    assert parcel.taken
    page.hide()
    page.appear()
    assert list(page._stage) == [page._plots]
    assert parcel.taken


@pytest.mark.proof
def test_a_desk_sensor_without_fixes_is_compared_at_rest(
    without_fixes: Opened, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(twin_part_module, "LEAST_REST", 5.0)
    monkeypatch.setattr(twin_module, "TWINS", 3)
    page = without_fixes.page
    page._choice.value = TWIN
    part = page._twin
    assert part._compare.disabled
    assert "leave it at rest" in part._words.object

    def ready() -> bool:
        part.tell()
        return not part._compare.disabled

    without_fixes.until(ready)
    part._sensors.value = twin_part_module.MEASURED
    part._start()
    assert "make one under Allan" in part._job._after.text
    part._sensors.value = twin_part_module.SETTINGS
    part._start()
    without_fixes.until(lambda: "Real / simulated" in part._table.object)
    assert "Noise of the gyros above 20 Hz" in part._table.object
    assert part._grid.visible
    assert len(part._figures.figures[0].renderers[0].data_source.data["at"]) > 50
    part._start()
    page._toggle()  # while it compares
    without_fixes.until(lambda: not part._job.busy)
    without_fixes.run()
    assert part._table.object == ""
    assert not part._grid.visible
    assert "Connect a source" in part._words.object


@pytest.mark.proof
def test_a_stream_with_fixes_needs_a_minute(one: Opened) -> None:
    one.until(lambda: one.page._station is not None and one.page._station.source.end.fix > 1)
    part = one.page._twin
    part.tell()
    assert "s more of the stream" in part._words.object
    part._start()  # a hand-made message
    assert not part._job.busy


def test_a_browser_that_is_behind_gets_the_next_update_later(
    one: Opened, monkeypatch: pytest.MonkeyPatch
) -> None:
    page, updates = one.page, 0

    def advance(**_: bool) -> None:
        nonlocal updates
        updates += 1

    page._unwatch()  # ticks by hand
    monkeypatch.setattr(page, "_advance", advance)
    carrier = page._figures._parcel.carrier
    carrier.data = {"what": ["not yet taken"]}
    page._waited = 0
    for _ in range(SLOWEST - 1):
        page._refresh_page()
    assert updates == 0
    page._refresh_page()  # after a second, whatever the browser does
    assert updates == 1
    carrier.data = {"what": []}  # as the browser confirms
    page._refresh_page()
    assert updates == 2
