"""The way to a viser server: only the token of a view opens it, and only while the view is there."""

from __future__ import annotations

import pytest
from bokeh.document import Document

from dashboards.viser_proxy import client_page, web_application


def test_the_client_is_one_page() -> None:
    page, tag = client_page()
    assert b"<html" in page[:200].lower()
    assert tag.startswith('"')


def test_without_a_browser_there_is_no_way() -> None:
    with pytest.raises(RuntimeError, match="open in a browser"):
        web_application(Document())
