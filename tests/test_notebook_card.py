"""Cards of a notebook: drawn by whoever registered, and not loaded before."""

from __future__ import annotations

import json
import subprocess
import sys

from lab import notebook_card
from lab.notebook_card import NotebookCard, register
from lab.sensors.gps import GpsErrors


class Shown(NotebookCard):
    """Has a card that nobody of the lab draws."""

    CARD = "a card of this test"


def test_a_card_is_drawn_by_whoever_registered_for_it(monkeypatch):
    monkeypatch.setattr(notebook_card, "_DRAWERS", dict(notebook_card._DRAWERS))
    assert Shown()._repr_html_() is None  # Jupyter shows the text then
    register("a card of this test", lambda shown: f"<p>{type(shown).__name__}</p>")
    assert Shown()._repr_html_() == "<p>Shown</p>"


def test_a_subclass_has_the_card_of_its_parent():
    assert "sensors" not in GpsErrors()._repr_html_()
    assert "<table>" in GpsErrors(period=2.0)._repr_html_()


def test_importing_the_lab_registers_the_cards_and_loads_nothing_that_draws():
    script = (
        "import json, sys, lab\nfrom lab import notebook_card\n"
        "print(json.dumps([sorted(notebook_card._DRAWERS), sorted(sys.modules)]))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    cards, modules = json.loads(done.stdout)
    assert {"settings", "result"} <= set(cards)
    assert not {"numpy", "param", "holoviews", "bokeh", "lab.result", "lab.settings"} & set(modules)
