"""Widgets: a field for each kind of setting, made from its declaration."""

from __future__ import annotations

import math
from collections.abc import Callable
from html import escape
from typing import Any

import panel as pn
import panel_material_ui as pmui
import param
from bokeh.models import CustomJSTickFormatter

from dashboards.field_text import (
    FOLLOWS,
    describe_empty_field,
    field_label,
    follows_sensor,
    parse_field,
    per_axis,
    shown,
)
from dashboards.sigmas import sigma_of, to_sigma, to_variance
from dashboards.style import HIDDEN_LABEL, TOOLTIP, plain_column, plain_row, wide_html
from lab.base.parameters.setting_error import RefusedValueError, SettingError
from lab.base.parameters.setting_kinds import AxisQuantity, Quantity, requirement

Change = Callable[[Any], object]

SETTING = "setting"
"""Tag of what sends the value of a setting, and of buttons that change settings.

What sends a value has two more: the path of the setting, and which part of the field it is.
"""
LOGARITHMIC_FROM = 100
"""A slider is logarithmic if the ratio of its ends is at least this."""


_LABEL = {"& .MuiFormLabel-root": {"fontSize": "0.8125rem"}}
_HINTED = {
    "& .MuiInputLabel-root": {
        "transform": "translate(14px, -9px) scale(0.75)",
        "maxWidth": "calc(133% - 32px)",
    },
    "& .MuiOutlinedInput-notchedOutline legend": {"maxWidth": "100%"},
    "& label[data-shrink] + .MuiInputBase-formControl .MuiInputBase-input::placeholder": {
        "opacity": "0.75 !important"
    },
}
"""An empty box shows its hint: the label is above it, as if there were a value."""
_AT_ONCE = {"& .MuiSlider-thumb, & .MuiSlider-track": {"transition": "none"}}
"""An animated thumb would keep the browser painting frames while it should paint the plots."""
_BY_THUMB = {
    "@media (pointer: coarse)": {
        "& .MuiSlider-root": {"pointerEvents": "none"},
        "& .MuiSlider-thumb": {"pointerEvents": "auto"},
    }
}
"""A finger that scrolls the settings starts anywhere: it moves a slider by its thumb alone."""
_RED = "p { margin: 0; font-size: 0.75rem; color: var(--mui-palette-error-main, #b3261e); }"
_BOX = {"& input": {"fontSize": "0.8125rem", "textAlign": "right", "padding": "0 0 1px"}}


def _over(right: int) -> dict[str, str]:
    """Place a widget on the line of the label, at this distance from the right edge [px]."""
    return {"position": "absolute", "top": "0", "right": f"{right}px", "z-index": "1"}


class Slider(pmui.FloatSlider):
    """A slider that reports each movement at once."""

    _debounce = 10

    def __init__(self, **params: Any) -> None:
        super().__init__(**params)  # type: ignore[no-untyped-call]


