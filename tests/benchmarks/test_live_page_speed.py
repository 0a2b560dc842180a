"""The Live page: from the wire to the painted pixel, and what the server spends on one page and on ten.

A device of another process streams to a server in this process; the pages are drawn by Chromium. Each figure
is printed; the asserted bars are those of a quiet machine.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import panel as pn
import psutil
import pytest
from playwright.sync_api import Page

from dashboards.devices import STATIONS
from lab.data.streams.recorded_log import recorded_samples
from tests.benchmarks.test_live_speed import delays_of_navigator, device
from tests.browser.conftest import IDLE, ROOT, chromium, free_port, new_context, show

__all__ = ["chromium"]

SECONDS = float(os.environ.get("INS_LAB_LIVE_SECONDS", "60"))
"""How long each stream is watched [s]; the bar of the laboratory is 600."""
pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(300 + 2 * SECONDS)]
PAGES = int(os.environ.get("INS_LAB_PAGES", "10"))
"""Pages that watch one stream."""
RATES = "Bokeh.documents[0].get_model_by_name('live:Angular rate').data.time"
WATCH = f"""() => {{
    window.painted = [];
    let last = -1;
    const look = () => {{
        const newest = {RATES}.at(-1);
        if (newest !== last) {{
            // Bokeh paints in this frame; the task runs after it.
            const now = () => (performance.timeOrigin + performance.now()) / 1000;
            setTimeout(() => window.painted.push([now(), newest]));
            last = newest;
        }}
        requestAnimationFrame(look);
    }};
    requestAnimationFrame(look);
}}"""


@contextmanager
def served() -> Iterator[str]:
    """Serve the simulator from a thread of this process; give its address."""
    port = free_port()
    server = pn.serve(
        {"simulator": str(ROOT / "dashboards" / "simulator.py")},
        port=port, threaded=True, show=False, websocket_origin=f"127.0.0.1:{port}",
    )  # fmt: skip
    try:
        yield f"http://127.0.0.1:{port}/simulator"
    finally:
        server.stop()
        STATIONS.close()


def watching(chromium, address: str) -> Page:
    """Return a page that shows the stream of the allowed device."""
    page = new_context(chromium, viewport={"width": 1440, "height": 900}).new_page()
    page.goto(address)
    page.wait_for_function(IDLE)
    show(page, "Live")
    page.get_by_role("combobox", name="Source").click()
    page.get_by_role("menuitem").filter(has_text="tcp:").first.click()
    page.get_by_role("button", name="Connect", exact=True).click()
    page.get_by_role("button", name="Disconnect").wait_for()
    page.wait_for_function(f"{RATES}.length > 20")
    return page


def share(page: Page, seconds: float) -> tuple[float, float]:
    """Return what this process takes of a core while pages watch, and how its memory varies."""
    process = psutil.Process()
    before, begin, memory = process.cpu_times(), time.monotonic(), []
    while time.monotonic() - begin < seconds:
        page.wait_for_timeout(1000)
        memory.append(process.memory_info().rss)
    after, late = process.cpu_times(), memory[len(memory) // 5 :]
    spent = after.user + after.system - before.user - before.system
    return spent / (time.monotonic() - begin), max(late) / min(late) - 1


@pytest.mark.parametrize("rate", [200, 1000])
def test_from_the_wire_to_the_pixel(
    rate: int, chromium, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    delays = delays_of_navigator(monkeypatch)
    with device(rate) as source:
        monkeypatch.setenv("INS_LAB_DEVICES", source.split("?")[0])
        with served() as address:
            page = watching(chromium, address)
            page.wait_for_timeout(10_000)  # the clocks settle
            page.evaluate(WATCH)
            station = next(iter(STATIONS._open.values())).station
            station.source.record(tmp_path / "stream.inslab")
            delays.clear()
            spent, grown = share(page, SECONDS)
            navigator = 1e3 * np.concatenate(delays)
            painted = np.array(page.evaluate("window.painted"))
            arrived = time.time() - time.monotonic() + station.zero + painted[:, 1]
            page.context.close()
    recorded = recorded_samples(tmp_path / "stream.inslab")
    # Each sample between two pictures is painted with the later one. Times count from the first picture:
    # over seconds of the epoch, steps of `arange` are wrong by 10 ms after ten minutes.
    begun = arrived[0]
    ends = np.arange(0.0, arrived[-1] - begun - 0.5 / rate, 1.0 / rate)  # half a sample: times are rounded
    shown = painted[np.searchsorted(arrived - begun, ends), 0] - begun
    delay = 1e3 * (shown - ends)
    print(
        f"\n{rate} Hz, {SECONDS:g} s, one page: {len(recorded.imu)} samples recorded, "
        f"{recorded.reception.loss.missing} missing; wire to navigator median {np.median(navigator):.2f} ms, "
        f"99 % {np.percentile(navigator, 99):.2f} ms; wire to pixel median {np.median(delay):.0f} ms, "
        f"99 % {np.percentile(delay, 99):.0f} ms, {len(painted) / SECONDS:.1f} pictures a second; "
        f"server {spent:.1%} of a core; memory in the last four fifths within {grown:.1%}"
    )
    assert recorded.reception.loss.missing == 0
    assert np.median(navigator) <= 2.0
    assert np.percentile(navigator, 99) <= 20.0
    assert np.median(delay) <= 150.0
    if rate == 200:
        assert spent <= 0.40
    assert grown <= 0.10  # ± 5 %


def pictures(page: Page, seconds: float) -> tuple[float, float]:
    """Return what this process takes of a core, and the pictures a second that a page paints meanwhile."""
    before = page.evaluate("window.painted.length")
    spent, _ = share(page, seconds)
    return spent, (page.evaluate("window.painted.length") - before) / seconds


@pytest.mark.timeout(300 + 2 * SECONDS + 60 * PAGES)
def test_many_pages_cost_little_more_than_one(chromium, monkeypatch: pytest.MonkeyPatch) -> None:
    # The pages are opened one after the other, while those that are open draw.
    with device(200, 120 + 2 * SECONDS + 60 * PAGES) as source:
        monkeypatch.setenv("INS_LAB_DEVICES", source.split("?")[0])
        with served() as address:
            pages = [watching(chromium, address)]
            pages[0].evaluate(WATCH)
            pages[0].wait_for_timeout(10_000)
            one, alone = pictures(pages[0], SECONDS)
            pages += [watching(chromium, address) for _ in range(PAGES - 1)]
            pages[0].wait_for_timeout(10_000)
            many, among = pictures(pages[0], SECONDS)
            for page in pages:
                page.context.close()
    print(
        f"\nCPU of the server in {SECONDS:g} s with one page {SECONDS * one:.2f} s, {alone:.1f} pictures a "
        f"second; with {PAGES} {SECONDS * many:.2f} s, {among:.1f} pictures a second on the first: "
        f"{many / one:.2f} times; load {psutil.getloadavg()[0]:.1f}"
    )
    assert among > 0.2, "the first page stands still"
    assert many <= 1.5 * one
