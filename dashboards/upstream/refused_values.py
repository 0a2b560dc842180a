"""Refused values: a value that a component does not take is one line of the log, not a traceback.

Panel processes a value of a browser, and logs whatever fails with its traceback: a value that no page sends
is then as long in the log as a fault of a callback. No upstream issue is known.
"""

from __future__ import annotations

import logging
from functools import wraps
from typing import Any

from panel.reactive import Syncable

log = logging.getLogger(__name__)

_SHOWN = 200
"""Longest reason in the log [characters]."""


def refuse_values() -> None:
    """Make Panel look at the values of a browser before it processes them, and drop what is refused."""
    process_any = Syncable._process_events
    if hasattr(process_any, "__wrapped__"):
        return

    @wraps(process_any)
    def process(component: Syncable, events: dict[str, Any]) -> None:
        try:
            for name, value in component._process_property_change(dict(events)).items():
                if name in component.param:
                    component.param[name]._validate(value)
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            log.warning("a value of a page is refused: %s", ascii(str(error))[:_SHOWN])
        else:
            process_any(component, events)

    Syncable._process_events = process  # type: ignore[method-assign, assignment]
