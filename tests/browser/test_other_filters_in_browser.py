"""The page Other filters in a browser: a dropped log is judged; one without a filter is refused in words."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from estimator_logs import px4
from playwright.sync_api import Page, expect
from writers import WRITERS
from xplane_simulator import montreal

from tests.browser.conftest import show

pytestmark = pytest.mark.browser


def drop(page: Page, name: str, content: bytes) -> None:
    buffer: dict[str, Any] = {"name": name, "mimeType": "application/octet-stream", "buffer": content}
    # The files of a homework have an ending, those of a flight may be several.
    field = page.locator("input[type=file]:not([multiple]):not([accept])")
    expect(field).to_have_js_property("value", "")
    field.set_input_files(buffer)  # type: ignore[arg-type]


def test_a_dropped_log_is_judged_and_one_without_a_filter_refused(shared_page: Page) -> None:
    page = shared_page
    show(page, "Other filters")
    plots = page.locator("canvas:visible")
    expect(plots).to_have_count(0)
    rng, time = np.random.default_rng(1), np.arange(100.0, 180.0, 0.2)
    innovations = rng.normal(size=(len(time), 11))
    innovations[:, 3:5] *= 3
    drop(page, "copter.ulg", px4(time, innovations, np.ones(innovations.shape)))
    expect(page.get_by_text("The GPS position innovations are 3 times as large").first).to_be_visible()
    expect(page.get_by_text("What its own flags say")).to_be_visible()
    expect(plots).not_to_have_count(0)
    drop(page, "track.gpx", WRITERS["GPX"](montreal(20)))
    expect(page.get_by_text("holds no innovations of a filter")).to_be_visible()
    expect(page.get_by_text("What its own flags say")).to_be_hidden()
    expect(plots).to_have_count(0)
