"""Texts and formulas of lessons: only a few elements come out, whatever goes in."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.classroom.lessons import formula as formulas
from lab.classroom.lessons.formula import FormulaError, mathml
from lab.classroom.lessons.text import TextError, text_html

ELEMENTS = {
    *("p", "ul", "li", "em", "code", "math", "mrow", "mi", "mn", "mo", "mtext", "mspace"),
    *("mfrac", "msqrt", "msub", "msup", "msubsup", "mover", "x"),
}
ATTRIBUTES = {"display", "width", "accent"}


def parsed(html: str) -> ElementTree.Element:
    """Return HTML as a tree; what is not well formed is an error."""
    return ElementTree.fromstring(f"<x>{html}</x>")


@given(st.text(alphabet=st.sampled_from("ab1 <>&\"'$\\{}^_*`-\nfrac;=/"), max_size=80))
def test_nothing_but_known_elements_comes_out(text: str) -> None:
    try:
        html = text_html(text)
    except TextError:
        return
    for element in parsed(html).iter():
        assert element.tag in ELEMENTS
        assert set(element.attrib) <= ATTRIBUTES


def test_markup_is_shown_as_it_is() -> None:
    html = text_html("<script>alert(1)</script> & $a < b$ `<b>` *<i>*")
    assert "".join(parsed(html).itertext()) == "<script>alert(1)</script> & a<b <b> <i>"


def test_paragraphs_lists_and_formulas() -> None:
    html = text_html("One\nline.\n\nTwo:\n- *first*\n  goes on\n- `navigator.q`\n\n$$x$$")
    assert html == (
        "<p>One line.</p><p>Two:</p><ul><li><em>first</em> goes on</li><li><code>navigator.q</code></li></ul>"
        '<p><math display="block"><mrow><mi>x</mi></mrow></math></p>'
    )


@pytest.mark.parametrize(
    ("formula", "inside"),
    [
        ("x^2", "<msup><mi>x</mi><mn>2</mn></msup>"),
        ("P_{k+1}", "<msub><mi>P</mi><mrow><mi>k</mi><mo>+</mo><mn>1</mn></mrow></msub>"),
        (r"x_a^b", "<msubsup><mi>x</mi><mi>a</mi><mi>b</mi></msubsup>"),
        (r"\frac12", "<mfrac><mn>12</mn><mi>x</mi></mfrac>"),
        (r"\sqrt{2}", "<msqrt><mrow><mn>2</mn></mrow></msqrt>"),
        (r"\dot{v}", '<mover accent="true"><mrow><mi>v</mi></mrow><mo>˙</mo></mover>'),
        (r"\text{a & b}", "<mtext>a &amp; b</mtext>"),
        (r"0.5\sigma\le\sin\phi", "<mn>0.5</mn><mi>σ</mi><mo>≤</mo><mi>sin</mi><mi>φ</mi>"),
    ],
)
def test_formulas(formula: str, inside: str) -> None:
    given_formula = formula + "x" if formula == r"\frac12" else formula
    assert mathml(given_formula) == f"<math><mrow>{inside}</mrow></math>"


@pytest.mark.parametrize(
    "formula",
    ["{", "}", "x^", "x^2^3", r"\foo", r"\text x", r"\frac{1}", "^2", "{" * 50 + "}" * 50, "x" * 1000],
)
def test_a_formula_that_cannot_be_read_is_refused(formula: str) -> None:
    with pytest.raises(FormulaError, match=r"accepted|expected|inside|needs"):
        mathml(formula)


def test_a_dollar_alone_is_refused() -> None:
    with pytest.raises(TextError, match="accepted"):
        text_html("costs 5 $")


def test_the_message_about_a_command_names_those_that_are_accepted() -> None:
    with pytest.raises(TextError, match=r"\\foo is not known") as caught:
        text_html(r"see $\foo$")
    assert all(re.search(rf"\b{word}\b", str(caught.value)) for word in formulas.WORDS)
