"""The plans shown in the documents can be flown as they stand there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from lab.flying.flight_plan import read_plan
from lab.missions import fly, fly_mission
from lab.missions.mission import Mission

ROOT = Path(__file__).parents[2]


def examples(name: str) -> list[str]:
    """Return the examples in TOML of a Markdown file that hold a whole plan."""
    found = re.findall(r"```toml\n(.*?)```", (ROOT / name).read_text(encoding="utf-8"), re.S)
    return [
        text
        for text in found
        if any(f"[[flight.{word}]]" in text for word in ("waypoints", "commands", "manoeuvres"))
    ]


@pytest.mark.proof
def test_the_figure_of_eight_flies(tmp_path: Path) -> None:
    pytest.importorskip("jsbsim", reason="flying needs the extra 'fly'")
    (text,) = examples("docs/flying.md")
    plan = tmp_path / "eight.toml"
    plan.write_text(text, encoding="utf-8")
    flown = fly_mission(plan)
    assert flown.ending == ""
    assert flown.duration == pytest.approx(200, abs=0.06)


@pytest.mark.proof
@pytest.mark.parametrize("number", range(3))
def test_the_plans_beside_the_missions_are_flown(number: int, tmp_path: Path) -> None:
    path = tmp_path / "plan.toml"
    text = examples("missions/README.md")[number]
    if "title" not in text:
        text = 'title = "Plan"\nrecording = "plan.csv.gz"\n' + text
    path.write_text(text, encoding="utf-8")
    flight = Mission.from_toml(path).flight
    assert flight is not None
    plan = read_plan(flight)
    if number == 0:
        pytest.importorskip("jsbsim", reason="flying needs the extra 'fly'")
    assert fly(plan).ending == ""
