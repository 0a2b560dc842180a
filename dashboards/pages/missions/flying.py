"""Flying: the part of the page to edit a flight plan, fly it in JSBSim, and get a mission."""

from __future__ import annotations

import importlib.util
import io
import threading
from collections.abc import Mapping
from typing import Any

import panel_material_ui as pmui

from dashboards.computing import SupersededError
from dashboards.mission_titles import mission_titles
from dashboards.notice import Notice
from dashboards.pages.missions.entry_fields import fields_row, layout_width
from dashboards.pages.missions.job import Job
from dashboards.pages.missions.naming import Naming
from dashboards.pages.missions.plan_editor import PlanEditor
from dashboards.session import Session
from dashboards.style import whole_column
from lab.base.parameters.toml_file import toml_text
from lab.base.progress import Progress
from lab.missions import FlightPlan, Mission, MissionError, add_mission, fly, missions

MISSING = "Flying needs JSBSim, which is not installed on this server: pip install 'ins-lab[fly]'"
_SMALL: dict[str, Any] = {"size": "small", "variant": "outlined"}


class Flying:
    """Edits a flight plan and flies it.

    Parameters
    ----------
    session
        Session that then runs the mission.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._cancelled = threading.Event()
        self._closed = False
        self._job = Job(self._cancelled.set)
        plans = _plans()
        self._load = pmui.Select(
            label="Start from",
            options=mission_titles(plans),
            **_SMALL,
            margin=(6, 4),
            **layout_width(230),
        )
        load = pmui.Button(label="Use this plan", **_SMALL, margin=(10, 4))
        load.on_click(lambda _event: self._accept(self._load.value))
        save = pmui.FileDownload(
            callback=self._toml, filename="flight.toml", label="Save plan", **_SMALL, margin=(10, 4)
        )
        self._state = Notice()
        self._naming = Naming("flight", "A flight")
        self._fly = pmui.Button(label="Fly this plan", icon="flight_takeoff", color="primary", margin=(10, 4))
        self._fly.on_click(lambda _event: self._start())
        self._editor = PlanEditor(self._check)
        self.view = whole_column(
            fields_row(self._load, load, save),
            self._editor.view,
            self._state.view,
            fields_row(self._naming.view, self._fly),
            self._job.view,
        )
        self._accept(next(iter(plans)))
        session.on_library(self._offer)

    def refresh(self) -> None:
        """Do nothing: this part does not depend on the missions."""

    def close(self) -> None:
        """End a flight in progress; it is not kept."""
        self._closed = True
        self._cancelled.set()
        self._job.close()

    def _offer(self) -> None:
        self._load.options = mission_titles(_plans())

    def _accept(self, name: str) -> None:
        found = _plans().get(name)
        if found is not None:
            self._editor.load(found.flight or {})

    def _check(self) -> None:
        """Show what is not accepted."""
        problem = "" if importlib.util.find_spec("jsbsim") else MISSING
        try:
            self._editor.plan()
        except MissionError as error:
            problem = problem or str(error)
        self._state.say(problem, "warning")
        self._fly.disabled = bool(problem)

    def _toml(self) -> io.BytesIO:
        return io.BytesIO(toml_text({"flight": self._editor.read()}).encode())

    def _start(self) -> None:
        if self._job.busy:
            return
        try:
            plan, name, title = self._editor.plan(), self._naming.checked_name(), self._naming.title
        except MissionError as error:
            self._job.say(str(error))
            return
        self._cancelled.clear()
        self._job.start(
            "Flying", lambda progress: self._fly_plan(plan, name, title, progress), self._show_mission
        )

    def _fly_plan(self, plan: FlightPlan, name: str, title: str, progress: Progress) -> Mission:
        flight = fly(
            plan, progress=lambda fraction: progress("Flying", fraction), cancelled=self._cancelled.is_set
        )
        if self._closed:
            raise SupersededError
        return add_mission(
            flight.recording,
            name,
            title=title,
            origin="Flown by the lab's own pilot in JSBSim",
            aircraft=plan.flown_with.title,
            tags=("flown",),
            flight=plan.to_dict(),
            ending=flight.ending,
        )

    def _show_mission(self, flown: Mission) -> None:
        words = f"{flown.name} was flown for {flown.duration:.0f} s and opened."
        if flown.ending:
            words += f" It ended early: {flown.ending}. The flight up to that point is kept."
        self._job.say(words, "warning" if flown.ending else "success")
        self._session.library_changed(flown.name)
        self._naming.suggest("flight", "A flight")
        if not flown.ending:
            self._session.go("", None)


def _plans() -> Mapping[str, Mission]:
    """Return the missions that have a plan of manoeuvres."""
    return {name: one for name, one in missions().items() if "manoeuvres" in (one.flight or {})}