class Field(param.Parameterized):
    """A field that shows one setting and requests changes.

    Parameters
    ----------
    declaration
        The parameter of the setting.
    change
        Called with a new value; raises `SettingError` if it is not accepted. Then the field shows the old
        value again and, if the value is wrong in itself, says below what it must be.

    Attributes
    ----------
    motion : int or None
        While a slider requests a change: how many times it was taken until now. None otherwise.
    said : param.Parameter
        The declaration of what is shown and typed: of a variance, it may be that of its root.
    view : panel.viewable.Viewable
        The widgets to place on the page.
    parts : dict
        The widgets that send a value, each by its name.
    """

    view: pn.viewable.Viewable
    parts: dict[str, Any]

    def __init__(self, declaration: param.Parameter, change: Change) -> None:
        super().__init__()
        self.motion: int | None = None
        self.declaration = self.said = declaration
        self._change = change
        self._value: Any = declaration.default
        self._showing = False
        self._path = ""

    def unfold(self) -> None:
        """Show all parts, also those of the axes."""

    def name_parts(self, path: str) -> None:
        """Write the path of the setting on the widgets that send its value."""
        self._path = path
        for name, widget in self.parts.items():
            widget.tags = [SETTING, path, name]

    @property
    def value(self) -> Any:
        """The value that the field shows."""
        return self._value

    def show(self, value: Any) -> None:
        """Show a value that another part of the page has set."""
        self._value = value
        self._showing = True
        try:
            self._render(value)
        finally:
            self._showing = False

    def speak(self, sigmas: bool) -> None:
        """Show a variance as σ, or as itself; what is no variance stays as it is."""
        said = (sigma_of(self.declaration) if sigmas else None) or self.declaration
        if said.label != self.said.label:
            self.said = said
            self.complain("")
            self._relabel()
            self.show(self._value)

    def in_words(self, value: Any) -> str:
        """Return a value of the setting as this field shows it."""
        return shown(self._as_said(value))

    def complain(self, sentence: str) -> None:
        """Show a sentence about a refused value below the field; an empty one shows nothing."""

    def _relabel(self) -> None:
        """Show the label and the unit of what is said; only numbers can be said in two ways."""

    def _as_said(self, value: Any) -> Any:
        return value if self.said is self.declaration else to_sigma(value)

    def _as_set(self, value: Any) -> Any:
        return value if self.said is self.declaration else to_variance(value)

    def _render(self, value: Any) -> None:
        raise NotImplementedError

    def _ask(self, value: Any) -> None:
        if self._showing or value == self._value:
            return
        self._take(value, requirement(self.said, value))

    def _take(self, value: Any, sentence: str) -> None:
        """Request a change, and show its outcome; the sentence says what the value must be."""
        try:
            self._change(value)
        except SettingError as error:
            self.show(self._value)
            self.complain(sentence if isinstance(error, RefusedValueError) else "")
        else:
            self.show(value)
            self.complain("")


