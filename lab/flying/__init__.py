"""Flying: the pilot flies a plan in JSBSim, or the plan is carried out as waypoints or motion commands.

In: a plan (`read_plan`). Out: a `Flight`, which is a recording and the reason for an early end.
"""
