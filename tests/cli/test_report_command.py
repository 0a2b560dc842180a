"""``ins-lab report``."""

from __future__ import annotations

import json
from pathlib import Path

from asking import ask, refused


def test_a_report_is_written_and_replaced_only_when_told(tmp_path: Path) -> None:
    path = tmp_path / "flight.html"
    note = ("--note", "60-75:<b>Look</b>: here", "--note", "80:There")
    asked = ("report", "montreal", "--set", "trajectory.imu_rate=50", "--to", str(path), *note)
    answer = ask(*asked)
    assert answer.exit_code == 0
    assert answer.stdout.strip() == str(path)
    html = path.read_text(encoding="utf-8")
    assert "<h1>Montréal</h1>" in html
    assert "<li>60.0 to 75.0 s: &lt;b&gt;Look&lt;/b&gt;: here</li><li>80.0 s: There</li>" in html
    refused(ask(*asked), "exists already", "--force")
    told = ask(*asked, "--force", "--json")
    assert told.exit_code == 0
    for late in ("300:Beyond", "200-205.5:Beyond"):
        refused(ask(*asked, "--force", "--note", late), "'Beyond'", "lasts 205.0 s")
    facts = json.loads(told.stdout)
    assert (facts["report"], facts["changed"]) == (str(path), {"trajectory.imu_rate": 50.0})


def test_what_cannot_be_written_is_said_before_the_work(tmp_path: Path) -> None:
    refused(ask("report", "montreal", "--to", str(tmp_path / "a.pdf")), "--to", ".html")
    refused(ask("report", "montreal", "--to", str(tmp_path / "no" / "a.html")), "there is no folder")
    for wrong in ("75-60:x", "60", "60:", "nan:x", "-1:x", f"1:{'x' * 201}"):
        refused(
            ask("report", "montreal", "--to", str(tmp_path / "a.html"), "--note", wrong), "--note", "60-75"
        )
    for name in ("nowhere", ""):  # as of a variable of a shell that is not set
        refused(ask("report", name, "--to", str(tmp_path / "a.html")), f"there is no mission {name!r}")
    assert not list(tmp_path.iterdir())
