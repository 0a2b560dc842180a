"""The page Live asks what a source does not say: the unit of its rates, and what its columns are."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from further_outputs import G, motion
from test_live_page import Opened, wait_until_nothing_is_left
from text_outputs import still_dot

from dashboards import devices
from dashboards.devices import allow_devices
from dashboards.pages.live.question_part import OTHERS_QUESTION
from lab.live.live_state import WAITING

SECONDS, RATE = 60, 60


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], Opened]]:
    """Return what opens a page on a device; it is closed in the end, and nothing is left."""
    monkeypatch.setattr(devices, "_decided", {})
    pages: list[Opened] = []

    def open_one(address: str) -> Opened:
        allow_devices([address])
        one = Opened(monkeypatch)
        pages.append(one)
        one.page._fields.refresh()
        one.page._fields._source.value = address
        return one

    yield open_one
    for one in pages:
        one.close()
    wait_until_nothing_is_left()


def written(path: Path) -> Path:
    """Write what a Movella DOT at rest exports."""
    path.write_text(still_dot(SECONDS * RATE))
    return path


def odd_lines(path: Path) -> Path:
    """Write lines whose columns nothing shows: forces of 3.5 of an unknown unit."""
    rng = np.random.default_rng(2)
    rows = 2 + 0.3 * rng.standard_normal((SECONDS * RATE, 6))
    path.write_text("".join(f"D {' '.join(f'{one:.3f}' for one in row)}\n" for row in rows))
    return path


def button(one: Opened, label: str) -> None:
    """Press a button of the question."""
    (found,) = (button for button in one.page._question.buttons if button.label == label)
    found.clicks += 1


def test_a_unit_in_doubt_is_asked_in_amber_and_an_answer_navigates_again(opened, tmp_path: Path) -> None:
    source = f"replay:{written(tmp_path / 'dot.csv')}?speed=10"
    one = opened(source)
    station = one.connect()
    part = one.page._question
    one.until(lambda: part.notice.view.visible)
    assert part.notice.view.severity == "warning"
    assert "°/s is used, and rad/s is possible" in part.notice.text
    assert [one.label for one in part.buttons] == ["They are in °/s", "They are in rad/s"]
    # The likelier unit levels: in rad/s the device would turn by 12 °/s.
    one.until(lambda: station.state.phase != WAITING)
    before, begun = station.source.since().imu, station.begun
    button(one, "They are in rad/s")
    assert not part.notice.view.visible
    assert not part.buttons.visible
    one.until(lambda: station.begun > begun and one.page._begun == station.begun)
    after = station.source.since().imu[: len(before)]
    np.testing.assert_allclose(after["rate"], np.degrees(before["rate"]), rtol=1e-12)
    one.until(lambda: "moves" in station.state.reason)
    thinned = station.thinned.since(0)[1]
    assert float(np.nanmax(np.abs(thinned["rate"]))) > 0.05
    one.page._toggle()
    one.until(lambda: one.page._station is None)
    # The answer is kept with the source.
    wait_until_nothing_is_left()
    again = one.connect()
    assert again.source.status.doubt == ()
    one.page._report()
    assert not part.notice.view.visible


def test_the_confirmed_unit_keeps_the_solution(opened, tmp_path: Path) -> None:
    one = opened(f"replay:{written(tmp_path / 'dot.csv')}?speed=10")
    station = one.connect()
    one.until(lambda: one.page._question.buttons.visible and station.state.phase != WAITING)
    begun = station.begun
    button(one, "They are in °/s")
    assert station.source.status.doubt == ()
    for _ in range(5):
        one.run()
    assert station.begun == begun


def test_lines_that_are_not_recognised_are_shown_with_a_choice_for_each_column(
    opened, tmp_path: Path
) -> None:
    path = odd_lines(tmp_path / "odd.txt")
    with path.open("rb") as file:
        lines = file.readlines()
    one = opened(f"tcp:127.0.0.1:{served(lines)}")
    one.page._toggle()
    part = one.page._question
    one.until(lambda: one.page._station is not None and part.chooser.visible)
    assert part._lines.object.count("D ") == 3
    assert len(part._choices) == 6
    part._use.clicks += 1
    assert "no column is a rate, a force or a latitude" in part.notice.text
    for number, choice in enumerate(part._choices):
        choice.value = f"{('force', 'rate')[number // 3]}_{'xyz'[number % 3]}[{('m/s²', '°/s')[number // 3]}]"
    assert "--column '4=rate_x[°/s]'" in part._command.object
    part._use.clicks += 1
    station = one.page._station
    assert station is not None
    one.until(lambda: station.source.end.imu > 100)
    rows = station.source.since().imu
    printed = np.array([line.split()[1:] for line in lines], dtype=float)
    place = int(np.flatnonzero(np.isclose(printed[:, 0], rows["force"][50, 0]))[0])
    np.testing.assert_allclose(rows["force"][50], printed[place, :3], atol=1e-12)
    np.testing.assert_allclose(rows["rate"][50], np.radians(printed[place, 3:]), atol=1e-12)
    one.page._report()
    assert not part.chooser.visible


def test_axes_in_different_units_are_said_and_a_button_reads_them_right(opened, tmp_path: Path) -> None:
    """A sketch prints x and y in g and z in m/s²."""
    path = tmp_path / "slip.csv"
    _, force, rate = motion(1)
    rows = np.tile(np.hstack((force / (G, G, 1.0), rate)), (20, 1))
    rows = np.column_stack((np.arange(len(rows)) / 50, rows))
    path.write_text("".join(",".join(f"{one:.5f}" for one in row) + "\n" for row in rows))
    one = opened(f"replay:{path}?speed=10")
    station = one.connect()
    part = one.page._question
    one.until(lambda: part.notice.text.startswith("The axes of the specific force"))
    assert "x and y in g and z in m/s²" in part.notice.text
    assert [one.label for one in part.buttons] == ["Read them so"]
    before = station.source.end.imu
    button(one, "Read them so")
    one.until(lambda: station.source.end.imu > before + 200)
    lengths = np.linalg.norm(station.source.since().imu["force"][before + 20 :], axis=1)
    assert np.abs(lengths / G - 1).max() < 0.03
    one.until(lambda: not part.notice.view.visible)


def test_only_the_owner_answers_for_a_class(opened, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one = opened(f"replay:{written(tmp_path / 'dot.csv')}?speed=10")
    station = one.connect()
    one.until(lambda: one.page._question.buttons.visible)
    monkeypatch.setattr("dashboards.pages.live.watched.may_change", lambda visitor, owner: False)
    button(one, "They are in rad/s")
    assert one.page._question.notice.text == OTHERS_QUESTION
    assert station.source.status.doubt


def served(lines: list[bytes]) -> int:
    """Serve lines at 60 Hz over TCP until the test ends; return the port."""
    server = socket.create_server(("127.0.0.1", 0))
    wait = threading.Event().wait

    def send() -> None:
        try:
            link, _ = server.accept()
            with link:
                for line in lines:
                    link.sendall(line)
                    wait(1 / RATE)
        except OSError:
            return
        finally:
            server.close()

    threading.Thread(target=send, daemon=True).start()
    return int(server.getsockname()[1])
