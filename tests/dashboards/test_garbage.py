"""What lives is left out of searches for garbage; what a page has left is found once it has ended."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from weakref import ref

import pytest

from dashboards.garbage import Garbage


class Link:
    """Something in a cycle: only a search finds that nobody needs it."""

    def __init__(self) -> None:
        self.itself = self


@pytest.fixture
def garbage() -> Iterator[Garbage]:
    automatic = gc.isenabled()
    gc.disable()
    yield Garbage()
    gc.unfreeze()
    if automatic:
        gc.enable()


def test_what_lives_is_not_searched(garbage: Garbage) -> None:
    living = [Link() for _ in range(1000)]
    garbage.keep()
    searched = gc.get_objects()
    assert not any(isinstance(one, Link) for one in searched)
    assert len(searched) < len(living)


def test_what_an_ended_page_leaves_is_found(garbage: Garbage) -> None:
    page = Link()
    gone = ref(page)
    garbage.keep()
    del page
    gc.collect()
    assert gone() is not None
    garbage.page_ended()
    garbage.keep()  # another page opens before the search
    gc.collect()
    assert gone() is None
    living = Link()
    garbage.keep()
    assert not any(one is living for one in gc.get_objects())
