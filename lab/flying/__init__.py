"""Flying: a plan is flown by the pilot in JSBSim, or carried out as waypoints or motion commands.

In: a plan (`read_plan`). Out: a `Flight`, which is a recording and the reason for an early end.
"""
