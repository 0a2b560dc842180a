"""Check: a condition on a student's result, in a small language of its own; nothing is evaluated as code.

The language has comparisons of numbers, and the verdict:

    check   = and ("or" and)*
    and     = not ("and" not)*
    not     = "not" not | "(" check ")" | verdict | compare
    verdict = "verdict" ("names" text | "consistent")
    compare = sum (("<" | "<=" | ">" | ">=") sum)+
    sum     = product (("+" | "-") product)*
    product = factor (("*" | "/") factor)*
    factor  = "-" factor | number | quantity | setting | "(" sum ")"

Length, depth and numbers are bounded. `lab.classroom.lessons.quantities` has the quantities.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterable
from typing import NamedTuple

from lab.analysis.verdicts.finding_table import FINDING_NAMES
from lab.classroom.lessons.quantities import QUANTITIES, setting_value
from lab.experiment.result import Result

LONGEST = 300
"""Longest check [characters]; the longest that ships has 70."""
DEEPEST = 16
"""Deepest nesting of brackets and signs."""
LONGEST_NUMBER = 20
"""Longest number [characters]."""

Value = Callable[[Result], float]
Condition = Callable[[Result], bool]

_TOKEN = re.compile(
    r"\s*(?:(?P<number>\d+(?:\.\d*)?(?:[eE][+-]?\d{1,3})?)|(?P<name>[A-Za-z_][\w.]*)"
    r"|(?P<text>\"[^\"]*\")|(?P<sign><=|>=|[-<>+*/()]))"
)
_COMPARE: dict[str, Callable[[float, float], bool]] = {
    "<": lambda a, b: a < b,
    "<=": lambda a, b: a <= b,
    ">": lambda a, b: a > b,
    ">=": lambda a, b: a >= b,
}
_RESERVED = ("and", "or", "not", "verdict", "names", "consistent")


class CheckError(ValueError):
    """A check that cannot be read; the message says where, and what is accepted."""


class Check(NamedTuple):
    """A condition on a result.

    Attributes
    ----------
    text : str
        How it is written.
    quantities, settings : tuple of str
        The quantities, and the paths of the settings, that it names.
    condition : callable
        Whether a result meets it; a quantity that is unknown meets no comparison.
    """

    text: str
    quantities: tuple[str, ...]
    settings: tuple[str, ...]
    condition: Condition

    def accepts(self, result: Result) -> bool:
        """Return whether a result meets the check."""
        return self.condition(result)


def parse_check(text: str, is_setting: Callable[[str], bool]) -> Check:
    """Return the check that a text describes.

    Parameters
    ----------
    text
        The check.
    is_setting
        Returns whether there is a numeric setting of this path.

    Raises
    ------
    CheckError
        If it cannot be read.
    """
    if len(text) > LONGEST:
        raise CheckError(f"has {len(text)} characters; accepted are up to {LONGEST}")
    parser = _Parser(_tokens(text), is_setting)
    condition = parser.whole()
    if not (parser.quantities or parser.settings or parser.has_verdict):
        raise CheckError("compares numbers only; accepted is a condition on the result, such as nis < 1.5")
    return Check(text, tuple(parser.quantities), tuple(parser.settings), condition)


class _Token(NamedTuple):
    kind: str
    text: str
    place: int


def _tokens(text: str) -> list[_Token]:
    tokens, at = [], 0
    while text[at:].strip():
        found = _TOKEN.match(text, at)
        if found is None:
            place = at + len(text[at:]) - len(text[at:].lstrip())
            raise CheckError(
                f"character {place + 1}: {text[place]!r} is not accepted; accepted are names, numbers, "
                '< <= > >= + - * / ( ), and, or, not, and verdict names "…"'
            )
        kind = str(found.lastgroup)
        if kind == "number" and len(found[kind]) > LONGEST_NUMBER:
            raise CheckError(
                f"character {found.start(kind) + 1}: a number of more than {LONGEST_NUMBER} characters"
            )
        tokens.append(_Token(kind, found[kind], found.start(kind) + 1))
        at = found.end()
    return tokens


class _Parser:
    """Reads tokens into functions of a result."""

    def __init__(self, tokens: list[_Token], is_setting: Callable[[str], bool]) -> None:
        self._tokens, self._at, self._depth = tokens, 0, 0
        self._is_setting = is_setting
        self.quantities: list[str] = []
        self.settings: list[str] = []
        self.has_verdict = False

    def whole(self) -> Condition:
        """Return the whole check."""
        condition = self._parse_either()
        if self._at < len(self._tokens):
            raise self._unexpected_error("and, or, or the end")
        return condition

    def _parse_either(self) -> Condition:
        parts = [self._parse_all()]
        while self._accept("or"):
            parts.append(self._parse_all())
        return parts[0] if len(parts) == 1 else lambda result: any(part(result) for part in parts)

    def _parse_all(self) -> Condition:
        parts = [self._parse_not()]
        while self._accept("and"):
            parts.append(self._parse_not())
        return parts[0] if len(parts) == 1 else lambda result: all(part(result) for part in parts)

    def _parse_not(self) -> Condition:
        self._check_depth()
        try:
            if self._accept("not"):
                inner = self._parse_not()
                return lambda result: not inner(result)
            if self._accept("verdict"):
                self.has_verdict = True
                return self._verdict()
            if self._next == "(" and self._is_condition():
                self._at += 1
                condition = self._parse_either()
                self._expect_text(")")
                return condition
            return self._compare()
        finally:
            self._depth -= 1

    def _verdict(self) -> Condition:
        if self._accept("consistent"):
            return lambda result: bool(result.verdict.consistent)
        if not self._accept("names"):
            raise self._unexpected_error('names "…" or consistent')
        if self._kind != "text":
            raise self._unexpected_error('a quantity in quotes, such as "GPS latency"')
        named = self._tokens[self._at].text[1:-1]
        if named not in FINDING_NAMES:
            raise self._unknown_name_error("finding", named, FINDING_NAMES, "")
        self._at += 1
        return lambda result: any(named == finding.quantity for finding in result.verdict.findings)

    def _compare(self) -> Condition:
        sides, signs = [self._sum()], list[str]()
        while self._next in _COMPARE:
            signs.append(self._next)
            self._at += 1
            sides.append(self._sum())
        if not signs:
            raise self._unexpected_error("a comparison: < <= > >=")

        def condition(result: Result) -> bool:
            values = [side(result) for side in sides]
            return all(_COMPARE[sign](values[i], values[i + 1]) for i, sign in enumerate(signs))

        return condition

    def _sum(self) -> Value:
        value = self._product()
        while (sign := self._next) in ("+", "-"):
            self._at += 1
            value = _combine_values(sign, value, self._product())
        return value

    def _product(self) -> Value:
        value = self._factor()
        while (sign := self._next) in ("*", "/"):
            self._at += 1
            value = _combine_values(sign, value, self._factor())
        return value

    def _factor(self) -> Value:
        self._check_depth()
        try:
            if self._accept("-"):
                inner = self._factor()
                return lambda result: -inner(result)
            if self._accept("("):
                inside = self._sum()
                self._expect_text(")")
                return inside
            if self._kind == "number":
                number = float(self._tokens[self._at].text)
                self._at += 1
                return lambda _result: number
            if self._kind == "name" and self._next not in _RESERVED:
                return self._parse_named()
            raise self._unexpected_error("a quantity, a setting or a number")
        finally:
            self._depth -= 1

    def _parse_named(self) -> Value:
        name = self._next
        if name in QUANTITIES:
            self._at += 1
            self.quantities.append(name)
            return QUANTITIES[name].of
        if "." in name and self._is_setting(name):
            self._at += 1
            self.settings.append(name)
            return lambda result: setting_value(result, name)
        raise self._unknown_name_error(
            "quantity", name, QUANTITIES, ", and numeric settings by their path, such as navigator.r_scale"
        )

    def _unknown_name_error(self, kind: str, name: str, accepted: Iterable[str], others: str) -> CheckError:
        """Return the refusal of a name that does not exist; `others` is what else is accepted."""
        close = difflib.get_close_matches(name, list(accepted), n=1)
        hint = f"; did you mean {close[0]}?" if close else "."
        return CheckError(
            f"character {self._tokens[self._at].place}: there is no {kind} {name[:40]}{hint} Accepted are "
            f"{', '.join(accepted)}{others}"
        )

    def _is_condition(self) -> bool:
        """Return whether the bracket here contains a condition, and not a sum."""
        depth = 0
        for token in self._tokens[self._at :]:
            depth += {"(": 1, ")": -1}.get(token.text, 0)
            if depth == 0:
                return False
            if token.text in _COMPARE or token.text in _RESERVED:
                return True
        return False

    def _check_depth(self) -> None:
        self._depth += 1
        if self._depth > DEEPEST:
            raise CheckError(f"has brackets or signs inside one another more than {DEEPEST} times")

    @property
    def _next(self) -> str:
        return self._tokens[self._at].text if self._at < len(self._tokens) else ""

    @property
    def _kind(self) -> str:
        return self._tokens[self._at].kind if self._at < len(self._tokens) else ""

    def _accept(self, text: str) -> bool:
        found = self._next == text
        self._at += found
        return found

    def _expect_text(self, text: str) -> None:
        if not self._accept(text):
            raise self._unexpected_error(text)

    def _unexpected_error(self, wanted: str) -> CheckError:
        if self._at < len(self._tokens):
            token = self._tokens[self._at]
            return CheckError(f"character {token.place}: {token.text[:40]} where {wanted} is expected")
        return CheckError(f"ends where {wanted} is expected")


def _combine_values(sign: str, a: Value, b: Value) -> Value:
    if sign == "+":
        return lambda result: a(result) + b(result)
    if sign == "-":
        return lambda result: a(result) - b(result)
    if sign == "*":
        return lambda result: a(result) * b(result)
    return lambda result: _ratio(a(result), b(result))


def _ratio(a: float, b: float) -> float:
    return a / b if b else float("nan")
