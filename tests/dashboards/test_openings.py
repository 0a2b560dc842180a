"""Pages that open at once take turns."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any

import pytest
from bokeh.document import Document
from panel.io.state import set_curdoc

from dashboards import openings
from dashboards.openings import Openings
from dashboards.page import SimulatorPage

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
        assert turns.crowded
        events.append("a slider of an open page")
        await asyncio.gather(*pages)
        assert not turns.crowded

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
    page._steps = [page._show]
    page.axis.range.end = 5.0
    page._draw_window()
    assert page._stage.objects == []
    page._take_step()
    assert page._stage.objects != []
    page.close()


def test_without_a_server_there_are_no_turns() -> None:
    assert Openings.of(Document()) is None
