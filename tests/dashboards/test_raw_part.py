"""The raw part of the page Live: frames and lines as they came, as text, and only while they are seen."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

import dashboards.pages.live.raw_part as raw_module
from dashboards.pages.live.live import PLOTS, RAW
from dashboards.pages.live.raw_part import FRAMES, LONGEST, raw_html
from lab.data.protocols.catalogue import ENCODERS, ROW, last_frames
from lab.data.streams.source_status import STREAMING
from lab.live.simulated.simulated_flight import REST, SimulatedFlight
from tests.dashboards.test_live_parts import Opened, connected

ATTACK = b"$<img src=x onerror=alert(1)>\r\n"


@pytest.fixture(scope="module")
def flight() -> SimulatedFlight:
    return SimulatedFlight.of(REST, 100.0, rest=3.0)


@pytest.fixture
def one(monkeypatch: pytest.MonkeyPatch) -> Iterator[Opened]:
    """Return a page that is connected to a device on a table."""
    yield from connected(monkeypatch, "simulated:rest?device=vectornav&hz=100&rest=60")


@pytest.mark.parametrize("name", ENCODERS)
def test_the_last_frames_are_whole_and_in_their_order(flight: SimulatedFlight, name: str) -> None:
    sent = ENCODERS[name]().encode(flight.imu[:200], flight.fix[:2])
    data = sent[7:-3]  # from anywhere in the stream
    frames = last_frames(name, data, 5)
    assert 1 < len(frames) <= 5
    at = 0
    for frame in frames:
        assert frame
        at = data.index(frame, at) + len(frame)
    assert at <= len(data)


def test_what_has_neither_frames_nor_lines_is_shown_in_rows() -> None:
    noise = np.random.default_rng(1).bytes(50 * ROW).replace(b"\n", b"\r")
    for name in ("", "vectornav", "a_decoder.py:Own"):
        assert last_frames(name, noise, FRAMES) == [noise[-ROW * k :][:ROW] for k in range(FRAMES, 0, -1)]
    assert last_frames("", b"cut\nfirst\nsecond\nnot yet", FRAMES) == [b"first", b"second"]
    assert last_frames("", b"", FRAMES) == []


def test_bytes_are_text_and_no_mark_up() -> None:
    shown = raw_html([ATTACK, b"\x00<\xff>", b"A" * (LONGEST + 1)])
    assert "<img" not in shown
    assert "$&lt;img src=x onerror=alert(1)&gt;··" in shown
    assert "00 3c ff 3e" in shown
    assert "·&lt;·&gt;" in shown
    assert shown.index("41 41") < shown.index("00 3c") < shown.index("24 3c")  # newest first
    assert f"{'A' * LONGEST} …" in shown
    assert "class=lines" in raw_html([ATTACK])
    assert "class=lines" not in shown


def test_bytes_are_looked_at_only_while_they_are_seen(one: Opened, monkeypatch: pytest.MonkeyPatch) -> None:
    page, station = one.page, one.page._station
    assert station is not None
    looked: list[str] = []

    def look(name: str, data: bytes, most: int) -> list[bytes]:
        looked.append(name)
        return last_frames(name, data, most)

    monkeypatch.setattr(raw_module, "last_frames", look)
    one.until(lambda: station.status.state == STREAMING and page._told > 0)
    assert not looked
    page._choice.value = RAW
    one.until(lambda: page._parts[RAW].view.object.count("<tr>") == FRAMES + 1)
    assert "<td>fa " in page._parts[RAW].view.object  # each frame of the protocol begins so
    page._choice.value = PLOTS
    one.until(lambda: not page._parts[RAW]._work.busy)
    before, told = len(looked), page._told
    one.until(lambda: page._told > told)
    assert len(looked) == before
    page._toggle()
    assert "fa " not in page._parts[RAW].view.object
