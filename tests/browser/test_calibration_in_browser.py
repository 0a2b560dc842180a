"""The page Calibration in a browser: a simulated drive is refused in words, a log of rests is calibrated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from lab.data.log.calibration import read_calibration
from tests.browser.conftest import show
from tests.calibration_logs import bench, errors, write_bench

pytestmark = pytest.mark.browser


def test_a_simulated_drive_is_refused_and_a_dropped_log_calibrated(shared_page: Page, tmp_path: Path) -> None:
    page = shared_page
    show(page, "Calibration")
    page.get_by_role("button", name="Find the mounting in this mission").click()
    expect(page.get_by_text("is a simulated mission, whose IMU is mounted straight")).to_be_visible()
    expect(page.get_by_role("button", name="Download calibration.toml")).to_be_hidden()
    rng = np.random.default_rng(1)
    made = errors(rng)
    path = write_bench(tmp_path / "bench.csv", *bench(rng, made))
    page.get_by_role("button", name="Choose or drop a log").set_input_files(path)
    expect(page.get_by_text("The calibration of the accelerometer gains")).to_be_visible(timeout=60_000)
    expect(page.get_by_role("cell", name="misalignment xy").first).to_be_visible()
    with page.expect_download() as download:
        page.get_by_role("button", name="Download calibration.toml").click()
    known = read_calibration(download.value.path())
    assert known.source == "bench.csv"
    assert known.gyro is not None
    np.testing.assert_allclose(known.gyro.matrix, made.K_g, atol=1e-3)
