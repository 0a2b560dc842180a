"""What a homework or the gallery hides, and the seed, are in nothing that a page or a command gives away."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable, Iterator

import pytest
from panel.io.state import set_curdoc

from dashboards.share import FILES, ShareMenu
from lab.classroom.gallery.faults import FAULTS
from lab.classroom.gallery.faulty_experiment import FaultyExperiment
from lab.classroom.homework.hidden_experiment import HiddenExperiment
from lab.classroom.homework.homework import Homework
from lab.classroom.homework.scenario import Hidden, Scenario
from lab.cli.run import json_facts, report
from lab.experiment.experiment import Experiment
from lab.run.run import ResultError
from tests.dashboards.walking import Walk, walking

SEED, HIDDEN_SEED = 3141592653, 2718281828
BIAS, ARM = 0.0437219, 2.6173911
SECRET = {"sensors": {"gyro": {"bias": [BIAS, 0.0, 0.0]}, "gps": {"lever_arm": [ARM, 0.0, 0.0]}}}
FAULT = FAULTS["latency"]
WORDS = [
    *map(str, (SEED, HIDDEN_SEED, (HIDDEN_SEED + SEED - 1) % 2**32, BIAS, ARM)),
    *(FAULT.title, "latency = 0.12", '"latency": 0.12', "gps.latency"),
]
"""What nobody may read."""
SHOWN = {"mission": "los_angeles", "trajectory": {"imu_rate": 20.0}}


def homework(hidden: Hidden) -> HiddenExperiment:
    scenario = Scenario("abc", "A title", SHOWN, ("navigator",), hidden)
    return Homework(scenario, "", b"").experiment()


def of_homework() -> Experiment:
    return homework(Hidden(("latency",), SECRET, HIDDEN_SEED))


def of_the_gallery() -> Experiment:
    return FaultyExperiment(FAULT).update(SHOWN)


@pytest.fixture(params=[of_homework, of_the_gallery], ids=lambda made: made.__name__)
def walk(request: pytest.FixtureRequest) -> Iterator[Walk]:
    """Return a page that shows the run of an experiment that hides something, with another seed."""
    made: Callable[[], Experiment] = request.param
    with pytest.MonkeyPatch.context() as patch, walking(patch) as opened:
        experiment = made()
        experiment.set("seed", SEED)
        experiment.set("navigator.q_scale", 0.5)
        with set_curdoc(opened._document):
            opened.page.session.accept(experiment)
        opened.show(experiment.run())
        yield opened


def read(content: bytes) -> bytes:
    """Return a file, or all files in a zip file with their names."""
    if not content.startswith(b"PK"):
        return content
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return b"\n".join(name.encode() + archive.read(name) for name in archive.namelist())


def test_no_output_has_what_is_hidden_or_the_seed(walk: Walk, monkeypatch: pytest.MonkeyPatch) -> None:
    given = dict[str, bytes]()
    monkeypatch.setattr(ShareMenu, "give", lambda _self, name, content: given.update({name: content}))
    page = walk.page
    result = page.session.result
    assert result is not None
    outputs = {name: read(kind.write(result, lambda _words, _part: None)) for name, kind in FILES.items()}
    with set_curdoc(walk._document):
        page._holding.hold()
        page._share._act("settings")
        page._share._act("open")
    ((name, settings),) = given.items()
    outputs |= {
        "names": page._share._name(result.experiment, "nc").encode() + name.encode(),
        "settings": settings,
        "menu": json.dumps(page._share.view.told).encode(),
        "held": page._address.held.query.encode(),
        "run --json": json.dumps(json_facts(result, ("budget",), None, out=None)).encode(),  # type: ignore[arg-type]
        "run": report(result, result.tried_verdict).encode(),
        "card": (result._repr_html_() or "").encode() + repr(result).encode(),
    }
    found = {(name, word) for name, text in outputs.items() for word in WORDS if word.encode() in text}
    assert found == set()
    with pytest.raises(ResultError, match="hidden"):  # P and H show what the filter assumes
        result.update_at(30.0)
    assert b"q_scale" in outputs["settings"]
    assert b"navigator.q_scale=0.5" in outputs["menu"]
