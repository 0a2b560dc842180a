"""Settings panel: all settings as fields, with the order and texts of their declarations."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import panel as pn
import panel_material_ui as pmui
import param

from dashboards.card_chooser import CardChooser
from dashboards.covariance_field import CovarianceField
from dashboards.field_text import FOLLOWS
from dashboards.mission_titles import mission_titles
from dashboards.notice import Notice
from dashboards.other_form import OtherFormField
from dashboards.session import Glide, Session
from dashboards.setting_finder import MARKED, SettingFinder, mark_changed
from dashboards.sigmas import sigma_of
from dashboards.style import HIDDEN_LABEL, TOOLTIP, plain_column, plain_row
from dashboards.titled import Card
from dashboards.widgets import SETTING, ChoiceField, Field, TextField, field
from lab.base.aid_table import AIDS
from lab.base.parameters.setting_error import RefusedValueError, SettingError
from lab.base.parameters.setting_kinds import MatrixOrNone
from lab.experiment.experiment import Experiment
from lab.experiment.log_run import has_effect
from lab.missions import LogMission, missions
from lab.navigation.alignment.rest_alignment import usual_covariance
from lab.navigation.belief import belief
from lab.navigation.filters.blocks import IMU_DENSITIES

SECTIONS = {
    "sensors.gyro": ("Gyros", True),
    "sensors.accelerometer": ("Accelerometers", False),
    "sensors.temperature": ("Temperature", False),
    "sensors.gps": ("GPS receiver", True),
    **{f"sensors.{aid.name}": (aid.title, False) for aid in AIDS},
    "navigator": ("Navigator and filter", True),
    "trajectory": ("Trajectory", False),
}
"""Title of each group of settings, and whether it is initially open."""

RESETS = {
    "Everything": "",
    "All sensors": "sensors.",
    **{title: f"{path}." for path, (title, _) in SECTIONS.items()},
}
"""What can be set to its defaults, and how the paths of its settings begin; everything includes what is
hidden."""

COMMON = frozenset(
    {
        "sensors.gyro.noise_density",
        "sensors.gyro.bias_sigma",
        "sensors.gyro.instability",
        "sensors.accelerometer.noise_density",
        "sensors.accelerometer.bias_sigma",
        "sensors.accelerometer.instability",
        "sensors.temperature.profile",
        "sensors.temperature.start",
        "sensors.temperature.compensation",
        "sensors.gps.position_variance",
        "sensors.gps.velocity_variance",
        "sensors.gps.period",
        "sensors.gps.outages",
        *(f"sensors.{aid.name}.{term}" for aid in AIDS for term in ("fitted", "noise", aid.common)),
        "navigator.model",
        "navigator.states",
        "navigator.correction",
        "navigator.correction_period",
        "navigator.p0_scale",
        "navigator.q_scale",
        "navigator.r_scale",
        "trajectory.imu_rate",
    }
)
"""Settings that are always visible; the others are in an expandable list below."""

OF_NOTEBOOKS = frozenset({"navigator.own_states"})
"""Settings without a field: a visitor of a page cannot declare states, which needs a function."""

OF_A_LOG = (
    "Recorded data: the settings of the sensors tell the filter what to assume. Those without effect are "
    "hidden."
)


class SettingsPanel:
    """The settings of a session in the sidebar.

    Parameters
    ----------
    session
        Session whose settings are shown and changed.
    later
        Called with functions that fill the open groups, one after the other; by default they run at once.
    """

    def __init__(self, session: Session, later: Callable[[Callable[[], None]], None] | None = None) -> None:
        self._session = session
        self._later = later or (lambda fill: fill())
        self._fields: dict[str, Field] = {}
        self._is_log = False
        self._views: list[tuple[pn.viewable.Viewable, list[str]]] = []
        self._meant = {path: session.experiment.derived(path).setting for path in Experiment.OTHER_FORMS}
        self._forms = {setting: path for path, setting in self._meant.items()}
        session.on_idle(self._refresh_forms)
        session.on_library(self._offer_missions)
        self._mission = ChoiceField(
            session.experiment.param["mission"], self._change("mission"), mission_titles(missions())
        )
        self._seed = TextField(session.experiment.param["seed"], self._change("seed"))
        self._fields |= {"mission": self._mission, "seed": self._seed}
        for path, made in self._fields.items():
            made.name_parts(path)
        self._cards = CardChooser(session)
        session.on_settings(self.refresh)  # once the chooser knows the card
        self._found: dict[str, Field] = {}
        self._finder = SettingFinder(
            self._names(), self._changed, self._rows, self._hide, (self._reset_menu(), self._sigma_switch())
        )
        self._groups = plain_column(*self._sections())
        self._note = Notice(margin=(4, 0))
        self.view = plain_column(
            self._mission.view,
            self._note.view,
            self._seed_row(),
            self._cards.view,
            self._finder.view,
            self._groups,
            margin=(6, 14, 4, 14),
        )
        self.refresh()

    def refresh(self) -> None:
        """Show the current settings; fields that show theirs already are left alone."""
        for fields in (self._fields, self._found):
            for path, made in fields.items():
                value = self._session.experiment.get(path)
                made.complain("")
                if value != made.value:
                    made.show(value)
                self._mark(path, made)
        self._finder.count()
        self._suit()

    def views(self, paths: Iterable[str]) -> list[pn.viewable.Viewable]:
        """Return the fields of some settings, as far as they are there."""
        return [
            fields[path].view for path in paths for fields in (self._fields, self._found) if path in fields
        ]

    def repeat(self, path: str, part: str, value: Any) -> None:
        """Change a setting as a part of its field did on a page that the server did not hear any more."""
        made = self._fields.get(path) or (self._field(path, {}) if path in self._finder.names else None)
        if made is None:
            return
        if part not in made.parts:
            made.unfold()
        if part in made.parts:
            with contextlib.suppress(ValueError, TypeError):  # no value of this part
                made.parts[part].value = value
            self.refresh()

    def _names(self) -> dict[str, tuple[str, ...]]:
        """Return what each setting with a field can be found by."""
        experiment = self._session.experiment

        def named(path: str, owner: str, declaration: param.Parameter) -> tuple[str, ...]:
            sigma = sigma_of(declaration)
            labels = (sigma.label, declaration.label) if sigma else (declaration.label,)
            shown_first = labels if self._session.shows_sigmas else labels[::-1]
            return SECTIONS[owner][0], *shown_first, path

        return {
            path: named(path, owner, owner_settings.param.objects("existing")[name])
            for path, owner_settings, name in experiment.leaves()
            if (owner := path.rpartition(".")[0]) in SECTIONS and path not in OF_NOTEBOOKS
        }

    def _changed(self) -> list[str]:
        """Return the settings that differ from those of the card in use, or from the first ones."""
        base, experiment = self._cards.base, self._session.experiment
        return [
            path
            for path in self._finder.names
            if experiment.get(path) != base.get(path) and (not self._is_log or has_effect(path))
        ]

    def _mark(self, path: str, made: Field) -> None:
        """Mark the field of a changed setting, and say what it was."""
        if path not in self._finder.names:
            return
        before, words = self._cards.base.get(path), ""
        if before != self._session.experiment.get(path):
            said = made.in_words(before) or "empty"
            words = "followed the sensor" if said == FOLLOWS else f"was {said}"
        mark_changed(made.view, words)

    def _rows(self, paths: Iterable[str]) -> list[pn.viewable.Viewable]:
        """Return a field for each of some settings, with the name of its group before the first of each."""
        self._found, rows, group = {}, list[pn.viewable.Viewable](), ""
        for path in paths:
            owner = path.rpartition(".")[0]
            if owner != group:
                group = owner
                rows.append(pn.pane.HTML(f"<small>{SECTIONS[owner][0]}</small>", margin=(8, 0, 0, 0)))
            made = self._field(path, self._found)
            self._found[path] = made
            rows.append(made.view)
        return rows

    def _sigma_switch(self) -> pn.viewable.Viewable:
        """Return the switch between σ and variances."""
        switch = pmui.RadioButtonGroup(
            label="Noise as σ or as variance",
            options={"σ": True, "σ²": False},
            value=self._session.shows_sigmas,
            size="small",
            margin=(6, 0, 2, 4),
            sx={"& button": {"padding": "3px 14px"}},
            stylesheets=[HIDDEN_LABEL],
        )

        def turn(event: param.parameterized.Event) -> None:
            self._session.shows_sigmas = bool(event.new)
            self._finder.rename(self._names())
            for fields in (self._fields, self._found):
                for path, made in fields.items():
                    made.speak(self._session.shows_sigmas)
                    self._mark(path, made)

        switch.param.watch(turn, "value")
        words = pn.pane.HTML("<small>Noise as</small>", margin=(12, 0, 0, 0))
        return pn.Row(words, switch, margin=0)

    def _hide(self, sought: bool) -> None:
        """Hide the groups while settings are sought; their fields show the changes made meanwhile."""
        self._groups.visible = not sought

    def _offer_missions(self) -> None:
        self._mission.offer(mission_titles(missions()), self._session.experiment.mission)

    def _suit(self) -> None:
        """Show only settings with an effect: for a sensor log, nothing is simulated."""
        is_log = isinstance(missions().get(self._session.experiment.mission), LogMission)
        if is_log == self._is_log:
            return
        self._is_log = is_log
        self._note.say(OF_A_LOG if self._is_log else "", "info")
        for view, paths in self._views:
            view.visible = not self._is_log or any(map(has_effect, paths))

    def _suited(self, view: pn.viewable.Viewable, paths: list[str]) -> pn.viewable.Viewable:
        """Return a view that is visible only if one of its settings has an effect."""
        self._views.append((view, paths))
        view.visible = not self._is_log or any(map(has_effect, paths))
        return view

    def _change(self, path: str, fields: dict[str, Field] | None = None) -> Any:
        fields = self._fields if fields is None else fields

        def change(value: Any) -> None:
            motion = fields[path].motion if path in fields else None
            try:
                self._session.set(path, value, Glide(path, motion) if motion else None)
            except RefusedValueError:  # the field says why
                raise
            except SettingError as error:
                self._session.problem = str(error)
                raise
            if path == "mission":
                self._suit()
            if path.startswith("sensors."):
                self._cards.refresh()
            meant = self._meant.get(path, path)
            self._finder.used(meant)
            self._follow(meant, value if meant == path else self._session.experiment.get(meant))

        return change

    def _follow(self, path: str, value: Any) -> None:
        """Mark the fields of a setting that was changed, and show its value in those that show another."""
        for fields in (self._fields, self._found):
            if path in fields:
                if fields[path].motion is None and fields[path].value != value:
                    fields[path].show(self._session.experiment.get(path))
                self._mark(path, fields[path])

    def _seed_row(self) -> pn.viewable.Viewable:
        another = pmui.IconButton(
            icon="casino",
            description="Another seed",
            size="1.3em",
            margin=(10, 0, 0, 2),
            align="center",
            stylesheets=[TOOLTIP],
            tags=[SETTING],
        )
        another.on_click(lambda _event: self._next_seed())
        row = plain_row(self._seed.view, another)
        return self._suited(row, ["seed"])

    def _next_seed(self) -> None:
        self._session.change("seed", (int(self._session.experiment.seed) + 1) % 2**32)
        self._seed.show(self._session.experiment.seed)

    def _reset_menu(self) -> pn.viewable.Viewable:
        reset = pmui.MenuButton(
            label="Reset",
            items=[{"label": title} for title in RESETS],
            size="small",
            variant="outlined",
            margin=(6, 0, 2, 0),
            description="Reset settings to what they were at first. The arrow at the top brings them back.",
            # As Changed beside it.
            sx={"& button, &": {"padding": "3px 10px !important", "fontSize": "14px"}},
            stylesheets=[TOOLTIP],
            tags=[SETTING],
        )
        reset.on_click(self._reset)
        return reset

    def _reset(self, chosen: Any) -> None:
        """Set a group of settings, or all but the mission, to their defaults."""
        title = str(chosen["label"])
        experiment = Experiment(mission=self._session.experiment.mission)
        if RESETS[title]:
            plain, experiment = experiment, self._session.experiment.copy()
            for path, owner, name in plain.leaves():
                if path.startswith(RESETS[title]) and may_change(experiment, path):
                    experiment.set(path, getattr(owner, name))
        self._session.accept(experiment, called=f"Reset: {title}")

    def _sections(self) -> list[pn.viewable.Viewable]:
        return [self._section(path, title, is_open) for path, (title, is_open) in SECTIONS.items()]

    def _section(self, group: str, title: str, is_open: bool) -> pn.viewable.Viewable:
        paths = [path for path, _, _ in self._session.experiment.leaves() if path.startswith(f"{group}.")]
        common = [path for path in paths if path in COMMON]
        others = [path for path in paths if path not in COMMON | OF_NOTEBOOKS]
        card = Card(
            title=title,
            title_variant="subtitle2",
            collapsed=not is_open,
            margin=(4, 0),
            sizing_mode="stretch_width",
            variant="outlined",
        )

        def fill(*_events: param.parameterized.Event) -> None:
            if not card.collapsed and not card.objects:
                more = [self._more(others)] if others else []
                card[:] = [plain_column(*map(self._make, common), *more, margin=(0, 4, 8, 4))]

        card.param.watch(fill, "collapsed")
        if is_open:
            self._later(fill)
        return self._suited(card, paths)

    def _more(self, paths: list[str]) -> pn.viewable.Viewable:
        toggle = pmui.Toggle(
            label="More",
            icon="expand_more",
            size="small",
            variant="text",
            color="default",
            margin=(4, 0),
            sx={"& button, &": {"border": 0, "padding": "2px 6px"}},
        )

        def unfold(event: param.parameterized.Event) -> None:
            if len(column) == 1:
                column.append(plain_column(*(self._make(path) for path in paths)))
            column.objects[1].visible = event.new
            toggle.param.update(
                label="Less" if event.new else "More", icon="expand_less" if event.new else "expand_more"
            )

        toggle.param.watch(unfold, "value")
        column = plain_column(toggle)
        return self._suited(column, paths)

    def _field(self, path: str, fields: dict[str, Field]) -> Field:
        """Return a new field of a setting, which is to be among some others."""
        owner, _, name = path.rpartition(".")
        declaration = self._session.experiment.get(owner).param[name]
        change = self._change(path, fields)
        made: Field
        if isinstance(declaration, MatrixOrNone):
            made = CovarianceField(
                declaration, change, lambda: matched_variances(self._session.experiment, name)
            )
            self._session.param.watch(lambda _event: made.refresh(), "result")
        else:
            made = field(declaration, change)
        made.show(self._session.experiment.get(path))
        made.speak(self._session.shows_sigmas)
        made.name_parts(path)
        made.view.stylesheets = [*made.view.stylesheets, MARKED]
        self._mark(path, made)
        return made

    def _make(self, path: str) -> pn.viewable.Viewable:
        made = self._fields[path] = self._field(path, self._fields)
        if path in self._forms:
            form = self._make_form(self._forms[path])
            both = plain_column(made.view, form)
            return self._suited(both, [path])
        return self._suited(made.view, [path])

    def _make_form(self, path: str) -> pn.viewable.Viewable:
        """Return the box for another form of a setting."""
        made = OtherFormField(self._session.experiment.derived(path).declaration, self._change(path))
        made.show(self._session.experiment.get(path))
        made.speak(self._session.shows_sigmas)
        made.name_parts(path)
        self._fields[path] = made
        return made.view

    def _refresh_forms(self) -> None:
        """Show the same value in settings and their other forms, whichever was changed."""
        for path in (*self._forms, *self._forms.values()):
            if path in self._fields:
                self._fields[path].show(self._session.experiment.get(path))
        self._finder.count()


def may_change(experiment: Experiment, path: str) -> bool:
    """Return whether a person may change a setting, which a homework may fix."""
    try:
        experiment.check_change(path)
    except SettingError:
        return False
    return True


def check_variant(experiment: Experiment, variant: Experiment) -> None:
    """Raise `SettingError` if a person may not change an experiment as a variant differs from it."""
    for path, owner, name in variant.leaves():
        if getattr(owner, name) != experiment.get(path):
            experiment.check_change(path)


def matched_variances(experiment: Experiment, name: str) -> list[float]:
    """Return the variances, in SI units, that the filter uses for p0, q or r while none are given.

    For p0 after an alignment, a level vehicle is assumed, because the first attitude is unknown here.
    """
    plain = experiment.navigator.copy()
    plain.set("own_states", "")
    for setting in ("p0", "q", "r"):
        plain.set(setting, None)
        plain.set(f"{setting}_scale", 1.0)
    matched = belief(experiment.sensors, plain, usual_covariance(experiment.sensors, plain))
    states, densities = plain.states, matched.noise[:IMU_DENSITIES]  # without further ones
    covariance = {"p0": matched.P0[:states, :states], "q": np.diag(densities), "r": matched.R}[name]
    return [float(variance) for variance in np.diag(covariance)]
