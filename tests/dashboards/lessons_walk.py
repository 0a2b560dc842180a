"""The page Lessons of a walk: the page itself, and a click on one of its buttons."""

from __future__ import annotations

import time

import panel_material_ui as pmui
from walking import PATIENCE, PAUSE, Walk

from dashboards.pages.lessons.lessons import Lessons


def page(walk: Walk) -> Lessons:
    """Return the page Lessons, which is open."""
    found = walk.page.pages._pages[Lessons]
    assert isinstance(found, Lessons)
    return found


def click(walk: Walk, label: str) -> None:
    """Click the button of this label, and wait until its answer is there."""
    (button,) = [one for one in page(walk).view.select(pmui.Button) if one.label == label]
    button.clicks += 1
    until = time.monotonic() + PATIENCE
    while page(walk)._judging.busy:
        time.sleep(PAUSE)
        assert time.monotonic() < until
    walk.settle()
