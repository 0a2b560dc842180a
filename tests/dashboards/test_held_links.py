"""Held results in an address and in a settings file: as settings, and computed anew behind the page."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from types import SimpleNamespace
from urllib.parse import urlencode

import pytest
from panel.io.state import set_curdoc
from walking import Walk, walking

from dashboards.address import LONGEST
from dashboards.computing import Outcome
from dashboards.exchange import experiment_of
from dashboards.session import MOST_HELD, Held
from dashboards.share import LACKS
from lab.base.parameters.setting_error import SettingError
from lab.experiment.experiment import Experiment

SMALL = "mission=los_angeles&trajectory.imu_rate=50"


@pytest.fixture
def walk() -> Iterator[Walk]:
    with pytest.MonkeyPatch.context() as patch, walking(patch) as opened:
        yield opened


def small(**navigator: float) -> Experiment:
    return Experiment(mission="los_angeles").update(
        {"trajectory": {"imu_rate": 50.0}, "navigator": dict(navigator)}
    )


def take(walk: Walk, *texts: str) -> list[str]:
    return walk.page._address.held.take_link(urlencode([("hold", text) for text in texts]), LONGEST)


def finish(walk: Walk) -> None:
    """Let the time pass after which held results are computed, and wait for them."""
    held, pause = walk.page._address.held, threading.Event()
    with set_curdoc(walk._document):
        held._begin()
    while held._waiting:
        pause.wait(0.01)
        walk.settle()


def hold(walk: Walk, experiment: Experiment) -> None:
    walk.page.session.experiment = experiment.copy()
    assert walk.run(experiment).problem == ""
    with set_curdoc(walk._document):
        walk.page._holding.hold()


def test_held_results_stand_in_the_address_and_come_back_from_it(walk: Walk) -> None:
    hold(walk, small(q_scale=0.1))
    hold(walk, small(r_scale=4.0))
    search = walk.sent()["search"]
    assert search.count("hold=") == 2
    with pytest.MonkeyPatch.context() as patch, walking(patch) as other:
        address = other.page._address
        address.search = search
        with set_curdoc(other._document):
            address.read()
        assert other.page.session.problem == ""
        assert other.page.session.held == ()
        assert other.sent()["search"].count("hold=") == 2  # a reload meanwhile loses none
        assert other.run(small(r_scale=4.0)).problem == ""
        assert address.held._due
        assert other.page.session.held == ()
        finish(other)
        for before, after in zip(walk.page.session.held, other.page.session.held, strict=True):
            assert before.name == after.name
            assert before.result.summary.equals(after.result.summary)
        assert other.sent()["search"].count("hold=") == 2


def test_nothing_is_computed_before_the_first_result(walk: Walk) -> None:
    assert take(walk, f"{SMALL}&navigator.q_scale=0.1") == []
    held = walk.page._address.held
    assert not held._due
    assert not held._work.busy


@pytest.mark.parametrize(
    ("texts", "words", "left"),
    [
        ([f"{SMALL}&seed={k}" for k in range(20)], f"{MOST_HELD} results can be held", MOST_HELD),
        (["navigator.q_scale=" + "1" * LONGEST], "longer than", 0),
        (["no.such=1"], "unknown setting, no.such", 0),
        (["{"], "unknown setting, {", 0),
        (["navigator.q_scale=-1"], "q_scale must be between", 0),
        (["navigator.q_scale=-1&navigator.r_scale=2"], "q_scale must be between", 1),
        (["mission=/etc/passwd"], "'/etc/passwd', which is not here", 0),
        (["mission=../../other/flight.csv"], "which is not here", 0),
        (["&".join(f"a{k}=1" for k in range(300))], "too many settings", 0),
        (["<script>=1"], "unknown setting, <script>", 0),
        ([SMALL] * 3, "", 1),
    ],
)
def test_a_hostile_address_is_answered_in_a_sentence(
    walk: Walk, texts: list[str], words: str, left: int
) -> None:
    problems = take(walk, *texts)
    assert words in " ".join(problems)
    assert len(problems) == bool(words)
    assert len(walk.page._address.held._waiting) == left


def test_a_held_result_that_cannot_be_computed_is_named_and_the_next_one_is(walk: Walk) -> None:
    assert walk.run(small()).problem == ""
    assert (
        take(walk, f"{SMALL}&trajectory.imu_rate=10&navigator.model=nonlinear&sensors.gps.period=60", SMALL)
        == []
    )
    walk.page._address.held._waiting[0][0].run = _fail  # type: ignore[method-assign]
    finish(walk)
    assert "could not be computed again. It diverges" in walk.page.session.problem
    assert len(walk.page.session.held) == 1


def _fail(*_given: object) -> None:
    raise SettingError("It diverges.")


def test_what_does_not_fit_into_a_link_is_in_the_settings_file(walk: Walk) -> None:
    for k in range(MOST_HELD):
        one = small(q_scale=1.0 + k)
        one.set("sensors.gps.outages", [(0.1 * j + 0.001, 0.1 * j + 0.002) for j in range(200)])
        walk.page.session.held = (*walk.page.session.held, _held(one))
    search = walk.sent()["search"]
    assert "hold=" not in search
    assert len(search) <= LONGEST
    with set_curdoc(walk._document):
        walk.page._share._act("open")
        walk.page._share._act("settings")
    assert walk.page._share.view.told["note"] == LACKS
    content = walk.page._address.held.lines + walk.page.session.experiment.to_toml()
    assert experiment_of(content.encode()).to_dict() == walk.page.session.experiment.to_dict()
    with pytest.MonkeyPatch.context() as patch, walking(patch) as other:
        assert other.page._address.held.take_file(content) == []
        assert other.page._address.held.texts == walk.page._address.held.texts


def test_a_settings_file_brings_its_held_results(walk: Walk) -> None:
    assert walk.run(small()).problem == ""
    content = f"# held: {SMALL}&seed=2\n# held: mission=nowhere\n{small(r_scale=4.0).to_toml()}".encode()
    with set_curdoc(walk._document):
        walk.page._add_files()
        files = walk.page._files
        assert files is not None
        files._read(content, Outcome(experiment_of(content)))
    assert walk.page.session.experiment.navigator.r_scale == 4.0
    assert "'nowhere', which is not here" in walk.page.session.problem
    finish(walk)
    assert [one.result.experiment.seed for one in walk.page.session.held] == [2]


def _held(experiment: Experiment) -> Held:
    """Return a held result of which only the settings matter."""
    return Held("made", SimpleNamespace(experiment=experiment, algorithm="", is_long=False))  # type: ignore[arg-type]


def test_hidden_settings_are_not_held_in_an_address(walk: Walk) -> None:
    secret = type("Hidden", (Experiment,), {"hidden": "a lesson"})
    walk.page.session.held = (_held(secret()), _held(small()))
    assert walk.page._address.held.texts == ["mission=los_angeles&trajectory.imu_rate=50.0&name=made"]


def test_a_name_that_a_person_gave_comes_back_with_the_link(walk: Walk) -> None:
    hold(walk, small(q_scale=0.1))
    (held,) = walk.page.session.held
    walk.page.session.held = (held._replace(name="Fast & <b>loose</b>"),)
    (text,) = walk.page._address.held.texts
    walk.page.session.held = ()
    assert take(walk, text, f"{SMALL}&navigator.r_scale=4&name={'x' * 500}") == []
    finish(walk)
    first, second = walk.page.session.held
    assert first.name == "Fast & <b>loose</b>"
    assert len(second.name) == 40
    assert first.result.experiment.navigator.q_scale == 0.1
    assert walk.page._address.held.texts[0] == text
