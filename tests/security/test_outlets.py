"""Outlets: only whoever starts the command names a destination; nothing that is served or read can."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from lab.data.streams.address import FORMS, Address
from lab.data.streams.transport import TransportError

ROOT = Path(__file__).parents[2]
OUTLETS = re.compile(r"lab\.live\.outlets|lab\.cli\.live_solution")


def test_only_the_command_line_opens_outlets() -> None:
    files = [path for top in ("lab", "dashboards") for path in (ROOT / top).rglob("*.py")]
    found = {path.relative_to(ROOT).parts[:2] for path in files if OUTLETS.search(path.read_text("utf-8"))}
    assert found == {("lab", "cli"), ("lab", "live")}
    outside = [
        path
        for path in (ROOT / "lab" / "live").rglob("*.py")
        if OUTLETS.search(path.read_text("utf-8")) and path.parent.name != "outlets"
    ]
    assert outside == []


@pytest.mark.parametrize("form", FORMS)
def test_no_address_of_a_source_names_a_destination(form: str) -> None:
    kind = form.partition(":")[0]
    with pytest.raises(TransportError, match="'to' is no option"):
        Address(kind, "place", {"to": "udp:10.0.0.1:5555"}).check(())
