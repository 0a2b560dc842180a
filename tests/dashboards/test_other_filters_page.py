"""The page Other filters as objects: its layout; `test_other_filters_in_browser` drops logs on it."""

from __future__ import annotations

import pytest
from bokeh.document import Document

from dashboards.pages.other_filters import OtherFilters
from dashboards.upstream.server import speed_up
from lab.views.figures import TimeAxis


def test_the_page_is_laid_out_without_a_part_that_wants_another_size(
    caplog: pytest.LogCaptureFixture,
) -> None:
    speed_up()
    page = OtherFilters(TimeAxis())
    page.view.get_root(Document())
    assert "sizing_mode" not in caplog.text