class NumberField(Field):
    """A number, or one for each axis: a slider over the usual range, and a box for all accepted values."""

    def __init__(self, declaration: param.Parameter, change: Change) -> None:
        super().__init__(declaration, change)
        self._axes: tuple[str, ...] = getattr(declaration, "axes", ())
        self._scale = Scale(declaration)
        self._motions, self._in_motion = 0, False
        self._spoken = CustomJSTickFormatter(code=self._scale.words(getattr(declaration, "unit", "")))
        self._slider = self._make_slider(field_label(declaration), declaration.doc or "")
        self._slider.param.watch(lambda event: self._moved(None, event.new), "value")
        self._box = pmui.TextInput(
            label=field_label(declaration),
            size="small",
            variant="standard",
            width=96,
            margin=0,
            styles=_over(22),
            sx=_BOX,
            stylesheets=[HIDDEN_LABEL],
            tags=[SETTING],
        )
        self._box.param.watch(self._typed, "value")
        self.parts = {"slider": self._slider, "box": self._box}
        self._axis_sliders: list[Slider] = []
        self._complaint: pn.pane.HTML | None = None
        self.view = plain_column(self._slider, self._box, margin=(4, 0), styles={"position": "relative"})
        if self._axes:
            more = pmui.ToggleIcon(
                icon="expand_more",
                active_icon="expand_less",
                size="1.1em",
                margin=0,
                width=20,
                color="default",
                description=f"{declaration.label}: one for each axis",
                stylesheets=[TOOLTIP],
                styles=_over(-4),
            )
            more.param.watch(self._unfold, "value")
            self.view.append(more)
            self._more = more
        self.show(declaration.default)

    def unfold(self) -> None:
        """Show the sliders of the axes."""
        if self._axes:
            self._more.value = True

    def _make_slider(self, label: str, doc: str = "") -> Slider:
        slider = Slider(
            label=label,
            description=doc,
            show_value=False,
            tooltips=False,
            size="small",
            sizing_mode="stretch_width",
            margin=0 if doc else (0, 0, 0, 12),
            sx=_LABEL | _AT_ONCE | _BY_THUMB,
            tags=[SETTING],
            start=self._scale.start,
            end=self._scale.end,
            step=self._scale.step,
            value=self._scale.start,
            format=self._spoken,
        )
        # The last step and the release may arrive together: the step comes first.
        slider.param.watch(lambda _event: self._released(), "value_throttled", precedence=1)
        return slider

    def _render(self, value: Any) -> None:
        components = self._as_said(value) if self._axes else (value,)
        self._box.value = self.in_words(value)
        self._place(self._slider, max(components, key=abs))
        for slider, number in zip(self._axis_sliders, components, strict=False):
            self._place(slider, number)

    def _place(self, slider: Slider, number: float) -> None:
        """Move a slider unless it shows the number: a rounded position sent back would undo a later move."""
        if self._scale.value(slider.value) != number:
            slider.value = self._scale.position(number)

    def complain(self, sentence: str) -> None:
        """Show a sentence between the slider and those of the axes."""
        if sentence and self._complaint is None:
            self._complaint = wide_html(margin=(0, 0, 4, 0), stylesheets=[_RED])
            self.view.insert(1, self._complaint)
        if self._complaint is not None:
            self._complaint.param.update(
                object=f'<p role="alert">{escape(sentence)}</p>' if sentence else "", visible=bool(sentence)
            )

    def _moved(self, axis: int | None, position: float) -> None:
        if self._showing:
            return
        number = self._scale.value(position)
        if not self._in_motion:
            self._motions, self._in_motion = self._motions + 1, True
        self.motion = self._motions
        if not self._axes:
            self._ask(number)
        elif axis is None:
            self._ask(self._as_set((number,) * len(self._axes)))
        else:
            components = list(self._value)
            components[axis] = self._as_set(number)
            self._ask(tuple(components))
        self.motion = None

    def _released(self) -> None:
        self._in_motion = False

    def _typed(self, event: param.parameterized.Event) -> None:
        if self._showing or event.new == self.in_words(self._value):
            return
        self._ask(self._as_set(per_axis(event.new, self._axes)))

    def _relabel(self) -> None:
        self._scale = Scale(self.said, self._scale.logarithmic)
        self._spoken = CustomJSTickFormatter(code=self._scale.words(self.said.unit))
        self._box.label = self._slider.label = field_label(self.said)
        scale = self._scale
        ends = {"start": scale.start, "end": scale.end, "step": scale.step, "format": self._spoken}
        self._showing = True
        for slider in (self._slider, *self._axis_sliders):
            slider.param.update(**ends, value=min(max(slider.value, scale.start), scale.end))
        self._slider.description = self.said.doc
        if self._axes:
            self._more.description = f"{self.said.label}: one for each axis"
        self._showing = False

    def _unfold(self, event: param.parameterized.Event) -> None:
        if event.new and not self._axis_sliders:
            for axis, name in enumerate(self._axes):
                slider = self._make_slider(name)
                slider.value = self._scale.position(self._as_said(self._value)[axis])
                slider.param.watch(lambda moved, axis=axis: self._moved(axis, moved.new), "value")
                self._axis_sliders.append(slider)
                self.parts[name] = slider
            self.name_parts(self._path)
            self.view.extend(self._axis_sliders)
        for slider in self._axis_sliders:
            slider.visible = event.new


class ChoiceField(Field):
    """One of a few words: buttons side by side, or a list if there are many."""

    def __init__(
        self, declaration: param.Parameter, change: Change, labels: dict[str, Any] | None = None
    ) -> None:
        super().__init__(declaration, change)
        self.view = self._widget = pmui.Select(
            label=declaration.label,
            options=labels or list(declaration.objects),
            size="small",
            variant="outlined",
            margin=(8, 0),
            sizing_mode="stretch_width",
            description=declaration.doc,
            tags=[SETTING],
        )
        self._widget.param.watch(lambda event: self._ask(event.new), "value")
        self.parts = {"choice": self._widget}
        self.show(declaration.default)

    def offer(self, labels: dict[str, Any], value: Any) -> None:
        """Set other choices, and show one of them."""
        self._value = value
        self._showing = True
        try:
            self._widget.param.update(options=labels, value=value)
        finally:
            self._showing = False

    def _render(self, value: Any) -> None:
        self._widget.value = value


class SwitchField(Field):
    """On or off."""

    def __init__(self, declaration: param.Parameter, change: Change) -> None:
        super().__init__(declaration, change)
        self.view = self._widget = pmui.Switch(
            label=declaration.label,
            description=declaration.doc,
            size="small",
            margin=(8, 0),
            sizing_mode="stretch_width",
            tags=[SETTING],
        )
        self._widget.param.watch(lambda event: self._ask(event.new), "value")
        self.parts = {"switch": self._widget}
        self.show(declaration.default)

    def _render(self, value: Any) -> None:
        self._widget.value = value


