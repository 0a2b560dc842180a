"""``ins-lab identify``: what the innovations of a log say, and the files that take it over."""

from __future__ import annotations

import json

import pytest
from asking import ask, refused
from sensor_logs import tables, write


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """Return a log whose lever arm nobody states."""
    return write(tmp_path_factory.mktemp("logs") / "drive", tables(40, 120, lever_arm=(2.0, 0.0, 0.0)))


@pytest.mark.proof
def test_a_log_is_identified_and_run_with_what_was_found(drive, tmp_path):
    settings, card = tmp_path / "found.toml", tmp_path / "mine.toml"
    answer = ask("identify", str(drive), "--settings", str(settings), "--card", str(card), "--json")
    assert answer.exit_code == 0, answer.stderr
    facts = json.loads(answer.stdout)
    rows = {row["parameter"]: row for row in facts["rows"]}
    assert rows["lever arm forward"]["after"] == pytest.approx(
        2.0, abs=4 * rows["lever arm forward"]["sigma"]
    )
    assert facts["after"]["log_likelihood"] > facts["before"]["log_likelihood"]
    assert ask("cards", str(card)).exit_code == 0
    again = ask("run", str(drive), "--config", str(settings), "--json")
    assert again.exit_code == 0, again.stderr
    used = json.loads(again.stdout)["settings"]["navigator"]
    assert used["lever_arm"] == pytest.approx(facts["changes"]["navigator"]["lever_arm"])


@pytest.mark.proof
def test_the_table_says_what_is_not_observable(drive):
    answer = ask("identify", str(drive))
    assert answer.exit_code == 0, answer.stderr
    assert "95 % interval" in answer.stdout
    assert "not observable in this flight" in answer.stdout
    assert "Fixes withheld for 10 s" in answer.stdout


def test_what_exists_is_not_replaced(drive, tmp_path):
    (tmp_path / "found.toml").write_text("")
    refused(ask("identify", str(drive), "--settings", str(tmp_path / "found.toml")), "exists already")
