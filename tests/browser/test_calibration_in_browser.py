"""The page Calibration in a browser: a log of rests is calibrated; one that moved is refused in words."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from lab.data.log.calibration import read_calibration
from tests.browser.conftest import show
from tests.calibration_logs import bench, errors, write_bench

pytestmark = pytest.mark.browser


def give(page: Page, path: Path) -> None:
    """Choose a file."""
    page.get_by_role("button", name=re.compile("Choose or drop a log|Uploaded")).set_input_files(path)


def test_a_dropped_log_is_calibrated_and_one_that_moved_is_refused(shared_page: Page, tmp_path: Path) -> None:
    page = shared_page
    show(page, "Calibration")
    rng = np.random.default_rng(1)
    made = errors(rng)
    write_bench(tmp_path / "bench.csv", *bench(rng, made))
    give(page, tmp_path / "bench.csv")
    expect(page.get_by_text("The calibration of the accelerometer gains")).to_be_visible(timeout=60_000)
    expect(page.get_by_role("cell", name="misalignment xy").first).to_be_visible()
    with page.expect_download() as download:
        page.get_by_role("button", name="Download calibration.toml").click()
    known = read_calibration(download.value.path())
    assert known.source == "bench.csv"
    assert known.gyro is not None
    np.testing.assert_allclose(known.gyro.matrix, made.K_g, atol=1e-3)
    write_bench(tmp_path / "held.csv", *bench(rng, made, shake=0.3))
    give(page, tmp_path / "held.csv")
    expect(page.get_by_text("the device never stands still")).to_be_visible(timeout=60_000)
    expect(page.get_by_role("button", name="Download calibration.toml")).to_be_hidden()
    page.get_by_role("button", name="Mounting in the drive of this page").click()
    expect(page.get_by_text("is a simulated mission, whose IMU is mounted straight")).to_be_visible()
