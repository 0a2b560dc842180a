"""Exits: code that asks Python to exit, in a server, ends neither the server nor the session of anybody else.

Tornado and asyncio pass on `SystemExit`, which ends the loop of events.
"""

from __future__ import annotations

import asyncio
import logging
from functools import wraps
from typing import Any

from tornado.ioloop import IOLoop
from tornado.web import RequestHandler

log = logging.getLogger(__name__)


def outlive_exits(loop: IOLoop) -> None:
    """Answer a request that asks for an exit with status 500, and go on with the loop whatever asks.

    Parameters
    ----------
    loop
        Loop of events of the server; it may run already.
    """
    execute = RequestHandler._execute
    if not hasattr(execute, "__wrapped__"):

        @wraps(execute)
        async def answer(handler: RequestHandler, *args: Any, **options: Any) -> None:
            try:
                await execute(handler, *args, **options)
            except SystemExit:
                log.exception("a request asked for an exit: %.200s", handler.request.uri)
                if not handler._finished:
                    handler.send_error(500)

        RequestHandler._execute = answer  # type: ignore[method-assign, assignment]
    inner: Any = getattr(loop, "asyncio_loop", None)
    if not isinstance(inner, asyncio.BaseEventLoop) or "_run_once" in vars(inner):
        return
    once = inner._run_once  # type: ignore[attr-defined]

    def go_on() -> None:
        try:
            once()
        except SystemExit:
            log.exception("an event asked for an exit")

    inner._run_once = go_on  # type: ignore[attr-defined]
