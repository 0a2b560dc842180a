r"""Formula: a small part of LaTeX as MathML, which browsers draw without a script or a font from outside.

Accepted are letters, numbers, operators, ``^`` and ``_``, groups in braces, the `WORDS`, and the commands
``\frac``, ``\sqrt``, ``\text`` and the `ACCENTS`. Whatever is in a formula, only these elements come
out.
"""

from __future__ import annotations

import re
from html import escape

LONGEST = 400
"""Longest formula [characters]; the longest that ships has 70."""
DEEPEST = 12
"""Deepest nesting of groups; a fraction of roots with indices has 4."""

_LOWER = {"alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ε", "zeta": "ζ", "eta": "η"}
_LOWER |= {"theta": "θ", "lambda": "λ", "mu": "μ", "nu": "ν", "xi": "ξ", "pi": "π", "rho": "ρ", "sigma": "σ"}
_LOWER |= {"tau": "τ", "phi": "φ", "chi": "χ", "psi": "ψ", "omega": "ω"}
_UPPER = {"Gamma": "Γ", "Delta": "Δ", "Theta": "Θ", "Lambda": "Λ", "Sigma": "Σ", "Phi": "Φ", "Psi": "Ψ"}
_GREEK = _LOWER | _UPPER | {"Omega": "Ω"}
_OPERATORS = {"cdot": "⋅", "times": "×", "approx": "≈", "le": "≤", "ge": "≥", "ne": "≠", "ll": "≪", "gg": "≫"}
_OPERATORS |= {"pm": "±", "sim": "∼", "sum": "∑", "int": "∫", "partial": "∂", "infty": "∞", "to": "→"}
_OPERATORS |= {"ldots": "…"}
_FUNCTIONS = ("sin", "cos", "tan", "exp", "log")
WORDS = (*_GREEK, *_OPERATORS, *_FUNCTIONS)
"""Commands that stand for one sign or one function."""
ACCENTS = {"hat": "^", "bar": "¯", "dot": "˙", "tilde": "~", "vec": "→"}
"""Commands that put a sign over the next group."""
_SIGNS = {name: f"<mi>{sign}</mi>" for name, sign in _GREEK.items()}
_SIGNS |= {name: f"<mo>{sign}</mo>" for name, sign in _OPERATORS.items()}
_SIGNS |= {name: f"<mi>{name}</mi>" for name in _FUNCTIONS}
_SIGNS |= dict.fromkeys((",", ";", " "), '<mspace width="0.3em"></mspace>')
_TOKEN = re.compile(r"\s+|\\(?:[A-Za-z]+|.)|\d+(?:\.\d+)?|.", re.DOTALL)
_CLOSED = re.compile(r"\{([^{}$]*)\}")


class FormulaError(ValueError):
    """A formula that cannot be read; the message says what is accepted."""


def mathml(formula: str, *, display: bool = False) -> str:
    """Return a formula as a MathML element.

    Parameters
    ----------
    formula
        The formula, without dollar signs.
    display
        Whether it stands on a line of its own.

    Raises
    ------
    FormulaError
        If it cannot be read.
    """
    if len(formula) > LONGEST:
        raise FormulaError(f"has {len(formula)} characters; accepted are up to {LONGEST}")
    reader = _Reader(formula)
    inside = reader.row("")
    return f"<math{' display=' + chr(34) + 'block' + chr(34) if display else ''}>{inside}</math>"


class _Reader:
    """Reads a formula from left to right."""

    def __init__(self, formula: str) -> None:
        self._formula, self._at, self._depth = formula, 0, 0

    def row(self, end: str) -> str:
        """Return all up to a closing brace, or up to the end, as one row."""
        self._depth += 1
        if self._depth > DEEPEST:
            raise FormulaError(f"has groups inside one another more than {DEEPEST} times")
        parts = []
        while (token := self._peek()) != end:
            if not token:
                raise FormulaError("ends before a brace is closed; accepted is { with its }")
            parts.append(self._scripted())
        self._pop()
        self._depth -= 1
        return f"<mrow>{''.join(parts)}</mrow>"

    def _scripted(self) -> str:
        base, scripts = self._read_one(), dict[str, str]()
        while (sign := self._peek()) in ("^", "_"):
            if sign in scripts:
                raise FormulaError(
                    f"has two {sign} after one another; accepted is one, with a group in braces"
                )
            self._pop()
            scripts[sign] = self._read_one()
        if len(scripts) == 2:
            return f"<msubsup>{base}{scripts['_']}{scripts['^']}</msubsup>"
        if "_" in scripts:
            return f"<msub>{base}{scripts['_']}</msub>"
        return f"<msup>{base}{scripts['^']}</msup>" if scripts else base

    def _read_one(self) -> str:
        """Return a sign, a number, a command with its groups, or a group."""
        token = self._pop()
        if token in ("", "}", "^", "_"):
            raise FormulaError(f"has {token or 'its end'} where a letter, a number or a group is expected")
        if token == "{":
            return self.row("}")
        if token.startswith("\\"):
            return self._command(token[1:])
        if token[0].isdigit():
            return f"<mn>{token}</mn>"
        element = "mi" if token.isalpha() else "mo"
        return f"<{element}>{escape(token)}</{element}>"

    def _command(self, name: str) -> str:
        if name in _SIGNS:
            return _SIGNS[name]
        if name == "text":
            return self._text()
        if name == "frac":
            return f"<mfrac>{self._read_one()}{self._read_one()}</mfrac>"
        if name == "sqrt":
            return f"<msqrt>{self._read_one()}</msqrt>"
        if name in ACCENTS:
            return f'<mover accent="true">{self._read_one()}<mo>{ACCENTS[name]}</mo></mover>'
        accepted = ", ".join((*WORDS, "frac", "sqrt", "text", *ACCENTS))
        raise FormulaError(f"\\{name[:20]} is not known; accepted are {accepted}")

    def _text(self) -> str:
        found = _CLOSED.match(self._formula, self._at)
        if found is None:
            raise FormulaError("\\text needs its words in braces, such as \\text{fix}")
        self._at = found.end()
        return f"<mtext>{escape(found[1])}</mtext>"

    def _peek(self) -> str:
        while found := _TOKEN.match(self._formula, self._at):
            if not found[0].isspace():
                return found[0]
            self._at = found.end()
        return ""

    def _pop(self) -> str:
        token = self._peek()
        self._at += len(token)
        return token
