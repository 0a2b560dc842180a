"""Computing in the background: the latest settings win, and every problem becomes a sentence."""

from __future__ import annotations

from threading import Event

import pytest

from dashboards import computing
from dashboards.computing import LatestWins, Outcome, run
from lab.experiment import Experiment
from lab.missions import MissionError

PATIENCE = 60


@pytest.fixture
def gate(monkeypatch: pytest.MonkeyPatch) -> Event:
    """Hold every run back until the event is set; the problem of an outcome names the seed that was run."""
    gate = Event()

    def wait(experiment: Experiment, *_args: object) -> Outcome:
        assert gate.wait(PATIENCE)
        return Outcome(problem=str(experiment.seed))

    monkeypatch.setattr(computing, "run", wait)
    return gate


class Receiver:
    """Takes outcomes, and tells when a certain one has come."""

    def __init__(self, last: str) -> None:
        self.seeds: list[str] = []
        self.done = Event()
        self._last = last

    def __call__(self, outcome: Outcome) -> None:
        """Take an outcome."""
        self.seeds.append(outcome.problem)
        if outcome.problem == self._last:
            self.done.set()


def test_the_latest_wins(gate: Event) -> None:
    receiver = Receiver(last="9")
    runs = LatestWins(lambda _result: None, receiver)
    for seed in range(1, 10):
        runs.submit(Experiment(seed=seed))
    gate.set()
    assert receiver.done.wait(PATIENCE)
    assert receiver.seeds == ["1", "9"]


def test_settings_are_those_of_the_moment(gate: Event) -> None:
    receiver = Receiver(last="1")
    runs = LatestWins(lambda _result: None, receiver)
    experiment = Experiment(seed=1)
    runs.submit(experiment)
    experiment.seed = 2
    gate.set()
    assert receiver.done.wait(PATIENCE)


def test_nothing_comes_after_the_end(gate: Event) -> None:
    first, second = Receiver(last="1"), Receiver(last="2")
    ended = LatestWins(lambda _result: None, first)
    ended.submit(Experiment(seed=1))
    ended.close()
    ended.submit(Experiment(seed=1))
    other = LatestWins(lambda _result: None, second)
    for _ in range(computing.POOL._max_workers + 1):  # behind the run that was under way
        other.submit(Experiment(seed=2))
    gate.set()
    assert second.done.wait(PATIENCE)
    assert first.seeds == []


def test_a_result_is_prepared_where_it_was_computed() -> None:
    prepared = []
    outcome = run(Experiment(), prepare=prepared.append)
    assert outcome.problem == ""
    assert prepared == [outcome.result]


def test_a_missing_mission_is_a_sentence() -> None:
    outcome = run(Experiment(mission="nowhere"))
    assert outcome.result is None
    assert "there is no mission 'nowhere'" in outcome.problem


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (MissionError("row 3 is wrong"), "row 3 is wrong"),
        (MemoryError(), "more memory"),
        (ZeroDivisionError("x"), "This run failed: ZeroDivisionError: x"),
    ],
)
def test_every_failure_is_a_sentence(monkeypatch: pytest.MonkeyPatch, error: Exception, words: str) -> None:
    def fail(*_args: object) -> None:
        raise error

    monkeypatch.setattr(Experiment, "run", fail)
    assert words in run(Experiment()).problem
