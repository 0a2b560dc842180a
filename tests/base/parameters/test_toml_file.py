"""What is written as TOML is read again as it was, by the standard library's reader too."""

from __future__ import annotations

import tomllib

from hypothesis import given
from hypothesis import strategies as st

from lab.base.parameters.toml_file import toml_text

ANY = st.text(st.characters(exclude_categories=("Cs",)), max_size=20)
TEXTS = ANY | st.text("\"'\\\n\r\t\0\x7fa ", max_size=8)
VALUES = st.recursive(
    TEXTS | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False) | st.booleans(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXTS, inner, max_size=3),
    max_leaves=6,
)


@given(st.dictionaries(TEXTS, VALUES, max_size=4))
def test_any_values_come_back(values: dict[str, object]) -> None:
    assert tomllib.loads(toml_text(values)) == values


def test_a_text_of_several_lines_is_written_as_several_lines() -> None:
    assert toml_text({"description": "one\ntwo\n"}) == 'description = """one\ntwo\n"""\n'
