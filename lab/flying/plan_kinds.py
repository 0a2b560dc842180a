"""Plan kinds: the three kinds of flight plans, distinguished by what a plan lists.

``manoeuvres`` are flown in JSBSim (`FlightPlan`), ``waypoints`` are passed one after the other
(`WaypointPlan`), ``commands`` are followed (`MotionPlan`); the latter two need no simulator.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from lab.base.files.mission_error import MissionError
from lab.flying.flight_plan import FlightPlan

if TYPE_CHECKING:
    from lab.flying.motion_commands import MotionPlan
    from lab.flying.waypoints import WaypointPlan

    Plan = FlightPlan | WaypointPlan | MotionPlan

KINDS = ("manoeuvres", "waypoints", "commands")
"""The keys of lists, of which a plan has one."""


def read_plan(values: Mapping[str, Any], where: str = "flight") -> Plan:
    """Return the plan in a mapping, such as the ``[flight]`` table of a mission's TOML file.

    Raises
    ------
    MissionError
        If a key is unknown or missing, or a value is not accepted.
    """
    listed = [kind for kind in KINDS if kind in values]
    if len(listed) > 1:
        raise MissionError(f"{where}: has {' and '.join(listed)}; accepted is one of {', '.join(KINDS)}")
    if listed == ["waypoints"]:
        from lab.flying.waypoints import WaypointPlan  # noqa: PLC0415 - SciPy, for those who need it

        return WaypointPlan.from_dict(values, where)
    if listed == ["commands"]:
        from lab.flying.motion_commands import MotionPlan  # noqa: PLC0415 - SciPy, for those who need it

        return MotionPlan.from_dict(values, where)
    return FlightPlan.from_dict(values, where)
