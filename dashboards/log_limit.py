"""Log limit: bounds on the length and rate of log records, since a visitor can cause any number of them."""

from __future__ import annotations

import logging
import time

from panel.io.logging import panel_log_handler
from tornado.websocket import WebSocketClosedError

LONGEST = 4000
"""Longest text of one record, and of its traceback [characters]: a traceback of forty frames fits."""
AT_ONCE = 100
"""Records that may come in a burst: as many as one fault in thirty sessions writes."""
PER_SECOND = 5.0
"""Sustained rate of records [1/s]: more than a person reads, and 40 kB/s if all have the greatest length."""


class LogLimit(logging.Filter):
    """Shortens long records, and drops those that come too fast; the next one written says how many.

    A browser that leaves while a message is on its way is no fault: Bokeh logs that it left, and the failed
    write, of which Panel leaves a task behind, is not logged.
    """

    def __init__(self) -> None:
        super().__init__()
        self._left, self._filled, self._dropped = float(AT_ONCE), time.monotonic(), 0

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether a record is written."""
        if record.exc_info and isinstance(record.exc_info[1], WebSocketClosedError):
            return False
        now = time.monotonic()
        self._left = min(AT_ONCE, self._left + PER_SECOND * (now - self._filled))
        self._filled = now
        if self._left < 1:
            self._dropped += 1
            return False
        self._left -= 1
        text = _shorten_text(record.getMessage())
        if self._dropped:
            text += f" ({self._dropped} records before this one came too fast and were dropped)"
            self._dropped = 0
        record.msg, record.args = text, ()
        if record.exc_info:
            record.exc_text = _shorten_text(logging.Formatter().formatException(record.exc_info))
        return True


def _shorten_text(text: str) -> str:
    if len(text) <= LONGEST:
        return text
    half = LONGEST // 2
    return f"{text[:half]} … {len(text) - 2 * half} characters left out … {text[-half:]}"


def limit_log() -> None:
    """Limit what this process writes to its log, once."""
    handlers = [logging.lastResort, panel_log_handler, *logging.getLogger().handlers]
    for handler in filter(None, handlers):
        if not any(isinstance(one, LogLimit) for one in handler.filters):
            handler.addFilter(LogLimit())
