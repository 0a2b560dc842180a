"""The command that compiles ahead."""

from __future__ import annotations

import pytest
from asking import ask

from lab.experiment import variants


@pytest.mark.proof
def test_warm_reports_how_many_combinations_are_ready(monkeypatch: pytest.MonkeyPatch) -> None:
    refused = {"navigator.model": "nonlinear", "navigator.smoother": True}
    monkeypatch.setattr(variants, "variants", lambda: [{}, refused])
    answer = ask("warm")
    assert answer.exit_code == 0
    assert answer.stdout == "The filter is compiled for 1 of 2 combinations; the others are not accepted.\n"
