"""Plan editor: a flight plan as fields: aircraft, start, air and manoeuvres."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import panel as pn
import panel_material_ui as pmui
import param

from dashboards.pages.missions.entry_fields import EntryFields, fields_row, layout_width
from dashboards.pages.missions.part_list import PartList
from dashboards.style import plain_column, whole_column
from dashboards.titled import Card
from lab.flying import airports
from lab.flying.aircraft import AIRCRAFT
from lab.flying.flight_plan import AirStart, Runway
from lab.flying.manoeuvres import MANOEUVRES
from lab.flying.plan_table import entries
from lab.flying.weather import Air, Gust
from lab.missions import FlightPlan

STARTS: dict[str, type] = {"runway": Runway, "air_start": AirStart}
_SELECT: dict[str, Any] = {"size": "small", "margin": (6, 4), **layout_width(220)}


class PlanEditor:
    """A flight plan as fields.

    Parameters
    ----------
    changed
        Called after every change of the plan.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        self._changed = changed
        self._loading = False
        self._aircraft = pmui.Select(
            label="Aircraft", options={one.title: name for name, one in AIRCRAFT.items()}, **_SELECT
        )
        self._start = pmui.Select(
            label="Start", options={"On a runway": "runway", "In the air": "air_start"}, **_SELECT
        )
        names = airports.airport_names()
        self._runway = pmui.Select(
            label="Runway of",
            options={"choose …": ""}
            | {f"{names[name.split()[0]]}: {name}": name for name in airports.runways()},
            **_SELECT,
        )
        self._runway.param.watch(self._placed, "value")
        for choice in (self._aircraft, self._start):
            choice.param.watch(lambda _event: self._chosen(), "value")
        self._manoeuvres = PartList(MANOEUVRES, "manoeuvre", self._told)
        self._gusts = PartList({"gust": Gust}, "gust", self._told)
        self._general, self._where, self._air = (plain_column() for _ in range(3))
        for fields in (self._general, self._where):
            fields.stylesheets = [":host { flex: 1 1 310px !important; }"]
        self.view = whole_column(
            _card(
                "Flight",
                fields_row(self._aircraft, self._start, self._general),
                fields_row(self._runway, self._where),
            ),
            _card("Manoeuvres", self._manoeuvres.view),
            _card("Air", self._air, self._gusts.view, collapsed=True),
        )

    def load(self, values: Mapping[str, Any]) -> None:
        """Show a plan in the form of a mission's ``[flight]`` table; without a plan there are no fields."""
        if isinstance(values.get("runway"), str):
            values = {**values, "runway": airports.runway(values["runway"])}
        self._loading = True
        try:
            self._aircraft.value = values.get("aircraft", "c172p")
            self._start.value = "air_start" if "air_start" in values else "runway"
            self._fill(values)
        finally:
            self._loading = False
        self._changed()

    def read(self) -> dict[str, Any]:
        """Return the current plan as plain data, valid or not."""
        air = self._air_fields.read()
        gusts = [values for _, values in self._gusts.read()]
        return {
            "aircraft": self._aircraft.value,
            **self._general_fields.read(),
            self._start.value: self._where_fields.read(),
            "air": air | ({"gusts": gusts} if gusts else {}),
            "manoeuvres": [{"do": word} | values for word, values in self._manoeuvres.read()],
        }

    def plan(self) -> FlightPlan:
        """Return the plan.

        Raises
        ------
        MissionError
            If the plan is not accepted.
        """
        return FlightPlan.from_dict(self.read(), "plan")

    def _fill(self, values: Mapping[str, Any]) -> None:
        limits = AIRCRAFT[self._aircraft.value].limits
        start, air = self._start.value, values.get("air", {})
        in_the_air = limits if start == "air_start" else None
        self._general_fields = EntryFields(FlightPlan, values, self._told, skip=("aircraft",))
        self._where_fields = EntryFields(STARTS[start], values.get(start, {}), self._told, in_the_air)
        self._air_fields = EntryFields(Air, air, self._told)
        self._runway.visible = start == "runway"
        self._general[:], self._where[:] = [self._general_fields.view], [self._where_fields.view]
        self._air[:] = [self._air_fields.view]
        self._gusts.load([("gust", gust) for gust in air.get("gusts", [])])
        tables = [(entry["do"], entry) for entry in values.get("manoeuvres", [])]
        # A take-off ends low: the heights of the aircraft are those that it climbs to.
        self._manoeuvres.load(tables, limits)

    def _chosen(self) -> None:
        """Show the fields for another aircraft or kind of start; the place of the start stays."""
        if self._loading:
            return
        values = self.read()
        start = self._start.value
        accepted = entries(STARTS[start])
        values[start] = {name: value for name, value in values[start].items() if name in accepted}
        self.load(values)

    def _placed(self, event: param.parameterized.Event) -> None:
        """Put the start on a runway, which can be changed afterwards."""
        if event.new:
            self._where_fields.write(airports.runway(event.new))
            self._runway.value = ""

    def _told(self) -> None:
        if not self._loading:
            self._changed()


def _card(title: str, *content: pn.viewable.Viewable, collapsed: bool = False) -> pn.viewable.Viewable:
    return Card(
        *content,
        title=title,
        title_variant="subtitle2",
        collapsed=collapsed,
        variant="outlined",
        margin=(6, 2),
        sizing_mode="stretch_width",
    )
