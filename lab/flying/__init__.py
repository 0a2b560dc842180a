"""Flying: new flights. The pilot flies a plan in JSBSim, or the plan is carried out as waypoints or commands.

In: a plan (`plan_kinds.read_plan`). Out: a `Flight`: a `Recording`, and the reason for an early end.

Read first: `flight` (from a plan to a flight), `pilot` (how an aircraft is flown), `waypoints` (a smooth path
through points).
"""
