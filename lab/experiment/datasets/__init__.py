"""Datasets of a run: its arrays with names, units and coordinates, for a person to plot, slice and save.

Each is made by a function of the `Run`; the attribute of the same name of `Result` documents it.
"""
