"""Covariance field: a covariance as text, or each σ in an expandable list."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import panel_material_ui as pmui
import param

from dashboards.field_text import number, shown
from dashboards.style import TOOLTIP, plain_column, plain_row
from dashboards.widgets import Change, TextField
from lab.base.parameters.setting_kinds import requirement
from lab.base.parameters.units import TO_SI


class CovarianceField(TextField):
    """A covariance as text, or each σ in an expandable list; an unset one is matched to the sensors.

    Parameters
    ----------
    declaration, change
        As for any field.
    matched
        Returns the variances that apply while none are given, in SI units.
    """

    def __init__(
        self, declaration: param.Parameter, change: Change, matched: Callable[[], Sequence[float]]
    ) -> None:
        self._sigmas: list[Any] = []
        self._matched = matched
        super().__init__(declaration, change)
        assert self._lock is not None
        self._list = plain_column(visible=False)
        more = pmui.ToggleIcon(
            icon="expand_more",
            active_icon="expand_less",
            size="1.1em",
            margin=(22, 0, 0, 0),
            width=20,
            color="default",
            description=f"{declaration.label}: one σ for each row",
            stylesheets=[TOOLTIP],
        )
        more.param.watch(self._unfold, "value")
        self._more = more
        self.view = plain_column(plain_row(self._widget, self._lock, more), self._list)

    def unfold(self) -> None:
        """Show each σ."""
        self._more.value = True

    def refresh(self) -> None:
        """Show the current matched values."""
        self.show(self._value)

    def _render(self, value: Any) -> None:
        super()._render(value)
        variances = self._variances() if self._sigmas else ()
        for index, box in enumerate(self._sigmas):
            box.visible = index < len(variances)
            if box.visible:
                unit = self.declaration.rows[index][1]
                box.value = shown(float(f"{math.sqrt(variances[index]) / TO_SI[unit]:.4g}"))

    def _variances(self) -> tuple[float, ...]:
        """Return the current variances: given as a diagonal or as a whole matrix, or matched."""
        if self._value is None:
            return tuple(self._matched())
        return tuple(row[i] if isinstance(row, tuple) else row for i, row in enumerate(self._value))

    def _unfold(self, event: param.parameterized.Event) -> None:
        if event.new and not self._sigmas:
            for index, (name, unit) in enumerate(self.declaration.rows):
                box = pmui.TextInput(
                    label=f"{name} [{unit}]",
                    size="small",
                    variant="standard",
                    margin=(2, 0, 2, 12),
                    sizing_mode="stretch_width",
                )
                box.param.watch(lambda typed, index=index: self._typed_sigma(index, typed.new), "value")
                self._sigmas.append(box)
                self.parts[name] = box
            self.name_parts(self._path)
            self.refresh()  # before the browser has the boxes: it drops a value that comes with its box
            self._list[:] = self._sigmas
        self._list.visible = event.new

    def _typed_sigma(self, index: int, text: str) -> None:
        if self._showing:
            return
        sigma = number(text)
        # Invalid or negative numbers are passed on: the setting itself says what it accepts.
        unit = self.declaration.rows[index][1]
        variance = sigma if isinstance(sigma, str) else sigma * abs(sigma) * TO_SI[unit] ** 2
        asked: tuple[Any, ...]
        if self._value is not None and isinstance(self._value[0], tuple):
            row = _replace_value(self._value[index], index, variance)
            asked = _replace_value(self._value, index, row)
        else:
            asked = _replace_value(self._variances(), index, variance)
        self._take(asked, requirement(self.declaration))


def _replace_value(values: tuple[Any, ...], index: int, value: Any) -> tuple[Any, ...]:
    """Return the values with one replaced."""
    return (*values[:index], value, *values[index + 1 :])
