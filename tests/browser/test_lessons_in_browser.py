"""Lessons in a browser: formulas without help from outside, settings, answers, and the reminder."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from tests.browser.conftest import show, wait_for
from tests.cli.asking import ask

pytestmark = pytest.mark.browser


@pytest.mark.proof
def test_a_lesson_from_its_text_to_the_right_answer(open_page: Callable[..., Page]) -> None:
    page = open_page("?mission=los_angeles&trajectory.imu_rate=50")
    show(page, "Lessons")
    page.get_by_role("button", name="Tuning R", exact=True).click()
    formula = page.locator("math").first
    expect(formula).to_be_visible()
    box = formula.bounding_box()
    assert box is not None
    assert box["width"] > 50  # drawn, not folded away
    expect(formula).to_have_css("font-family", "math")  # others have no roots and no accents
    page.get_by_role("button", name="Check the answer").click()
    expect(page.get_by_text("Give an answer first.")).to_be_visible()
    page.get_by_role("radio", name="no, they are too small").click()
    page.get_by_role("button", name="Check the answer").click()
    expect(page.get_by_text("Not yet.")).to_be_visible()
    page.get_by_role("radio", name="yes", exact=True).click()
    page.get_by_role("button", name="Check the answer").click()
    expect(page.get_by_text("1 of 3 solved")).to_be_visible()
    page.get_by_role("button", name="Next step").click()
    wait_for(page, "location.search.includes('navigator.r_scale=0.1')")
    page.get_by_role("button", name="Look at Verdict").click()
    expect(page.get_by_text("R position is about").first).to_be_visible()
    expect(page.get_by_text("Tuning R · step 2 of 3")).to_be_visible()  # beside the verdict
    page.get_by_role("button", name="Close Lessons").click()
    expect(page.get_by_text("Tuning R, step 2 of 3")).to_be_visible()


HOMEWORK = """title = "The new receiver"
text = "Something is wrong."
change = ["navigator.r_scale"]
fault_points = 2
[settings]
mission = "los_angeles"
trajectory.imu_rate = 20
[hidden]
faults = ["r"]
[[question]]
text = "How many times?"
answer = 10
tolerance = 1
[[goal]]
text = "NEES below 5."
condition = "nees < 5"
points = 4
"""


@pytest.mark.proof
def test_a_homework_from_the_file_of_the_teacher_to_the_grades(
    open_page: Callable[..., Page], tmp_path: Path
) -> None:
    source, key, handed = tmp_path / "receiver.toml", tmp_path / "receiver.key", tmp_path / "handed"
    source.write_text(HOMEWORK, encoding="utf-8")
    assert ask("homework", "make", str(source), "--out", str(source.with_suffix(".homework"))).exit_code == 0
    page = open_page("?mission=los_angeles&trajectory.imu_rate=20")
    show(page, "Lessons")
    page.locator("input[type=file][accept='.homework']").set_input_files(source.with_suffix(".homework"))
    expect(page.get_by_text("Which faults are hidden?")).to_be_visible()
    scale = page.get_by_role("slider", name="R scale").first
    expect(scale).to_be_visible()
    scale.press("End")
    page.get_by_role("checkbox", name="R ten times too small").click()
    page.get_by_role("textbox", name="Your answer, a number").fill("10")
    page.get_by_role("button", name="Save the file to hand in").click()
    expect(page.get_by_text("no name")).to_be_visible()
    page.get_by_role("textbox", name="Your name").fill("Ada Lovelace")
    page.get_by_role("textbox", name="Your name").press("Tab")
    with page.expect_download() as download:
        page.get_by_role("button", name="Save the file to hand in").click()
    assert download.value.suggested_filename == "Ada_Lovelace.handin"
    download.value.save_as(handed / "ada.handin")
    (row,) = csv.DictReader(io.StringIO(ask("grade", str(handed), "--key", str(key)).stdout))
    assert (row["name"], row["status"], row["answer_1"]) == ("Ada Lovelace", "graded", "10")
    assert row["settings"] == "navigator.r_scale=100"
    assert (row["faults_points"], row["answer_points_1"], row["goal_1_points"]) == ("2", "1", "4")
