"""Pages that open at once take turns."""

from __future__ import annotations

import asyncio
import gc
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from contextvars import ContextVar
from functools import partial
from threading import Event
from types import SimpleNamespace
from typing import Any
from weakref import ref

import pytest
from bokeh.document import Document
from panel.io.state import set_curdoc

from dashboards import garbage, openings, session
from dashboards.computing import Outcome
from dashboards.openings import Openings
from dashboards.page import SimulatorPage
from lab.experiment.experiment import Experiment

CONTEXT: Any = SimpleNamespace(destroyed=False)


def completed(work: Callable[[], Coroutine[Any, Any, None]]) -> None:
    """Run a coroutine to its end, within 30 s."""
    # In a thread of its own: a browser of other tests may leave a loop running in this one.
    with ThreadPoolExecutor(1) as thread:
        thread.submit(lambda: asyncio.run(asyncio.wait_for(work(), 30))).result()


def test_one_page_at_a_time_in_the_order_they_came_and_others_between() -> None:
    events: list[str] = []

    async def open_page(name: str, turns: Openings) -> None:
        await turns.on_session_created(CONTEXT)
        events.append(name)

    async def burst() -> None:
        turns = Openings()
        pages = [asyncio.ensure_future(open_page(name, turns)) for name in "abc"]
        await pages[0]
        assert turns.is_crowded(Document())
        events.append("a slider of an open page")
        await asyncio.gather(*pages)
        assert not turns.is_crowded(Document())

    completed(burst)
    assert events == ["a", "a slider of an open page", "b", "c"]


def test_a_page_that_has_left_keeps_nobody_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither one that has gone nor one whose browser takes nothing more."""
    monkeypatch.setattr(openings, "LONGEST", 0.01)
    taken: list[str] = []

    async def burst() -> None:
        turns, stuck = Openings(), Document()
        turns.later(Document(), lambda: taken.append("gone"))
        context: Any = SimpleNamespace(destroyed=False)
        stuck._session_context = lambda: context
        turns.later(stuck, lambda: taken.append("stuck"))
        await turns.on_session_created(CONTEXT)

    completed(burst)
    assert taken == []


def test_a_result_and_a_zoom_do_not_draw_before_the_plots_have_their_turn() -> None:
    """The first result sets the time axis, which looks like a zoom."""
    document = Document()
    with set_curdoc(document):
        page = SimulatorPage()
    page._steps = [page.pages.draw]
    page.axis.range.end = 5.0
    page._draw_window()
    assert page.pages._stage.view.objects == []
    page._take_step()
    assert page.pages._stage.view.objects != []
    page.close()


@pytest.mark.parametrize("crowded", [False, True])
def test_a_page_alone_has_its_plots_first_and_all_settings_in_one_step(
    crowded: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A browser paints the plots before it makes seventy fields; in a crowd, each step is a turn."""
    document, asked = Document(), list[Callable[[], None]]()
    with set_curdoc(document):
        page = SimulatorPage()
        page._openings = Openings()
        monkeypatch.setattr(page._openings, "is_crowded", lambda _document: crowded)
        monkeypatch.setattr(page._openings, "later", lambda _document, step: asked.append(step))
        page.servable()
        plots = page.pages._stage.view.objects
        assert (plots == []) == crowded
        assert page._sidebar.objects == []
        page._is_ready()
        steps = 0
        while asked:
            asked.pop(0)()
            steps += 1
    assert page._settings is not None
    assert page._files is not None
    assert page._files.view in page._sidebar.objects
    assert page.pages._stage.view.objects != []
    assert steps > 3 if crowded else steps == 1
    page.close()


