"""What a notice says is text: names of files are never markup."""

from __future__ import annotations

import panel as pn

from dashboards.notice import Notice


def test_names_of_files_are_text() -> None:
    notice = Notice()
    notice.say('<img src="x" onerror="alert(1)">.csv & more', points=["<b>bold</b>", "plain"])
    (pane,) = notice.view.select(pn.pane.HTML)
    assert "<img" not in pane.object
    assert "<b>" not in pane.object
    assert "&lt;img src=&quot;x&quot; onerror=&quot;alert(1)&quot;&gt;.csv &amp; more" in pane.object
    assert "<li>&lt;b&gt;bold&lt;/b&gt;</li><li>plain</li>" in pane.object
    assert notice.view.visible


def test_nothing_said_is_nothing_shown() -> None:
    notice = Notice()
    notice.say("something")
    notice.say("")
    assert not notice.view.visible
