"""Datasets of a result: its arrays with names, units and coordinates, for a person to plot, slice and save.

Each is made by a function of the `Result`, whose attribute of the same name documents it.
"""