class TextField(Field):
    """A text box: for whole numbers, intervals of time, variances.

    A setting of the filter that follows the sensor until it is given has a lock, which lets it follow again.
    """

    def __init__(self, declaration: param.Parameter, change: Change) -> None:
        super().__init__(declaration, change)
        hint = describe_empty_field(declaration)
        self.view = self._widget = pmui.TextInput(
            label=field_label(declaration),
            placeholder=hint,
            sx=_HINTED if hint else {},
            size="small",
            variant="outlined",
            margin=(8, 0),
            sizing_mode="stretch_width",
            description=declaration.doc,
            tags=[SETTING],
        )
        self._widget.param.watch(self._typed, "value")
        self.parts = {"box": self._widget}
        self._lock: pmui.IconButton | None = None
        if follows_sensor(declaration):
            self._lock = pmui.IconButton(
                size="1.1em", margin=(14, 0, 0, 0), width=26, stylesheets=[TOOLTIP], tags=[SETTING]
            )
            self._lock.on_click(lambda _event: self._ask(None))
            self.view = plain_column(plain_row(self._widget, self._lock))
        self.show(declaration.default)

    def in_words(self, value: Any) -> str:
        """Return a value of the setting as this field shows it."""
        return FOLLOWS if value is None and self._lock is not None else super().in_words(value)

    def complain(self, sentence: str) -> None:
        """Show a sentence below the box."""
        self._widget.param.update(helper_text=sentence, error_state=bool(sentence))

    def _render(self, value: Any) -> None:
        self._widget.value = shown(value)
        if self._lock is not None:
            name = str(self.declaration.label)
            words = f"{name} {FOLLOWS}" if value is None else f"{name}: follow the sensor again"
            self._lock.param.update(icon="lock" if value is None else "lock_open", description=words)

    def _typed(self, event: param.parameterized.Event) -> None:
        if self._showing or event.new == shown(self._value):
            return
        self._ask(parse_field(self.declaration, event.new))


class Scale:
    """The scale of a slider: linear, or logarithmic if the range spans decades, or if that is given."""

    def __init__(self, declaration: param.Parameter, logarithmic: bool | None = None) -> None:
        low, high = declaration.softbounds or declaration.bounds
        spans_decades = low > 0 and high / low >= LOGARITHMIC_FROM
        self.logarithmic = spans_decades if logarithmic is None else logarithmic
        self.start = math.log10(low) if self.logarithmic else float(low)
        self.end = math.log10(high) if self.logarithmic else float(high)
        self.step = 0.01 if self.logarithmic else float(declaration.step or (high - low) / 200)

    def words(self, unit: str) -> str:
        """Return JavaScript for the value at a position, `tick`, with its unit, for who hears the page."""
        value = "10 ** tick" if self.logarithmic else "tick"
        return f"return `${{Number(({value}).toPrecision(3))}} {unit}`.trim()"

    def position(self, value: float) -> float:
        """Return the position of a value; values beyond the slider are at its end."""
        if self.logarithmic:
            value = math.log10(value) if value > 0 else self.start
        return min(max(value, self.start), self.end)

    def value(self, position: float) -> float:
        """Return the rounded value at a position; a position beyond the slider counts as its end."""
        # Ten to the power of a huge integer, which a message may contain, would take forever.
        position = min(max(self.start, position), self.end)
        value = 10**position if self.logarithmic else round(position / self.step) * self.step
        return float(f"{value:.3g}" if self.logarithmic else f"{value:.10g}")


def field(declaration: param.Parameter, change: Change) -> Field:
    """Return the field for a setting."""
    if isinstance(declaration, param.Selector):
        return ChoiceField(declaration, change)
    if isinstance(declaration, Quantity | AxisQuantity):
        return NumberField(declaration, change)
    if isinstance(declaration, param.Boolean):
        return SwitchField(declaration, change)
    return TextField(declaration, change)
