"""Tabs and cards with texts as titles: a browser gets their texts, and no pane for them."""

from __future__ import annotations

import panel as pn
import pytest
from bokeh.models import Model

from dashboards.titled import Card, Tabs


def sent(view: pn.viewable.Viewable) -> list[str]:
    root: Model = view.get_root()
    return sorted(type(model).__name__ for model in root.references())


def test_tabs_have_their_titles_and_parts_alone() -> None:
    parts = [pn.Column(), pn.Column()]
    tabs = Tabs(("first", parts[0]), ("second", parts[1]), active=1)
    data = tabs.get_root().data
    assert (data._names, data.active) == (["first", "second"], 1)
    assert len(data.objects) == 2
    assert tabs.objects == parts
    assert not [kind for kind in sent(tabs) if "HTML" in kind]


@pytest.mark.parametrize("collapsed", [False, True])
def test_a_card_has_its_title_and_parts_alone(collapsed: bool) -> None:
    card = Card(pn.Column(), pn.Row(), title="Gyros", collapsed=collapsed)
    data = card.get_root().data
    assert (data.title, data.collapsed, len(data.objects)) == ("Gyros", collapsed, 2)
    assert not [kind for kind in sent(card) if "HTML" in kind]
