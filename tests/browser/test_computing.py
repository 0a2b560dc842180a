"""Computing in the background: the latest settings win, and every problem becomes a sentence."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from queue import Queue
from threading import Event

import pytest
from bokeh.document import Document

from dashboards import computing, session
from dashboards.computing import LatestWins, Outcome, run
from lab.base.progress import Progress
from lab.experiment.experiment import Experiment
from lab.missions import MissionError

PATIENCE = 60


Work = Callable[[int, Progress], Outcome]


@pytest.fixture
def gate() -> Event:
    """Return what holds every work back until it is set."""
    return Event()


@pytest.fixture
def held(gate: Event) -> Work:
    """Return work that waits at the gate, and then tells its progress."""

    def work(number: int, progress: Progress) -> Outcome:
        assert gate.wait(PATIENCE)
        progress("working", 0.5)
        return Outcome(result=number)

    return work


class Receiver:
    """Takes outcomes, and tells when a certain one has come."""

    def __init__(self, last: int) -> None:
        self.numbers: list[int] = []
        self.done = Event()
        self._last = last

    def __call__(self, number: int, outcome: Outcome) -> None:
        """Take an outcome."""
        assert outcome == Outcome(result=number)
        self.numbers.append(number)
        if number == self._last:
            self.done.set()


@pytest.mark.parametrize(("at_once", "delivered"), [(False, [1, 9]), (True, [9])])
def test_the_latest_wins(gate: Event, held: Work, at_once: bool, delivered: list[int]) -> None:
    receiver = Receiver(last=9)
    runs = LatestWins(held, receiver, at_once=at_once)
    for number in range(1, 10):
        runs.submit(number)
    gate.set()
    assert receiver.done.wait(PATIENCE)
    assert receiver.numbers == delivered


@pytest.mark.parametrize("begun", [True, False])
def test_what_nobody_sees_waits_behind_what_is_seen(begun: bool) -> None:
    """Whether it was under way already, or waited before the other; it is done afterwards."""
    delivered: Queue[int] = Queue()
    gate, started = Event(), Event()

    def work(number: int, progress: Progress) -> Outcome:
        started.set()
        assert gate.wait(PATIENCE)
        progress("working", 0.5)
        return Outcome(result=number)

    with ThreadPoolExecutor(1) as pool:
        holds: LatestWins[int] = LatestWins(work, lambda number, _outcome: delivered.put(number), pool)
        left, seen = (
            LatestWins[int](work, lambda number, _outcome: delivered.put(number), pool, at_once=True)
            for _ in range(2)
        )
        if not begun:
            holds.submit(0)
            assert started.wait(PATIENCE)
        left.submit(1)
        assert started.wait(PATIENCE)
        left.is_seen = False
        seen.submit(2)
        gate.set()
        order = [delivered.get(timeout=PATIENCE) for _ in range(2 if begun else 3)]
        assert order == ([2, 1] if begun else [0, 2, 1])
        left.submit(3)  # nothing waits: it is not put off
        assert delivered.get(timeout=PATIENCE) == 3


def test_nothing_comes_after_the_end(gate: Event, held: Work) -> None:
    first, second = Receiver(last=1), Receiver(last=2)
    ended = LatestWins(held, first)
    ended.submit(1)
    ended.close()
    ended.submit(1)
    other = LatestWins(held, second)
    for _ in range(computing.POOL._max_workers + 1):  # behind the run that was under way
        other.submit(2)
    gate.set()
    assert second.done.wait(PATIENCE)
    assert first.numbers == []


def test_settings_are_those_of_the_moment(gate: Event, monkeypatch: pytest.MonkeyPatch) -> None:
    ran: Queue[int] = Queue()

    def wait(experiment: Experiment, *_args: object) -> Outcome:
        assert gate.wait(PATIENCE)
        ran.put(int(experiment.seed))
        return Outcome(problem="none")

    monkeypatch.setattr(session, "run", wait)
    one = session.Session(Document())
    one.experiment.seed = 7
    one.compute()
    one.experiment.seed = 8
    gate.set()
    assert ran.get(timeout=PATIENCE) == 7
    one.close()


def test_rest_comes_once_after_the_last_of_many_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "run", lambda *_args: Outcome(problem="none"))
    monkeypatch.setattr(session, "REST", 250)
    now = [100.0]
    monkeypatch.setattr(session.time, "monotonic", lambda: now[0])
    document = Document()
    one = session.Session(document)
    rests: list[float] = []
    one.on_idle(lambda: rests.append(now[0]))

    def look(after: float) -> None:
        """Have the session look whether there is rest, when it wanted to."""
        (due,) = (c for c in document.session_callbacks if getattr(c, "timeout", 1000) <= session.REST)
        assert due.timeout == pytest.approx(after, abs=1)
        callback = due.callback  # a callback that was removed refers to nothing
        document.remove_timeout_callback(due)
        callback()

    for seed in range(3):
        assert one.change("seed", seed)
        now[0] += 0.1
    now[0] = 100.25
    look(250)
    assert rests == []
    now[0] = 100.45
    look(200)
    assert rests == [100.45]
    assert one.change("seed", 9)
    now[0] = 100.70
    look(250)
    assert rests == [100.45, 100.70]
    one.close()


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
