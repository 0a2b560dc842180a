"""A session takes changes from widgets and addresses, and is no way to files of the server."""

from __future__ import annotations

import gc
from pathlib import Path
from weakref import ref

import pytest
from bokeh.document import Document

from dashboards.computing import Outcome, run
from dashboards.progress import ProgressText
from dashboards.session import Session
from lab.base.parameters.setting_error import SettingError
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.missions import missions


@pytest.fixture
def session():
    made = Session(Document())
    yield made
    made.close()


@pytest.fixture
def elsewhere(tmp_path: Path) -> str:
    """Return the path of a flight csv that the experiment itself would accept."""
    path = tmp_path / "flight.csv.gz"
    path.write_bytes(missions()["los_angeles"].recording_path.read_bytes())
    assert Experiment(mission=str(path)).run is not None
    return str(path)


def test_a_mission_is_named_and_never_a_file(session: Session, elsewhere: str) -> None:
    assert not session.change("mission", elsewhere)
    assert "there is no such mission" in session.problem
    assert session.experiment.mission == "montreal"
    with pytest.raises(SettingError, match="there is no such mission"):
        session.accept(Experiment(mission=elsewhere))
    assert session.experiment.mission == "montreal"
    assert session.change("mission", "los_angeles")
    assert (session.experiment.mission, session.problem) == ("los_angeles", "")


def test_a_mission_that_was_deleted_on_another_page_is_named_as_such(session: Session) -> None:
    session._receive(Experiment(mission="deleted"), Outcome(problem="a sentence for the command line"))
    assert "'deleted' is not there any more" in session.problem
    session._receive(Experiment(), Outcome(problem="another fault"))
    assert session.problem == "another fault"


def test_a_text_that_looks_like_a_mission_of_another_setting_is_not_asked(session: Session) -> None:
    """Only the mission is looked up in the catalogue."""
    assert session.change("navigator.model", "psi")
    assert session.experiment.navigator.model == "psi"


def test_the_progress_says_what_is_done_after_the_computation(session: Session) -> None:
    shown = ProgressText(session).view
    for stage, fraction, words in (
        ("Navigating", 0.25, "Navigating … · 25 %"),
        ("Done", 1.0, "Drawing …"),
        ("", 0.0, ""),
    ):
        session.param.update(stage=stage, fraction=fraction)
        assert shown.object == words


def test_pages_with_the_same_settings_share_a_result_while_one_shows_it() -> None:
    def result(**changed: object) -> Result:
        found = run(Experiment(mission="los_angeles").update(changed)).result
        assert isinstance(found, Result)
        return found

    first = result()
    assert result() is first
    assert result(seed=2) is not first
    assert result(seed=2).errors is not first.errors
    gone = ref(first)
    del first
    gc.collect()
    assert gone() is None


def test_a_closed_session_keeps_no_result(session: Session) -> None:
    """A page that has ended waits for a search for garbage; its result need not."""
    heard: list[object] = []
    session.param.watch(heard.append, "result")
    session.result = object()
    session.close()
    assert session.result is None
    assert len(heard) == 1
