"""Sweep choice: which settings a sweep varies, over which values and how many seeds, and what it shows."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import panel as pn
import panel_material_ui as pmui

from dashboards.seen_names import seen_name
from dashboards.settings_panel import SECTIONS, may_change
from dashboards.sigmas import sigma_at, to_variance
from dashboards.style import whole_column
from lab.base.parameters.setting_error import SettingError
from lab.base.parameters.setting_kinds import AxisQuantity, Quantity
from lab.experiment.experiment import Experiment
from lab.experiment.log_run import has_effect
from lab.experiment.sweep import Sweep
from lab.run.experiment_settings import ExperimentSettings
from lab.views.sweep_figure import METRICS

MOST_RUNS = 2000
"""Most runs of a sweep: at ten runs a second, three minutes."""
MOST_STEPS = 40
"""Most values of a setting: more than a figure of a page shows apart."""
FIRST = "navigator.q_scale"
NOTHING = "No second setting"
AXIS = ("setting", "start", "end", "steps", "logarithmic")
"""The widgets of an axis; the setting comes first, because it suggests the others."""
DECADES = 10.0
"""Ratio of the ends of a logarithmic sweep to the present value."""


class Plan(NamedTuple):
    """What a sweep runs.

    Attributes
    ----------
    values : dict of str to tuple
        Values of each setting, by its path.
    seeds : int
        Number of runs with each combination.
    """

    values: dict[str, tuple[float, ...]]
    seeds: int


class Axis:
    """A setting to sweep, and its values: ends, number, and whether they are even in their logarithms."""

    def __init__(self, label: str, steps: int) -> None:
        self.path = ""
        self.sigmas = False
        self.setting = pmui.Select(
            label=label, options={}, searchable=True, size="small", width=300, margin=(6, 6)
        )
        self.start, self.end = (
            pmui.FloatInput(label=words, value=1.0, size="small", width=140, margin=(6, 6))
            for words in ("From", "To")
        )
        self.steps = pmui.IntInput(
            label="Values", value=steps, start=2, end=MOST_STEPS, size="small", width=90, margin=(6, 6)
        )
        self.logarithmic = pmui.Switch(label="Logarithmic", value=True, size="small", margin=(14, 6))
        self.view = pn.FlexBox(
            self.setting, self.start, self.end, self.steps, self.logarithmic, margin=0, align_items="center"
        )

    def take(self, experiment: Experiment) -> None:
        """Suggest values of the chosen setting around its present one."""
        self.path = (
            str(self.setting.value or "") if self.setting.value in self.setting.options.values() else ""
        )
        for widget in (self.start, self.end, self.steps, self.logarithmic):
            widget.visible = bool(self.path)
        if not self.path:
            return
        sigma = self._sigma
        declaration = sigma or experiment.declaration(self.path)
        low, high = declaration.softbounds or declaration.bounds
        least, most = declaration.bounds
        value = largest(experiment.get(self.path))
        if sigma:
            value = math.sqrt(value)
        is_log = value > 0 and least is not None and least >= 0
        if is_log:
            low, high = max(least, value / DECADES), min(most, value * DECADES)
        self.start.value, self.end.value = float(f"{low:.4g}"), float(f"{high:.4g}")
        self.logarithmic.value = is_log

    @property
    def _sigma(self) -> AxisQuantity | None:
        """The declaration of σ, if the ends are those of σ, and the setting is a variance."""
        return sigma_at(self.path) if self.sigmas and self.path else None

    def speak(self, sigmas: bool) -> None:
        """Show the ends of a variance as those of σ, or as they are."""
        before, self.sigmas = self._sigma, sigmas
        if bool(before) == bool(self._sigma):
            return
        for widget in (self.start, self.end):
            if widget.value is not None and widget.value >= 0:
                root = float(f"{math.sqrt(widget.value):.6g}")
                widget.value = to_variance(widget.value) if before else root

    def values(self) -> tuple[float, ...]:
        """Return the values of the setting.

        Raises
        ------
        SettingError
            If there are none.
        """
        name = seen_name(self.path, self.sigmas)
        start, end, steps = self.start.value, self.end.value, self.steps.value
        if start is None or end is None or not np.isfinite([start, end]).all() or start == end:
            raise SettingError(f"{name}: the sweep needs two different numbers, from and to.")
        if steps is None or not 2 <= steps <= MOST_STEPS:
            raise SettingError(f"{name}: the number of values must be between 2 and {MOST_STEPS}.")
        if self._sigma and min(start, end) < 0:
            raise SettingError(f"{name}: values must be above zero.")
        if self.logarithmic.value and min(start, end) <= 0:
            raise SettingError(f"{name}: logarithmic values must be above zero.")
        spaced = np.geomspace if self.logarithmic.value else np.linspace
        # The ends as typed, and what is between with digits that a person reads.
        between = [float(f"{value:.6g}") for value in spaced(start, end, steps)[1:-1]]
        values = tuple(dict.fromkeys((float(start), *between, float(end))))
        return to_variance(values) if self._sigma else values


class SweepChoice:
    """The widgets of a sweep.

    Parameters
    ----------
    run
        Called when the button is pressed.
    draw
        Called when another figure of merit is chosen.
    """

    def __init__(self, run: Callable[[], None], draw: Callable[[], None]) -> None:
        self._axes = (Axis("Setting", 9), Axis("Second setting", 7))
        self._experiment = Experiment()
        for axis in self._axes:
            axis.setting.param.watch(lambda _event, axis=axis: axis.take(self._experiment), "value")
        self._seeds = pmui.IntInput(
            label="Seeds of each", value=5, start=1, end=200, size="small", width=120, margin=(6, 6)
        )
        self._metric = pmui.Select(
            label="Shown", options=list(METRICS), value=METRICS[0], size="small", width=300, margin=(6, 6)
        )
        self._metric.param.watch(lambda _event: draw(), "value")
        button = pmui.Button(label="Run the sweep", size="small", margin=(10, 6))
        button.on_click(lambda _event: run())
        row = pn.FlexBox(self._seeds, self._metric, button, margin=0, align_items="center")
        self.view = whole_column(*(axis.view for axis in self._axes), row, margin=(0, 10), visible=False)

    @property
    def metric(self) -> str:
        """The figure of merit that is shown; a browser may ask for any."""
        return self._metric.value if self._metric.value in METRICS else METRICS[0]

    def suit(self, experiment: Experiment, is_log: bool, sigmas: bool) -> None:
        """Offer the settings that may be swept in an experiment; variances as σ, if fields show them so."""
        self._experiment = experiment
        for axis in self._axes:
            axis.speak(sigmas)
        offered = {seen_name(path, sigmas): path for path in sweepable(experiment, is_log)}
        first, second = self._axes
        self._seeds.visible = not is_log
        for axis, options in ((first, offered), (second, {NOTHING: ""} | offered)):
            if axis.setting.options == options:
                continue
            usual = FIRST if axis is first and FIRST in options.values() else next(iter(options.values()), "")
            kept = axis.setting.value if axis.setting.value in options.values() else usual
            axis.setting.param.update(options=options, value=kept)
            if axis.path != kept or not kept:
                axis.take(experiment)

    def kept(self) -> dict[str, Any]:
        """Return what is chosen, as plain data."""
        axes = [[getattr(axis, name).value for name in AXIS] for axis in self._axes]
        return {"axes": axes, "seeds": self._seeds.value, "metric": self.metric}

    def take_back(self, kept: dict[str, Any]) -> bool:
        """Choose what was kept, which may be anything; return whether it was a choice."""
        try:
            for axis, values in zip(self._axes, kept["axes"], strict=True):
                if values[0] not in axis.setting.options.values():
                    return False
                for name, value in zip(AXIS, values, strict=True):
                    getattr(axis, name).value = value
            self._seeds.value, self._metric.value = kept["seeds"], kept["metric"]
        except (KeyError, TypeError, ValueError, IndexError):
            return False
        return True

    def plan(self) -> Plan:
        """Return what to run.

        Raises
        ------
        SettingError
            If the choices make no sweep.
        """
        for axis in self._axes:
            if axis.path:
                self._experiment.check_change(axis.path)
        values = {axis.path: axis.values() for axis in self._axes if axis.path}
        seeds = int(self._seeds.value or 0) if self._seeds.visible else 1
        if not values:
            raise SettingError("There is no setting here that a sweep may change.")
        if self._axes[0].path == self._axes[1].path:
            raise SettingError("The sweep needs two different settings, or one.")
        if seeds < 1:
            raise SettingError("The number of seeds must be 1 or more.")
        runs = seeds * int(np.prod([len(one) for one in values.values()]))
        if runs > MOST_RUNS:
            raise SettingError(f"This sweep has {runs:,} runs; accepted are up to {MOST_RUNS:,}.")
        return Plan(values, seeds)


def sweepable(experiment: Experiment, is_log: bool) -> list[str]:
    """Return the paths of the numeric settings that a person may change, and that have an effect."""
    found = []
    for path, owner, name in experiment.leaves():
        group = path.rpartition(".")[0]
        numeric = isinstance(owner.param[name], AxisQuantity | Quantity) and group in SECTIONS
        fitted = getattr(experiment.get(group), "fitted", True) if numeric else False
        if fitted and may_change(experiment, path) and (not is_log or has_effect(path)):
            found.append(path)
    return found


def largest(value: object) -> float:
    """Return the largest size of a number, or of the numbers for each axis."""
    return float(np.max(np.abs(np.asarray(value, dtype=float))))


def as_fields(sweep: Sweep, sigmas: bool) -> Sweep:
    """Return a sweep whose settings have the names of their fields, and σ where these show it."""
    data = sweep.dataset.copy()
    for dim in sweep.dims:
        path = data[dim].attrs["setting"]
        sigma = sigma_at(path) if sigmas else None
        about = {**data[dim].attrs, "long_name": seen_name(path, sigmas)}
        if sigma:
            data = data.assign_coords({dim: np.sqrt(data[dim].values)})
            about["units"] = sigma.unit
        data[dim].attrs.update(about)
    return replace(sweep, dataset=data)


def present(experiment: ExperimentSettings, paths: Iterable[str], sigmas: bool) -> dict[str, float]:
    """Return the value of each setting that is the same for all axes; σ where the field shows it."""
    now = {path: np.unique(np.asarray(experiment.get(path), dtype=float)) for path in paths}
    alike = {path: float(one[0]) for path, one in now.items() if one.size == 1}
    return {path: math.sqrt(one) if sigmas and sigma_at(path) else one for path, one in alike.items()}
