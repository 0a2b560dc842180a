"""Garbage: an ended page is searched alone, so that nobody waits for a search through all pages.

To find what is left in cycles, Python goes through all objects there are, and answers nobody meanwhile.
Thirty pages and what they import are 1.6 million objects, and such a search takes more than a second. So
what lives is left out of the searches. Once a page has ended, its objects are made young again, 27,000 of a
page that shows its first plots, and a search of the young frees them.
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
from types import BuiltinFunctionType, CodeType, ModuleType

import panel as pn
from bokeh.application.application import Application, ServerContext
from bokeh.application.handlers.handler import Handler
from bokeh.server.contexts import ApplicationContext
from tornado.ioloop import IOLoop
from tornado.web import Application as WebApplication

NEWEST, YOUNG = 0, 1
"""Generations of Python's objects."""

AT_ONCE = 3000
"""Objects of an ended page that are looked at before others have their turn; they take 15 ms."""
MOST = 400_000
"""Most objects that are taken for those of a page; one that has shown all its tabs has 100,000."""

SHARED = (
    *(type, ModuleType, BuiltinFunctionType, CodeType, str, bytes, int, float),
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
"""Types of what a page refers to without owning it, and of what refers to nothing."""

_untrack, _track = ctypes.pythonapi.PyObject_GC_UnTrack, ctypes.pythonapi.PyObject_GC_Track
_untrack.argtypes = _track.argtypes = [ctypes.py_object]
_untrack.restype = _track.restype = None


def keep() -> None:
    """Leave all objects there are out of the next searches."""
    gc.collect(YOUNG)
    gc.freeze()


def search_all() -> None:
    """Search all objects there are, and leave those that live out of the next searches."""
    gc.unfreeze()
    gc.collect()
    gc.freeze()


async def search_from(root: object) -> None:
    """Search what can be reached from an object that nobody else needs, and free what is garbage.

    What somebody still refers to stays: it is only searched in vain.
    """
    await _make_young(root)
    del root
    gc.collect(NEWEST)


async def _make_young(root: object) -> None:
    """Move what can be reached from an object to the newest generation."""
    shared = {id(vars(module)) for module in list(sys.modules.values()) if isinstance(module, ModuleType)}
    found: dict[int, object] = {}
    waiting = [root]
    while waiting and len(found) < MOST:
        one = waiting.pop()
        number = id(one)
        if number not in found and number not in shared and not isinstance(one, SHARED):
            found[number] = one
            waiting.extend(gc.get_referents(one))
            if len(found) % AT_ONCE == 0:
                await asyncio.sleep(0)
    # All of it without a line of Python: no other thread sees an object between the two calls.
    deque(map(_track, filterfalse(_untrack, filter(gc.is_tracked, found.values()))), maxlen=0)
