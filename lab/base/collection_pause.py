"""Collection pause: imports and the compiler keep most of the objects that they make.

Searches for garbage take a tenth of an import, and half of the time in which a syntax tree is built.
"""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Iterator


@contextlib.contextmanager
def collection_pause() -> Iterator[None]:
    """Search no garbage while this is open; another thread may go on searching before it ends."""
    collected = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collected:
            gc.enable()
