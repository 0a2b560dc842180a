"""Sheets: a csv of unknown origin becomes a sensor log: what its columns are, their units, axes and times."""
