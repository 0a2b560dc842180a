"""Run: the frozen arrays of one run, all settings that made it, and the memory that it needs.

In: the truth, the sensors and the solution of one run, as arrays. Out: a `Run`, of which analysis, datasets
and plots are functions.

Read first: `run` (the arrays), `experiment_settings` (all settings, and their TOML form), `memory`.
"""
