"""Garbage: an ended page is collected alone, so that no session waits for a collection over all pages.

To find cyclic garbage, Python goes through all objects, and serves no request meanwhile. Thirty pages and
their imports have 1.6 million objects, which takes more than a second. Live objects are therefore frozen:
collections skip them. When a page has ended, its objects are moved to the youngest generation (27,000 objects
for a page that shows its first plots), and a collection of that generation frees them.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import ctypes
import gc
import logging
import sys
import threading
from collections import deque
from itertools import filterfalse
from types import CodeType, ModuleType

import panel as pn
from bokeh.application.application import Application, ServerContext
from bokeh.application.handlers.handler import Handler
from bokeh.server.contexts import ApplicationContext
from tornado.ioloop import IOLoop
from tornado.web import Application as WebApplication

NEWEST, YOUNG = 0, 1
"""Generations of Python's garbage collector."""

AT_ONCE = 10_000
"""References of an ended page that are followed before other tasks run; they take 5 ms."""
MOST = 400_000
"""Most objects that count as those of one page; a page that has shown all its tabs has 100,000."""

SHARED = (
    *(type, ModuleType, CodeType, str, bytes, int, float),
    *(
        Application,
        ApplicationContext,
        ServerContext,
        WebApplication,
        Handler,
        type(pn.state),
        type(pn.config),
    ),
    *(IOLoop, asyncio.AbstractEventLoop, concurrent.futures.Executor, threading.Thread, logging.Logger),
)
"""Types of objects that a page refers to without owning them, and of objects that refer to nothing."""

_untrack, _track = ctypes.pythonapi.PyObject_GC_UnTrack, ctypes.pythonapi.PyObject_GC_Track
_untrack.argtypes = _track.argtypes = [ctypes.py_object]
_untrack.restype = _track.restype = None


def freeze_objects() -> None:
    """Exclude all present objects from the next collections."""
    gc.collect(YOUNG)
    gc.freeze()


def search_all() -> None:
    """Collect over all objects, and exclude the live ones from the next collections."""
    gc.unfreeze()
    gc.collect()
    gc.freeze()


async def collect_from(roots: list[object]) -> None:
    """Collect the garbage that is reachable from some objects; the list is empty afterwards.

    Objects that are still referred to stay; the search is then only wasted time.
    """
    await _make_young(roots)
    gc.collect(NEWEST)


async def _make_young(roots: list[object]) -> None:
    """Move all objects reachable from some objects to the youngest generation; empty the list."""
    # The globals of a module lead to everything that the process has.
    passed = {id(vars(module)) for module in list(sys.modules.values()) if isinstance(module, ModuleType)}
    shared, owned = set[type](), set[type]()
    found: dict[int, object] = {}
    while roots and len(found) < MOST:
        tracked = list(filter(gc.is_tracked, roots[-AT_ONCE:]))
        del roots[-AT_ONCE:]
        some = dict(zip(map(id, tracked), tracked, strict=True))
        for number in passed.intersection(some):
            del some[number]
        passed.update(some)
        for kind in set(map(type, some.values())) - shared - owned:
            (shared if issubclass(kind, SHARED) else owned).add(kind)
        new = {number: one for number, one in some.items() if type(one) in owned}
        # Held here, so that no number of an object is given to another one meanwhile.
        found |= new
        roots += gc.get_referents(*new.values())
        await asyncio.sleep(0)
    roots.clear()
    # Both calls run in C without releasing the lock, so no other thread sees an object in between.
    deque(map(_track, filterfalse(_untrack, filter(gc.is_tracked, found.values()))), maxlen=0)
