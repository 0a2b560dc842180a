"""``ins-lab export`` and ``ins-lab run --export``."""

from __future__ import annotations

import json
from pathlib import Path

from asking import ask, refused


def test_a_mission_is_written_and_replaced_only_when_told(tmp_path: Path) -> None:
    path = tmp_path / "flight.kml"
    answer = ask("export", "montreal", "--to", str(path))
    assert answer.exit_code == 0
    assert answer.stdout.strip() == str(path)
    assert "<name>Montréal</name>" in path.read_text(encoding="utf-8")
    refused(ask("export", "montreal", "--to", str(path)), "exists already", "--force")
    assert ask("export", "montreal", "--to", str(path), "--force").exit_code == 0


def test_a_run_writes_its_paths(tmp_path: Path) -> None:
    path = tmp_path / "run.gpx"
    answer = ask("run", "montreal", "--export", str(path), "--json")
    assert json.loads(answer.stdout)["export"] == str(path)
    assert path.read_text(encoding="utf-8").count("<trkseg>") == 3


def test_what_cannot_be_written_is_said_before_the_work(tmp_path: Path) -> None:
    refused(ask("export", "montreal", "--to", str(tmp_path / "a.shp")), "--to", ".kml, .gpx, .csv, .csv.gz")
    refused(ask("export", "montreal", "--to", str(tmp_path / "no" / "a.kml")), "there is no folder")
    refused(ask("export", "nowhere", "--to", str(tmp_path / "a.kml")), "there is no mission")
    refused(ask("run", "montreal", "--export", str(tmp_path / "a.txt")), "--export", ".kml")
    assert not list(tmp_path.iterdir())
