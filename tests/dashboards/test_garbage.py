"""What lives is left out of searches for garbage; what a page has left is found once it has ended."""

from __future__ import annotations

import asyncio
import gc
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any
from weakref import ref

import pytest
from bokeh.core.types import ID
from bokeh.document import Document
from bokeh.util.tornado import _CallbackGroup

from dashboards import garbage
from dashboards.upstream.server import speed_up

PAGES = 2
OPENED = ("Flight", "Filter")
"""Tabs that each page shows; each drops the models of the one before."""
SERVED_PAGES = f"""
import asyncio, gc, os
from functools import partial
import panel as pn
from tornado.ioloop import IOLoop
from weakref import WeakSet, ref
from dashboards import garbage
from dashboards.openings import Openings
from dashboards.page import SimulatorPage
from dashboards.page_tabs import TABS
from tests.benchmarks.visitor import Visitor

async def open_and_leave(address, count):
    visitors = [Visitor(address) for _ in range(count)]
    await asyncio.gather(*(one.open() for one in visitors))
    for tab in {OPENED}:
        shown = list(pages)
        kind = TABS[tab][0]
        for page in shown:
            page._document.add_next_tick_callback(partial(page.pages.tabs.open, kind))
        while any(page.pages._stage._visible is not page.pages._pages.get(kind) for page in shown):
            await asyncio.sleep(0.05)
        del page, shown
        visitors.append(Visitor(address))
        await visitors[-1].open()  # what is there now is kept
    for one in visitors:
        one.close()
    async with asyncio.timeout(300):
        while pages:
            await asyncio.sleep(0.05)

async def main():
    address = f"http://localhost:{{server.port}}/simulator"
    await open_and_leave(address, 1)  # compiles and reads what the first visitor needs
    garbage.search_all()
    await open_and_leave(address, {PAGES})
    gc.unfreeze()
    print(len(strays), gc.collect(), flush=True)

pages, begin = WeakSet(), SimulatorPage.__init__
def begin_and_note(page):
    begin(page)
    pages.add(page)
SimulatorPage.__init__ = begin_and_note
strays, search = [], garbage.collect_from
async def search_and_note(roots):
    left = [ref(one) for one in roots]
    await search(roots)
    alive = {{type(one()).__name__ for one in left if one() is not None}}
    if alive and "SimulatorPage" not in alive:  # otherwise, the page is still in use
        strays.append(alive)
garbage.collect_from = search_and_note
Openings.let_go.__defaults__ = (0.5,)
gc.disable()
pn.io.document._garbage_collect = lambda: None
server = pn.serve(
    {{"/simulator": "dashboards/simulator.py"}}, port=0, show=False, start=False, verbose=False,
    unused_session_lifetime_milliseconds=5000, check_unused_sessions_milliseconds=200,
)
server.start()
IOLoop.current().run_sync(main)
os._exit(0)
"""
"""Opens pages, and waits until all are freed. Nothing else is searched.

Prints how many searches freed a page but not all of its models, and how many objects are left in the end.
"""


class Link:
    """Something in a cycle: only a search finds that nobody needs it."""

    def __init__(self, *others: object) -> None:
        self.itself = self
        self.others = others


class Plain:
    """Something that is freed as soon as nobody refers to it."""


@pytest.fixture(autouse=True)
def no_other_search() -> Iterator[None]:
    automatic = gc.isenabled()
    gc.disable()
    yield
    gc.unfreeze()
    if automatic:
        gc.enable()


def search_from(root: list[object]) -> None:
    """Search from what a list holds, and nobody else."""
    # In a thread of its own: a browser of other tests may leave a loop running in this one.
    with ThreadPoolExecutor(1) as thread:
        thread.submit(lambda: asyncio.run(garbage.collect_from(root))).result()


def test_what_lives_is_not_searched() -> None:
    living = [Link() for _ in range(1000)]
    garbage.freeze_objects()
    searched = gc.get_objects()
    assert not any(isinstance(one, Link) for one in searched)
    assert len(searched) < len(living)


def test_what_an_ended_page_leaves_is_found_without_a_search_through_others() -> None:
    other, needed = Link(), Link()
    others = {id(other), id(vars(other))}
    page = [Link([Link() for _ in range(2 * garbage.AT_ONCE)], needed)]
    left = ref(page[0])
    garbage.freeze_objects()
    search_from(page)
    assert left() is None
    assert needed.itself is needed
    assert others.isdisjoint(map(id, gc.get_objects()))


def test_what_is_still_needed_is_found_later() -> None:
    page = Link()
    left = ref(page)
    garbage.freeze_objects()
    search_from([page])
    garbage.freeze_objects()
    assert left() is page
    pages: list[object] = [page]
    del page
    search_from(pages)
    assert left() is None


@pytest.mark.proof
def test_a_search_of_everything_finds_the_rest() -> None:
    page = Link()
    left = ref(page)
    garbage.freeze_objects()
    del page
    gc.collect()
    assert left() is not None
    garbage.search_all()
    assert left() is None
    assert len(gc.get_objects()) < 1000


def test_a_callback_that_was_called_is_gone_with_its_page() -> None:
    speed_up()
    document, page = Document(), Plain()
    left = ref(page)

    def show(_page: Plain = page) -> None:
        pass

    callback = document.add_next_tick_callback(show)
    callback.callback()
    del callback, show, page
    assert left() is None


@pytest.mark.parametrize("removed", [False, True])
def test_a_turn_that_was_taken_or_removed_holds_no_page(removed: bool) -> None:
    """While a turn waits, it may be excluded from searches: a cycle in it would be found by none."""
    speed_up()
    asked, shown, page = list[Callable[[], None]](), list[bool](), Plain()
    loop: Any = SimpleNamespace(add_callback=asked.append)
    group, left = _CallbackGroup(loop), ref(page)

    def show(_page: Plain = page) -> None:
        shown.append(True)

    group.add_next_tick_callback(show, ID("a turn"))
    if removed:
        group.remove_all_callbacks()
    asked.pop()()
    del show, page
    assert shown == [True] * (not removed)
    assert left() is None
    with pytest.raises(ValueError, match="twice"):
        group.remove_next_tick_callback(ID("a turn"))


@pytest.mark.proof
def test_pages_leave_next_to_nothing() -> None:
    """Served pages, each with 38,000 objects, are freed by the searches from them alone."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    run = subprocess.run(
        [sys.executable, "-c", SERVED_PAGES], capture_output=True, text=True, env=environment, check=False
    )
    assert run.returncode == 0, run.stderr
    strays, left = map(int, run.stdout.split()[-2:])
    assert strays == 0, "what is left of a page is searched again, after 10 s"
    assert left / (PAGES + len(OPENED)) < 500
