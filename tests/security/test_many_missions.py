"""A folder with thousands of missions keeps nobody waiting."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lab.experiment.experiment import Experiment
from lab.missions import add_mission, mission
from tests.security.conftest import Visitor, serving
from tests.security.watch import WAIT, as_map, say, watched

MANY = 2000


def fill(folder: Path) -> None:
    """Fill a folder with missions: flights, logs and what cannot be read, and one called mine."""
    add_mission(mission("los_angeles").recording, "mine", title="My flight", folder=folder)
    for number in range(MANY):
        name = f"many{number:04}"
        if number % 3 == 0:
            (folder / f"{name}.toml").write_text('title = "Flight"\nrecording = "mine.csv.gz"\n')
        elif number % 3 == 1:
            (folder / f"{name}.toml").write_text("nothing = 0\n")
        else:
            (folder / name).mkdir()
            for file in ("imu.csv", "gnss.csv"):
                (folder / name / file).touch()


class Editor:
    """A visitor who turns to the missions, and acts there as a browser does."""

    def __init__(self, visitor: Visitor) -> None:
        self.visitor = visitor
        self._count = 0

    async def open(self) -> None:
        """Turn to the page of the missions, and wait until all are listed."""
        await say(self.visitor, "document_ready")
        while not list(self._cards()):
            await self.visitor.pull()
        await self.wish("ready", "", f"many{MANY - 1}")

    async def wish(self, what: str, name: str, answer: str) -> None:
        """Press a button of a card, and wait for the answer."""
        (cards,) = self._cards()
        self._count += 1
        await self.visitor.change(cards["id"], wish=as_map(what=what, name=name, count=self._count))
        await self._until(answer)

    async def press(self, label: str, answer: str) -> None:
        """Press the button of a dialog, and wait for the answer."""
        (button,) = (one for one in self.visitor.models() if _inside(one).get("label") == label)
        await say(self.visitor, "dom_event", model={"id": button["id"]}, node="click", data=as_map())
        await self._until(answer)

    async def write(self, label: str, text: str) -> None:
        """Write into a field."""
        (field,) = self.visitor.models(label=label)
        await self.visitor.change(field["id"], value_input=text)

    def _cards(self) -> Iterator[dict[str, Any]]:
        return self.visitor.models(chosen=Experiment().mission)

    async def _until(self, answer: str) -> None:
        while answer not in json.dumps(self.visitor.document):
            await self.visitor.pull()


def _inside(model: dict[str, Any]) -> dict[str, Any]:
    data = model["attributes"].get("data")
    found: dict[str, Any] = data.get("attributes", {}) if isinstance(data, dict) else {}
    return found


@pytest.mark.proof
def test_thousands_of_missions_keep_nobody_waiting(tmp_path: Path, run) -> None:
    folder = tmp_path / "missions"
    folder.mkdir()
    fill(folder)

    async def manage() -> dict[str, float]:
        waits = {}
        async with watched(served) as watch, served.visitor("/?tab=Missions") as visitor:
            editor = Editor(visitor)
            for step, work in {
                "the page opened": editor.open(),
                "a dialog opened": editor.wish("edit", "mine", '"My flight"'),
                "a title written": editor.write("Title", "Another title"),
                "a mission saved": editor.press("Save", "another title"),
                "another question": editor.wish("delete", "mine", "and its recording will be deleted"),
                "a mission deleted": editor.press("Delete", "mine was deleted"),
            }.items():
                await work
                waits[step] = watch.longest
                watch.forget()
        return waits

    with serving(tmp_path, INS_LAB_MISSIONS=str(folder)) as served:
        waits = run(manage())
    print(waits)
    assert not (folder / "mine.toml").exists()
    assert max(waits.values()) <= WAIT