@pytest.mark.parametrize("crowded", [False, True])
def test_a_page_alone_is_made_with_the_result_that_is_in_the_cache(
    crowded: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its browser lays the plots out once; in a crowd, nobody waits for a result, however soon it comes."""
    Experiment().run()
    monkeypatch.setattr(session, "AT_HAND", 30.0)
    document = Document()
    with set_curdoc(document):
        page = SimulatorPage()
        page._openings = Openings()
        monkeypatch.setattr(page._openings, "is_crowded", lambda _document: crowded)
        page.servable()
    assert (page.session.result is None) == crowded
    page.close()


def test_a_page_does_not_wait_for_a_long_run(monkeypatch: pytest.MonkeyPatch) -> None:
    goes_on = Event()
    monkeypatch.setattr(session, "run", lambda *_given: goes_on.wait(30) and Outcome(problem="too late"))
    document = Document()
    with set_curdoc(document):
        page = SimulatorPage()
        page._openings = Openings()
        page.servable()
    assert page.session.is_running
    assert page.session.problem == ""
    goes_on.set()
    page.close()


def test_without_a_server_there_are_no_turns() -> None:
    assert Openings.of(Document()) is None


class Ended:
    """An ended page: only a search frees it."""

    def __init__(self) -> None:
        self.itself = self


def test_an_ended_page_is_freed_once_no_other_waits_to_open() -> None:
    async def end_and_open() -> None:
        turns = Openings()
        page = Ended()
        left = ref(page)
        garbage.freeze_objects()
        turns.let_go(page, Document())
        del page
        for _ in range(3):
            await turns.on_session_created(CONTEXT)
            assert left() is not None
        await turns._working
        assert left() is None

    completed(end_and_open)


def test_an_ended_page_that_is_still_in_use_is_freed_later(monkeypatch: pytest.MonkeyPatch) -> None:
    """A computation in a thread refers to its page until it is done."""
    again: list[Callable[[], None]] = []

    async def end() -> None:
        loop, turns, page = asyncio.get_running_loop(), Openings(), Ended()
        monkeypatch.setattr(loop, "call_later", lambda _wait, call, *rest: again.append(partial(call, *rest)))
        left = ref(page)
        await turns._search([page], 1.0)
        assert left() is page
        garbage.freeze_objects()
        del page
        gc.collect()
        assert left() is not None
        again.pop()()
        monkeypatch.undo()
        await turns._working
        assert left() is None
        assert again == []

    completed(end)


def test_the_turns_do_not_refer_to_the_page_that_asked_first() -> None:
    current: ContextVar[object] = ContextVar("current")

    async def end() -> None:
        turns, page = Openings(), Ended()
        left = ref(page)
        token = current.set(page)  # as Panel does with the document of a page
        turns.let_go(page, Document())
        current.reset(token)
        del page, token
        await turns._working
        assert left() is None

    completed(end)


UNLIMITED = 10**12
"""More objects and bytes than a process has. After thousands of tests it has more than a server searches."""


def searches(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return a list that gets an entry with each search of everything, asked for with each ended page."""
    found: list[int] = []
    monkeypatch.setattr(openings, "MUCH", UNLIMITED)
    monkeypatch.setattr(openings, "rested", lambda: openings.STILL)
    monkeypatch.setattr(garbage, "search_all", lambda: found.append(1))
    return found


def end_pages(turns: Openings, count: int) -> None:
    """End some pages, one after the other."""

    async def end_one() -> None:
        await turns._search([Ended()], 1.0)
        if turns._searching is not None:
            await turns._searching

    for _ in range(count):
        completed(end_one)


@pytest.mark.proof
def test_everything_is_searched_now_and_then_while_there_is_not_too_much(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found, turns = searches(monkeypatch), Openings()
    monkeypatch.setattr(openings, "ENOUGH", 2)
    monkeypatch.setattr(openings, "MOST", UNLIMITED)
    end_pages(turns, 4)
    assert len(found) == 2
    monkeypatch.setattr(openings, "MOST", 0)
    end_pages(turns, 4)
    assert len(found) == 2


def test_everything_is_searched_for_a_page_that_only_garbage_refers_to(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found, turns, page = searches(monkeypatch), Openings(), Ended()
    monkeypatch.setattr(openings, "ENOUGH", 0)
    monkeypatch.setattr(openings, "MOST", UNLIMITED)

    async def end() -> None:
        await turns._search([page], 1e9)  # no second search meanwhile
        await turns._searching

    completed(end)
    assert found == [1]


@pytest.mark.proof
def test_everything_is_searched_when_much_memory_was_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stream at 1 kHz is few objects, and 100 MB."""
    memory = [300]
    monkeypatch.setattr(openings, "resident", lambda: memory[-1])
    found, turns = searches(monkeypatch), Openings()
    monkeypatch.setattr(openings, "MUCH", 100)
    monkeypatch.setattr(openings, "MOST", UNLIMITED)
    expected = 0
    for now, is_much in ((390, False), (200, False), (290, False), (310, True), (400, False), (420, True)):
        memory.append(now)
        end_pages(turns, 1)
        expected += is_much
        assert len(found) == expected, now


def test_everything_is_searched_only_while_nobody_moves_a_slider(monkeypatch: pytest.MonkeyPatch) -> None:
    found, turns = searches(monkeypatch), Openings()
    rests = iter((0.0, openings.STILL / 2, openings.STILL))
    seen: list[int] = []

    def rested() -> float:
        seen.append(len(found))
        return next(rests)

    monkeypatch.setattr(openings, "rested", rested)
    monkeypatch.setattr(openings, "ENOUGH", 1)
    monkeypatch.setattr(openings, "LOOK", 0.0)
    monkeypatch.setattr(openings, "MOST", UNLIMITED)
    end_pages(turns, 1)
    assert seen == [0, 0, 0]
    assert found == [1]


@pytest.mark.proof
def test_everything_is_searched_once_the_last_page_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its streams may have left much, and the memory taken before was that of streams too.

    However much it is, nobody waits while it is searched.
    """
    found, turns = searches(monkeypatch), Openings()
    monkeypatch.setattr(openings, "MOST", 0)
    context: Any = Context([SimpleNamespace(connection_count=1, document=Document())])
    turns._context = ref(context)
    end_pages(turns, 1)
    assert found == []
    context.sessions = []

    async def leave() -> None:
        turns.let_go(document := Document(), document)
        await turns._working
        await turns._searching
        turns._search_all()  # nothing has ended since

    completed(leave)
    assert found == [1]


def test_a_page_that_ends_leaves_the_cache_what_the_others_need(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages one after the other fill no cache; one that has lost its browser needs nothing any more."""
    sizes: list[int] = []
    monkeypatch.setattr(openings.CACHE, "shrink", sizes.append)

    async def leave() -> None:
        turns = Openings()
        seen, left = (SimpleNamespace(connection_count=n, document=Document()) for n in (1, 0))
        context: Any = Context([])
        turns._context = ref(context)
        for context.sessions in ([seen, seen, left], [seen], [left], []):
            turns.let_go(Document(), Document())  # one that is in use is searched again after some time
            await turns._working

    completed(leave)
    assert sizes == [openings.AT_REST + number * openings.EACH for number in (2, 1, 0, 0)]


class Context:
    """What a server knows of its sessions."""

    def __init__(self, sessions: list[Any]) -> None:
        self.sessions = sessions


def test_a_page_opens_in_steps_while_another_is_open() -> None:
    turns, session = Openings(), SimpleNamespace(connection_count=0, document=Document())
    context: Any = Context([session])
    assert not turns.is_crowded(Document())
    turns._context = ref(context)
    assert not turns.is_crowded(Document())
    session.connection_count = 1
    assert turns.is_crowded(Document())
    assert not turns.is_crowded(session.document)  # its own page


def test_a_page_with_a_stream_stays_until_the_one_that_is_loaded_again_may_be_there() -> None:
    document, left = Document(), SimpleNamespace(milliseconds_since_last_unsubscribe=0.0)
    context: Any = SimpleNamespace(session=left)
    document._session_context = lambda: context
    assert not openings.may_not_end(document)
    openings.end_later(document)
    for seconds, stays in ((openings.LEFT, True), (7.9, True), (8.1, False)):
        left.milliseconds_since_last_unsubscribe = 1000 * seconds
        assert openings.may_not_end(document) == stays


def test_a_page_that_asks_while_memory_goes_back_has_its_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    begun, asked = Event(), Event()

    def give_back() -> None:
        begun.set()
        assert asked.wait(30)

    monkeypatch.setattr(openings, "give_back", give_back)

    async def open_meanwhile() -> None:
        turns = Openings()
        turns.let_go(document := Document(), document)
        await asyncio.to_thread(begun.wait, 30)
        opening = asyncio.ensure_future(turns.on_session_created(CONTEXT))
        await asyncio.sleep(0)
        asked.set()
        await asyncio.wait_for(opening, 5)

    completed(open_meanwhile)
