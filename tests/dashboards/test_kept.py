"""What a browser stores of a page comes back as it was, and anything else as nothing."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as some

from dashboards.kept import LONGEST, MOST_ENTRIES, Kept, Own, Typed, brought_back
from dashboards.teaching.school_class import MOST_LESSONS, MOST_STEPS

WORD = some.text(max_size=20)
KEY = some.tuples(WORD, WORD)
STEPS = some.sets(some.integers(0, MOST_STEPS - 1), min_size=1, max_size=4).map(
    lambda found: tuple(sorted(found))
)
PLAIN = some.recursive(
    some.none() | some.booleans() | some.integers() | some.floats() | WORD,
    lambda inner: some.lists(inner, max_size=4) | some.dictionaries(WORD, inner, max_size=4),
)


@given(
    some.builds(
        Kept,
        some.none() | some.tuples(KEY, some.integers(0, 30)),
        some.booleans(),
        some.dictionaries(KEY, STEPS, max_size=5),
        WORD,
        some.none() | some.builds(Own, WORD, WORD, some.floats(0, 1e6)),
        some.none() | some.builds(Typed, WORD, WORD, some.tuples(WORD), some.tuples(WORD, WORD)),
        some.dictionaries(WORD, some.lists(WORD, max_size=3), max_size=3),
        some.just(()),
        some.none() | WORD,
    ),
    some.booleans(),
)
def test_what_is_stored_comes_back(kept: Kept, is_same: bool) -> None:
    brought = json.dumps({"kept": kept.text, "is_same": is_same})
    assert brought_back(brought) == ((kept, is_same) if kept.text else (Kept(), False))


@given(PLAIN, some.dictionaries(some.sampled_from(Kept._fields), PLAIN))
def test_anything_else_is_nothing_or_plain(whole: object, parts: dict[str, object]) -> None:
    for inner in (whole, parts):
        for brought in (inner, json.dumps(inner), json.dumps({"kept": json.dumps(inner), "is_same": 1})):
            kept, is_same = brought_back(brought)
            assert is_same is False
            assert len(kept.solved) <= MOST_LESSONS
            assert all(0 <= step < MOST_STEPS for steps in kept.solved.values() for step in steps)
            assert isinstance(kept.name, str)


@pytest.mark.parametrize(
    "brought", ["[" * 50_000, "x" * (3 * LONGEST), '{"kept": "' + "[" * 9000 + '"}', None, 7]
)
def test_what_is_hostile_is_nothing(brought: object) -> None:
    assert brought_back(brought) == (Kept(), False)


@given(
    some.lists(some.tuples(WORD, WORD, some.booleans() | some.integers(-9, 9) | some.floats(-1, 1) | WORD))
)
def test_changes_that_the_server_did_not_hear_come_with_the_same_address_alone(
    changes: list[tuple[str, str, bool | float | str]],
) -> None:
    told = {"kept": "{}", "unheard": [*changes, None, ["path"], ["path", "box", [1]], ["path", "box", None]]}
    kept, _ = brought_back(json.dumps({**told, "is_same": True}))
    assert list(kept.unheard) == changes[:MOST_ENTRIES]
    assert brought_back(json.dumps({**told, "is_same": False})) == (Kept(), False)


def test_too_much_is_not_stored() -> None:
    assert Kept(name="x" * LONGEST).text == ""
