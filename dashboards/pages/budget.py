"""Budget: the contribution of each source of error over time, and which manoeuvres reduced σ."""

from __future__ import annotations

from html import escape

import panel as pn
import panel_material_ui as pmui

from dashboards.pages.base import AROUND, plot_grid
from dashboards.pages.computed import ComputedPage
from dashboards.style import choice_row
from lab.analysis.budget import QUANTITIES
from lab.analysis.observability import observability_table
from lab.base.progress import Progress
from lab.experiment.result import Result
from lab.views.budget import BudgetFigures
from lab.views.legend import SLIM

_ROWS = f"""
:host {{ grid-auto-rows: max(240px, calc((100vh - {AROUND + 100}px) / 2)) !important; }}
@container stage (max-width: {SLIM}px) {{ :host {{ grid-auto-rows: 440px !important; }} }}
"""
"""Two rows that share the height of the window below the selection and the sentence; on a phone, they have
room for a legend below the plot."""


class Budget(ComputedPage):
    """Stacked contributions to the variance of a quantity, its σ, and the manoeuvres that reduced it."""

    title = "Budget"
    contents = "which sensor error causes how much of the navigation error"
    working = "Computing the error budget (the first time, its code is compiled) …"

    def make(self) -> pn.viewable.Viewable:
        """Return the selection of the quantity, the sentence about it, and the two figures."""
        self._figures = BudgetFigures(self.axis)
        self._choice = pmui.Select(
            label="Quantity",
            options=list(QUANTITIES),
            value="heading",
            size="small",
            width=220,
            margin=(10, 8),
        )
        self._choice.param.watch(lambda _event: self._chosen(), "value")
        grid = plot_grid(self._figures.figures, 1)
        grid.stylesheets = [*grid.stylesheets, _ROWS]
        return pn.Column(
            choice_row(self._choice, self.words),
            grid,
            sizing_mode="stretch_both",
            margin=0,
        )

    @classmethod
    def missing_reason(cls, result: Result) -> str:
        """Return why there is no budget."""
        return result.missing_reason("budget")

    def work_out(self, result: Result, _progress: Progress) -> None:
        """Compute the budget and the observability of the result."""
        _ = result.budget, result.observability

    def clear(self) -> None:
        """Draw nothing."""
        self._figures.clear()

    def paint(self, result: Result, _content: None) -> str:
        """Draw the selected quantity."""
        known = result.budget.quantity.values.tolist()
        if self._choice.options != known:
            chosen = self._choice.value if self._choice.value in known else "heading"
            self._choice.param.update(options=known, value=chosen)
        quantity = str(self._choice.value)
        self._figures.show(result.budget, result.observability, quantity)
        return escape(sentence(result, quantity))

    def _chosen(self) -> None:
        """Draw another quantity of the same result."""
        if self._content is not None:
            self._paint(*self._content)


def sentence(result: Result, quantity: str) -> str:
    """Return a sentence: the largest error sources of a quantity at the end, and what reduced its σ."""
    there = result.budget.isel(time=-1).sel(quantity=quantity)
    share = there.share.values
    order = [at for at in share.argsort()[::-1][:3] if round(share[at]) > 0]
    parts = ", ".join(f"{there.source.values[at]} {share[at]:.0f} %" for at in order)
    largest = f"largest sources are {parts}" if len(order) > 1 else f"largest source is {parts}"
    row = observability_table(result.observability).set_index("quantity").loc[quantity]
    text = (
        f"At the end, σ of the {quantity} is {float(there.total):.3g} {row['unit']}; the filter states "
        f"{float(there.believed):.3g} {row['unit']}. The {largest}. The filter's σ was "
        f"{row['σ at start']:.3g} {row['unit']} at the start. It was reduced by {row['brought by']}."
    )
    left_out = result.budget.attrs["left_out"]
    return f"{text} Not in the budget: {left_out}." if left_out else text
