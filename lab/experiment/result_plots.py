"""Result plots: the plots of one result as methods, which a notebook completes: ``result.plot.errors()``.

The functions are those of `lab.views.plots`, registered in `lab.views.cards`.
"""

from __future__ import annotations

from collections.abc import Callable
from types import MethodType
from typing import Any, Protocol

from lab.base.registry import find, names


class Plottable(Protocol):
    """A result, as far as its plots need it."""

    def missing_reason(self, name: str) -> str:
        """Return, in a sentence, why something is unknown; empty if it is known."""


class ResultPlots:
    """The plots that a result has; ``dir`` lists them, and each is a method.

    Parameters
    ----------
    result
        The result.
    """

    def __init__(self, result: Plottable) -> None:
        self._result = result

    def __dir__(self) -> list[str]:
        return [name for name in names("plot") if not self._result.missing_reason(name)]

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name not in names("plot"):
            raise AttributeError(f"result.plot has no plot {name!r}; accepted: {', '.join(dir(self))}")
        return MethodType(find("plot", name), self._result)

    def __call__(self) -> Any:
        """Return the first plot that the result has: its errors, or of a log without reference its σ."""
        return getattr(self, self.__dir__()[0])()

    def __repr__(self) -> str:
        return f"<plots of a result: {', '.join(f'.{name}()' for name in self.__dir__())}>"
