"""Sheets: a csv becomes a flight or a sensor log: what its columns are, their units, axes and times."""
