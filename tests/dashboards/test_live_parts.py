"""The parts Axes and Allan of the page Live, on a simulated device at rest."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

import dashboards.pages.live.allan_part as allan_module
import lab.live.growing_allan as growing_module
from dashboards import devices
from dashboards.devices import allow_devices
from dashboards.pages.live.live import ALLAN, AXES, PLOTS
from lab.live.axis_map import AxisMap
from lab.sensors.cards import read_cards
from lab.toml_file import parse_toml
from tests.dashboards.test_live_page import Opened, wait_until_nothing_is_left


@pytest.fixture
def one(monkeypatch: pytest.MonkeyPatch) -> Iterator[Opened]:
    """Return a page that is connected to a device on a table."""
    monkeypatch.setattr(devices, "_decided", {})
    address = "simulated:rest?device=vectornav&hz=200&rest=60"
    allow_devices([address])
    opened = Opened(monkeypatch)
    opened.page._fields.refresh()
    opened.page._fields._source.value = address
    opened.connect()
    yield opened
    opened.close()
    wait_until_nothing_is_left()


def test_a_position_is_taken_and_the_axes_are_used(one: Opened) -> None:
    page, station = one.page, one.page._station
    assert station is not None
    page._choice.value = AXES
    part = page._axes
    assert list(page._stage) == [part.view]
    one.until(lambda: station.source.end.imu > 700)
    part._take("level")
    assert list(part.check.positions) == ["level"]
    assert "Gyro biases" in part._words.object
    assert "Earth" in part._words.object
    assert part._use.disabled
    part._take("nose up")
    assert "alike" in part._notice.text
    part._apply()  # nothing is found yet
    assert station.source.axes == AxisMap()
    rows = station.source.last(3.0).imu
    rows["force"] = rows["force"][:, [2, 1, 0]] * (-1, 1, 1)  # as if the nose were up
    part.check.take("nose up", rows)
    part._tell()
    assert not part._use.disabled
    assert "forward" in part._picture.object
    part._apply()
    assert station.source.axes == AxisMap()  # the device has the axes of the vehicle
    assert "for all who watch it" in part._notice.text
    part._forget()
    assert part._use.disabled


def test_the_deviation_grows_and_becomes_a_card(
    one: Opened, monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> None:
    for module in (allan_module, growing_module):
        monkeypatch.setattr(module, "LEAST_FOR_CARD", 4.0)
    page = one.page
    page._choice.value = ALLAN
    part = page._allan
    assert part._make.disabled

    def told(happened: Callable[[], bool]) -> Callable[[], bool]:
        def look() -> bool:
            part.tell()
            return happened()

        return look

    source = part._figures._sources["gyro"]
    one.until(told(lambda: len(source.data["tau"]) > 3))
    assert "At rest for" in part._words.object
    assert "τ = 100 s is reached in" in part._words.object
    assert source.data["x"][0] > 0
    one.until(told(lambda: not part._make.disabled))
    part._start_card()
    one.until(lambda: part._download.visible)
    path = tmp_path_factory.mktemp("card") / "cards.toml"
    path.write_bytes(part._file().getvalue())
    assert parse_toml(path.read_text())
    (made,) = read_cards(path).values()
    assert made.datum("gyro", "noise_density") is not None
    page._choice.value = PLOTS
    assert list(page._stage) == [page._plots]
    page._toggle()
    assert "Connect a source" in part._words.object
    assert len(source.data["tau"]) == 0
